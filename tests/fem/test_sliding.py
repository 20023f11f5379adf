"""Scenes whose joints do not match, and the end of runs with finite sliding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from fem import Explicit, Frames, Material, solve_explicit
from fem.explicit.setup.quasi_static import block_frequencies
from fem.explicit.setup.timed_system import timed_system
from fem.system.effects import AdaptiveMassDamping, Effects
from fem.system.system import System
from geometry import ColumnBox, RefusedError, box_block, box_column
from geometry.files.mesh_io import write_hex_mesh
from geometry.loads import face_pressure
from tests.support.answers import on_its_mesh
from tests.support.coarse_tubes import coarse, keys
from tests.support.commands import answered
from tests.support.explicit_runs import explicit_run
from tests.support.fem_problems import deformable_assembly, in_contact
from tests.support.own_blocks import SECTIONS
from tests.support.printed import printed
from validation import Case, load_case

Box = tuple[tuple[float, float, float], tuple[int, int, int]]

WIDE = (100.0, 80.0, 50.0)


def column(*boxes: Box, pressure: float = 0.5, poisson: float = 0.0, **sections) -> Case:
    stated = {
        "block": {"type": "boxes", "boxes": [{"size": s, "divisions": d} for s, d in boxes]},
        "load": {"pressure": pressure},
        "material": {"density": 2.4e-9, "young_modulus": 33e3, "poisson_ratio": poisson},
        "contact": {"clearance_at_zero_pressure": 1e-3, "pressure_at_zero_clearance": 1e-4},
        "fem": {"method": "explicit", "damping": "static", "residual": 1e-8},
    }
    return load_case(stated | sections)


CROSSING = ((WIDE, (4, 4, 2)), (WIDE, (3, 3, 2)), (WIDE, (5, 2, 2)))


def test_one_facet_in_the_middle_of_four() -> None:
    """No facet lies inside another: the only one is cut in four equal parts, on which the load
    presses alike by symmetry, to the residual."""
    scene = column((WIDE, (2, 2, 1)), ((50.0, 40.0, 50.0), (1, 1, 1)))
    found = on_its_mesh(scene, method="explicit").details.contact_state
    assert found.n_facets == 1
    quarter = np.sign(found.positions[:, :2]) @ [2.0, 1.0]
    areas = [found.point_areas[quarter == k].sum() for k in (-3.0, -1.0, 1.0, 3.0)]
    assert areas == pytest.approx([500.0] * 4, rel=1e-12)
    assert found.point_forces.sum(axis=0) == pytest.approx([0.0, 0.0, 1000.0], abs=1e-3)


@pytest.mark.usefixtures("undrawn")
def test_rigid_blocks_meet_where_a_search_finds_facets(tubelock) -> None:
    """Joints that do not match: a uniform pressure on each, to rounding, and the force of the load,
    which the static answer passes to its residual of 1e-8."""
    assert tubelock("mbd", "column-nonmatching", "--fields", "-o", "rigid")[0] == 0
    surface = meshio.read("rigid/contact_pressures.vtu")
    pressure, area = (surface.cell_data[key][0] for key in ("contact_pressure", "area"))
    layers = np.minimum(*(surface.cell_data[f"layer_{side}"][0] for side in "ms"))
    for lower, size in ((0, 8000.0), (1, 2400.0)):
        joint = layers == lower
        assert area[joint].sum() == pytest.approx(size, rel=1e-12)
        assert pressure[joint] == pytest.approx(1200.0 / size, rel=1e-9)
    data, _ = answered("compare", "column-nonmatching", "--no-explicit", "-o", "all")
    assert data["n_contacts"] == 16 + 15
    for method in ("rigid (force)", "rigid (pressure)"):
        assert data["interface_force_error"][method] < 1e-7
        assert data["agreement"][method][0]["force_ratio"] == pytest.approx(1, abs=1e-7)


@pytest.mark.usefixtures("undrawn")
def test_the_built_in_column_from_the_command_line(tubelock) -> None:
    data, out = answered("fem", "column-nonmatching", "-o", "run", "--fields")
    assert "finite sliding (non-matching meshes)" in out
    surface = meshio.read("run/contact_pressures.vtu")
    pressure, area = (surface.cell_data[key][0] for key in ("contact_pressure", "area"))
    assert len(pressure) == data["n_contacts"]
    # Two joints carry the load of 0.5 MPa on 60 × 40 mm²; the scene stops at a residual of 1e-4.
    assert pressure @ area == pytest.approx(2 * 0.5 * 2400.0, rel=1e-3)
    assert data["contact"]["force"] == pytest.approx(float(pressure @ area), rel=1e-12)
    blocks = np.column_stack([surface.cell_data[f"block_{side}"][0] for side in "ms"])
    assert {tuple(sorted(pair)) for pair in blocks.tolist()} == {(0, 1), (1, 2)}


def test_matching_joints_have_no_search_unless_asked() -> None:
    matching = ((WIDE, (4, 4, 2)), (WIDE, (4, 4, 1)))
    fixed = "matching meshes, fixed pairs (small sliding)"
    for asked, words in ((False, fixed), (True, "finite sliding")):
        run = on_its_mesh(column(*matching, effects={"finite_sliding": asked}), method="explicit")
        data = run.as_dict()
        assert data["contact_search"] == words
        assert (run.details.contact_state.interface is None) == asked
        assert data["contact"]["p_max_point"] == pytest.approx(0.5, rel=1e-6)
        assert data["n_contacts"] == 16
        assert data["contact"]["effective_count_percent"] == pytest.approx(50.0, rel=1e-9)


def rigid(deformable: System) -> System:
    """Blocks that yield 1e-12 of what contact does."""
    groups = deformable.bodies
    stiff = [replace(g, material=replace(g.material, young_modulus=1e16)) for g in groups]
    return replace(deformable, bodies=tuple(stiff))


def test_frequencies_are_those_of_the_facets_that_face_each_other() -> None:
    """Points and normals of flat joints are the same, to rounding, whether facets are matched or
    searched; a joint that does not match has as much area. Facets of a tube are warped: a search
    spreads their area over the points by its projection, a square of the warp of 1e-2 apart."""
    small = coarse(2, 4)
    tube = load_case("tsb1-pipe", small)
    alike = column(*[(WIDE, (4, 4, 2))] * 3)
    for case, rel in ((alike, 1e-9), (tube, 1e-3)):
        deformable = case.problem.system
        matched, searched = (
            block_frequencies(timed_system(stated).system, 0.01)
            for stated in (deformable, in_contact(deformable, finite_sliding=True))
        )
        assert searched.excited == pytest.approx(matched.excited, rel=rel)
        assert searched.lowest == pytest.approx(matched.lowest, rel=rel)
    # Vertical motion of rigid blocks is uniform on a joint: its frequency depends on area alone.
    found, expected = (
        block_frequencies(timed_system(rigid(case.problem.system)).system, 0.01)
        for case in (column(*CROSSING), alike)
    )
    assert found.excited == pytest.approx(expected.excited, rel=1e-9)


def test_a_pushed_box_presses_where_it_ended() -> None:
    """A box on a plank of 20 mm facets, pushed by a = 2e6 mm/s² against damping α = 1000 /s, no
    friction: it slides a/α (t - (1 - exp(-α t))/α) = 58 mm, three facets, in 0.03 s. Vertical
    motion has decayed by exp(-15 · (1 - ramp/end)): force and place are the load's to 1e-3; the
    plank lengthens by some 1e-3 of the slide."""
    scene = column(
        ((300.0, 80.0, 50.0), (15, 4, 2)),
        ((50.0, 40.0, 50.0), (3, 3, 2)),
        pressure=0.1,
        poisson=0.2,
        effects={
            "gravity": [2.0e6, 0.0, 0.0],
            "rayleigh": {"mass_proportional": 1000.0},
            "finite_sliding": True,
        },
        fem={"method": "explicit", "ramp_time": 2e-3, "end_time": 0.03},
    )
    run = on_its_mesh(scene, method="explicit")
    slide = 2e3 * (0.03 - (1.0 - np.exp(-30.0)) / 1e3)
    assert run.details.displacement_of(1)[:, 0].mean() == pytest.approx(slide, rel=1e-3)
    found = run.details.contact_state
    forces = found.point_forces
    assert forces.sum(axis=0) == pytest.approx([0.0, 0.0, 200.0], abs=0.2)
    centre = forces[:, 2] @ found.positions / forces[:, 2].sum()
    assert centre[:2] == pytest.approx([slide, 0.0], abs=1e-3 * slide)
    assert found.areas.sum() == pytest.approx(2000.0, rel=1e-6)
    corners = found.corners.reshape(-1, 3)
    assert corners[:, 0].min() == pytest.approx(slide - 25.0, abs=0.01)
    assert corners[:, 0].max() == pytest.approx(slide + 25.0, abs=0.01)


def settled_box(built: float, slid: float) -> tuple[np.ndarray, np.ndarray]:
    """Pressures and places of a box on a plank of 20 mm facets, x from the box's own place.

    ``built``: where the box stands in the assembly; ``slid``: its initial displacement [mm].
    """
    assembly = box_column(
        [ColumnBox((300.0, 80.0, 50.0), (15, 4, 2)), ColumnBox((50.0, 40.0, 50.0), (3, 3, 2))]
    )
    moved = np.array([[0.0, 0.0, 0.0], [built, 0.0, 0.0]])
    assembly = replace(assembly, translations=assembly.translations + moved)
    deformable = deformable_assembly(
        assembly,
        face_pressure(assembly, np.array([1]), "z+", 0.1),
        Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2),
        frames=Frames.DEFORMABLE,
        finite_sliding=True,
    )
    stated = timed_system(
        deformable,
        effects=Effects(adaptive_mass_damping=AdaptiveMassDamping(interval=50)),
        ramp_time=1e-3,
    )
    start = tuple(np.zeros((1, group.n_nodes, 3)) for group in stated.bodies)
    start[1][:, :, 0] = slid
    result = explicit_run(stated, end_time=0.1, displacements=start, residual=1e-7)
    assert str(result.run.status) == "converged"
    found = result.contact_state
    return found.point_pressures, found.positions - [built + slid, 0.0, 0.0]


def test_a_box_that_slid_presses_as_one_built_there() -> None:
    """Slid by three facets, or by half of one, it meets the plank as one that was built there: the
    same points with the same pressures, to the residual of 1e-7 times the softness of contact,
    tenfold. Cuts follow the motion."""
    for slide in (60.0, 10.0):
        here, at = settled_box(0.0, slide)
        there, to = settled_box(slide, 0.0)
        np.testing.assert_allclose(at, to, atol=1e-5)
        np.testing.assert_allclose(here, there, rtol=1e-5)


@pytest.mark.parametrize("method", ["static", "explicit"])
def test_a_brick_on_two_others_and_one_that_hangs_over(method: str, tmp_path: Path) -> None:
    """Facets that lie on two blocks or partly on none count with the area they have on each: two
    halves of 40 cm², and 100 × 70 mm² of a brick moved aside by 10 mm; half of all weight and load
    goes to each support by symmetry: the residual is 1e-6. The load bends the bricks, and without
    friction they would slide off slowly; with it they stay within 3e-3 mm, 4e-5 of the shorter
    side of the joints, and so does the area on which they meet."""
    write_hex_mesh(tmp_path / "coarse.vtu", box_block(WIDE, (4, 3, 2)).mesh)
    write_hex_mesh(tmp_path / "fine.vtu", box_block(WIDE, (5, 4, 3)).mesh)
    path = tmp_path / "own.toml"
    path.write_text(
        """
