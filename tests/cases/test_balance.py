"""Printed forces balance every block: all built-in scenes by all methods, and random assemblies."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from fem import solve_static
from geometry import Answer
from tests.fixtures.commands import small_meshes
from tests.support.coarse_tubes import keys, pressed
from validation import load_case, solve

#: Static answers on the mesh of the scene; error bars would take another solution.
ON_ITS_MESH = {"fem.mesh": "scene", "fem.error_estimate": False}
SCENES = sorted(file.stem for file in Path(str(files("validation") / "scenes")).glob("*.toml"))
TUBE = keys(1, 2)
TWISTED = {"assembly.layers": 1, "mesh.edge": 2, "mesh.radial": 1}
SMALL: dict[str, dict[str, Any]] = {
    "osteomorphic": {"assembly.columns": 1, "assembly.layers": 1, "mesh.divisions": [4, 2, 2]},
    "planar-sine": {"assembly.columns": 1, "assembly.layers": 1, "mesh.divisions": [12, 2, 2]},
    "arch": {"assembly.voussoirs": 5, "block.thickness": 200.0},
    "wall": {"assembly.rows": 2, "assembly.columns": 2},
}
SMALL |= {s: TUBE for s in SCENES if s.startswith("tsb")}
SMALL |= {s: TWISTED for s in SCENES if s.startswith("thb0")}
BODIES = {"beam-on-springs", "cantilever", "spinning-block"}
MOVED = {"cattaneo-mindlin", "hertz-ball", "hertz-roller", "shifted-boxes"}
#: Scenes that have no answer of a method to balance.
WITHOUT = {
    "rigid": BODIES | MOVED | {"brick-stack", "tetrahedra"},  # their load drives a mechanism
    # No contact; mechanisms without friction; folded hexahedra.
    "static": BODIES | {"arch", "brick-stack", "tetrahedra", "thb0-pillar", "voxel-puzzle", "wall"},
    "explicit": BODIES | {"voxel-puzzle"},
}
#: Deformable blocks of these, on which nothing acts, are given a push.
UNLOADED = {"cubes", "octahedra"}
PUSH = {"loads": [{"blocks": [18], "force": [0.0, 0.0, -10.0]}]}
#: Scenes of more than 3 CPU s.
EXPENSIVE = {
    "rigid": {"pushed-panel"},
    "static": MOVED - {"shifted-boxes"}
    | {"octahedra", "pushed-panel", "versatile", "versatile-panel"},
    "explicit": {"arch", "brick-stack", "cattaneo-mindlin", "hertz-ball", "hertz-roller"},
}
#: Tubes of which `make test` has one of the family by this method.
ALIKE = ("tsb2-", "thb0-beam", "thb0-shaft", "thb0-pillar")
CASES = [
    pytest.param(
        *(scene, method),
        marks=[pytest.mark.thorough] * (method != "rigid" and scene.startswith(ALIKE)),
    )
    for method, without in WITHOUT.items()
    for scene in SCENES
    if scene not in without | EXPENSIVE[method]
]


def imbalance(answer: Answer) -> float:
    """Force and moment that are left, the larger one [-]."""
    left = answer.report["imbalance"]
    return max(left["force"], left["moment"])


@pytest.mark.parametrize(("scene", "method"), CASES)
def test_joints_loads_and_reactions_balance_every_block(scene: str, method: str) -> None:
    """To 1e-6 and ten times the residual; explicit runs, far from rest, with m a and damping."""
    settings = SMALL.get(scene, {})
    if method == "rigid" and scene.startswith("thb0"):
        settings = {"assembly.layers": 1}  # coarse facets of these let blocks slide
    elif method == "static":
        settings = settings | ON_ITS_MESH | {"fem.method": "static"}
    elif method == "explicit":
        settings = settings | {"fem.method": "explicit", "fem.end_time": 5e-5}
    if method != "rigid" and scene in UNLOADED:
        settings = settings | PUSH
    answer = solve(load_case(scene, settings, method=method))
    allowed = 1e-6
    if method == "static":
        allowed = max(allowed, 10.0 * answer.report["residual"])
    assert answer.report["joints"]
    assert imbalance(answer) <= allowed


# ---------------------------------------------------------------------------------------------
# Random assemblies


def random_case(seed: int) -> tuple[str, dict[str, Any]]:
    """A wall that is pushed, an arch, a tube or a column, with sizes and friction by chance."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(60.0, 240.0, 3).round(1).tolist()
    kind = ("wall", "arch", "tsb1-pipe", "column")[seed % 4]
    if kind == "wall":
        push = float(rng.choice([-1.0, 1.0]) * rng.uniform(100.0, 300.0))
        return kind, {
            "block.size": size,
            "assembly.rows": int(rng.integers(1, 4)),
            "assembly.columns": int(rng.integers(1, 4)),
            "load.acceleration": [push, 0.0, 0.0],
            "effects.friction": 0.7,
            "rigid.collapse": False,
        }
    if kind == "arch":
        return kind, {
            "assembly.voussoirs": int(rng.integers(2, 8)),
            "block.thickness": float(rng.uniform(200.0, 350.0)),
            "block.depth": size[0],
        }
    if kind == "tsb1-pipe":
        return kind, TUBE | {
            "block.amplitude": float(rng.uniform(8.0, 25.0)),
            "block.thickness": float(rng.uniform(30.0, 60.0)),
            "load.pressure": float(rng.uniform(0.01, 0.1)),
            "effects.gravity": [0.0, 0.0, -9810.0],
        }
    boxes = [
        {"size": rng.uniform(60.0, 240.0, 3).round(1).tolist(), "divisions": [2, 2, 1]}
        for _ in range(int(rng.integers(2, 5)))
    ]
    return kind, {"block.boxes": boxes, "load.pressure": float(rng.uniform(0.1, 1.0))}


