"""Results kept by content: nothing half trusted, nothing promised that is not so."""

from __future__ import annotations

import json
import random
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import validation.output.store as stores
from tests.study.designs import WALLS, Here, content
from validation import InputError
from validation.output.store import Layout, Store, content_key, rescue
from validation.study.run import sweep
from validation.study.store import Older, ResultFile, write_csv
from validation.study.study import Study, check_study, load_study

pytestmark = pytest.mark.quick

LAYOUT = Layout("cost", {"name": "TEXT NOT NULL", "count": "INTEGER", "value": "REAL"})


def row(number: int) -> dict[str, object]:
    """A row whose values are known."""
    return {"name": f"row {number} — ±", "count": number, "value": number / 3}


def filled(path: Path, count: int = 200) -> dict[str, dict[str, object]]:
    """Write rows; return them by key."""
    rows = {content_key(number): row(number) for number in range(count)}
    with Store(path, LAYOUT) as store:
        for key, values in rows.items():
            store.put(key, values)
    return rows


def test_rows_come_back_to_the_last_bit_and_the_latest_counts(tmp_path) -> None:
    rows = filled(tmp_path / "a.sqlite")
    with Store(tmp_path / "a.sqlite", LAYOUT) as store:
        for key, values in rows.items():
            found = store.get(key)
            assert found is not None
            assert found.items() >= values.items()
        assert store.get("nobody asked") is None
        first = next(iter(rows))
        store.put(first, row(7) | {"value": float("nan"), "count": None})
        assert store.get(first).items() >= {"name": "row 7 — ±", "value": None}.items()
        assert store.ask("SELECT count(*) FROM rows") == [(200,)]


def read_again(path: Path, rows: dict[str, dict[str, object]]) -> str:
    """What opening refuses, after making sure that all rows are as written where it does not."""
    try:
        store = Store(path, LAYOUT)
    except InputError as error:
        return str(error)
    with store:
        for key, values in rows.items():
            found = store.get(key)
            assert found is not None
            assert found.items() >= values.items()
    return ""


@pytest.mark.slow
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@example(place=0.11, bit=7)  # in the name of a column, which is no text then
def test_a_flipped_bit_is_refused_or_was_never_data(tmp_path, place, bit) -> None:
    """Of all bytes of a file: refused in one line, or every row is as it was written."""
    path = tmp_path / "flipped.sqlite"
    path.unlink(missing_ok=True)
    rows = filled(path, 60)
    raw = bytearray(path.read_bytes())
    raw[int(place * len(raw))] ^= 1 << bit
    path.write_bytes(raw)
    said = read_again(path, rows)
    told = ("is damaged", "not a file of results", "was written by", "another kind")
    assert not said or any(words in said for words in told)
    assert "\n" not in said