[block]
type = "mesh"
[[parts]]
file = "coarse.vtu"
fixed = true
places = [{at = [0, 0, 0]}, {at = [100, 0, 0]}]
[[parts]]
file = "fine.vtu"
places = [{at = [50, 0, 50]}, {at = [50, 10, 100]}]
[effects]
gravity = [0, 0, -9810]
[[loads]]
blocks = [3]
force = [0, 0, -4000]
"""
        + SECTIONS,
        "utf-8",
    )
    residual = ["fem.residual=1e-6"] if method == "explicit" else []
    settings = [*residual, "effects.friction.coefficient=0.3", f"fem.method='{method}'"]
    found = on_its_mesh(path, settings).details.contact_state
    weight = 2.4e-9 * 400_000.0 * 9810.0
    for joint, area, force in (
        ((0, 2), 4000.0, 2000.0 + weight),
        ((1, 2), 4000.0, 2000.0 + weight),
        ((2, 3), 7000.0, 4000.0 + weight),
    ):
        points = found.joint(*joint)
        assert found.point_areas[points].sum() == pytest.approx(area, rel=4e-5)
        assert np.abs(found.point_forces[points, 2]).sum() == pytest.approx(force, rel=1e-6)
    assert not len(found.joint(0, 1)) or not found.point_pressures[found.joint(0, 1)].any()


def test_an_overlap_that_no_facet_matches_is_refused() -> None:
    """Boxes 0.05 mm in each other, beyond the law's curve: named with their depth."""
    scene = column(*CROSSING, contact={"law": "exponential"})
    problem = scene.problem
    problem.system.offsets[1:, 2] -= 0.05
    method = Explicit(damping="static")
    with pytest.raises(RefusedError, match=r"deepest 0.05 mm between blocks"):
        solve_explicit(problem, method)


