"""Empty, negative and extreme values of scenes of files and of Python: one line each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import Explicit
from geometry import (
    Assembly,
    Box,
    DetectionOptions,
    HeldFace,
    LineLoad,
    LoadCase,
    Plane,
    PressureLoad,
    RefusedError,
    read_blocks,
)
from tests.support.drawn_blocks import cuboid, write_obj

pytestmark = pytest.mark.quick

_BOXES = {"base": cuboid((0, 0, 0), (100, 100, 50)), "top": cuboid((0, 0, 50), (100, 100, 90))}


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("[[supports]]\nblocks = []\nplane = {z = 0}", "supports.0.blocks: got []"),
        ("[[loads]]\nblocks = []\nplane = {z = 90}\npressure = 1", "loads.0.blocks: got []"),
        ("[[sections]]\nblocks = []\npoint = [0, 0, 60]\nnormal = [0, 0, 1]", "sections.0.blocks"),
        ("[[supports]]\nplane = {z = 0}\nmove = [0, 0, 1]\npath = [[0, 0]]", "two rows at least"),
        ("[[supports]]\nplane = {z = 0}\nmove = [0, 0, 1]\npath = [[0, 1], [1, 1]]", "share of 0"),
        ("[[supports]]\nblocks = [-1]\nplane = {z = 0}", "supports.0.blocks.0: got -1"),
        ("[detection]\ntolerance = 1e-40", "or more"),
    ],
)
def test_wrong_values_of_a_scene_of_files_get_one_line(
    tubelock: Callable[..., tuple[int, str, str]], lines: str, words: str
) -> None:
    write_obj(Path("a.obj"), _BOXES)
    Path("a.toml").write_text(
        f'[block]\ntype = "mesh"\n[[parts]]\nfile = "a.obj"\n[assembly]\nfixed = [0]\n{lines}\n'
    )
    status, out, told = tubelock("mbd", "a.toml")
    assert (status, out, told.count("\n")) == (2, "", 1)
    assert words in told


def _assembly(**options: Any) -> Assembly:
    return Assembly.from_blocks([*_BOXES.values()], **{"fixed": 0} | options)


def _load(*faces: Any, **more: Any) -> LoadCase:
    blocks: Any = _assembly()
    return LoadCase(blocks, "load", faces, blocks.fixed, **more)


def _small(size: float) -> Assembly:
    blocks = [cuboid((0, 0, k * size), (size, size, (k + 1) * size)) for k in (0, 1)]
    return Assembly.from_blocks(blocks, fixed=0)


_Z, _WHERE = np.array([0.0, 0.0, 1.0]), Plane([0.0, 0.0, 90.0], [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: _assembly(fixed=-1), "fixed: got block -1"),
        (lambda: _assembly(fixed=2), "fixed: got block 2"),
        (lambda: _assembly(repair="no"), "repair: got 'no'; expected True or False"),
        (lambda: read_blocks(Path("a.obj"), repair=1), "repair: got 1; expected True or False"),
        (lambda: _assembly(detection=DetectionOptions(tolerance=1e-300)), "1e-12 mm or more"),
        (lambda: _small(1e-200), "all vertices lie within 1e-200 units"),
        (lambda: _small(1e40), "1e+30 units away or more"),
        (lambda: Box((0, 0), (1, 1)), "box: got [0.0, 0.0]; expected three numbers"),
        (lambda: Box((0, 0, "a"), (1, 1, 1)), "low: got (0, 0, 'a'); expected an array"),
        (lambda: Plane((0, 0, 0), (0, 0, 0)), "plane: got the normal [0, 0, 0]"),
        (lambda: _load(PressureLoad([], _WHERE, 1.0)), "load: got blocks []"),
        (lambda: _load(PressureLoad([-1], _WHERE, 1.0)), "load: got block -1"),
        (lambda: _load(lines=(LineLoad([-1], _Z, 2 * _Z, _Z),)), "load: got block -1"),
        (lambda: _load(held=(HeldFace(-1, _WHERE),)), "got block -1"),
        (lambda: HeldFace(1, _WHERE, displacement=_Z, path=((0.0, 0.0),)), "two rows at least"),
        (lambda: Explicit(safety_factor=1e-300), "safety_factor: got 1e-300"),
    ],
)
def test_wrong_values_in_python_get_one_line(make: Callable[[], object], words: str) -> None:
    with pytest.raises(RefusedError) as caught:
        make()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_lists_and_tuples_stand_for_arrays() -> None:
    """Boxes and planes of tuples choose what those of arrays choose."""
    for where in (Box((0, 0, 90), (100, 100, 90)), Plane((0, 0, 90), [0, 0, 1])):
        load = _load(PressureLoad((1,), where, 2.0))
        np.testing.assert_allclose(load.facet_forces.sum(axis=0), [0.0, 0.0, -2e4])


def test_a_file_that_ends_in_an_object_of_points_alone_is_rejected(tmp_path: Path) -> None:
    """Cut anywhere, a file is read whole or rejected: no object is lost."""
    path = tmp_path / "a.obj"
    write_obj(path, _BOXES)
    text = path.read_text()
    for end in range(text.index("top") + 3, len(text.rstrip()), 7):
        path.write_text(text[:end])
        with pytest.raises(RefusedError):
            read_blocks(path)
    path.write_text(text)
    assert len(read_blocks(path)) == 2