@pytest.mark.parametrize("share", [0.2, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused_and_what_is_whole_is_rescued(tmp_path, share) -> None:
    path, new = tmp_path / "cut.sqlite", tmp_path / "new.sqlite"
    rows = filled(path)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(InputError, match="is damaged"):
        Store(path, LAYOUT)
    cut = path.read_bytes()
    whole, _ = rescue(path, new)
    assert path.read_bytes() == cut
    if share >= 0.5:
        assert whole > 0.3 * share * len(rows)
    with Store(new, LAYOUT) as store:
        assert store.ask("SELECT count(*) FROM rows") == [(whole,)]
        for key, values in rows.items():
            found = store.get(key)
            assert found is None or found.items() >= values.items()


def test_without_its_first_page_nothing_is_promised(tmp_path) -> None:
    path = tmp_path / "cut.sqlite"
    filled(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="is damaged"):
        Store(path, LAYOUT)
    with pytest.raises(InputError, match="nothing can be rescued"):
        rescue(path, tmp_path / "new.sqlite")
    assert [p.name for p in tmp_path.iterdir()] == ["cut.sqlite"]


def test_flipped_rows_are_left_behind_and_the_others_rescued(tmp_path) -> None:
    path, new = tmp_path / "flipped.sqlite", tmp_path / "new.sqlite"
    rows = filled(path)
    raw = bytearray(path.read_bytes())
    # A digit in a name: still a table, still a text, no longer what was written.
    for number in (17, 31):
        raw[raw.index(f"row {number} ".encode()) + 4] ^= 1
    path.write_bytes(raw)
    with pytest.raises(InputError, match="a row is not what was written") as refusal:
        Store(path, LAYOUT)
    assert f"tubelock rescue {path} -o NEW.sqlite" in str(refusal.value)
    assert rescue(path, new) == (198, 2)
    with Store(new, LAYOUT) as store:
        assert [k for k in rows if store.get(k) is None] == [content_key(17), content_key(31)]
    with pytest.raises(InputError, match="exists"):
        rescue(path, new)
    with pytest.raises(InputError, match="no such file"):
        rescue(tmp_path / "nothing", tmp_path / "x.sqlite")


def test_other_formats_kinds_and_files_are_told_apart(tmp_path, monkeypatch) -> None:
    old = tmp_path / "old.sqlite"
    with sqlite3.connect(old) as connection:
        connection.execute("CREATE TABLE rows (number INTEGER PRIMARY KEY)")
    before = old.read_bytes()
    with pytest.raises(InputError, match="not a file of results"):
        Store(old, LAYOUT)
    assert old.read_bytes() == before
    path = tmp_path / "a.sqlite"
    filled(path, 3)
    with pytest.raises(InputError, match="results of another kind"):
        Store(path, Layout("study", LAYOUT.columns))
    with pytest.raises(InputError, match="its columns are not those"):
        Store(path, Layout("cost", {**LAYOUT.columns, "more": "REAL"}))
    for change, age in ((-1, "a newer tubelock"), (1, "an older tubelock")):
        with monkeypatch.context() as patch:
            patch.setattr(stores, "FORMAT", stores.FORMAT + change)
            with pytest.raises(InputError, match=age):
                Store(path, LAYOUT)


# ---------------------------------------------------------------------------------------------
# Studies


@pytest.fixture
def walls(tmp_path) -> Study:
    """Sixteen walls."""
    (tmp_path / "walls.toml").write_text(WALLS)
    return load_study(str(tmp_path / "walls.toml"))


def test_versions_of_the_program_never_mix_unasked(walls, tmp_path, monkeypatch) -> None:
    path = tmp_path / "walls.sqlite"
    with monkeypatch.context() as patch:
        patch.setattr(stores, "program", lambda: "0.0.9+older")
        with ResultFile(path, walls) as results:
            sweep(results, Here(walls, limit=6))
    with pytest.raises(InputError, match=r"6 of its rows .* \(0.0.9\+older\); give --older keep"):
        ResultFile(path, walls)
    with ResultFile(path, walls, Older.KEEP) as results:
        assert sweep(results, Here(walls)).computed == 10
        write_csv(results, tmp_path / "rows.csv")
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    place = lines[0].split(",").index("program")
    assert sum("0.0.9+older" in line for line in lines[1:]) == 6
    assert place > 0
    with ResultFile(path, walls, Older.RENEW) as results:
        assert sweep(results, Here(walls)).computed == 6
        assert results.counts() == (16, 4)
    with ResultFile(path, walls) as results:
        assert sweep(results, Here(walls)).computed == 0


def test_a_second_sweep_on_one_file_is_told(walls, tmp_path) -> None:
    path = tmp_path / "walls.sqlite"
    text = (
        "import sys; from pathlib import Path\n"
        "from validation.study.store import ResultFile\n"
        "from validation.study.study import load_study\n"
        "with ResultFile(Path(sys.argv[2]), load_study(sys.argv[1])) as results, results.alone():\n"
        "    print('alone', flush=True); sys.stdin.read()\n"
    )
    arguments = [sys.executable, "-c", text, str(tmp_path / "walls.toml"), str(path)]
    with subprocess.Popen(
        arguments,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "alone\n"
        with ResultFile(path, walls) as results:
            with pytest.raises(InputError, match="another process is computing for this file"):
                sweep(results, Here(walls))
            assert results.counts() == (0, 0)
        other.communicate("")
    with ResultFile(path, walls) as results:
        assert sweep(results, Here(walls)).computed == 16
    assert not (tmp_path / "walls.sqlite.lock").exists()


def test_a_complete_file_that_cannot_be_written_is_exported(walls, tmp_path, monkeypatch) -> None:
    path = tmp_path / "walls.sqlite"
    with ResultFile(path, walls) as results:
        sweep(results, Here(walls))
    kept = path.read_bytes()
    (tmp_path / "half.sqlite").write_bytes(kept)
    with sqlite3.connect(tmp_path / "half.sqlite") as connection:
        connection.execute("DELETE FROM rows WHERE number > 7")
    # Root may write everywhere: what the system would say of a disk without writing is said here.
    monkeypatch.setattr(stores, "_writable", lambda _: False)
    with ResultFile(path, walls) as results:
        assert sweep(results, Here(walls)).computed == 0
        write_csv(results, tmp_path / "rows.csv")
        with pytest.raises(InputError, match="readonly database"):
            results.add(next(iter(Here(walls).rows([0]))))
    assert len((tmp_path / "rows.csv").read_text().splitlines()) == 17
    assert path.read_bytes() == kept
    with (
        ResultFile(tmp_path / "half.sqlite", walls) as results,
        pytest.raises(InputError, match="nothing can be written, and results are missing"),
    ):
        sweep(results, Here(walls))


def test_a_rescued_study_goes_on(tubelock, walls, tmp_path) -> None:
    with ResultFile(tmp_path / "walls.sqlite", walls) as results:
        sweep(results, Here(walls))
    reference = content(tmp_path / "walls.sqlite")
    raw = bytearray((tmp_path / "walls.sqlite").read_bytes())
    raw[raw.index(b"activated") + 3] ^= 2
    (tmp_path / "walls.sqlite").write_bytes(raw)
    with pytest.raises(InputError, match="is damaged"):
        ResultFile(tmp_path / "walls.sqlite", walls)
    status, out, _ = tubelock("rescue", "walls.sqlite", "-o", "new.sqlite")
    assert status == 0
    assert "15 results are whole, 1 found damaged" in out
    with ResultFile(tmp_path / "new.sqlite", walls) as results:
        assert sweep(results, Here(walls)).computed == 1
    assert content(tmp_path / "new.sqlite") == reference


def test_numbers_beyond_sqlite_are_kept_as_real_ones(tmp_path) -> None:
    study = check_study(
        {"scene": "brick-stack", "parameters": {"load.pressure": [1, 10**29]}}, "large"
    )
    with ResultFile(tmp_path / "large.sqlite", study) as results:
        sweep(results, Here(study))
        assert [r["load.pressure"] for r in results.rows()] == [1.0, 1e29]


def test_keys_are_the_content() -> None:
    a, b = {"x": 1, "y": [2.0, None]}, {"y": [2.0, None], "x": 1}
    assert content_key(a) == content_key(json.loads(json.dumps(b)))
    rng = random.Random(0)
    keys = {content_key([rng.random()]) for _ in range(1000)}
    assert len(keys) == 1000


def test_rows_of_a_csv_are_not_computed_again(walls, tmp_path) -> None:
    """What ``--csv`` wrote, without numbers of its own, is what a new store begins with."""
    with ResultFile(tmp_path / "walls.sqlite", walls) as results:
        sweep(results, Here(walls, limit=6))
        write_csv(results, tmp_path / "rows.csv", digits=6)
        computed = list(results.rows())
    with ResultFile(tmp_path / "new.sqlite", walls, Older.KEEP) as results:
        results.take(tmp_path / "rows.csv")
        results.take(tmp_path / "rows.csv")
        for old, new in zip(computed, results.rows(), strict=True):
            assert new.pop("program") == "rows.csv"
            numbers = {name: v for name, v in old.items() if isinstance(v, float)}
            assert {name: new[name] for name in numbers} == pytest.approx(numbers, rel=1e-5)
            assert new | numbers == old
        assert sweep(results, Here(walls)).computed == 10
    text = (tmp_path / "rows.csv").read_text()
    (tmp_path / "rows.csv").write_text(text.replace("status", "state"))
    with (
        ResultFile(tmp_path / "new.sqlite", walls, Older.KEEP) as results,
        pytest.raises(InputError, match=r"rows.csv: no rows of walls: 'status'; expected what"),
    ):
        results.take(tmp_path / "rows.csv")
