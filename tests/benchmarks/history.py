"""Rates over the months: one dated line for each run, and what has become slower.

``python -m tests.benchmarks.history [--history FILE] [--no-record]`` (``make bench``)

A rate alone says little: the next machine, or the same one with a busy neighbour, gives another.
So each run measures the machine's roofline as well, and each rate is kept with the share of what
that roofline allows: for a loop of f operations and b bytes an element, min(peak/f, bandwidth/b)
(Williams, Waterman and Patterson, "Roofline", CACM 52 (2009) 65). A fall of the *share* by more
than a tenth is said. Whole analyses have no such count: their limit is the peak alone, one analysis
for 10⁹ operations.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fem.system.body import Body
from fem.system.effects import Effects
from fem.system.time_step import critical_time_step
from geometry.machine.system import write_whole
from tests.benchmarks import contact, explicit, rigid
from tests.benchmarks.kernels import internal_force_work, update_work
from tests.benchmarks.roofline import Roofline, Work, roofline
from tests.support.lone_bodies import lone_bodies
from validation import InputError
from validation.output.files import prepare_file
from validation.output.provenance import processor, program

HISTORY = Path(__file__).with_name("history.jsonl")

#: A share that is less than this part of the last one is a fall.
KEPT = 0.9


@dataclass(frozen=True)
class Rate:
    """One rate, and what the roofline of the same run would allow."""

    name: str
    value: float
    """In `unit`, of one core."""
    unit: str
    limit: float
    """The same by the roofline."""

    @property
    def share(self) -> float:
        """Of the limit [-]."""
        return self.value / self.limit


@dataclass(frozen=True)
class Entry:
    """One run of the benchmarks."""

    date: str
    program: str
    processor: str
    roofline: Roofline
    rates: tuple[Rate, ...]

    def line(self) -> str:
        """One line of JSON, numbers of four digits."""
        return json.dumps(_short(asdict(self)), ensure_ascii=False)


def _short(value: Any) -> Any:
    """Numbers of four digits: the fifth is noise."""
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, dict):
        return {key: _short(v) for key, v in value.items()}
    return [_short(v) for v in value] if isinstance(value, list | tuple) else value


def read_history(path: Path) -> list[Entry]:
    """Entries of a file, oldest first; none where there is no file.

    Raises
    ------
    InputError
        A line that is no entry.
    """
    if not path.exists():
        return []
    entries = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            found = json.loads(line)
            found["roofline"] = Roofline(**found["roofline"])
            found["rates"] = tuple(Rate(**rate) for rate in found["rates"])
            entries.append(Entry(**found))
        except (ValueError, TypeError, KeyError):
            raise InputError(
                f"{path}, line {number}: got {line[:40]!r}, expected one run of the benchmarks as "
                "JSON; restore the file or give another with --history"
            ) from None
    return entries


def last_like(entries: Sequence[Entry], entry: Entry) -> Entry | None:
    """Last entry of the same processor, or of any where there is none."""
    same = [e for e in entries if e.processor == entry.processor]
    return next(reversed(same or entries), None)


def falls(before: Entry, now: Entry) -> list[str]:
    """One sentence for each rate whose share fell by more than a tenth."""
    shares = {rate.name: rate.share for rate in before.rates}
    alike = before.processor == now.processor
    then = before.date + ("" if alike else f" on another processor ({before.processor})")
    return [
        f"{rate.name}: {100 * (1 - rate.share / shares[rate.name]):.0f} % slower than on "
        f"{then}, relative to the roofline ({rate.share:.3g} of it, {shares[rate.name]:.3g} then)"
        for rate in now.rates
        if rate.name in shares and rate.share < KEPT * shares[rate.name]
    ]


# ---------------------------------------------------------------------------------------------
# What is measured


def _works(group: Body) -> tuple[Work, Work]:
    """Internal force and whole step of a group."""
    force = internal_force_work(group)
    return force, force + update_work(group)


def explicit_rates(machine: Roofline) -> list[Rate]:
    """Internal force and whole step of many, few and one copy; the step with each effect."""
    rates = []
    unit = "M element updates/s"
    group = explicit.benchmark_group(explicit.SMALL, 1)
    time_step = 0.9 * critical_time_step([group], Effects()).critical_time_step
    for copies in (52, 12, 1):
        group = explicit.benchmark_group(explicit.SMALL, copies)
        row = explicit.row(group, time_step, 1)
        force, whole = (w.limit(machine) for w in _works(group))
        name = f"{copies} {'copy' if copies == 1 else 'copies'}, float64"
        rates.append(Rate(f"internal force, {name}", row.internal_force, unit, force))
        rates.append(Rate(f"step with loads, {name}", row.whole_step, unit, whole))
    group = explicit.benchmark_group(explicit.SMALL, 52)
    limit = _works(group)[1].limit(machine)
    for name, effects in explicit.EFFECTS.items():
        case = explicit.ready(lone_bodies((group,), effects=effects), time_step)
        seconds = explicit.seconds_of_step(*case, threads=1, repeats=3)
        updates = group.mesh.n_elements * group.n_copies
        rates.append(Rate(f"step with {name}", updates / seconds / 1e6, unit, limit))
    return rates


def contact_rates(machine: Roofline) -> list[Rate]:
    """Whole step of one layer in contact."""
    case = contact.pressing(contact.tube(1, 960), 1, Effects(), steps=500)
    (group,) = case[0].stated.bodies
    limit = _works(group)[1].limit(machine)
    seconds = explicit.seconds_of_step(*case, threads=1, repeats=20)
    value = case[0].stated.n_elements / seconds / 1e6
    return [Rate("step with contact, 960 elements a block", value, "M element updates/s", limit)]


def rigid_rates(machine: Roofline) -> list[Rate]:
    """Analyses per second of blocks without deformation."""
    # Compiled and imported by the first: the others are what a study pays for each design.
    seconds = min([rigid.whole_analysis([]).cpu_seconds for _ in range(4)][1:])
    limit = machine.peak_float64_gflops
    return [Rate("rigid analysis, tsb1-pipe", 1.0 / seconds, "analyses/s", limit)]


MEASUREMENTS: tuple[Callable[[Roofline], list[Rate]], ...] = (
    explicit_rates,
    contact_rates,
    rigid_rates,
)


def measure() -> Entry:
    """Run all benchmarks; two minutes on an idle machine."""
    machine = roofline()
    rates = [rate for measurement in MEASUREMENTS for rate in measurement(machine)]
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    return Entry(today, f"tubelock {program()}", processor(), machine, tuple(rates))


def table(entry: Entry) -> str:
    """The entry as text."""
    machine = entry.roofline
    lines = [
        f"{entry.date}, {entry.program}, {entry.processor}",
        f"One core: triad {machine.triad_memory_gb_per_s:.1f} GB/s from memory, "
        f"{machine.triad_cache_gb_per_s:.1f} GB/s from cache; multiply-adds "
        f"{machine.peak_float64_gflops:.1f} GF/s",
        "",
        f"{'':45s} {'rate':>8s} {'limit':>8s} {'share':>6s}",
    ]
    lines += [f"{r.name:45s} {r.value:8.3g} {r.limit:8.3g} {r.share:6.3f}" for r in entry.rates]
    return "\n".join(lines)


def record(path: Path, entry: Entry) -> None:
    """Append an entry; the file is whole at every moment."""
    old = path.read_text(encoding="utf-8") if path.exists() else ""
    text = old + entry.line() + "\n"
    write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))


def main(arguments: list[str] | None = None) -> int:
    """Measure, compare with the last run, and add a line to the history."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--history", metavar="FILE", type=Path, default=HISTORY)
    parser.add_argument("--no-record", action="store_true", help="compare only")
    options = parser.parse_args(arguments)
    try:
        past = read_history(options.history)
        if not options.no_record:
            prepare_file(options.history)
        entry = measure()
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    before = last_like(past, entry)
    sys.stdout.write(table(entry) + "\n\n")
    if before is None:
        sys.stdout.write("The first entry: nothing to compare with.\n")
    else:
        said = falls(before, entry) or [f"Nothing fell by more than a tenth since {before.date}."]
        sys.stdout.write("\n".join(said) + "\n")
    if not options.no_record:
        record(options.history, entry)
    return 0


if __name__ == "__main__":
    sys.exit(main())
