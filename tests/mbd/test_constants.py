"""Laws that fix the constants of the rigid answer: each fails where one of them is another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import Assembly
from geometry.block import box_block
from geometry.families.masonry import RunningBondWall, box
from geometry.loads import LoadCase
from geometry.mesh import FloatArray
from geometry.parts.measures import block_measures
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.options import ContactPlacement, DetectionOptions
from geometry.polyhedra.polyhedron import Polyhedron, convex_polyhedron
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import newton_equilibrium
from mbd.limits.force_range import force_ranges
from mbd.limits.plane import in_space, reduced
from mbd.limits.pushes import Pushes
from mbd.limits.sliding_collapse import SlidingCheck, SlidingCollapse
from mbd.options import FrictionLaw
from mbd.system import RigidSystem, Stated
from tests.support.blocks import random_rotation

I = np.eye(3)  # noqa: E741
DOWN = np.array([0.0, 0.0, -1.0])


# ---------------------------------------------------------------------------------------------
# Measures


@given(n=st.integers(2, 200), seed=st.integers(0, 10**6))
@settings(max_examples=100, deadline=None)
def test_round_off_of_uniform_pressures_takes_no_element_away(n: int, seed: int) -> None:
    """Pressures equal to 1e-13 take part everywhere: N_eff is n to round-off."""
    noise = 1e-13 * np.random.default_rng(seed).uniform(-1.0, 1.0, n)
    pressures = 0.3 * (1.0 + noise)
    first = np.zeros(n, dtype=np.int64)
    found = block_measures(np.array([0]), first, first + 1, pressures, np.ones(n))
    assert found.participation[0] == n


@given(order=st.permutations(range(4)))
def test_of_equal_pressures_the_largest_facets_are_effective(order: list[int]) -> None:
    """N_eff of 2, 1, 1, 1 is 25 / 7 = 3.6: three elements, of the equal ones those of 5 and 4."""
    pressures, areas = np.array([2.0, 1.0, 1.0, 1.0])[order], np.array([1.0, 3.0, 5.0, 4.0])[order]
    first = np.zeros(4, dtype=np.int64)
    found = block_measures(np.array([0]), first, first + 1, pressures, areas)
    assert found.participation[0] == 3
    assert found.effective_area[0] == 1.0 + 5.0 + 4.0


# ---------------------------------------------------------------------------------------------
# Contacts


@pytest.mark.parametrize("gap", [3e-5, 1e-4, 1e-3])
def test_a_pair_that_almost_lies_like_another_is_searched_by_itself(gap: float) -> None:
    """Two pairs of cubes, one with a gap, in sides, beyond the tolerance of 1e-5 diagonals."""
    side = 20.0
    cube = box_block((side,) * 3, (1, 1, 1), contact_faces=("x-", "x+", "y-", "y+", "z-", "z+"))
    apart = [0.0, side, 10 * side, 11 * side + gap * side]
    assembly = Assembly(
        name="pairs",
        shapes=(cube,),
        shape_of=np.zeros(4, dtype=np.int64),
        rotations=np.tile(I, (4, 1, 1)),
        translations=np.array([[0.0, 0.0, z] for z in apart]),
        layer=np.arange(4),
        fixed=np.array([True, False, True, False]),
        unmatched_allowed=True,
    )
    found = assembly.interfaces
    pairs = np.column_stack([found.block_m, found.block_s])
    np.testing.assert_array_equal(pairs, [[0, 1]])


def stacked(
    shapes: list[tuple[Polyhedron, list[float]]], turn: FloatArray, **options: object
) -> PolyhedralAssembly:
    """Blocks at places, turned as a whole; the first one is fixed."""
    blocks = [(shape, turn, turn @ np.array(place)) for shape, place in shapes]
    fixed = np.zeros(len(shapes), dtype=bool)
    fixed[0] = True
    detection = DetectionOptions(**options)  # type: ignore[arg-type]
    return polyhedral_assembly("stack", blocks, fixed, detection)


@pytest.mark.parametrize("seed", range(5))
def test_points_at_centroids_have_the_first_moment_of_the_contact_area(seed: int) -> None:
    """Boxes that share a rectangle of 7 × 5: the mean of the points is its middle."""
    turn = random_rotation(seed)
    shapes = [(box((10.0, 10.0, 4.0)), [0.0, 0.0, 0.0]), (box((10.0, 10.0, 4.0)), [3.0, 5.0, 4.0])]
    found = stacked(shapes, turn, points=ContactPlacement.CENTROIDS).interfaces
    assert found.areas.sum() == pytest.approx(35.0, rel=1e-9)
    mean = found.areas @ found.centroids / found.areas.sum()
    np.testing.assert_allclose(mean, turn @ np.array([6.5, 7.5, 4.0]), atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_faces_that_share_an_edge_alone_make_no_patch(seed: int) -> None:
    """An overlap as wide as round-off has no area, however the blocks are turned."""
    turn = random_rotation(seed)
    shapes = [(box((10.0, 10.0, 4.0)), [0.0, 0.0, 0.0]), (box((10.0, 10.0, 4.0)), [10.0, 0.0, 4.0])]
    found = stacked(shapes, turn).interfaces
    assert len(found.patches.areas) == 0
    assert not (found.patch >= 0).any()


def pit(width: float, depth: float) -> Polyhedron:
    """Box of 10 × 10 × 6 with a pyramidal pit in its top, whose tip is at the origin."""
    outer = [[x, y, z] for z in (-4.0, depth) for x, y in ((-5, -5), (5, -5), (5, 5), (-5, 5))]
    inner = [[x * width, y * width, depth] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    points = np.array([*outer, *inner, [0.0, 0.0, 0.0]])
    faces = [[0, 3, 2], [0, 2, 1]]
    for k in range(4):
        after = (k + 1) % 4
        faces += [[k, after, 4 + after], [k, 4 + after, 4 + k]]
        faces += [[4 + k, 4 + after, 8 + after], [4 + k, 8 + after, 8 + k]]
        faces.append([8 + k, 8 + after, 12])
    return Polyhedron("pit", points, np.array(faces, dtype=np.int64))


def test_a_tip_in_a_pit_stands_on_all_its_sides() -> None:
    """Four contacts at one point, of four normals: the tip cannot move sideways or down."""
    corners = [[a, b, 6.0] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    tip = convex_polyhedron("tip", [*corners, [0.0, 0.0, 0.0]])
    assembly = polyhedral_assembly(
        "pit", [(pit(3.0, 2.0), I, np.zeros(3)), (tip, I, np.zeros(3))], np.array([True, False])
    )
    found = assembly.interfaces
    assert found.n_contacts == 4
    assert np.unique(found.normals.round(6), axis=0).shape == (4, 3)
    contacts = contact_jacobian(assembly)
    for way in (*(sign * I[k] for k in (0, 1) for sign in (1.0, -1.0)), DOWN):
        rates = contacts.jacobian.gap_rates(np.concatenate([way, np.zeros(3)]))
        assert rates.min() < -0.1


# ---------------------------------------------------------------------------------------------
# Friction


@given(seed=st.integers(0, 10**6), mu=st.floats(0.05, 2.0))
@settings(max_examples=30, deadline=None)
def test_least_work_of_a_contact_is_that_of_some_admissible_force(seed: int, mu: float) -> None:
    """By enumeration: corners of the pyramid, directions of the cone."""
    wall = RunningBondWall((200.0, 100.0, 80.0), 1, 1).build()
    contacts = contact_jacobian(wall)
    motion = np.random.default_rng(seed).standard_normal(contacts.jacobian.shape[0])
    angles = np.linspace(0.0, 2 * np.pi, 721)[:-1]
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    corners = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    # 720 directions miss the least work of a cone by at most 1 - cos(0.25°) of its friction.
    for law, ways, missed in (
        (FrictionLaw.PYRAMID, corners, 1e-12),
        (FrictionLaw.CONE, around, 1e-5),
    ):
        frictional = frictional_contacts(wall, contacts, mu, law)
        slip = frictional.slip(motion)
        works = slip[:, :1] + mu * slip[:, 1:] @ ways.T
        slack = missed * (1.0 + mu) * np.abs(slip).max()
        np.testing.assert_allclose(frictional.smallest_work(motion), works.min(axis=1), atol=slack)


@pytest.mark.parametrize("law", list(FrictionLaw))
def test_projected_forces_lie_between_the_corners_of_the_law(law: FrictionLaw) -> None:
    """In every direction they reach no further than the corners (720 of the cone: 1e-5 of it);
    forces half as far from the axis as the nearest side of the pyramid stay as they are."""
    wall = RunningBondWall((200.0, 100.0, 80.0), 1, 1).build()
    contacts, mu = contact_jacobian(wall), 0.4
    frictional = frictional_contacts(wall, contacts, mu, law)
    forces = np.random.default_rng(1).standard_normal((frictional.matrix.shape[1] // 3, 3))
    forces[:, 0] = np.abs(forces[:, 0])
    angles = np.linspace(0.0, 2 * np.pi, 721)[:-1]
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    corners = mu * (ways if law is FrictionLaw.CONE else ways[::180])
    found = frictional.projected(forces)
    reach = (corners @ ways.T).max(axis=0) * found[:, :1]
    assert (found[:, 1:] @ ways.T <= reach * (1.0 + 1e-5) + 1e-12).all()
    inside = np.column_stack([np.ones(len(forces)), forces[:, 1:]])
    inside[:, 1:] *= 0.5 * mu / np.sqrt(2.0) / np.linalg.norm(forces[:, 1:], axis=1)[:, None]
    np.testing.assert_array_equal(frictional.projected(inside), inside)


@pytest.mark.parametrize(
    "law", ["residual", "excess", "overlap", "opening_work", "slipping_defect"]
)
@pytest.mark.parametrize(("violation", "certified"), [(1e-5, False), (1e-8, True)])
def test_sliding_is_certified_only_where_every_law_holds(
    law: str, violation: float, certified: bool
) -> None:
    check = replace(SlidingCheck(0.0, 0.0, 0.0, 0.0, 0.0), **{law: violation})
    found = SlidingCollapse(
        factor=1.0, associated=1.0, forces=np.zeros((1, 3)), mechanism=np.zeros(6), check=check
    )
    assert found.certified is certified


# ---------------------------------------------------------------------------------------------
# Pushes and ranges


@pytest.mark.parametrize("degrees", [1.0, 5.0, 30.0])
def test_weight_in_a_shallow_groove_holds_against_a_small_push(degrees: float) -> None:
    """Across the groove a push of tan(angle) of the weight lifts the block out, a small one not."""
    lean = np.tan(np.radians(degrees))
    groove = [
        convex_polyhedron(
            f"side {side}",
            [
                [side * x, y, z]
                for y in (0, 60)
                for x, z in ((0, 0), (0, -9), (50, -9), (50, 50 * lean))
            ],
        )
        for side in (-1, 1)
    ]
    keel = [
        [x, y, z] for y in (0, 60) for x, z in ((0, 0), (-20, 20 * lean), (20, 20 * lean), (0, 30))
    ]
    block = convex_polyhedron("keel", keel)
    assembly = polyhedral_assembly(
        "groove",
        [(shape, I, np.zeros(3)) for shape in (*groove, block)],
        np.array([True, True, False]),
    )
    weight = np.zeros((3, 6))
    weight[2, :3] = DOWN
    load = LoadCase(assembly, "weight", (), assembly.fixed, body_wrenches=weight)
    assert Pushes(RigidSystem(Stated(assembly, load))).held == {
        "+x": True,
        "-x": True,
        "+y": False,
        "-y": False,
        "+z": True,
        "-z": True,
    }


@pytest.mark.parametrize("component", [1, 3, 5])
def test_what_acts_out_of_the_plane_is_no_plane_problem(component: int) -> None:
    """A millionth of the load across the wall or about its axes is a load; round-off is none."""
    wall = RunningBondWall((200.0, 100.0, 80.0), 2, 2).build()
    contacts = contact_jacobian(wall)
    frictional = frictional_contacts(wall, contacts, 0.5, FrictionLaw.PYRAMID)
    down = np.zeros((len(contacts.free_blocks), 6))
    down[:, 2] = -wall.volumes[contacts.free_blocks]
    for part, plane in ((1e-6, False), (1e-12, True)):
        load = down.copy()
        load[-1, component] = part * np.abs(down).max()
        problem = reduced(wall, contacts, frictional, down.ravel(), load.ravel())
        assert len(problem.rows) == (3 if plane else 6) * len(down)


def test_a_keystone_between_abutments_can_be_prestressed_by_friction_alone() -> None:
    """Straight joints: friction alone lets them be pressed, by any prestress."""
    brick = box((10.0, 10.0, 10.0))
    places = [[-10.0, 0.0, 0.0], [0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, -10.0]]
    assembly = polyhedral_assembly(
        "row", [(brick, I, np.array(p)) for p in places], np.array([True, False, True, True])
    )
    contacts = contact_jacobian(assembly)
    load = np.concatenate([DOWN, np.zeros(3)])
    frictional = frictional_contacts(assembly, contacts, 0.5, FrictionLaw.PYRAMID)
    shown = newton_equilibrium(contacts.jacobian, load).forces
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    # The sides press each other, and their friction presses the block on what it stands on.
    assert found.unbounded.all()
    stack = polyhedral_assembly(
        "stack", [(brick, I, np.array(p)) for p in places[1::2]], np.array([False, True])
    )
    contacts = contact_jacobian(stack)
    frictional = frictional_contacts(stack, contacts, 0.5, FrictionLaw.PYRAMID)
    shown = newton_equilibrium(contacts.jacobian, load).forces
    found = force_ranges(contacts, load, shown, frictional=in_space(frictional))
    assert found is not None
    assert not found.unbounded.any()
