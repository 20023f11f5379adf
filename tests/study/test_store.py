"""Results kept by content: nothing half trusted, nothing lost that need not be."""

from __future__ import annotations

import json
import os
import random
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.study.designs import WALLS, Here, content
from validation import InputError
from validation.study import rowfile
from validation.study.rowfile import RowFile, StudyRows, write_row_csv
from validation.study.run import sweep
from validation.study.scene_study import SceneStudy, check_study, load_study
from validation.study.study import Study, data_digest

pytestmark = pytest.mark.quick


def row(number: int) -> dict[str, object]:
    """A row whose values are known."""
    return {"name": f"row {number} — ±", "count": number, "value": number / 3}


def filled(path: Path, count: int = 200) -> dict[str, dict[str, object]]:
    """Write rows; return them by what they answer."""
    rows = {data_digest(number): row(number) for number in range(count)}
    store = RowFile(path)
    for question, values in rows.items():
        store.put(question, values)
    return rows


def test_rows_come_back_to_the_last_bit_and_the_latest_counts(tmp_path) -> None:
    rows = filled(tmp_path / "a.jsonl")
    store = RowFile(tmp_path / "a.jsonl")
    assert {question: store.get(question) for question in rows} == rows
    assert store.get("nobody asked") is None
    first = next(iter(rows))
    store.put(first, row(7))
    assert store.get(first) == row(7)
    assert len(store) == len(RowFile(tmp_path / "a.jsonl")) == 200
    assert RowFile(tmp_path / "a.jsonl").get(first) == row(7)
    for line in (tmp_path / "a.jsonl").read_text("utf-8").splitlines():
        assert json.loads(line)["row"].keys() == row(0).keys()


def read_again(path: Path, rows: dict[str, dict[str, object]]) -> int:
    """Rows that a file still has, after making sure that each is as it was written."""
    store = RowFile(path)
    found = {question: store.get(question) for question in rows}
    kept = {question: values for question, values in found.items() if values is not None}
    assert kept.items() <= rows.items()
    return len(kept)


@pytest.mark.slow
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@example(place=0.0, bit=0)
@example(place=0.999_999, bit=0)  # the end of the last line
def test_a_flipped_bit_costs_its_row(tmp_path, place, bit) -> None:
    """Of all bytes of a file: one row at most is lost, or two whose lines are one now."""
    path = tmp_path / "flipped.jsonl"
    path.unlink(missing_ok=True)
    rows = filled(path, 60)
    raw = bytearray(path.read_bytes())
    raw[int(place * len(raw))] ^= 1 << bit
    path.write_bytes(raw)
    kept = read_again(path, rows)
    assert 58 <= kept < 60
    store = RowFile(path)
    for question, values in rows.items():
        if store.get(question) is None:
            store.put(question, values)
    assert read_again(path, rows) == 60


@pytest.mark.parametrize("share", [0.0, 0.001, 0.2, 0.5, 0.999])
def test_a_cut_file_has_what_is_whole_and_goes_on(tmp_path, share) -> None:
    path = tmp_path / "cut.jsonl"
    rows = filled(path)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    kept = read_again(path, rows)
    assert kept == path.read_bytes().count(b"\n")
    store = RowFile(path)
    for question, values in list(rows.items())[kept:]:
        store.put(question, values)
    assert read_again(path, rows) == 200


def test_lines_may_come_in_any_order_and_from_several_files(tmp_path) -> None:
    path = tmp_path / "a.jsonl"
    rows = filled(path)
    lines = path.read_bytes().splitlines(keepends=True)
    random.Random(0).shuffle(lines)
    path.write_bytes(b"".join(lines[:120]))
    (tmp_path / "b.jsonl").write_bytes(b"".join(lines[80:]))
    path.write_bytes(path.read_bytes() + (tmp_path / "b.jsonl").read_bytes())
    assert read_again(path, rows) == 200


def test_other_files_are_left_alone(tmp_path) -> None:
    for name, text in (("notes.txt", b"a thesis"), ("old.sqlite", b"SQLite format 3\x00\x01\n")):
        (tmp_path / name).write_bytes(text)
        with pytest.raises(InputError, match="not a file of results"):
            RowFile(tmp_path / name)
        assert (tmp_path / name).read_bytes() == text
    with pytest.raises(InputError, match="is a folder"):
        RowFile(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        RowFile(Path("/proc/nowhere/x.jsonl"))


def test_a_full_disk_ends_in_one_line_and_loses_no_row(tmp_path) -> None:
    """The limit of a file's size stops a write as a full disk does, in the middle of a line."""
    path, store = tmp_path / "full.jsonl", RowFile(tmp_path / "full.jsonl")
    rows = {data_digest(number): row(number) for number in range(100)}

    def fill() -> None:
        for question, values in rows.items():
            if store.get(question) is None:
                store.put(question, values)

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, before[1]))
    try:
        with pytest.raises(InputError, match=r"rows already in it are kept: make room"):
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    kept = read_again(path, rows)
    assert 20 < kept < 40
    fill()
    assert read_again(path, rows) == 100


# ---------------------------------------------------------------------------------------------
# Studies


@pytest.fixture
def walls(tmp_path) -> Study:
    """Sixteen walls."""
    (tmp_path / "walls.toml").write_text(WALLS)
    return load_study(str(tmp_path / "walls.toml"))


