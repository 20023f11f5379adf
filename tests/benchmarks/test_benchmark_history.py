"""The history of rates: what is kept, and what counts as a fall."""

from dataclasses import replace

import pytest

from tests.benchmarks import explicit, history
from tests.benchmarks.history import Entry, Rate, falls, last_like, read_history
from tests.benchmarks.kernels import internal_force_work, update_work
from tests.benchmarks.roofline import Roofline
from validation import InputError

MACHINE = Roofline(10.0, 40.0, 100.0)


def entry(date="2026-01-01", processor="one", **values) -> Entry:
    rates = tuple(Rate(name, value, "M/s", 100.0) for name, value in values.items())
    return Entry(date, "tubelock 1", processor, MACHINE, rates)


def test_a_fall_is_a_smaller_share_of_what_the_machine_allows():
    before = entry(step=50.0, force=60.0, gone=1.0)
    now = entry("2026-02-01", step=44.0, force=55.0, new=1.0)
    # 44 of 50 is less than nine tenths, 55 of 60 is not; names of one side only have no other.
    (said,) = falls(before, now)
    assert said.startswith("step: 12 % slower than on 2026-01-01")
    # The same rates on a machine of half the speed are no fall.
    half = replace(now, rates=tuple(replace(r, limit=50.0) for r in now.rates))
    assert falls(before, half) == []


def test_the_last_run_of_the_same_processor_is_compared():
    entries = [entry("a", "one"), entry("b", "one"), entry("c", "two")]
    assert last_like(entries, entry(processor="one")) is entries[1]
    assert last_like(entries, entry(processor="three")) is entries[2]
    assert last_like([], entry()) is None


def test_runs_are_added_to_the_history(tmp_path, monkeypatch, capsys):
    path = tmp_path / "history.jsonl"
    rate = {"value": 50.0}
    monkeypatch.setattr(history, "roofline", lambda: MACHINE)
    monkeypatch.setattr(
        history, "MEASUREMENTS", (lambda _: [Rate("step", rate["value"], "M/s", 100.0)],)
    )
    assert history.main(["--history", str(path)]) == 0
    assert "first entry" in capsys.readouterr().out
    rate["value"] = 40.0
    assert history.main(["--history", str(path), "--no-record"]) == 0
    assert "step: 20 % slower" in capsys.readouterr().out
    assert history.main(["--history", str(path)]) == 0
    assert [e.rates[0].value for e in read_history(path)] == [50.0, 40.0]
    assert history.main(["--history", str(path)]) == 0
    assert "Nothing fell" in capsys.readouterr().out


@pytest.mark.parametrize("line", ["{", "{}", '{"date": 1}', "[1]", "3"])
def test_a_damaged_history_is_refused_and_left_alone(tmp_path, capsys, line):
    path = tmp_path / "history.jsonl"
    path.write_text(entry(step=1.0).line() + "\n" + line + "\n")
    text = path.read_text()
    with pytest.raises(InputError, match=r"line 2: got .* expected one run of the benchmarks"):
        read_history(path)
    assert history.main(["--history", str(path)]) == 1
    assert "line 2" in capsys.readouterr().err
    assert path.read_text() == text


def test_the_history_of_the_repository_can_be_read():
    entries = read_history(history.HISTORY)
    assert entries
    # No loop is faster than the roofline of the same run; the triad is measured to some per cent.
    assert all(0.0 < rate.share < 1.1 for e in entries for rate in e.rates)


def test_work_is_counted_from_the_arrays():
    group = explicit.benchmark_group((3, 2, 2), 2)
    force, update = internal_force_work(group), update_work(group)
    # Blocks of a grid: (3 n + 1) along each edge; each read once for two copies.
    blocks, nodes, elements = 10 * 7 * 7, 4 * 3 * 3, 12
    assert force.flops == pytest.approx(18 * blocks / elements)
    assert force.bytes == pytest.approx((blocks * 76 / 2 + 3 * 8 * 3 * nodes) / elements)
    assert update.bytes == pytest.approx(5 * 8 * 3 * nodes / elements)
    # Twice the bandwidth and twice the peak: twice the limit, whichever binds.
    double = Roofline(20.0, 80.0, 200.0)
    for work in (force, update, force + update):
        assert work.limit(double) == pytest.approx(2 * work.limit(MACHINE))
