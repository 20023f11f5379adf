"""A notebook with names of the four packages alone: what the commands print is had by a call."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from threadpoolctl import threadpool_info, threadpool_limits

from fem import Explicit, Problem, concrete, solve_explicit, solve_static
from geometry import Answer, SineBlock, pipe, tube
from mbd import Rigid, analyse
from tests.fixtures.commands import small_meshes
from tests.support.answers import PLAIN
from tests.support.coarse_tubes import keys
from tests.support.commands import answered, set_words
from validation import compare, load_case, plot, read_answer, sweep, write

COARSE = keys(2, 2)
SETTINGS = set_words(COARSE)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return load_case("tsb1-pipe", COARSE).problem


@pytest.fixture(scope="module")
def answers(problem) -> tuple[Answer, Answer, Answer]:
    return (
        analyse(problem, Rigid(norm="force")),  # as the scene says
        solve_static(problem, PLAIN),
        solve_explicit(problem, Explicit()),
    )


@pytest.fixture(scope="module")
def refined(problem) -> Answer:
    with small_meshes():
        return solve_static(problem)


def test_numbers_of_the_rigid_command_are_those_of_the_answer(answers) -> None:
    same(answered("mbd", "tsb1-pipe", *SETTINGS)[0], answers[0].as_dict())


def same(printed: dict[str, Any], given: dict[str, Any]) -> None:
    """Plain data of a command and of a call below it, but for titles and times; the same rows."""
    keys = given.keys() - {"title", "rows", "cpu_seconds"}
    assert {k: printed[k] for k in keys} == {k: given[k] for k in keys}
    for row in given["rows"]:
        assert row["group"] == "time" or row in printed["rows"]


def test_numbers_of_the_fem_command_are_those_of_the_answer(answers) -> None:
    plain = set_words(("fem.method=static", "fem.error_estimate=false", "fem.mesh=scene"))
    printed, _ = answered("fem", "tsb1-pipe", *SETTINGS, *plain)
    static = answers[1].as_dict()
    assert printed["measures"] == static["measures"]
    same(printed, static)


@pytest.mark.usefixtures("small_meshes")
def test_numbers_of_the_compare_command_are_those_of_the_call(problem, answers, refined) -> None:
    printed, _ = answered("compare", "tsb1-pipe", *SETTINGS, "--explicit")
    rigid, on_mesh, explicit = answers
    by_pressure = analyse(problem, Rigid(norm="pressure"))
    found = compare(rigid, by_pressure, refined, on_mesh, explicit)
    told = json.loads(json.dumps(found.as_dict()))
    for theirs, ours in zip(printed["answers"], told["answers"], strict=True):
        for name in ("name", "words", "measures", "contact"):
            if name != "measures" or ours["name"] != "static on [mesh]":  # without error bars here
                assert theirs[name] == ours[name]
    for name in told.keys() - {"answers"}:
        assert printed[name] == told[name]
    assert printed["conclusion"] in repr(found)


def test_answers_are_written_and_read(answers, tmp_path: Path) -> None:
    for answer in answers:
        files = write(answer, tmp_path / answer.method)
        assert all(path.exists() for path in files)
        again = read_answer(tmp_path / answer.method)
        assert repr(again) == repr(answer)
        assert again.as_dict() == json.loads(json.dumps(answer.as_dict()))
        for found, kept in (
            (answer.fields, again.fields),
            (answer.contacts, again.contacts),
        ):
            assert list(found) == list(kept)
            assert all(np.array_equal(found[name], kept[name]) for name in found)
        assert np.array_equal(again.mesh().points, answer.mesh().points)
        assert compare(again, answers[1]).rows["p_eff"]
    (tmp_path / "static" / "answer.npz").write_bytes(b"no archive")
    with pytest.raises(ValueError, match="damaged answer"):
        read_answer(tmp_path / "static")
    with pytest.raises(ValueError, match="no such file"):
        read_answer(tmp_path / "nowhere")


def test_contacts_are_a_table_of_numbers(answers) -> None:
    pandas = pytest.importorskip("pandas")
    for answer in answers:
        contacts = answer.contacts
        table = pandas.DataFrame(answer.contact_table())
        assert len(table) == len(contacts["pressure"])
        assert all(kind.kind in "if" for kind in table.dtypes)
        vectors = ("centroid_{}_mm", "normal_{}", "force_{}_N")
        for name, column in zip(("centroid", "normal", "force"), vectors, strict=True):
            if name in contacts:  # facets of another mesh than that of the solution have no force
                columns = table[[column.format(axis) for axis in "xyz"]]
                np.testing.assert_array_equal(columns.to_numpy(), contacts[name])
        np.testing.assert_array_equal(table[["block_m", "block_s"]], contacts["blocks"])
        np.testing.assert_array_equal(table["pressure_MPa"], contacts["pressure"])
        np.testing.assert_array_equal(table["area_mm2"], contacts["area"])
        with pytest.raises(ValueError, match="read-only"):
            contacts["pressure"][:] = 0.0


@pytest.mark.parametrize("field", ["sigma_1", "mises", "displacement", "pressure", "area"])
@pytest.mark.parametrize("options", [{}, {"layer": 1}, {"layer": 1, "unrolled": True}], ids=str)
def test_fields_are_drawn(answers, field: str, options, tmp_path: Path) -> None:
    figure = plot(answers[1], field, **options)
    figure.savefig(tmp_path / "field.png", dpi=30)
    assert any(text.get_text().startswith(f"{field} [") for text in figure.texts)
    with Image.open(tmp_path / "field.png") as image:
        pixels = np.asarray(image.convert("RGB"))[:, : int(0.6 * image.width)].reshape(-1, 3)
    coloured = pixels[np.ptp(pixels.astype(int), axis=1) > 40]  # neither words nor lines nor bar
    assert len(np.unique(coloured, axis=0)) > 3


def test_a_sweep_is_a_call(tmp_path: Path) -> None:
    values = {"block.amplitude": [10.0, 20.0]}
    study = sweep("tsb1-pipe", values, COARSE, store=tmp_path / "study.jsonl")
    assert [row["block.amplitude"] for row in study.rows] == [10.0, 20.0]
    scene = load_case("tsb1-pipe", COARSE | {"block.amplitude": 10.0})
    one = analyse(scene.problem, Rigid(norm="force"))
    assert study.rows[0]["p_max"] == one["p_max"].value
    again = sweep("tsb1-pipe", values, COARSE, store=tmp_path / "study.jsonl")
    assert again.rows == study.rows
    assert all(f"{row['p_max']:.4g}" in repr(study) for row in study.rows)
    (curve,) = study.plot("block.amplitude", "p_max").axes[0].containers
    assert curve.lines[0].get_xydata().tolist() == [
        [row["block.amplitude"], row["p_max"]] for row in study.rows
    ]


def test_a_function_that_makes_problems_is_swept_as_a_scene_is() -> None:
    block = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )

    def made(amplitude: float) -> Problem:
        shape = replace(block, amplitude=amplitude)
        return Problem(tube(shape, layers=1, mesh=(12, 2, 2)), pipe(0.01), concrete)

    values = [10.0, 20.0]
    of_function = sweep(made, {"amplitude": values}, method=Rigid())
    of_scene = sweep("tsb1-pipe", {"block.amplitude": values}, COARSE | {"rigid.norm": "pressure"})
    for one, other in zip(of_function.rows, of_scene.rows, strict=True):
        assert one["p_max"] == other["p_max"]
        assert one["status"] == "ok"
    (curve,) = of_function.plot("amplitude", "p_max").axes[0].containers
    assert curve.lines[0].get_xydata().tolist() == [
        [row["amplitude"], row["p_max"]] for row in of_function.rows
    ]
    # Both go through one study: the same columns, printed in the same table.
    kept = {"number", "status", "message", "cpu_seconds", "amplitude", "block.amplitude"}
    assert set(of_function.rows[0]) - kept == set(of_scene.rows[0]) - kept
    assert all(f"{row['p_max']:.4g}" in repr(of_function) for row in of_function.rows)
    (failed,) = sweep(made, {"amplitude": [-1.0]}, method=Rigid()).rows
    assert failed["status"] == "failed"
    with pytest.raises(ValueError, match="expected method"):
        sweep(made, {"amplitude": values})


@pytest.mark.parametrize("threads", [1, 2, 16])
def test_linear_algebra_has_one_thread_inside_a_solve_alone(problem, threads) -> None:
    """Blocks are small dense problems; a user's own threads are afterwards what they were."""
    seen = []

    def look(_: object) -> None:
        seen.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")

    with threadpool_limits(threads, user_api="blas"):
        before = threadpool_info()
        analyse(problem, progress=look)
        solve_static(problem, PLAIN, progress=look)
        solve_explicit(problem, Explicit(end_time=1e-5, ramp_time=0.0), progress=look)
        assert [pool["num_threads"] for pool in threadpool_info()] == [
            pool["num_threads"] for pool in before
        ]
    assert set(seen) == {1}
