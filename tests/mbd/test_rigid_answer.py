"""What the rigid answer states of itself: sliding that can be checked, jams, symmetry, measures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from geometry import Answer, CircularArch, Polyhedron, convex_polyhedron
from geometry.parts.measures import first_largest
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.options import FrictionLaw
from tests.support.commands import command
from validation import load_case, solve


def solved(path: Path | str, *settings: str) -> Answer:
    file = load_case(str(path), list(settings))
    return solve(file.with_method("rigid"))


# ---------------------------------------------------------------------------------------------
# A flat arch that friction jams

FRICTION, WEIGHT_DENSITY = 0.6, 2.4e-9 * 9810.0


def wedge(low: tuple[float, float], high: tuple[float, float]) -> Polyhedron:
    """Prism 100 mm high and deep between x limits at its bottom and its top."""
    sides = zip(low, high, strict=True)
    corners = [[x, y, z] for a, b in sides for x, z in ((a, 0.0), (b, 100.0)) for y in (0.0, 100.0)]
    return convex_polyhedron("wedge", corners)


def flat_arch(folder: Path) -> Path:
    """Two wedges and a keystone between fixed blocks: joints lean by 20, 10, 10 and 20 degrees."""
    inner, outer = 100.0 * np.tan(np.radians([10.0, 20.0]))
    feet = np.array([-250.0, -150.0, -50.0, 50.0, 150.0, 250.0])
    tops = feet + np.array([0.0, -outer, -inner, inner, outer, 0.0])
    lines = ["[block]", 'type = "mesh"', "[effects]", "gravity = [0, 0, -9810]"]
    lines += [f"friction = {FRICTION}", "[[loads]]", "blocks = [1]", "force = [0, 0, 1000]"]
    lines += ["[rigid]", "collapse = true", "sliding = true"]
    for k in range(5):
        shape = wedge((feet[k], feet[k + 1]), (tops[k], tops[k + 1]))
        meshio.write(
            folder / f"{k}.stl", meshio.Mesh(shape.points, [("triangle", shape.triangles)])
        )
        fixed = str(k in (0, 4)).lower()
        lines += ["[[parts]]", f'file = "{k}.stl"', f"fixed = {fixed}", "[[parts.places]]"]
    path = folder / "flat.toml"
    path.write_text("\n".join(lines))
    return path


def test_a_jam_of_associated_friction_is_no_proof_that_nothing_slides(tmp_path: Path) -> None:
    run = solved(flat_arch(tmp_path))
    collapse, sliding = (run.parts[name] for name in ("collapse", "sliding"))
    ranges = run.parts["ranges"]
    assert np.isinf(collapse.factor)
    assert "associated friction" in collapse.status
    assert "no crushing" in collapse.status
    # The analysis without dilation runs there, and the range of the forces is told unasked.
    assert sliding.certified
    assert 0.0 < sliding.factor < 1.0
    assert ranges.unbounded.all()


def multiplied_out(sliding: dict[str, Any]) -> dict[str, float]:
    """Every law of dry friction from the numbers of the JSON alone."""
    blocks = {row["block"]: row for row in sliding["blocks"]}
    rest = {
        k: np.concatenate(
            [
                np.array(row["dead_force"]) + sliding["factor"] * np.array(row["live_force"]),
                np.array(row["dead_moment"]) + sliding["factor"] * np.array(row["live_moment"]),
            ]
        )
        for k, row in blocks.items()
    }
    work = [0.0, 0.0, 0.0]
    excess = overlap = 0.0
    for contact in sliding["contacts"]:
        point, normal, force = (np.array(contact[key]) for key in ("point", "normal", "force"))
        relative = np.zeros(3)
        for k, sign in zip(contact["blocks"], (-1.0, 1.0), strict=True):
            if k in blocks:
                arm = point - np.array(blocks[k]["centroid"])
                rest[k] += sign * np.concatenate([force, np.cross(arm, force)])
                turn = np.cross(blocks[k]["rotation"], arm)
                relative += sign * (np.array(blocks[k]["displacement"]) + turn)
        pressed, opening = float(force @ normal), float(relative @ normal)
        shear, slip = force - pressed * normal, relative - opening * normal
        excess = max(excess, float(np.linalg.norm(shear)) - FRICTION * pressed)
        overlap = max(overlap, -opening)
        work[0] += pressed * opening
        work[1] += FRICTION * pressed * float(np.linalg.norm(slip)) + float(shear @ slip)
        work[2] += pressed * float(np.linalg.norm(relative))
    size = max(abs(c) for contact in sliding["contacts"] for c in contact["force"])
    length = 100.0
    imbalance = max(max(np.abs(r[:3]).max(), np.abs(r[3:]).max() / length) for r in rest.values())
    return {
        "imbalance": float(imbalance) / size,
        "excess": float(excess) / size,
        "overlap": overlap,
        "opening under pressure": abs(work[0]) / work[2],
        "friction off its limit or not against the slip": abs(work[1]) / work[2],
    }


def test_certified_sliding_can_be_checked_from_the_json(tmp_path: Path) -> None:
    """STL files round corners to 1e-7 of their size; programs are solved to 1e-7."""
    answer = solved(flat_arch(tmp_path)).as_dict()
    sliding = answer["sliding"]
    assert sliding["certified"]
    laws = multiplied_out(sliding)
    assert max(laws.values()) < 1e-5, laws
    # The same rows with rotations in other units, as the JSON says.
    rows = np.array(sliding["mechanism"])
    rotations = np.array([block["rotation"] for block in sliding["blocks"]])
    np.testing.assert_allclose(rows[:, 3:], rotations * answer["rotation_length"], atol=1e-15)
    assert "rotation_length" in answer["units"]["mechanism"]
    assert [block["block"] for block in sliding["blocks"]] == answer["free_blocks"]
    # Another factor, or another friction, does not pass.
    assert max(multiplied_out(sliding | {"factor": 1.1 * sliding["factor"]}).values()) > 1e-4


# ---------------------------------------------------------------------------------------------
# The state that is shown


@pytest.mark.parametrize("law", list(FrictionLaw))
@pytest.mark.parametrize("turn", [0.0, 45.0, 30.0])
def test_the_frictional_state_of_a_symmetric_arch_is_symmetric(
    law: FrictionLaw, turn: float
) -> None:
    """The state of least norm is one, and so is its mirror image: they are the same."""
    arch = CircularArch(1000.0, 250.0, 300.0, 9).build()
    angle = np.radians(turn)
    about = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    object.__setattr__(arch, "rotations", about @ arch.rotations)
    object.__setattr__(arch, "translations", arch.translations @ about.T)
    contacts = contact_jacobian(arch)
    weight = np.zeros((len(contacts.free_blocks), 6))
    weight[:, 2] = -WEIGHT_DENSITY * arch.volumes[contacts.free_blocks]
    frictional = frictional_contacts(arch, contacts, 0.7, law)
    found = frictional_equilibrium(frictional, weight.ravel())
    assert found.holds
    joints = _normal_forces(contacts.block_m, found.forces[:, 0])
    # Clarabel's tolerance 1e-11 of forces, of which the norm is the square.
    np.testing.assert_allclose(joints, joints[::-1], rtol=1e-5)


def _normal_forces(joint: np.ndarray, forces: np.ndarray) -> np.ndarray:
    return np.array([forces[joint == k].sum() for k in np.unique(joint)])


# ---------------------------------------------------------------------------------------------
# First rows

TUBE = """
[block]
type = "sine"
height = 200.0
amplitude = {amplitude}
frequency = 1.5
shift = 0.0
blocks_per_layer = 6
inner_radius = 120.0
thickness = 60.0
[assembly]
layers = 2
[mesh]
around = 36
radial = {radial}
axial = 6
[load]
case = "{case}"
pressure = 0.01
"""


def tube(folder: Path, case: str, *, amplitude: float = 20.0, radial: int = 2) -> Answer:
    path = folder / "tube.toml"
    path.write_text(TUBE.format(case=case, amplitude=amplitude, radial=radial))
    return solve(load_case(str(path), method="rigid"))


def test_the_largest_pressure_is_the_largest_of_all_contacts(tmp_path: Path) -> None:
    run = tube(tmp_path, "tunnel")
    peak = run.as_dict()["measures"]["p_max_facet"]
    pressures = run.contacts["pressure"]
    assert peak["value"] == pressures.max()
    assert peak["value"] >= run["p_max"].value
    contact = run.details.contact_index[first_largest(pressures)]
    found, place = run.details.blocks.interfaces, peak["place"]
    np.testing.assert_allclose(place["position"], found.centroids[contact])
    assert place["blocks"] == [found.block_m[contact], found.block_s[contact]]
    assert place["layer"] == run.details.blocks.layer[place["blocks"][0]]
    # The face is the one whose facets have their middle there.
    block = place["blocks"][0]
    quads = run.details.blocks.shape(block).faces[place["face"]]
    middles = run.details.blocks.nodes(block)[quads].mean(axis=1)
    assert np.linalg.norm(middles - found.centroids[contact], axis=1).min() < 1e-9


@pytest.mark.parametrize("scene", ["wall", "arch", "tetrahedra"])
def test_the_supports_carry_the_weight(scene: str) -> None:
    run = solved(scene, "effects.friction=1.0", "rigid.margin=false")
    answer = run.as_dict()
    found = answer["measures"]
    weight = run.details.load.body_wrenches
    assert weight is not None
    applied = weight[~run.details.load.fixed, :3].sum(axis=0)
    # Residual of an equilibrium, relative to the load.
    size = np.linalg.norm(applied)
    np.testing.assert_allclose(answer["reaction"], -applied, atol=1e-6 * size)
    assert found["total_reaction"]["value"] == np.linalg.norm(answer["reaction"])
    forces = [joint["normal_force"] for joint in answer["joints"]]
    noise = 1e-9 * max(forces)  # round-off is printed as zero
    assert found["least_joint_force"]["value"] == pytest.approx(min(forces), abs=noise)
    assert found["largest_joint_force"]["value"] == max(forces)


@pytest.mark.parametrize(
    ("case", "radius", "sense"), [("tunnel", 180.0, "compression"), ("pipe", 120.0, "tension")]
)
def test_ring_pressure_by_hand(tmp_path: Path, case: str, radius: float, sense: str) -> None:
    ring = tube(tmp_path, case).as_dict()["ring_pressure"]
    assert ring["value"] == pytest.approx(0.01 * radius / 60.0, rel=1e-15)
    assert ring["sense"] == sense
    assert "ring_pressure" not in tube(tmp_path, "shaft").as_dict()


def test_the_default_norm_gives_the_ring_pressure_on_any_mesh(tmp_path: Path) -> None:
    """Straight joints of a tube in a pressure of 0.01 MPa: p·r/t, whatever the facets are."""
    for radial in (1, 2, 4):
        run = tube(tmp_path, "tunnel", amplitude=0.0, radial=radial)
        upright = np.abs(run.details.blocks.interfaces.normals[run.details.contact_index, 2]) < 1e-6
        pressures = run.contacts["pressure"][upright]
        areas = run.details.blocks.interfaces.areas[run.details.contact_index][upright]
        assert pressures @ areas / areas.sum() == pytest.approx(0.03, rel=0.02)
        if radial == 1:
            # One facet through the wall: its mean is that of the joint.
            assert run["p_max_facet"].value == pytest.approx(0.03, rel=0.02)


def test_first_rows_are_printed_before_the_paper_s_measures(tmp_path: Path) -> None:
    tube(tmp_path, "tunnel")
    told = ("--json", str(tmp_path / "answer.json"))
    status, words, said = command("mbd", str(tmp_path / "tube.toml"), *told)
    assert status == 0, said
    order = ["verdict", "in equilibrium", "largest contact pressure", "normal forces of joints"]
    order += [
        "total reaction",
        "the paper's measures",
        "p_eff (formula)",
        "p_max",
        "hoop stress p·r/t",
    ]
    places = [words.index(f"│ {row} ") for row in order]
    assert places == sorted(places)
    assert 'norm = "pressure"' in words
    # Of contacts at points, which solids have; those of a tube are facets.
    assert "largest contact force" not in words
