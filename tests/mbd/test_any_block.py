"""Known verdicts of known assemblies, contacts against the conforming path, limit analysis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry import Assembly
from geometry.families.masonry import CircularArch, RunningBondWall, box
from geometry.families.planar_wall import OsteomorphicWall, PlanarSineWall
from geometry.families.platonic_layers import (
    CubesLayer,
    OctahedraLayer,
    TetrahedraLayer,
)
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.families.voxels import VoxelPuzzle
from geometry.loads import LoadCase, named_load
from geometry.mesh import FloatArray
from geometry.parts.placed import AnyBlocks
from geometry.polyhedra.assembly import PolyhedralAssembly, as_polyhedral, polyhedral_assembly
from geometry.polyhedra.facet_contact import _at_vertices
from geometry.polyhedra.options import ContactPlacement, CubeArrangement, DetectionOptions
from mbd import Norm, Rigid, Solver, analyse, contact_jacobian
from mbd.contacts.friction import FrictionalContacts, RigidFrictionError, frictional_contacts
from mbd.contacts.jacobian import RigidContacts
from mbd.equilibrium import equilibrium, frictional_equilibrium, newton_equilibrium
from mbd.limits.collapse import collapse_load
from mbd.limits.pushes import Pushes, interlocking_margin
from mbd.mechanism import Classification, Mechanism, SelfStress, classify
from mbd.options import FrictionLaw
from mbd.system import RigidSystem, Stated
from tests.support.blocks import random_rotation, tsb
from tests.support.linear_programs import solve_linear_programs
from tests.verification.closed_forms import (
    ARCH_LIMIT,
    arch_limit,
    body_force,
    groove,
    incline,
    tilt_limit,
)
from validation import load_case, solve

pytestmark = pytest.mark.quick

I = np.eye(3)  # noqa: E741
DOWN = np.array([0.0, 0.0, -1.0])


def _verdict(assembly: AnyBlocks) -> tuple[RigidContacts, Classification]:
    """Class without a load; the certificate is checked by multiplication."""
    contacts = contact_jacobian(assembly)
    g = contacts.jacobian
    found = classify(g, np.zeros(g.shape[0]))
    if isinstance(found.certificate, SelfStress):
        forces = found.certificate.forces
        # Positive forces that balance to round-off, and full rank: no motion opens nothing.
        assert forces.min() >= 1.0
        matrix = g.to_matrix()
        assert np.linalg.norm(matrix @ forces) <= 1e-9 * np.linalg.norm(forces)
        singular = np.linalg.svd(matrix.toarray(), compute_uv=False)
        assert singular[-1] > 1e-8 * singular[0]
    else:
        assert isinstance(found.certificate, Mechanism)
        motion = found.certificate.virtual_displacement.ravel()
        assert np.linalg.norm(motion) == pytest.approx(1.0)
        assert (g.to_matrix().T @ motion).min() >= -1e-9
    return contacts, found


KNOWN: dict[str, tuple[PolyhedralAssembly | Assembly, bool]] = {
    "one tetrahedron in its ring": (TetrahedraLayer(50.0, 1, 1).build(), True),
    "tetrahedra": (TetrahedraLayer(50.0, 3, 3).build(), True),
    "octahedra": (OctahedraLayer(50.0, 1).build(), True),
    "cubes on their corners": (CubesLayer(50.0, 1).build(), True),
    "cubes as paving": (CubesLayer(50.0, 1, CubeArrangement.SQUARE).build(), False),
    "brick wall": (RunningBondWall((200.0, 100.0, 80.0), 3, 3).build(), False),
    "arch": (CircularArch(1000.0, 150.0, 300.0, 9).build(), False),
    "osteomorphic": (
        OsteomorphicWall(200.0, 100.0, 80.0, 8.0, divisions=(8, 4, 2), columns=2, layers=2).build(),
        True,
    ),
    "osteomorphic without wave": (
        OsteomorphicWall(200.0, 100.0, 80.0, 0.0, divisions=(8, 4, 2), columns=2, layers=2).build(),
        False,
    ),
    "planar Sine Blocks": (
        PlanarSineWall(
            190.0, 40.0, 200.0, 20.0, 1.5, 0.0, divisions=(18, 3, 4), columns=2, layers=2
        ).build(),
        True,
    ),
    "planar bricks": (
        PlanarSineWall(
            190.0, 40.0, 200.0, 0.0, 1.5, 0.0, divisions=(18, 3, 4), columns=2, layers=2
        ).build(),
        False,
    ),
}


@pytest.mark.parametrize("name", list(KNOWN))
def test_verdict_of_known_assemblies(name: str) -> None:
    assembly, locked = KNOWN[name]
    _, found = _verdict(assembly)
    assert found.locked == locked


def test_tetrahedra_need_their_crossing_edges() -> None:
    # With face contacts alone 2 × 2 tetrahedra slide out along their faces, all four at once;
    # the edges of diagonal neighbours, which cross there, are what stops them.
    assembly = TetrahedraLayer(50.0, 2, 2).build()
    assert _verdict(assembly)[1].locked
    found = assembly.interfaces
    assert (found.patch < 0).sum() > 0
    faces = _at_vertices(found.patches, found.polygons)
    bare = contact_jacobian(_WithContacts(assembly, faces))
    assert not classify(bare.jacobian, np.zeros(24)).locked


class _WithContacts:
    """An assembly with other contacts."""

    def __init__(self, assembly: PolyhedralAssembly, interfaces: object) -> None:
        self._assembly, self.interfaces = assembly, interfaces
        self.kept: dict[object, object] = {}  # nothing that was computed of the other contacts

    def __getattr__(self, name: str) -> object:
        return getattr(self._assembly, name)


@pytest.mark.parametrize("name", ["tetrahedra", "cubes as paving", "brick wall"])
def test_verdict_agrees_with_the_linear_programs_and_with_random_loads(name: str) -> None:
    # Interlocked if and only if every load can be carried (Wang et al. 2019).
    assembly, locked = KNOWN[name]
    contacts, found = _verdict(assembly)
    n_rows = contacts.jacobian.shape[0]
    programs = solve_linear_programs(contacts.jacobian, np.zeros(n_rows))
    assert (str(programs.mechanism) == "locked") == locked
    rng = np.random.default_rng(3)
    carried = [
        newton_equilibrium(contacts.jacobian, rng.standard_normal(n_rows)).holds for _ in range(12)
    ]
    assert all(carried) if locked else not any(carried)
    assert found.locked == locked


def test_margin_is_positive_exactly_when_locked_and_turns_with_the_assembly() -> None:
    assembly = OctahedraLayer(50.0, 0).build()
    contacts = contact_jacobian(assembly)
    margin = interlocking_margin(contacts)
    assert margin.interlocked
    assert margin.mechanism is None
    worst = margin.areas[contacts.free_blocks == margin.block][0]
    row = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].index(margin.load[1:])
    assert worst[row, "+-".index(margin.load[0])] == margin.bearing_area
    # Of symmetric loads the first one counts, whichever round-off prefers.
    assert margin.bearing_area == pytest.approx(margin.areas.min(), rel=1e-6)
    # The bearing area of +Fz: only the three faces that lean over the block press, with normals
    # of height 1/3 and equal areas A: 1 N needs 3 · λ/3 = 1 at uniform pressure: Σλ²/A = 3/A.
    area = assembly.interfaces.patches.areas[0]
    np.testing.assert_allclose(margin.areas[0, 2], area / 3, rtol=1e-9)
    # A sum of unit loads costs at most the sum of their efforts.
    rng = np.random.default_rng(0)
    load = rng.standard_normal(6)
    weights = np.sqrt(contacts.areas / contacts.areas.mean())
    forces = newton_equilibrium(contacts.jacobian, load, weights=weights).forces
    effort = np.sqrt(np.sum(forces**2 / contacts.areas))
    ways = np.where(load > 0, 0, 1)
    bound = np.sum(np.abs(load) / np.sqrt(margin.areas[0][np.arange(6), ways]))
    assert effort <= bound * (1 + 1e-9)
    paving = contact_jacobian(KNOWN["cubes as paving"][0])
    loose = interlocking_margin(paving)
    assert not loose.interlocked
    assert loose.mechanism is not None


def test_verdict_does_not_depend_on_position_or_units() -> None:
    layer = TetrahedraLayer(50.0, 2, 1).build()
    turn, shift, scale = random_rotation(2), np.array([300.0, -200.0, 50.0]), 10.0
    moved = replace(
        layer,
        shapes=tuple(replace(s, points=scale * s.points) for s in layer.shapes),
        rotations=turn @ layer.rotations,
        translations=scale * layer.translations @ turn.T + shift,
    )
    a, b = layer.interfaces, moved.interfaces
    assert a.n_contacts == b.n_contacts
    assert b.patches.areas.sum() == pytest.approx(scale**2 * a.patches.areas.sum(), rel=1e-9)
    assert _verdict(moved)[1].locked


def _same_tube_other_meshes(tolerance: float) -> tuple[Assembly, PolyhedralAssembly]:
    """A tube, and the same tube whose odd layers have a coarser mesh, contacts detected."""
    fine = SineTube(tsb(), SineBlockDivisions(60, 6, 14), 2).build()
    coarse = SineTube(tsb(), SineBlockDivisions(48, 5, 11), 2).build()
    a, b = as_polyhedral(fine), as_polyhedral(coarse)
    mixed = replace(
        a,
        shapes=a.shapes + b.shapes,
        shape_of=np.where(fine.layer % 2 == 0, a.shape_of, a.shape_of + len(a.shapes)),
        detection=DetectionOptions(tolerance, 40.0, ContactPlacement.CENTROIDS),
    )
    return fine, mixed


@pytest.mark.slow
def test_detected_contacts_agree_with_the_conforming_ones_on_the_sine_block() -> None:
    fine, mixed = _same_tube_other_meshes(tolerance=0.5)
    # Facets of a wave of length 73 mm and amplitude 20 mm lie (Δs)² κ/8 = 0.3 mm apart at most
    # where its curvature is a (2π/73)² = 0.15 /mm: all of them touch within 0.5 mm. The area of
    # a wavy surface approximated by n facets a wave is off by (π/n)²/6: 0.5 %.
    area, exact = mixed.interfaces.areas.sum(), fine.interfaces.areas.sum()
    assert area == pytest.approx(exact, rel=0.005)
    load = named_load("pipe", 0.01).on(fine)
    expected = analyse(fine, Rigid(norm=Norm.PRESSURE), load=load).details
    bodies = replace(load, faces=(), body_wrenches=load.wrenches)
    found = analyse(mixed, Rigid(norm=Norm.PRESSURE), load=bodies).details
    assert found.mechanism is expected.mechanism
    assert found.measures is not None
    assert expected.measures is not None
    # Σλ²/A converges with the mesh; the meshes differ by a fifth in element size and the measures
    # of the finer one change by 4 % under such a change.
    assert found.measures.p_eff == pytest.approx(expected.measures.p_eff, rel=0.05)
    assert found.measures.effective_area_percent == pytest.approx(
        expected.measures.effective_area_percent, rel=0.05
    )


def test_flat_joints_at_vertices_do_not_rock() -> None:
    # A box on a box: four corners carry any eccentric load inside the joint, a centroid none.
    shape = box((10.0, 10.0, 10.0))
    blocks = [(shape, I, np.zeros(3)), (shape, I, np.array([4.0, 4.0, 10.0]))]
    for placement, stands in (
        (ContactPlacement.VERTICES, True),
        (ContactPlacement.CENTROIDS, False),
    ):
        options = DetectionOptions(points=placement)
        assembly = polyhedral_assembly("two", blocks, np.array([True, False]), options)
        contacts = contact_jacobian(assembly)
        force = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
        assert newton_equilibrium(contacts.jacobian, force).holds == stands


# ---------------------------------------------------------------------------------------------
# Friction


def _with_friction(
    assembly: PolyhedralAssembly, mu: float, law: FrictionLaw = FrictionLaw.CONE
) -> FrictionalContacts:
    return frictional_contacts(assembly, contact_jacobian(assembly), mu, law)


def _check_forces(contacts: FrictionalContacts, forces: FloatArray, load: FloatArray) -> None:
    """Admissible forces that balance the load, by one multiplication."""
    normal, tangential = forces[:, 0], np.linalg.norm(forces[:, 1:], axis=1)
    assert normal.min() >= 0.0
    # Admissible to the rounding of one scaling.
    assert (tangential <= contacts.friction * normal * (1 + 1e-12) + 1e-300).all()
    residual = np.linalg.norm(contacts.matrix @ forces.ravel() + load)
    assert residual <= 1e-6 * np.linalg.norm(load)


def _check_mechanism(contacts: FrictionalContacts, motion: FloatArray, load: FloatArray) -> None:
    """No admissible force works against the motion, the load drives it."""
    slip = (contacts.matrix.T @ motion).reshape(-1, 3)
    work = slip[:, 0] - contacts.friction * np.linalg.norm(slip[:, 1:], axis=1)
    assert load @ motion > 0
    assert work.min() >= -1e-6 * np.linalg.norm(load) * np.linalg.norm(motion)


@pytest.mark.parametrize("law", list(FrictionLaw))
@pytest.mark.parametrize("mu", [0.1, 0.5, 1.2])
def test_a_block_on_an_incline_slides_at_atan_mu(mu: float, law: FrictionLaw) -> None:
    # The pyramid's corners touch the cone along its tangents, of which one is x here. The block
    # is five times wider than high: it slides before it tips (tan = 5).
    assembly = incline()
    contacts = _with_friction(assembly, mu, law)
    found = collapse_load(contacts, body_force(assembly, DOWN), body_force(assembly, I[0]))
    assert found.certified
    assert np.arctan(found.factor) == pytest.approx(np.arctan(mu), abs=1e-7)


def test_pyramid_is_weaker_than_cone_off_its_corners() -> None:
    assembly = incline()
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    dead, live = body_force(assembly, DOWN), body_force(assembly, diagonal)
    cone = collapse_load(_with_friction(assembly, 0.5), dead, live)
    pyramid = collapse_load(_with_friction(assembly, 0.5, FrictionLaw.PYRAMID), dead, live)
    assert cone.factor == pytest.approx(0.5, abs=1e-7)
    assert pyramid.factor == pytest.approx(0.5 / np.sqrt(2), abs=1e-7)


def test_both_sides_of_the_incline_are_certified() -> None:
    assembly = incline()
    contacts = _with_friction(assembly, 0.3)
    for tangent, holds in ((0.299, True), (0.301, False)):
        load = body_force(assembly, DOWN + tangent * I[0])
        found = frictional_equilibrium(contacts, load)
        assert found.holds == holds
        if holds:
            _check_forces(contacts, found.forces, load)
        else:
            assert found.mechanism is not None
            assert np.linalg.norm(found.mechanism) == pytest.approx(1.0, rel=1e-14)
            _check_mechanism(contacts, found.mechanism, load)


@pytest.mark.parametrize("angle", [20.0, 45.0, 70.0])
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_tilt_limit_of_a_wedge_in_a_groove(angle: float, mu: float) -> None:
    """Without friction gravity must stay inside the cone of the two normals: it may tilt by β. With
    friction the prism slides up one side and off the other at β + atan μ, below a right angle."""
    limit = np.radians(angle) + np.arctan(mu)
    expected = min(limit, np.pi / 2)
    assert tilt_limit(groove(np.radians(angle)), mu) == pytest.approx(expected, abs=1e-5)


def test_semicircular_arch_stands_down_to_the_couplet_heyman_thickness() -> None:
    # Milankovitch's minimum for a semicircular arch with radial joints and no sliding is
    # t/R = 0.1075 (four digits); joints every 4.5° miss the best hinge (54.5° from the crown) by
    # half a degree, where the thrust line's distance is stationary: 1e-4 in t/R.
    def stands(ratio: float) -> bool:
        arch = CircularArch(1000.0, 1000.0 * ratio, 300.0, 40).build()
        contacts = _with_friction(arch, 1.0)
        load = body_force(arch, DOWN)
        found = frictional_equilibrium(contacts, load)
        if found.holds:
            _check_forces(contacts, found.forces, load)
        else:
            assert found.mechanism is not None
            _check_mechanism(contacts, found.mechanism, load)
        return found.holds

    assert stands(0.1077)
    assert not stands(0.1073)
    # Ten halvings of [0.09, 0.13] leave 2e-5.
    assert arch_limit(20, steps=10) == pytest.approx(ARCH_LIMIT, abs=1e-4)


def test_wall_slides_on_its_foundation_at_mu() -> None:
    wall = RunningBondWall((240.0, 115.0, 71.0), 3, 2).build()
    contacts = _with_friction(wall, 0.6)
    found = collapse_load(contacts, body_force(wall, DOWN), body_force(wall, I[0]))
    assert found.certified
    assert found.factor == pytest.approx(0.6, abs=1e-6)
    _check_forces(contacts, found.forces, body_force(wall, DOWN + found.factor * I[0]))


def test_collapse_answers_what_cannot_be_asked() -> None:
    assembly = incline()
    contacts = _with_friction(assembly, 0.3)
    dead = body_force(assembly, DOWN)
    with pytest.raises(RigidFrictionError, match="live load is zero"):
        collapse_load(contacts, dead, 0.0 * dead)
    lifted = collapse_load(contacts, -dead, dead)
    assert np.isnan(lifted.factor)
    assert lifted.certified
    assert lifted.status == "none: the dead load alone is not carried"
    never = collapse_load(contacts, dead, dead)
    assert np.isinf(never.factor)
    assert never.certified
    with pytest.raises(RigidFrictionError, match=r"friction: got -0\.1"):
        _with_friction(assembly, -0.1)
    with pytest.raises(RigidFrictionError, match=r"friction: got 30, .* tangent"):
        _with_friction(assembly, 30.0)


def test_friction_zero_is_the_frictionless_answer() -> None:
    layer = TetrahedraLayer(50.0, 2, 1).build()
    contacts = contact_jacobian(layer)
    load = np.random.default_rng(5).standard_normal(contacts.jacobian.shape[0])
    without = newton_equilibrium(contacts.jacobian, load)
    with_zero = frictional_equilibrium(frictional_contacts(layer, contacts, 0.0), load)
    assert without.holds
    assert with_zero.holds
    # Both minimise Σλ²; clarabel stops at 1e-11 of the objective, so 1e-5 in λ.
    np.testing.assert_allclose(with_zero.forces[:, 0], without.forces, atol=1e-5)


# ---------------------------------------------------------------------------------------------
# Puzzles


def _puzzle(fixed: str) -> PolyhedralAssembly:
    drawing = load_case("voxel-puzzle").scene.block.layers  # type: ignore[union-attr]
    return VoxelPuzzle(drawing, 20.0, fixed).build()


def test_puzzle_is_locked_with_its_key_and_any_neighbour_but_not_with_the_key_alone() -> None:
    for neighbour in "ACD":
        assert _verdict(_puzzle("K" + neighbour))[1].locked
    assert not _verdict(_puzzle("K"))[1].locked
    # The key itself slides out, along x only.
    _, found = _verdict(_puzzle("ACD"))
    assert isinstance(found.certificate, Mechanism)
    motion = found.certificate.virtual_displacement.ravel()
    np.testing.assert_allclose(motion, [-1, 0, 0, 0, 0, 0], atol=1e-9)


def test_what_weighs_on_a_floor_in_a_corner_is_held_against_what_it_leans_on() -> None:
    """A cube on a floor against a wall at its +x side: pushed down, up (it weighs) and on to the
    wall it stays; away from the wall and along it nothing holds it, however well it is carried."""
    cube = box((100.0, 100.0, 100.0))
    floor, wall = box((400.0, 400.0, 100.0)), box((100.0, 400.0, 100.0))
    places = [(floor, [0.0, 0.0, -50.0]), (wall, [100.0, 0.0, 50.0]), (cube, [0.0, 0.0, 50.0])]
    assembly = polyhedral_assembly(
        "corner",
        [(shape, I, np.array(place)) for shape, place in places],
        np.array([True, True, False]),
    )
    weight = np.zeros((3, 6))
    weight[2, :3] = DOWN
    load = LoadCase(assembly, "weight", (), assembly.fixed, body_wrenches=weight)
    held = Pushes(RigidSystem(Stated(assembly, load))).held
    assert held == {"+x": True, "-x": False, "+y": False, "-y": False, "+z": True, "-z": True}
    assert str(analyse(assembly, load=load).details.mechanism) == "suppressed"
    turn = Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
    aside = replace(
        assembly,
        rotations=turn @ assembly.rotations,
        translations=assembly.translations @ turn.T,
    )
    assert [
        axis for axis, found in Pushes(RigidSystem(Stated(aside, load))).held.items() if found
    ] == [
        "+y",
        "+z",
        "-z",
    ]


def test_loads_of_body_scenes_are_weights_and_pushes(tmp_path: Path) -> None:
    """The push acts 2 mm above the centroid: M_y = 2 · 3. Fixed blocks are ground: no weight."""
    force = {"blocks": [5], "force": [3.0, 0.0, 0.0]}
    case = load_case("wall", {"load.acceleration": [0, 0, 0], "loads": [force]})
    result = solve(case.with_method("rigid")).details
    at = result.blocks.centroids[5] + [0.0, 0.0, 2.0]
    raised = case.changed({"loads": [force | {"point": at.tolist()}]})
    other = solve(raised.with_method("rigid")).details
    loads, pushed = (r.load.wrenches for r in (result, other))
    weight = 1.9e-9 * 9810 * result.blocks.volumes
    np.testing.assert_allclose(loads[:, 2], np.where(result.blocks.fixed, 0.0, -weight))
    np.testing.assert_allclose(loads[5, [0, 1, 3, 4, 5]], [3, 0, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(pushed[5] - loads[5], [0, 0, 0, 0, 6, 0], atol=1e-9)


@pytest.mark.parametrize("slope", [1e-4, 1e-5, 3e-6])
def test_what_leans_beyond_the_tolerance_is_no_equilibrium(slope: float) -> None:
    """On a smooth plate nothing balances the part along it: a residual of the slope, not 1e-6."""
    assembly = incline()
    contacts = contact_jacobian(assembly)
    for lean, holds in ((slope, False), (1e-8, True)):
        load = body_force(assembly, DOWN + lean * I[0])
        for solver in (Solver.NEWTON, Solver.CLARABEL):
            found = equilibrium(contacts.jacobian, load, solver=solver)
            assert found.holds is holds, (solver, lean, found.status)
