"""Files of runs: readers of others open them all, and they belong to one answer."""

import math
from dataclasses import replace

import pytest
import pyvista

from mbd import analyse
from tests.support.coarse_tubes import coarse
from tests.support.commands import command
from validation import load_case, read_answer, write

TUBE = tuple(word for setting in coarse(1, 4) for word in ("--set", setting))
STATIC = (*TUBE, "--set", "fem.mesh=scene", "--set", "fem.error_estimate=false")
EXPLICIT = (
    *("--set", "fem.method=explicit", "--set", "fem.end_time=2e-5", "--set", "fem.frames=3"),
)
RUNS = {
    "rigid tube": ("mbd", "tsb1-pipe", *TUBE),
    "rigid blocks": ("mbd", "cubes"),
    "static": ("fem", "tsb1-pipe", *STATIC, "--set", "fem.frames=2"),
    "explicit": ("fem", "tsb1-pipe", *TUBE, *EXPLICIT),
    "explicit, the paper's damping": (
        *("fem", "tsb1-pipe", *TUBE, *EXPLICIT, "--set", "fem.damping=paper"),
    ),
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("words", RUNS.values(), ids=RUNS)
def test_a_reader_of_others_opens_every_field_that_is_written(tmp_path, words):
    status, _, printed = command(*words, "--fields", "-o", str(tmp_path))
    assert status == 0, printed
    meshes = [path for path in tmp_path.iterdir() if path.suffix in (".vtu", ".pvd")]
    assert meshes
    for path in meshes:
        reader = pyvista.get_reader(str(path))
        if path.suffix == ".pvd":
            assert len(reader.time_values) == len(list(tmp_path.glob("frame_*.vtu"))) > 1
            assert all(map(math.isfinite, reader.time_values))
            reader.set_active_time_value(reader.time_values[-1])
        mesh = reader.read()
        mesh = mesh[0] if path.suffix == ".pvd" else mesh
        assert mesh.n_points
        assert mesh.n_cells


def test_a_reader_of_others_opens_blocks_that_are_exported(tmp_path):
    path = tmp_path / "cubes.obj"
    status, _, printed = command("export", "cubes", "-o", str(path))
    assert status == 0, printed
    assert pyvista.read(path).n_cells


@pytest.mark.usefixtures("undrawn")
def test_a_run_removes_what_it_would_have_replaced_and_nothing_else(tmp_path):
    others = [tmp_path / name for name in ("mine.png", "mechanism.txt", "frame_of_mine.vtu")]
    for path in others:
        path.write_text("mine", "utf-8")
    loose = ("mbd", "tsb1-pipe", *TUBE, "--set", "block.amplitude=0", "-o", str(tmp_path))
    assert command(*loose)[0] == 0
    assert (tmp_path / "mechanism.png").exists()
    assert command("mbd", "tsb1-pipe", *TUBE, "-o", str(tmp_path))[0] == 0
    assert not (tmp_path / "mechanism.png").exists()
    rigid = {path.name for path in tmp_path.iterdir()}
    static = ("fem", "tsb1-pipe", *STATIC, "-o", str(tmp_path))
    assert command(*static, "--set", "fem.frames=2")[0] == 0
    assert (tmp_path / "frames.pvd").exists()
    assert command(*static)[0] == 0
    left = {path.name for path in tmp_path.iterdir()}
    assert not [name for name in left if name.startswith("frame") and name != "frame_of_mine.vtu"]
    assert rigid <= left  # what a run of another method may not write stays
    assert all(path.read_text("utf-8") == "mine" for path in others)


@pytest.mark.usefixtures("undrawn")
def test_arrays_and_fields_are_written_on_request_alone(tmp_path):
    run = ("mbd", "tsb1-pipe", *TUBE, "-o", str(tmp_path))
    small = {"answer.json", "joints.csv", "contact_pressures.png"}
    for more, large in (("--fields",), True), ((), False):
        assert command(*run, *more)[0] == 0
        written = {path.name for path in tmp_path.iterdir()}
        assert small <= written
        assert bool(written - small) is large
    status, _, printed = command("mbd", "tsb1-pipe", "--fields", "--json", str(tmp_path / "a"))
    assert (status, printed.count("\n")) == (2, 1)
    assert "--fields: got no folder" in printed


def test_an_answer_that_is_written_again_leaves_no_file_of_the_other(tmp_path):
    tube = load_case("tsb1-pipe", {"assembly.layers": 1, "mesh.around": 12, "mesh.axial": 4})
    answer = analyse(tube.problem)
    write(answer, tmp_path)
    assert (tmp_path / "contact_pressures.vtu").exists()
    write(replace(answer, contacts=type(answer.contacts)({})), tmp_path)
    assert not (tmp_path / "contact_pressures.vtu").exists()


@pytest.mark.usefixtures("undrawn")
def test_pressures_on_facets_that_are_written_have_the_largest_of_the_table(tmp_path):
    status, _, error = command("fem", "tsb1-pipe", *STATIC, "--fields", "-o", str(tmp_path))
    assert status == 0, error
    facets = pyvista.read(tmp_path / "contact_pressures.vtu")
    largest = read_answer(tmp_path).measures["p_max_facet"].value
    assert facets.cell_data["contact_pressure"].max() == pytest.approx(largest, rel=1e-9)


def test_pushes_that_rigid_blocks_have_no_limit_of_are_drawn(tmp_path):
    """Beside another support that moves the rigid analysis refuses a push."""
    coarse = ("--set", "mesh.elements=2", "--set", "fem.motion_steps=4")
    status, _, printed = command("fem", "cattaneo-mindlin", *coarse, "-o", str(tmp_path))
    assert status == 0, printed
    assert (tmp_path / "motions.png").exists()
