"""Contact with finite sliding: far slides, balances, closest points. Patch tests: test_sliding."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Explicit, LinearPenalty, Static, solve_explicit, solve_static
from fem.contact.cuts import closest_point
from fem.contact.normals import ContactNormals
from fem.contact.search import closest_points
from fem.contact.surfaces import ContactError
from fem.element.functions import bilinear
from fem.explicit.body import world_vectors
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.start import prepare
from fem.explicit.step import step
from geometry import Assembly
from geometry.block import box_block
from geometry.loads import LoadCase, named_load
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import CONCRETE, deformable_assembly, in_contact
from tests.support.pairs import stated


def sliding_block(speed):
    """A brick on a rigid floor with facets of 10 mm, pressed on it by gravity, moving along x."""
    sink = 2.4e-9 * 9810.0 * 10.0 / 100.0
    assembly = Assembly(
        name="a brick on a floor",
        shapes=(
            box_block((20.0, 20.0, 10.0), (3, 3, 1), contact_faces=("z-",)),
            box_block((100.0, 40.0, 10.0), (10, 4, 1), contact_faces=("z+",)),
        ),
        shape_of=np.array([0, 1]),
        rotations=np.tile(np.eye(3), (2, 1, 1)),
        translations=np.array([[5.0, 7.0, 10.0 - sink], [0.0, 0.0, 0.0]]),
        layer=np.array([1, 0]),
        fixed=np.array([False, True]),
        unmatched_allowed=True,
    )
    stated = deformable_assembly(
        assembly,
        LoadCase(assembly, "none", (), assembly.fixed),
        CONCRETE,
        law=LinearPenalty(100.0),
        gravity=np.array([0.0, 0.0, -9810.0]),
    )
    model = timed_system(in_contact(stated, finite_sliding=True), ramp_time=0.0, end_time=1.0)
    velocity = np.zeros((1, model.bodies[0].n_nodes, 3))
    velocity[:, :, 0] = speed
    return model, (velocity,)


def test_a_block_slides_over_many_facets():
    """Without friction on a flat floor it keeps its speed: normals are exactly vertical.

    What is left is rounding: eps of the speed in each of 1e4 steps, and eps K u on a slide of
    20 mm: 1e-8. The search runs only when the skin is used up, a tenth of the shortest edge,
    with every block counted by its fastest node, twice.
    """
    model, velocities = sliding_block(4000.0)
    loop = prepare(replace(model, velocities=velocities), time_step=5e-7)
    for _ in range(10_000):
        step(loop)
    (bound,), (body,) = loop.interactions, loop.bodies
    now = world_vectors(body, body.now.velocity)[0]
    mass = model.bodies[0].lumped_mass
    assert mass @ now[:, 0] / mass.sum() == pytest.approx(4000.0, rel=1e-7)
    moved = world_vectors(body, body.now.displacement)[0]
    assert moved[:, 0].mean() == pytest.approx(20.0, rel=1e-6)
    assert np.abs(moved[:, 2]).max() < 1e-4
    skin = 0.1 * 20.0 / 3.0
    assert bound.searches <= 2.0 * 20.0 / skin * 1.05 + 2


def closest_from_the_middle(corners, points):
    """As cuts find it: natural coordinates and gaps."""
    xi, work = np.zeros((len(points), 2)), np.empty((9, 3))
    gaps = [closest_point(c, x, at, work) for c, x, at in zip(corners, points, xi, strict=True)]
    return xi, np.array(gaps)


def test_closest_points_of_skewed_facets():
    """Facets of split triangles, angles from 45 to 135 degrees: every point is its own closest."""
    kite = np.array([[-1.3, -1.1, 1.0], [0.45, 0.65, 1.0], [-0.13, 1.23, 1.0], [-1.3, 0.65, 1.0]])
    stated = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 9)]), axis=-1).reshape(-1, 2)
    shapes, _ = bilinear(stated)
    for corners in (kite, kite[::-1], kite * [3.0, 1.0, 1.0]):
        points = shapes @ corners + [0.0, 0.0, 0.01]
        xi, gap = closest_from_the_middle(np.tile(corners, (len(points), 1, 1)), points)
        np.testing.assert_allclose(xi, stated, atol=1e-9)
        np.testing.assert_allclose(np.abs(gap), 0.01, rtol=1e-9)


def test_closest_points_of_a_warped_facet():
    """The way from the closest point stands on both tangents, to the accuracy of Newton."""
    rng = np.random.default_rng(4)
    flat = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    corners = flat + 0.1 * rng.standard_normal((60, 4, 3))
    points = np.array([1.0, 1.0, 0.3]) + 0.3 * rng.standard_normal((60, 3))
    near, away = closest_from_the_middle(corners, points)
    xi, gap, normal = closest_points(corners, points, near)
    assert (np.abs(xi) < 1.9).all()
    np.testing.assert_allclose(xi, near, atol=1e-9)
    np.testing.assert_allclose(gap, away, atol=1e-12)
    found = np.einsum("na,nai->ni", bilinear(xi)[0], corners)
    assert np.abs(points - found - gap[:, None] * normal).max() < 1e-12


def test_explicit_runs_that_search_refuse_reference_normals():
    found = ring(1, (12, 2, 4))
    deformable = deformable_assembly(found, named_load("pipe", 0.01).on(found), CONCRETE)
    stated = replace(deformable.contact, normals=ContactNormals.REFERENCE)
    with pytest.raises(ContactError, match="current ones"):
        timed_system(in_contact(replace(deformable, contact=stated), finite_sliding=True))


def test_a_run_comes_to_rest_on_cuts_of_where_it_rests():
    """A ring, prestressed much beyond its load: what a stale cut errs by is 2 % of the motion.

    A run ends where a thousandth of the way is left, an estimate that may be off by two.
    """
    of = frozenset({"finite sliding", "gap", "laws of pairs", "prestress", "springs", "sector"})
    problem = stated(of, "sector").stated
    run = solve_explicit(problem, Explicit(damping="static", symmetry="sector"))
    static = Static(mesh="scene", error_estimate=False, symmetry="sector")
    (moved,), (rests,) = (a.details.displacements for a in (run, solve_static(problem, static)))
    assert run.report["status"] == "converged"
    assert np.abs(moved - rests).max() <= 2e-3 * np.abs(rests).max()