@pytest.mark.parametrize(
    ("clearance", "sliding"), [(0.0, False), (0.1, False), (0.1, True), (5.0, False)]
)
def test_blocks_that_nothing_determines_and_large_motions_are_named(
    clearance: float, sliding: bool, tmp_path: Path
) -> None:
    """A ring of four blocks whose gaps close under pressure, on four points each: fewer than six
    contacts without friction hold no block, whichever way contact is found."""
    mesh = keys(1, 2)
    contact = {"contact.clearance": clearance, "effects.finite_sliding": sliding}
    case = load_case("tsb1-pipe", mesh | contact)
    run = on_its_mesh(case, method="static")
    text = printed(case, tmp_path)
    assert ("4, 5, 6, 7: no contact holds them in every direction" in text) == (clearance > 0.0)
    assert ("large motion" in text) == (clearance == 5.0)
    assert ("large_motion" in run.as_dict()) == (clearance == 5.0)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_contact_forces_of_blocks_that_move_away_end() -> None:
    """They grew until squares of displacements overflowed. Blocks go through the gap of 5 mm until
    their neighbours stop them; what iteration leaves is in balance, and the answer says how far
    they went."""
    mesh = keys(1, 2)
    case = load_case("tsb1-pipe", mesh | {"contact.clearance": 5.0, "fem.degree": 3})
    found = on_its_mesh(case, method="static").as_dict()
    assert found["residual"] < 1e-8
    assert found["imbalance"]["force"] < 1e-8
    assert found["max_displacement"] > 5.0
    assert "large_motion" in found


