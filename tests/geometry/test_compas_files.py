"""JSON of compas: transformations compose, and nothing of a file is dropped without a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry import RefusedError, read_blocks
from geometry.files.readers import left_out

pytestmark = pytest.mark.quick

#: Three blocks under two groups, written by compas_model 0.9.3 and compas_dem 0.6.0.
WRITTEN = Path(__file__).parents[1] / "fixtures" / "compas_model.json"

_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
_SIDES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def mesh(x: float = 0.0) -> dict[str, Any]:
    """Unit cube between x and x + 1."""
    return {
        "vertex": {
            str(k): dict(zip("xyz", point, strict=True))
            for k, point in enumerate(np.add(_CORNERS, [x, 0, 0]).tolist())
        },
        "face": dict(enumerate(_SIDES)),
    }


def typed(kind: str, **data: Any) -> dict[str, Any]:
    return {"dtype": f"compas.some/{kind}", "data": data}


def written(folder: Path, data: Any) -> Path:
    path = folder / "a.json"
    path.write_text(json.dumps(data))
    return path


def test_blocks_of_a_written_model_are_where_compas_model_has_them() -> None:
    blocks = read_blocks(WRITTEN, units="m")
    # `modelgeometry.centroid()` of the elements [m].
    expected = [
        [0.0, 0.0, 0.0],
        [0.81339746, -0.040889238, 0.301376957],
        [0.81339746, -0.15909732, 0.683511553],
    ]
    centroids = np.array([block.centroid for block in blocks])
    np.testing.assert_allclose(centroids, 1e3 * np.array(expected), atol=1e-5)
    assert [block.given_name for block in blocks[:2]] == ["base", "drum"]
    assert [block.held for block in blocks] == [True, False, False]


def test_transformations_of_model_group_and_element_compose(tmp_path: Path) -> None:
    matrices = [np.eye(4) for _ in range(4)]
    for matrix, turn in zip(matrices, Rotation.random(4, rng=3).as_matrix(), strict=True):
        matrix[:3] = np.column_stack([turn, turn @ [3.0, -5.0, 7.0]])
    model, group, above, own = (
        typed("Transformation", matrix=matrix.tolist()) for matrix in matrices
    )
    elements = {
        "own": typed("Block", geometry=typed("Mesh", **mesh()), transformation=own),
        "above": typed("Block", geometry=typed("Mesh", **mesh()), transformation=above),
        "group": typed("Group", transformation=group),
    }
    branch = {"element": "above", "children": [{"element": "own"}]}
    root = {"children": [{"element": "group", "children": [branch]}]}
    data = typed("Model", elements=elements, tree={"root": root}, transformation=model)
    blocks = read_blocks(written(tmp_path, data))
    for block, depth in zip(blocks, (4, 3), strict=True):
        place = np.linalg.multi_dot(matrices[:depth]) @ [0.5, 0.5, 0.5, 1.0]
        np.testing.assert_allclose(block.centroid, place[:3], atol=1e-12)


_BOX = {"xsize": 1.0, "ysize": 2.0, "zsize": 3.0}
_TURNED = {"point": [5.0, 0.0, 0.0], "xaxis": [0.0, 1.0, 0.0], "yaxis": [1.0, 0.0, 0.0]}
_JOINT = typed("Interface", mesh=typed("Mesh", **mesh()))
_NODES = {"0": {"block": typed("Block", **mesh()), "is_support": True}, "1": {"block": mesh(1.0)}}


@pytest.mark.parametrize(
    ("data", "n_blocks", "n_held", "others"),
    [
        (typed("Assembly", graph={"node": _NODES, "edge": {}}), 2, 1, []),
        (
            typed("Assembly", graph={"node": _NODES, "edge": {"0": {"1": {"all": [_JOINT]}}}}),
            *(2, 1, ["1 Interface (no block)"]),
        ),
        (
            {
                "assembly": {"node": {"0": {"is_support": True}, "1": {}}, "edge": {}},
                "blocks": {"0": mesh(), "1": mesh(1.0)},
            },
            *(2, 1, []),
        ),
        ({**mesh(2.0), "node": _NODES}, 3, 1, []),
        ([typed("Box", frame=_TURNED, **_BOX), typed("Mesh", **mesh())], 2, 0, []),
        (
            typed(
                "Model",
                elements={"a": typed("Block", geometry=typed("Mesh", **mesh()), features=[_JOINT])},
                materials={"c": typed("Concrete", fck=30)},
                graph={"edge": {"0": {"1": {"contacts": [typed("Contact"), typed("Contact")]}}}},
            ),
            *(1, 0, ["1 Interface (no block)", "1 Concrete (no block)", "2 Contact (no block)"]),
        ),
    ],
)
def test_objects_of_a_file_are_blocks_or_named_as_left_out(
    tmp_path: Path, data: Any, n_blocks: int, n_held: int, others: list[str]
) -> None:
    path = written(tmp_path, data)
    blocks = read_blocks(path)
    assert len(blocks) == n_blocks
    assert sum(block.held for block in blocks) == n_held
    assert left_out(path) == others


def test_a_box_stands_in_its_frame(tmp_path: Path) -> None:
    (box,) = read_blocks(written(tmp_path, [typed("Box", frame=_TURNED, **_BOX)]))
    np.testing.assert_allclose(box.centroid, [5.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.ptp(box.points, axis=0), [2.0, 1.0, 3.0], atol=1e-12)


def test_coordinates_that_a_vertex_leaves_out_are_those_of_its_mesh(tmp_path: Path) -> None:
    raised = mesh() | {"default_vertex_attributes": {"x": 0.0, "y": 0.0, "z": -3.0}}
    for vertex in raised["vertex"].values():
        if vertex["z"] == 0.0:
            del vertex["z"]
    (block,) = read_blocks(str(written(tmp_path, typed("Mesh", **raised))))
    np.testing.assert_allclose(block.centroid, [0.5, 0.5, -1.0], atol=1e-12)
    assert block.volume == pytest.approx(4.0, rel=1e-12)


def test_the_y_axis_of_a_frame_is_turned_square_to_its_x_axis(tmp_path: Path) -> None:
    """As in `compas.geometry.Frame`: the box was skewed, and smaller than it is."""
    skew = _TURNED | {"yaxis": [2.0, 0.5, 0.0]}
    (box,) = read_blocks(written(tmp_path, typed("Box", frame=skew, **_BOX)))
    np.testing.assert_allclose(np.ptp(box.points, axis=0), [2.0, 1.0, 3.0], atol=1e-12)
    assert box.volume == pytest.approx(6.0, rel=1e-12)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (
            [typed("Mesh", **mesh()), typed("Sphere", radius=1.0)],
            "an object is a Sphere, which has no faces",
        ),
        ({"name": "key", **typed("OCCBrep")}, "key is a OCCBrep, which has no faces"),
        (typed("Model", elements={"a": typed("Beam", name="b")}), "element b (Beam) has no mesh"),
    ],
)
def test_a_solid_without_faces_is_rejected_by_name(tmp_path: Path, data: Any, line: str) -> None:
    with pytest.raises(RefusedError) as caught:
        read_blocks(written(tmp_path, data))
    assert line in str(caught.value)