def left_by_hand(answer: Answer) -> np.ndarray:
    """Force, and moment over the length of a block, of joints and loads on each free block [N]."""
    blocks, load = answer.details.blocks, answer.details.load
    wrench = load.wrenches.copy()
    for joint in answer.report["joints"]:
        force, moment = (np.array(joint[name]) for name in ("force", "moment"))
        for block, sign in zip(joint["blocks"], (-1.0, 1.0), strict=True):
            arm = np.array(joint["centroid"]) - blocks.centroids[block]
            both = np.concatenate([force, moment + np.cross(arm, force)])
            wrench[block] += sign * both
    wrench[:, 3:] /= blocks.characteristic_length
    return wrench[~load.fixed]


@pytest.mark.parametrize("seed", range(16))
def test_random_rigid_assemblies_are_balanced_by_their_table_of_joints(seed: int) -> None:
    """Summed here from the table alone, by the residual of 1e-6 that an equilibrium may have. What
    holds fixed blocks is together minus all loads."""
    scene, settings = random_case(seed)
    answer = solve(load_case(scene, settings, method="rigid"))
    assert answer.report["carried"]
    largest = max(np.linalg.norm(joint["force"]) for joint in answer.report["joints"])
    left = np.linalg.norm(left_by_hand(answer).reshape(-1, 2, 3), axis=2)
    assert left.max() <= 1e-6 * largest
    assert imbalance(answer) <= 1e-6
    reactions = answer.report["reactions"].values()
    total = sum(np.array(of["force"]) for of in reactions)
    loads = answer.details.load.wrenches[:, :3].sum(axis=0)
    assert np.linalg.norm(total + loads) <= 1e-6 * largest


@pytest.mark.parametrize(
    ("seed", "method"),
    [(0, "static"), (4, "static"), (0, "explicit")],
)
def test_random_deformable_assemblies_with_friction_are_balanced(seed: int, method: str) -> None:
    """Walls that friction alone holds, on the mesh of the scene."""
    scene, settings = random_case(seed)
    settings |= {"effects.friction": {"coefficient": 0.7}}
    more = ON_ITS_MESH if method == "static" else {"fem.end_time": 5e-5}
    answer = solve(load_case(scene, settings | more | {"fem.method": method}, method=method))
    assert imbalance(answer) <= max(1e-6, 10.0 * answer.report["residual"] * (method == "static"))


# ---------------------------------------------------------------------------------------------
# Closed forms


