"""Parameter studies: reading, running, resuming, exporting, and what goes wrong on the way."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import os
import pickle
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

import validation
from tests.study.designs import WALLS, Here, content
from tests.support import endless
from tests.support.coarse_tubes import keys
from tests.support.commands import command
from validation import InputError, load_case
from validation.study.rowfile import StudyRows, write_row_csv
from validation.study.run import DaskRunner, LocalRunner, run_design, sweep
from validation.study.scene_study import check_study, load_study
from validation.study.study import DesignRow, Study


@pytest.fixture
def walls(tmp_path) -> Study:
    """The sixteen walls."""
    (tmp_path / "walls.toml").write_text(WALLS)
    return load_study(str(tmp_path / "walls.toml"))


@pytest.fixture
def reference(walls, tmp_path) -> list[dict]:
    """Rows of an uninterrupted run."""
    sweep(StudyRows(tmp_path / "reference.jsonl", walls), Here(walls))
    return content(tmp_path / "reference.jsonl", walls)


# ---------------------------------------------------------------------------------------------
# Reading


def test_designs_are_the_product_of_the_values_last_fastest(walls) -> None:
    assert walls.n_designs == 16
    expected = itertools.product((0.01, 0.02, 0.03, 0.04), (1, 2, 3, 9))
    found = [tuple(walls.design(k).values()) for k in range(16)]
    assert found == list(expected)
    assert walls.case(6).scene.load.pressure == 0.02
    assert walls.case(6).scene.load.layer == 3


def test_ranges_are_exact_decimals_and_keep_whole_numbers_whole() -> None:
    study = check_study(
        {
            "scene": "tsb1-pipe",
            "parameters": {
                "block.shift": {"from": 0.1, "to": 0.75, "step": 0.2},
                "block.blocks_per_layer": {"from": 6, "to": 2, "step": -2},
            },
        },
        "s",
    )
    values = dict(study.parameters)
    assert values["block.shift"] == (0.1, 0.3, 0.5, 0.7)
    assert values["block.blocks_per_layer"] == (6, 4, 2)
    assert all(isinstance(n, int) for n in values["block.blocks_per_layer"])


def test_the_built_in_study_is_the_printed_parameter_space() -> None:
    text = (files("validation") / "paper" / "reference.toml").read_text("utf-8")
    printed, study = tomllib.loads(text)["parameter_study"], load_study("paper-480")
    assert study.n_designs == 480
    for path, values in study.parameters:
        assert list(values) == printed[path.removeprefix("block.")]
    # Every frequency must meet node on node at the study's mesh: 2f divides the count around.
    scene = study.case(0).scene
    assert all(scene.mesh.around % round(2 * f) == 0 for f in (1.0, 1.5, 2.0))
    assert scene.assembly.turn == "one wave"


def test_the_half_block_study_is_its_designs_of_f_2_turned_otherwise() -> None:
    one, half = load_study("paper-480"), load_study("half-block-160")
    designs = [one.design(k) for k in range(one.n_designs)]
    assert [half.design(k) for k in range(half.n_designs)] == [
        d for d in designs if d["block.frequency"] == 2.0
    ]
    other = one.case(next(k for k, d in enumerate(designs) if d == half.design(0))).scene
    mine = half.case(0).scene
    assert mine.assembly.turn == "half block"
    assert (mine.block, mine.mesh, mine.load) == (other.block, other.mesh, other.load)


def test_equal_studies_have_equal_digests_whatever_their_files_look_like(walls, tmp_path) -> None:
    (tmp_path / "again.toml").write_text(
        WALLS.replace(
            "{ from = 0.01, to = 0.04, step = 0.01 }", "[0.01, 0.02, 0.03, 0.04]"
        ).replace('"load.layer"', "load.layer")
    )
    assert load_study(str(tmp_path / "again.toml")).digest == walls.digest
    other = load_study(str(tmp_path / "again.toml"), ["assembly.layers=4"])
    assert other.digest != walls.digest
    assert pickle.loads(pickle.dumps(walls)).digest == walls.digest


# ---------------------------------------------------------------------------------------------
# Rows


def test_failures_are_rows_with_their_message(reference) -> None:
    failed = [row for row in reference if row["status"] == "failed"]
    assert [row["load.layer"] for row in failed] == [9, 9, 9, 9]
    assert all("load.layer: got 9" in row["message"] for row in failed)
    assert len(reference) == 16


def test_a_stopped_sweep_goes_on_where_it_was(walls, reference, tmp_path) -> None:
    path = tmp_path / "stopped.jsonl"
    assert sweep(StudyRows(path, walls), Here(walls, limit=5)).computed == 5
    rows = StudyRows(path, walls)
    assert sweep(rows, Here(walls)).computed == 11
    assert sweep(rows, Here(walls)).computed == 0
    assert sweep(rows, Here(walls), retry_failed=True).computed == 4
    assert content(path, walls) == reference


def test_a_file_has_rows_of_several_studies(walls, reference, tmp_path) -> None:
    """Each sees its own; those of another question are never taken for them."""
    path = tmp_path / "both.jsonl"
    other = load_study(str(tmp_path / "walls.toml"), ["assembly.layers=4"])
    for study in (walls, other):
        assert sweep(StudyRows(path, study), Here(study)).computed == 16
    assert content(path, walls) == reference
    assert content(path, other) != reference


RANGE = "{ from = 0.01, to = 0.04, step = 0.01 }"


@pytest.mark.parametrize(
    ("start", "pressures", "layers", "new"),
    [
        (RANGE, "[0.01, 0.02, 0.03, 0.04, 0.05]", "[1, 2, 3, 9]", 4),
        (RANGE, "[0.05, 0.04, 0.03, 0.02, 0.015, 0.01]", "[9, 3, 2, 1]", 8),  # another order
        ("[1, 2]", "[1, 1.5, 2]", "[1, 2, 3, 9]", 4),  # no integers any more
        (RANGE, "[0.04, 0.01]", "[3, 1]", 0),  # shorter
    ],
)
def test_other_lists_of_values_compute_only_the_designs_that_are_new(
    tmp_path, start, pressures, layers, new
) -> None:
    (tmp_path / "walls.toml").write_text(WALLS.replace(RANGE, start))
    walls = load_study(str(tmp_path / "walls.toml"))
    path = tmp_path / "grown.jsonl"
    sweep(StudyRows(path, walls), Here(walls))
    first = content(path, walls)
    text = WALLS.replace(RANGE, pressures)
    (tmp_path / "other.toml").write_text(text.replace("[1, 2, 3, 9]", layers))
    other = load_study(str(tmp_path / "other.toml"))
    assert sweep(StudyRows(path, other), Here(other)).computed == new
    sweep(StudyRows(tmp_path / "straight.jsonl", other), Here(other))
    assert content(path, other) == content(tmp_path / "straight.jsonl", other)
    assert content(path, walls) == first


def test_exports_hold_the_same_rows(walls, reference, tmp_path) -> None:
    results = StudyRows(tmp_path / "reference.jsonl", walls)
    write_row_csv(results, tmp_path / "rows.csv")
    rows = list(results.rows())
    with (tmp_path / "rows.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    pressures = [float(r["load.pressure [MPa]"]) for r in read]
    assert pressures == [r["load.pressure"] for r in rows]
    # Digests prove the rows of the store; nobody reads them.
    assert not {"question", "digest", "program"} & (set(read[0]) | set(rows[0]))
    assert {"p_max [MPa]", "effective_area_percent [%]", "cpu_seconds [s]"} <= set(read[0])
    assert [r["residual"] == "" for r in read] == [r["residual"] is None for r in rows]


# ---------------------------------------------------------------------------------------------
# Deformable designs

COARSE = keys(2, 2)


def deformable(**changes: object) -> Study:
    """A short tube on a coarse mesh."""
    data = {"scene": "tsb1-pipe", "quantity": "fem", "parameters": {"block.amplitude": [20.0]}}
    return check_study(data | {"settings": COARSE} | changes, "tube")


@pytest.mark.slow
@pytest.mark.usefixtures("small_meshes")
def test_a_deformable_design_is_refined_as_the_command_does() -> None:
    from validation import solve

    study = deformable(accuracy="30%")
    row = run_design(study, 0)
    assert row.status == "ok", row.message
    # What a deformable design is refined to without another word, as `Static.accuracy` says.
    names = ("max_displacement", "p_eff", "p_max_point", "sigma_1_averaged")
    asked = {"fem.accuracy": dict.fromkeys(names, 0.3)}
    reference = solve(study.case(0).changed(asked)).measures
    for name in names:
        value, error = row.results[name], row.results[f"{name}_error"]
        assert (value, error) == (reference[name].value, reference[name].error)
    # What was requested, not the default, ends the refinement.
    assert row.results["max_displacement_error"] <= 0.3 * row.results["max_displacement"]


@pytest.mark.parametrize("settings", [{"fem.mesh": "scene"}, {"fem.element": "incompatible"}])
def test_a_deformable_design_keeps_the_mesh_that_it_states(settings) -> None:
    study = deformable(settings=COARSE | settings)
    row = run_design(study, 0)
    blocks = COARSE["mesh.around"] * COARSE["mesh.radial"] * COARSE["mesh.axial"]
    assert row.results["n_elements"] % blocks == 0
    # The coarse mesh is what was asked: its error bars are as wide as they are.
    assert row.results["p_max_point_error"] > 0.1 * row.results["p_max_point"]


def test_the_accuracy_is_part_of_the_question() -> None:
    assert deformable(accuracy=0.1).digest == deformable(accuracy="10%").digest
    assert deformable(accuracy=0.1).digest != deformable(accuracy=0.2).digest


# ---------------------------------------------------------------------------------------------
# What is printed and drawn


@pytest.fixture(scope="module")
def tubes(tmp_path_factory) -> tuple[Study, Path]:
    """Six tubes, of which one needs a mesh of another count around; and their rows."""
    study = check_study(
        {
            "scene": "tsb1-pipe",
            "parameters": {"block.amplitude": [10, 20, 15], "block.frequency": [1.0, 2.5]},
            "settings": COARSE,
        },
        "tubes",
    )
    path = tmp_path_factory.mktemp("tubes") / "tubes.jsonl"
    results = StudyRows(path, study)
    sweep(results, Here(study))
    return study, path


def test_the_table_ranks_designs_and_ends_with_those_that_failed(tubes) -> None:
    from rich.console import Console

    from validation.study.sweep import print_table

    study, path = tubes
    console = Console(width=400, record=True, file=io.StringIO())
    results = StudyRows(path, study)
    print_table(results, console)
    rows = {row["number"]: row for row in results.rows()}
    text = console.export_text()
    shown = [line.strip("│ ").split() for line in text.splitlines() if line.startswith("│")]
    numbers = [int(cells[0]) for cells in shown]
    ok = [number for number in numbers if rows[number]["status"] == "ok"]
    assert ok == sorted(ok, key=lambda number: rows[number]["p_max"])
    assert len(ok) == 3
    assert numbers[len(ok) :] == [1, 3, 5]
    assert all("mesh.around: got 12" in line for line in text.splitlines()[-4:-1])
    assert "[MPa]" in text


def test_curves_hold_the_rows_and_failed_designs_are_gaps(tubes) -> None:
    from validation.study.picture import study_figure

    study, path = tubes
    results = StudyRows(path, study)
    rows = list(results.rows())
    (axes,) = study_figure(study, rows, "block.amplitude", "p_max").axes
    first, second = (curve.lines[0].get_xydata() for curve in axes.containers)
    expected = {row["block.amplitude"]: row["p_max"] for row in rows if row["status"] == "ok"}
    assert first.tolist() == sorted([a, p] for a, p in expected.items())
    assert all(math.isnan(y) for _, y in second.tolist())
    assert axes.get_xlabel() == "block.amplitude [mm]"
    assert axes.get_ylabel() == "p_max of the paper [MPa]"
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["1", "2.5"]


def test_the_title_of_many_curves_stays_on_the_page() -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from validation.study.picture import study_figure

    figure = study_figure(load_study("paper-480"), [], "block.shift", "p_max")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    title = figure.axes[0].get_title(loc="left")
    assert title.replace("\n", " ").endswith(
        "240 curves, one for each combination of the other parameters"
    )
    box = figure.axes[0].get_tightbbox(canvas.get_renderer())
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.width


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (("block.height", "p_max"), "block.height does not vary in tubes"),
        (("block.amplitude", "p_mx"), "got p_mx, expected one of equilibrium"),
        (("block.amplitude", "mechanism"), "got mechanism, expected one of equilibrium"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_the_work(tubes, axes, message) -> None:
    from validation.study.picture import check_axes

    with pytest.raises(InputError, match=message):
        check_axes(tubes[0], *axes)


def test_the_expected_time_is_printed_first_and_where_it_changes() -> None:
    from validation.study.sweep import Expected

    def row(seconds: float, status: str = "ok") -> DesignRow:
        return DesignRow(0, status, "", {}, {}, seconds)

    expected = Expected(11)
    assert expected.words(row(0.0, "failed")) == ""
    first = "about 100 s of CPU time for 10 designs, often less: the first one took 10 s"
    assert expected.words(row(10.0)) == first
    assert expected.words(row(12.0)) == ""
    assert expected.words(row(59.0)) == ""  # one slow design of three
    assert "5.9 min of CPU time for 10 designs: half of 4 took less than 36 s" in expected.words(
        row(60.0)
    )
    assert Expected(10).words(row(0.1)) == ""
    assert Expected(1000).words(row(0.3)) == ""  # most of it the machine code that is loaded once


# ---------------------------------------------------------------------------------------------
# Processes


@pytest.fixture
def many_walls(tmp_path) -> Study:
    """Twenty walls of a few milliseconds each."""
    (tmp_path / "many.toml").write_text(endless.STUDY)
    return load_study(str(tmp_path / "many.toml"))


@pytest.mark.slow
def test_kill_9_in_the_middle_and_resume_gives_the_same_rows(many_walls, tmp_path) -> None:
    with endless.endless_sweep(tmp_path) as process:
        process.kill()
        process.communicate()  # workers end when their parent is gone
    results = StudyRows(tmp_path / "many.jsonl", many_walls)
    stopped, _ = results.counts()
    assert 1 <= stopped <= 3
    assert sweep(results, Here(many_walls)).computed == 20 - stopped
    sweep(StudyRows(tmp_path / "straight.jsonl", many_walls), Here(many_walls))
    both = [content(tmp_path / name, many_walls) for name in ("many.jsonl", "straight.jsonl")]
    assert both[0] == both[1]


@pytest.mark.thorough
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_what_stops_a_sweep_keeps_the_rows_and_leaves_no_process(tmp_path, stop) -> None:
    with endless.endless_sweep(tmp_path) as process:
        endless.interrupted(process, stop)
        while not endless.group_ended(process.pid):  # the pool's own helper does so a moment later
            time.sleep(0.05)
    assert 1 <= endless.rows(tmp_path) <= 3


@pytest.mark.thorough
def test_a_killed_worker_process_loses_no_design(many_walls, tmp_path) -> None:
    results = StudyRows(tmp_path / "killed.jsonl", many_walls)
    tally = sweep(results, LocalRunner(many_walls, 2), on_row=kill_the_first_worker())
    assert results.counts() == (20, 0)
    assert tally.workers >= 3


def kill_the_first_worker() -> Callable[[DesignRow], None]:
    """What kills the process of the first row, when it is there."""
    killed: list[int] = []

    def kill_once(row: DesignRow) -> None:
        if not killed:
            killed.append(row.worker[0])
            os.kill(row.worker[0], signal.SIGKILL)

    return kill_once


def test_a_script_without_a_main_guard_sweeps(tmp_path) -> None:
    """Worker processes that import the calling script start its study again, and end."""
    script = tmp_path / "plain.py"
    script.write_text(
        "from validation import load_case, sweep\n"
        'wall = load_case("brick-stack", {"mesh.divisions": [2, 1, 1], "assembly.layers": 1})\n'
        'study = sweep(wall, {"load.pressure": [0.01, 0.02]}, workers=2)\n'
        'print([row["status"] for row in study.rows], __file__)\n'
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert ran.stdout.split("\n") == [f"['ok', 'ok'] {script}", ""]
    assert not ran.stderr


def test_a_runner_needs_a_worker(walls) -> None:
    with pytest.raises(InputError, match="expected at least 1"):
        LocalRunner(walls, 0)


# ---------------------------------------------------------------------------------------------
# Dask


@pytest.mark.slow
def test_a_dask_cluster_with_one_of_two_workers_killed_gives_the_same_rows(
    many_walls, tmp_path
) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        runner = DaskRunner(many_walls, cluster.scheduler_address, timeout=300)
        results = StudyRows(tmp_path / "dask.jsonl", many_walls)
        tally = sweep(results, runner, on_row=kill_the_first_worker())
    assert tally.computed == 20
    assert tally.workers >= 2
    sweep(StudyRows(tmp_path / "straight.jsonl", many_walls), Here(many_walls))
    both = [content(tmp_path / name, many_walls) for name in ("dask.jsonl", "straight.jsonl")]
    assert both[0] == both[1]


def test_a_scheduler_that_is_not_there_is_told(walls) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="expected an address such as"):
        DaskRunner(walls, "nonsense")
    with pytest.raises(InputError, match=r"no Dask scheduler answers there within 0.2 s"):
        DaskRunner(walls, "tcp://127.0.0.1:1", timeout=0.2)


@pytest.mark.thorough
def test_a_scheduler_that_dies_halfway_stops_the_sweep_in_one_line(many_walls, tmp_path) -> None:
    pytest.importorskip("distributed")
    with ExitStack() as processes:

        def dask(name: str, *words: str) -> subprocess.Popen[bytes]:
            process = processes.enter_context(
                subprocess.Popen(
                    [
                        sys.executable,
                        "-m",
                        f"distributed.cli.dask_{name}",
                        "--no-dashboard",
                        *words,
                    ],
                    stderr=subprocess.DEVNULL,
                    cwd=tmp_path,
                    env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
                )
            )
            processes.callback(process.kill)
            return process

        scheduler = dask("scheduler", "--port=0", "--scheduler-file=scheduler.json")
        while not (address := scheduler_address(tmp_path / "scheduler.json")):
            assert scheduler.poll() is None
            time.sleep(0.1)
        dask("worker", address, "--no-nanny", "--nthreads=1")
        runner = DaskRunner(many_walls, address, timeout=300)
        results = StudyRows(tmp_path / "dask.jsonl", many_walls)
        with pytest.raises(InputError, match="the scheduler stopped answering"):
            sweep(results, runner, on_row=lambda _: scheduler.kill())
        written, _ = results.counts()
        assert 1 <= written < 20


def scheduler_address(path: Path) -> str:
    """Address in the file of a scheduler; empty before it is written."""
    try:
        return str(json.loads(path.read_text())["address"])
    except (FileNotFoundError, json.JSONDecodeError):
        return ""


# ---------------------------------------------------------------------------------------------
# Command line


def test_a_study_by_its_file_in_python(walls, reference, tmp_path) -> None:
    """Its rows are those of the command, each is reported, and a store keeps them."""
    told: list[tuple[int, int]] = []
    study = validation.sweep(
        tmp_path / "walls.toml",
        store=tmp_path / "rows.jsonl",
        progress=lambda _, done, total: told.append((done, total)),
    )
    assert content(tmp_path / "rows.jsonl", walls) == reference
    assert told == [(done, 16) for done in range(1, 17)]
    again = validation.sweep(tmp_path / "walls.toml", store=tmp_path / "rows.jsonl")
    assert (again.summary["this_run"]["computed"], again.rows) == (0, study.rows)


def test_sweep_on_the_command_line(walls, reference, tmp_path, tubelock) -> None:
    status, out, _ = tubelock("sweep", "walls.toml", "--workers", "1", "--json", "-")
    assert status == 0
    data = json.loads(out)
    assert data["n_designs"] == data["n_rows"] == len(data["rows"]) == 16
    assert data["n_failed"] == 4
    assert content(tmp_path / "out/walls.jsonl", walls) == reference
    assert not (tmp_path / "out/walls.png").exists()  # no wall is in equilibrium
    status, out, _ = tubelock("sweep", "walls.toml")
    assert "16, of which 0 computed now" in out
    assert "4; the first, design 3: load.layer: got 9" in out
    for arguments, message in (
        (["walls.toml", "--csv", "/proc/nowhere/x.csv"], "cannot be written"),
        (["walls.toml", "--plot", "load.presure", "p_max"], "does not vary in walls"),
        (["walls.toml", "-o", "walls.toml"], "is a file that this call reads"),
    ):
        status, out, err = tubelock("sweep", *arguments)
        assert (status, out) == (2, "")
        assert message in err
        assert err.count("\n") == 1
    assert "paper-480" in tubelock("scenes", "--studies")[1]
    assert tubelock("scenes", "--studies", "paper-480")[1].startswith(
        "# The paper's parameter study"
    )


def test_a_sweep_of_which_nothing_came_is_an_error(tmp_path, tubelock) -> None:
    """Rows with messages are kept, and a script sees that none has an answer."""
    text = 'scene = "tsb1-pipe"\n[parameters]\nblock.amplitude = [10, 20]\n'
    (tmp_path / "bad.toml").write_text(text + "[settings]\nmesh.around = 23\n")
    status, _, err = tubelock("sweep", "bad.toml", "-o", "bad.jsonl", "--workers", "1")
    assert status == 2
    assert "every design failed; the first: mesh.around: got 23" in err
    rows = StudyRows(tmp_path / "bad.jsonl", load_study(str(tmp_path / "bad.toml")))
    assert rows.counts() == (2, 2)


def test_pictures_of_a_study_name_its_method_and_its_load(tubes) -> None:
    study, _ = tubes
    assert study.title == "tubes, rigid blocks: internal pressure 0.01 MPa"
    pressed = replace(study, parameters=(("load.pressure", (0.01, 0.02)),))
    assert pressed.title == "tubes, rigid blocks"  # the axis has the load


@pytest.mark.parametrize("by_command", [True, False])
def test_each_scene_of_a_sweep_is_checked_once(
    by_command: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kind, checked = type(load_case("tsb1-pipe").scene), []
    validate = kind.model_validate
    monkeypatch.setattr(kind, "model_validate", lambda data: checked.append(1) or validate(data))
    if by_command:
        text = 'scene = "tsb1-pipe"\n[parameters]\n"block.amplitude" = [10, 15]\n[settings]\n'
        stated = "".join(f'"{key}" = {value}\n' for key, value in COARSE.items())
        (tmp_path / "two.toml").write_text(text + stated, "utf-8")
        words = ("--workers", "1", "-o", str(tmp_path / "two.jsonl"), "--json", "-")
        assert command("sweep", str(tmp_path / "two.toml"), *words)[0] == 0
    else:
        rows = validation.sweep("tsb1-pipe", {"block.amplitude": [10, 15]}, COARSE).rows
        assert [row["status"] for row in rows] == ["ok", "ok"]
    assert len(checked) == 2