def test_large_motions_are_not_refined(
    tubelock,  # type: ignore[no-untyped-def]
) -> None:
    """A gap of 5 mm closes, blocks have 79 mm: finer meshes leave an error of that order."""
    box = "{size = [100, 100, 50], divisions = [2, 2, 1]}"
    Path("gap.toml").write_text(
        f'[block]\ntype = "boxes"\nboxes = [{box}, {box}]\n[load]\npressure = 0.5\n'
        "[contact]\nclearance = 5.0\n"
    )
    answer, out = answered("fem", "gap.toml")
    assert answer["large_motion"] == pytest.approx(5.0 / 500000.0 ** (1.0 / 3.0), rel=0.01)
    assert answer["accuracy"]["ended_by"].startswith("the large motion")
    assert answer["accuracy"]["not_reached"]
    assert "for tighter" not in out


@pytest.mark.parametrize("sliding", [False, True])
def test_a_joint_that_opens_altogether_has_an_answer(sliding: bool) -> None:
    """A box on springs under tension moves by p / k; general contact finds no facet that faces it.

    The residual of 1e-8 is of the load, which the springs carry.
    """
    boxes = [((100.0, 100.0, 50.0), (1, 1, 1))] * 2
    spring = {"blocks": [1], "face": "z+", "spring": 0.005}
    effects = {"finite_sliding": sliding}
    pulled = column(*boxes, pressure=-0.5, supports=[spring], effects=effects)
    answer = on_its_mesh(pulled, method="static")
    assert answer.measures["p_max"].value == 0.0
    assert answer.measures["max_displacement"].value == pytest.approx(100.0, rel=1e-6)
    assert answer.as_dict()["loose_blocks"] == []
