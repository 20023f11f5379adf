"""Sets of mesh files as faces of blocks: supported and loaded by their names."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from geometry import RefusedError, box_block
from tests.support.answers import on_its_mesh
from validation import load_case

pytestmark = pytest.mark.quick

HEIGHT, PRESSURE = 60.0, 2.0
BOX = box_block((40.0, 20.0, HEIGHT), (2, 1, 3))
NODES, ELEMENTS = BOX.mesh.nodes, BOX.mesh.elements
BASE = np.flatnonzero(NODES[:, 2] == 0.0)
EDGE = BASE[NODES[BASE, 0] == 0.0]
SCENE = """
supports = [
    {{face = "{base}", blocks = [0], hold = ["z"], name = "base"}},
    {{plane = {{x = 0.0}}, hold = ["x"]}},
    {{plane = {{y = 0.0}}, hold = ["y"]}},
]
loads = [{{face = "TOP", blocks = [1], pressure = 2.0}}]
[block]
type = "mesh"
units = "mm"
[[parts]]
file = "column.{suffix}"
places = [{{at = [0, 0, 0]}}, {{at = [0, 0, 60]}}]
[material]
density = 2.4e-9
young_modulus = 30000.0
poisson_ratio = 0.2
[fem]
mesh = "scene"
error_estimate = false
"""


def abaqus() -> str:
    """A node set, a surface of an element set, and node sets that are no faces."""
    top = [100 + k for k, nodes in enumerate(NODES[ELEMENTS]) if nodes[:, 2].max() == HEIGHT]
    lines = ["*Node"]
    lines += [f"{k + 10}, {x:g}, {y:g}, {z:g}" for k, (x, y, z) in enumerate(NODES)]
    lines += ["*Element, type=C3D8, elset=ALL"]
    lines += [f"{100 + k}, {', '.join(map(str, row + 10))}" for k, row in enumerate(ELEMENTS)]
    for name, members in (("BASE", BASE), ("EDGE", EDGE), ("_Picked4", EDGE[:1])):
        lines += [f"*Nset, nset={name}", ", ".join(map(str, members + 10))]
    lines += ["*Elset, elset=_TOP_S2, internal", ", ".join(map(str, top))]
    lines += ["*Surface, type=ELEMENT, name=TOP", "_TOP_S2, S2", "*Elset, elset=LAST", "100"]
    return "\n".join(lines) + "\n"


def write(folder: Path, suffix: str, base: str = "BASE") -> str:
    path = folder / f"column.{suffix}"
    if suffix == "inp":
        path.write_text(abaqus(), "utf-8")
    else:
        top = BOX.faces["z+"]
        mesh = meshio.Mesh(
            NODES,
            [("hexahedron", ELEMENTS), ("quad", top), ("quad", BOX.faces["z-"])],
            cell_data={k: [np.full(6, 1), np.full(2, 2), np.full(2, 3)] for k in GMSH},
            field_data={"Top": np.array([2, 2]), "Base": np.array([3, 2])},
        )
        meshio.write(path, mesh, file_format="gmsh22", binary=False)
    scene = folder / "column.toml"
    scene.write_text(SCENE.format(base=base, suffix=suffix), "utf-8")
    return str(scene)


GMSH = ("gmsh:physical", "gmsh:geometrical")


@pytest.mark.parametrize("suffix", ["inp", "msh"])
def test_faces_of_a_file_are_supported_and_loaded_by_name(suffix: str, tmp_path: Path) -> None:
    """A uniform stress, exact for trilinear elements: reaction p A, and the joint passes p."""
    file = load_case(write(tmp_path, suffix))
    answer = on_its_mesh(file, method="static")
    force = PRESSURE * 40.0 * 20.0
    held = answer.report["reactions"]["base"]["force"]
    assert held == pytest.approx([0.0, 0.0, force], abs=1e-8 * force)
    assert answer.details.contact_state.point_pressures == pytest.approx(PRESSURE, rel=1e-8)


def test_sets_that_are_not_there_are_rejected_in_one_line(tmp_path: Path) -> None:
    file = load_case(write(tmp_path, "inp", "NONE"))
    with pytest.raises(
        RefusedError, match=r"block 0 .* expected one of surface, base, top"
    ) as error:
        on_its_mesh(file, method="static")
    assert "\n" not in str(error.value)


ALONE = """
supports = [
    {{{edge}, hold = ["x", "y", "z"], name = "edge"}},
    {{face = "BASE", hold = ["z"], name = "base"}},
]
loads = [{{face = "TOP", traction = [0.4, 0.0, -2.0]}}]
[block]
type = "mesh"
[[parts]]
file = "column.inp"
[material]
density = 2.4e-9
young_modulus = 30000.0
poisson_ratio = 0.2
[fem]
mesh = "scene"
degree = {degree}
error_estimate = false
"""


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_one_block_is_held_by_a_set_that_is_an_edge(degree: int, tmp_path: Path) -> None:
    """As a thin box round that edge holds it, and reactions balance the load."""
    write(tmp_path, "inp")
    answers = []
    for edge in ('face = "EDGE"', "box = [[0, 0, 0], [0, 20, 0]]"):
        scene = tmp_path / "alone.toml"
        scene.write_text(ALONE.format(edge=edge, degree=degree), "utf-8")
        file = load_case(str(scene))
        reactions = on_its_mesh(file, method="static").report["reactions"]
        answers.append([reactions[name]["force"] for name in ("edge", "base")])
    area = 40.0 * 20.0
    assert np.sum(answers[0], axis=0) == pytest.approx([-0.4 * area, 0.0, 2.0 * area], abs=1e-6)
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-8 * area)


def test_a_block_that_nothing_holds_or_touches_is_still_rejected(tmp_path: Path) -> None:
    path = Path(write(tmp_path, "inp"))
    away = "places = [{at = [0, 0, 0]}, {at = [0, 0, 60]}, {at = [500, 0, 0]}]"
    text = path.read_text("utf-8")
    kept = [line for line in text.splitlines() if "plane" not in line]
    path.write_text("\n".join(away if "places" in line else line for line in kept), "utf-8")
    file = load_case(str(path))
    with pytest.raises(RefusedError, match=r"block 2 \(column\) touches no other block"):
        on_its_mesh(file, method="static")