def test_versions_of_the_program_never_mix_unasked(walls, tmp_path, monkeypatch, tubelock) -> None:
    path = tmp_path / "walls.jsonl"
    with monkeypatch.context() as patch:
        patch.setattr(rowfile, "program", lambda: "0.0.9+older")
        sweep(StudyRows(path, walls), Here(walls, limit=6))
    assert StudyRows(path, walls).of_other_programs == {"0.0.9+older": 6}
    # Those of this version are computed, and the others are where they were.
    rows = StudyRows(path, walls)
    assert sweep(rows, Here(walls, limit=1)).computed == 1
    status, out, _ = tubelock("sweep", "walls.toml", "-o", "walls.jsonl", "--workers", "1")
    assert status == 0
    assert "16, of which 15 computed now" in out
    assert "6 rows of other versions are not used (0.0.9+older)" in " ".join(out.split())
    # Asked for, they count, and say which program computed them.
    new = StudyRows(tmp_path / "new.jsonl", walls)
    new.take(path)
    assert new.counts() == (16, 4)
    assert sum(row.get("program") == "0.0.9+older" for row in new.rows()) == 6
    new = StudyRows(tmp_path / "six.jsonl", walls)
    new.take(_lines(path, tmp_path / "six-older.jsonl", 6))
    assert sweep(new, Here(walls)).computed == 10
    write_row_csv(new, tmp_path / "rows.csv")
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert lines[0].endswith(",program")
    assert sum(line.endswith("0.0.9+older") for line in lines) == 6


def _lines(path: Path, new: Path, count: int) -> Path:
    """Write the first lines of a file into another one."""
    new.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:count]))
    return new


def test_rows_of_another_question_are_no_rows_of_this_one(walls, tmp_path) -> None:
    other = load_study(str(tmp_path / "walls.toml"), ["assembly.layers=4"])
    sweep(StudyRows(tmp_path / "other.jsonl", other), Here(other))
    rows = StudyRows(tmp_path / "walls.jsonl", walls)
    with pytest.raises(InputError, match="has no row of walls"):
        rows.take(tmp_path / "other.jsonl")
    with pytest.raises(InputError, match="no such file"):
        rows.take(tmp_path / "nothing.jsonl")
    assert rows.counts() == (0, 0)


def test_a_second_sweep_on_one_file_is_told(walls, tmp_path) -> None:
    path = tmp_path / "walls.jsonl"
    text = (
        "import sys; from pathlib import Path\n"
        "from validation.study.rowfile import RowFile\n"
        "with RowFile(Path(sys.argv[1])).alone():\n"
        "    print('alone', flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", text, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "alone\n"
        rows = StudyRows(path, walls)
        with pytest.raises(InputError, match="another process is computing for this file"):
            sweep(rows, Here(walls))
        assert rows.counts() == (0, 0)
        other.communicate("")
    rows = StudyRows(path, walls)
    # What another process wrote since the file was opened is not computed again.
    sweep(StudyRows(path, walls), Here(walls, limit=5))
    assert sweep(rows, Here(walls)).computed == 11
    assert not (tmp_path / "walls.jsonl.lock").exists()


def test_a_complete_file_that_cannot_be_written_is_exported(walls, tmp_path, monkeypatch) -> None:
    path = tmp_path / "walls.jsonl"
    sweep(StudyRows(path, walls), Here(walls))
    kept = path.read_bytes()
    half = _lines(path, tmp_path / "half.jsonl", 8)
    # Root may write everywhere: what the system would say of a disk without writing is said here.
    monkeypatch.setattr(os, "access", lambda *_: False)
    rows = StudyRows(path, walls)
    assert sweep(rows, Here(walls)).computed == 0
    with pytest.raises(InputError, match="nothing can be written, and results are missing"):
        sweep(StudyRows(half, walls), Here(walls))
    monkeypatch.undo()
    write_row_csv(rows, tmp_path / "rows.csv")
    assert len((tmp_path / "rows.csv").read_text().splitlines()) == 17
    assert path.read_bytes() == kept


def test_a_damaged_study_goes_on(tubelock, walls, tmp_path) -> None:
    path = tmp_path / "walls.jsonl"
    sweep(StudyRows(path, walls), Here(walls))
    reference = content(path, walls)
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"activated") + 3] ^= 2
    path.write_bytes(raw)
    status, out, _ = tubelock("sweep", "walls.toml", "-o", "walls.jsonl", "--workers", "1")
    assert status == 0
    assert "16, of which 1 computed now" in out
    assert "1 damaged lines are not used" in out
    assert content(path, walls) == reference


def test_large_whole_numbers_come_back(tmp_path) -> None:
    study = check_study(
        {"scene": "brick-stack", "parameters": {"load.pressure": [1, 10**29]}}, "large"
    )
    rows = StudyRows(tmp_path / "large.jsonl", study)
    sweep(rows, Here(study))
    assert [r["load.pressure"] for r in rows.rows()] == [1, 10**29]


def test_digests_are_the_content() -> None:
    a, b = {"x": 1, "y": [2.0, None]}, {"y": [2.0, None], "x": 1}
    assert data_digest(a) == data_digest(json.loads(json.dumps(b)))
    rng = random.Random(0)
    digests = {data_digest([rng.random()]) for _ in range(1000)}
    assert len(digests) == 1000


def test_another_mesh_file_is_another_question(tmp_path, monkeypatch) -> None:
    """A study of own blocks asks anew where the file of a block has other content."""
    monkeypatch.chdir(tmp_path)
    scene = {"block": {"type": "mesh"}, "parts": [{"file": "block.stl"}]}
    study = SceneStudy("own", "rigid", (("effects.friction", (0.5,)),), scene)
    digests = set()
    for text in ("one", "one", "two"):
        Path("block.stl").write_text(text)
        fresh = SceneStudy(study.name, study.quantity, study.parameters, study.scene)
        digests.add(fresh.digest)
    assert len(digests) == 2
