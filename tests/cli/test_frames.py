"""Frames: as many as asked, spread over what was run, the end always among them."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from validation import load_case
from validation.output.fields import FrameWriter

COARSE = "mesh.divisions=[4,2,2]"


def written(folder: Path) -> list[float]:
    """Times of the frames; every file is named and none else is there."""
    found = re.findall(r'timestep="([^"]+)" file="([^"]+)"', (folder / "frames.pvd").read_text())
    assert sorted(name for _, name in found) == sorted(p.name for p in folder.glob("frame_*.vtu"))
    return [float(time) for time, _ in found]


def box_frames(folder: Path, count: int, *settings: str):
    box = load_case("cantilever", [COARSE, f"fem.frames={count}", *settings])
    return on_its_mesh(box, on_frame=FrameWriter(folder, box))


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_a_run_that_settles_early_has_all_its_frames(tmp_path: Path, count: int) -> None:
    """It may run 0.5 s and settles after a thirtieth of that: one frame of 10 lay before."""
    settings = ("fem.damping=static", "fem.end_time=0.5", "fem.residual=1e-3")
    run = box_frames(tmp_path, count, *settings)
    assert run.details.run is not None
    assert run.details.run.status == "converged"
    times = written(tmp_path)
    assert len(times) == count
    assert times[-1] == run.details.run.time
    if count > 1:
        assert times[0] == 0.0
        # Of at least as many candidates at equal distances: no gap is twice the mean one, and the
        # last may be as short as it comes.
        assert np.diff(times).max() < 2.0 * run.details.run.time / (count - 1)
    last = meshio.read(tmp_path / f"frame_{count - 1:04d}.vtu").point_data["displacement"]
    np.testing.assert_allclose(
        last, run.details.displacements[0].reshape(-1, 3), rtol=1e-12, atol=1e-300
    )


def test_an_ordinary_run_has_frames_at_equal_times(tmp_path: Path) -> None:
    (tmp_path / "frame_0040.vtu").write_text("of an earlier run")
    run = box_frames(tmp_path, 6, "fem.end_time=2e-3", "fem.ramp_time=1e-3")
    assert run.details.run is not None
    times = np.array(written(tmp_path))
    assert len(times) == 6
    # A frame comes with the first step after its time.
    assert np.abs(times - np.linspace(0.0, 2e-3, 6)).max() <= run.details.run.time_step


def test_frames_of_a_linear_static_run_are_parts_of_its_end(tmp_path: Path) -> None:
    run = box_frames(tmp_path, 5, "fem.method=static")
    assert written(tmp_path) == [0.0, 0.25, 0.5, 0.75, 1.0]
    half = meshio.read(tmp_path / "frame_0002.vtu").point_data["displacement"]
    np.testing.assert_allclose(half, 0.5 * run.details.displacements[0].reshape(-1, 3), rtol=1e-12)


def test_frames_of_a_static_run_of_blocks_are_its_load_steps(tmp_path: Path) -> None:
    """Each is the equilibrium of its part of the load: that of a scene with this load."""
    small = ["mesh.around=6", "mesh.radial=1", "mesh.axial=2", "assembly.layers=1"]
    small += ["block.frequency=0.5", "block.amplitude=10.0"]

    def run(folder: Path | None, *settings: str):
        tube = load_case("tsb1-pipe", [*small, *settings])
        writer = None if folder is None else FrameWriter(folder, tube)
        return on_its_mesh(tube, on_frame=writer)

    full = run(tmp_path, "fem.frames=3")
    assert written(tmp_path) == [0.0, 0.5, 1.0]
    for number, found in (
        (1, run(None, "load.pressure=0.005")),
        (2, full),
    ):
        file = tmp_path / f"frame_{number:04d}.vtu"
        moved = meshio.read(file).point_data["displacement"]
        expected = np.concatenate([u.reshape(-1, 3) for u in found.details.displacements])
        # Newton stops at a residual of 1e-8 of the load; what contact leaves soft moves more.
        np.testing.assert_allclose(moved, expected, atol=1e-5 * np.abs(expected).max())
    assert not (tmp_path / "frame_0003.vtu").exists()


def test_a_resumed_run_keeps_the_frames_before(tmp_path: Path) -> None:
    known: list[Any] = []
    short = ("fem.method=static", "fem.frames=1")
    on_its_mesh("cantilever", [COARSE, *short], on_frame=known.append)
    four = load_case("cantilever", [COARSE, "fem.frames=4"])

    def frames(numbers, *, last: bool, resumed: bool) -> None:
        writer = FrameWriter(tmp_path, four, resumed=resumed)
        for number in numbers:
            ended = last and number == max(numbers)
            writer(replace(known[-1], number=number, time=0.1 * number, last=ended))

    frames(range(13), last=False, resumed=False)
    assert 5 <= len(written(tmp_path)) <= 8
    frames(range(13, 31), last=True, resumed=True)
    times = written(tmp_path)
    assert len(times) == 4
    assert (times[0], times[-1]) == (0.0, 3.0)
    assert np.diff(times).max() < 2.0