@pytest.mark.parametrize("method", ["rigid", "static"])
def test_an_arch_pushes_its_abutments_apart(method: str) -> None:
    """Half its weight on each, and thrusts that are equal and opposite: their sum is vertical."""
    settings = {"assembly.voussoirs": 5, "block.thickness": 200.0}
    if method == "static":
        settings |= ON_ITS_MESH | {"effects.friction": {"coefficient": 1.0}}
    answer = solve(load_case("arch", settings, method=method))
    one, two = (np.array(of["force"]) for of in answer.report["reactions"].values())
    weight = one[2] + two[2]
    thrust = [of["horizontal"] for of in answer.report["reactions"].values()]
    near = 1e-6 if method == "rigid" else 1e-5
    assert one[2] == pytest.approx(0.5 * weight, rel=near)
    assert one[:2] == pytest.approx(-two[:2], abs=near * weight)
    assert thrust == pytest.approx([abs(one[0])] * 2, rel=near)
    assert thrust[0] > 0.1 * weight


PLATE = """
[block]
type = "mesh"
[[parts]]
file = "plate.stl"
[[parts.places]]
at = [0, 0, 0]
fixed = true
[[parts]]
file = "block.stl"
[[parts.places]]
at = [0, 0, 0]
[effects]
gravity = [0, 0, -9810.0]
[material]
density = 2.4e-9
young_modulus = 33000.0
poisson_ratio = 0.2
[mesh]
size = {size}
[fem]
mesh = "scene"
error_estimate = false
"""
#: Corners of a block that overhangs its square base by half [50 mm], and its triangles from 1.
CORNERS = ((0, 0, 0), (2, 0, 0), (2, -2, 0), (0, -2, 0), (1, 1, 1), (2, 0, 1), (1, -1, 1))
CORNERS += ((0, -2, 1), (-1, -1, 1))
TRIANGLES = "124 234 765 987 975 195 215 562 726 327 437 784 489 491"


def write_plate(folder: Path, angle: float, size: float) -> tuple[Path, float]:
    """A block on a fixed plate, turned by an angle [degrees]; its scene and its volume [mm³]."""
    import pyvista as pv

    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    points = 50.0 * np.array(CORNERS, float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0, 0, 1.0]])
    sides = [[int(k) - 1 for k in word] for word in TRIANGLES.split()]
    pv.PolyData(points, np.hstack([[3, *side] for side in sides])).save(folder / "block.stl")
    plate = pv.Cube(center=(0, 0, -25), x_length=600, y_length=600, z_length=50)
    plate.triangulate().save(folder / "plate.stl")
    scene = folder / "plate.toml"
    scene.write_text(PLATE.format(size=size), "utf-8")
    a, b, d = points[np.array(sides)].transpose(1, 0, 2)
    return scene, float((a * np.cross(b, d)).sum() / 6.0)


@pytest.mark.parametrize(
    ("angle", "size", "degree"), [(0.0, 79.4, 1), (20.0, 79.4, 1), (20.0, 50.0, 1), (0.0, 120.0, 2)]
)
def test_a_joint_carries_the_weight_of_the_block_on_it(
    tmp_path: Path, angle: float, size: float, degree: int
) -> None:
    """Whatever the mesh: some facets press at a few of their points and gape elsewhere. Corners of
    an STL file are rounded to 6e-8."""
    scene, volume = write_plate(tmp_path, angle, size)
    answer = solve(load_case(scene, {"fem.degree": degree}))
    weight = volume * 2.4e-9 * 9810.0
    (joint,) = answer.report["joints"]
    near = max(1e-7, 10.0 * answer.report["residual"])
    assert joint["force"][2] == pytest.approx(weight, rel=near)
    assert answer.contacts["force"][:, 2].sum() == pytest.approx(weight, rel=near)
    assert answer.contacts["pressure"] @ answer.contacts["area"] == pytest.approx(weight, rel=1e-6)
    (base,) = answer.report["reactions"].values()
    assert base["force"][2] == pytest.approx(weight, rel=near)
    assert base["horizontal"] < 1e-6 * weight


@pytest.mark.parametrize("method", ["rigid", "static"])
def test_a_load_that_balances_itself_is_measured_by_its_parts(method: str) -> None:
    """A block pressed from both sides: resultant and joint forces are zero, and what is left of
    them is round-off of the pressures on its sides, 3 600 N each."""
    size = {"size": [60.0, 60.0, 60.0], "divisions": [2, 2, 2]}
    sides = [{"blocks": [1], "face": face, "pressure": 1.0} for face in ("x+", "x-")]
    scene = {"block": {"type": "boxes", "boxes": [size] * 2}, "loads": sides}
    scene["material"] = {"name": "concrete"}
    more = ON_ITS_MESH if method == "static" else {}
    answer = solve(load_case(scene, more, method=method))
    assert imbalance(answer) <= 1e-6


def test_no_friction_is_friction_of_zero() -> None:
    """In Python too: the same measures with the same error bars, from the same work."""
    problem = pressed()
    with small_meshes(1, 2):
        without, zero = (solve_static(replace(problem, friction=mu)) for mu in (None, 0.0))
    assert {n: m.as_json() for n, m in zero.measures.items()} == {
        n: m.as_json() for n, m in without.measures.items()
    }
    assert zero.report["work"]["done"] == without.report["work"]["done"]


# ---------------------------------------------------------------------------------------------
# Reactions

BOX = {"size": [100.0, 100.0, 100.0], "divisions": [2, 2, 2]}
#: Statements of two boxes, the lower one of which counts as fixed to rigid blocks.
STATED: dict[str, dict[str, Any]] = {
    "a support on the fixed block": {"supports": [{"blocks": [0], "face": "z-", "name": "foot"}]},
    "a force on the fixed block": {
        "loads": [
            {"blocks": [1], "face": "z+", "force": [0, 0, -600.0]},
            {"blocks": [0], "face": "z+", "force": [0, 0, -5.0]},
        ],
        "load": {"pressure": 0.0},
    },
    "weight": {"effects": {"gravity": [0.0, 0.0, -9810.0]}},
}


@pytest.mark.parametrize("stated", STATED)
def test_reactions_on_a_block_that_counts_as_fixed_balance_all_loads(stated: str) -> None:
    """Whether it is stated or weight, and whichever method: no load counts twice or not at all."""
    scene = {"block": {"type": "boxes", "boxes": [BOX] * 2}, "load": {"pressure": 0.06}}
    totals = []
    for method, mesh in (("rigid", {}), ("static", ON_ITS_MESH)):
        case = load_case(scene | STATED[stated], mesh, method=method)
        problem = case.problem
        weight = problem.rigid_weight
        loads = problem.load_case.wrenches[:, :3].sum(axis=0)
        loads = loads + (0.0 if weight is None else weight[:, :3].sum(axis=0))
        reactions = solve(case).report["reactions"].values()
        totals.append(sum(np.array(reaction["force"]) for reaction in reactions))
        assert totals[-1] == pytest.approx(-loads, abs=1e-6 * np.linalg.norm(loads))
    assert totals[0] == pytest.approx(totals[1], abs=1e-6 * np.linalg.norm(totals[0]))


@pytest.mark.parametrize("method", ["rigid", "static"])
def test_a_support_of_several_blocks_has_the_thrust_of_its_parts(
    tmp_path: Path, method: str
) -> None:
    """Four columns below a plate, each pulled outwards by 5 N: without friction each base alone
    takes its pull, and though together they are none, the support is pushed outwards by 20 N."""
    names, ways = "abcd", np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    for name, way in zip(names, ways, strict=True):
        column = trimesh.creation.box((60.0, 60.0, 100.0))
        column.apply_translation((*(100.0 * way), 50.0))
        column.export(tmp_path / f"{name}.stl")
    plate = trimesh.creation.box((300.0, 300.0, 50.0))
    plate.apply_translation((0.0, 0.0, 125.0))
    plate.export(tmp_path / "plate.stl")
    pulls = [{"blocks": [k], "force": [*(5.0 * way), 0.0]} for k, way in enumerate(ways)]
    base = {"name": "ring", "blocks": [0, 1, 2, 3], "plane": {"z": 0.0}, "hold": ["x", "y", "z"]}
    scene = {
        "block": {"type": "mesh"},
        "parts": [{"file": str(tmp_path / f"{name}.stl")} for name in (*names, "plate")],
        "supports": [base],
        "loads": pulls,
        "effects": {"gravity": [0.0, 0.0, -9810.0]},
        "material": {"name": "concrete"},
    }
    more = ON_ITS_MESH if method == "static" else {}
    reaction = solve(load_case(scene, more, method=method)).report["reactions"]["ring"]
    # Joints turn with the columns that bend: their share of the weight is below 1e-5 of the pulls.
    assert np.linalg.norm(reaction["force"][:2]) < 1e-6 * reaction["force"][2]
    assert reaction["outward"] == pytest.approx(20.0, rel=1e-5)
    assert reaction["horizontal"] == reaction["outward"]
