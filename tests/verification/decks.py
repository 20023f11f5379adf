"""Input decks in a folder: which are read and solved, which are rejected and why: ``--decks``.

Every deck has a process of its own, which is stopped after ten CPU minutes. Beside the answer stand
differences of displacements, node by node, over the largest: to a reference file (``NAME.dat.ref``)
and to CalculiX on the same text; and of CalculiX on that text to CalculiX on the deck that this
package writes of it, which judges how the deck is read. Contact pressures, means over facets or at
nodes, have the difference of the largest ones, and the root of the mean square of all. Rows are
kept in ``out/decks.jsonl``: a second call goes on where the first was stopped.
"""

from __future__ import annotations

import json
import multiprocessing
import re
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from fem import read_deck
from fem.decks.read.deck import InputDeck
from fem.decks.read.words import Dialect
from geometry import Answer, RefusedError
from tests.support.ccx import CalculixError
from tests.verification.deck_oracle import (
    deck_nodes,
    difference,
    original,
    ours,
    pressures,
    printed,
    printed_pressures,
    written_again,
)
from tests.verification.folder import LIMIT
from validation.output.decks import solve_deck

#: Places in decks, which differ where reasons do not.
_PLACE = re.compile(r"^(\S+, )?line \d+: |[\w-]+: (?=surfaces of)")
#: Where rows are kept.
KEPT = Path("out/decks.jsonl")
_NUMBER = re.compile(r"\d[\d.e+-]*")


def rows(folder: Path, kept: Path = KEPT) -> Iterator[dict[str, Any]]:
    """One row for each deck in a folder and its folders.

    Rows are kept in a file as they come: a second call goes on with decks that are missing there.
    """
    known = dict(_kept(kept))
    kept.parent.mkdir(parents=True, exist_ok=True)
    with kept.open("ab") as stream:
        if stream.tell() and not kept.read_bytes().endswith(b"\n"):
            stream.write(b"\n")  # what a stop cut short
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() == ".inp"):
        name, text = str(path.relative_to(folder)), sha256(path.read_bytes()).hexdigest()
        row = known.get((name, text))
        if row is None:
            row = {"deck": name, **_alone(path)}
            with kept.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([text, row], default=float) + "\n")
            print(f"{name}: {row['fate']}", file=sys.stderr, flush=True)
        yield row


def _kept(path: Path) -> Iterator[tuple[tuple[str, str], dict[str, Any]]]:
    """Rows of a file by deck and content; a line that a stop cut short is none."""
    for line in path.read_text("utf-8").splitlines() if path.exists() else ():
        with suppress(ValueError):
            text, row = json.loads(line)
            yield (row["deck"], text), row


def fates(found: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """How many decks have the same fate for the same reason."""
    found = [(row["fate"], "" if row["fate"] == "solved" else _reason(row)) for row in found]
    for (fate, why), count in sorted(
        Counter(found).items(), key=lambda item: (item[0][0], -item[1])
    ):
        yield {"fate": fate, "why": why, "decks": count}


def _reason(row: Mapping[str, Any]) -> str:
    """Why, without lines, names and numbers."""
    why = _NUMBER.sub("…", _PLACE.sub("", row["why"]))
    return why.partition(": " if why.startswith("*Include") else " (line")[0]


def _alone(path: Path) -> dict[str, Any]:
    """Fate of a deck, in a process of its own."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(there, path))
    process.start()
    there.close()
    try:
        result: dict[str, Any] = here.recv()
    except EOFError:
        result = {"fate": "read, not solved", "why": f"stopped after {LIMIT} CPU s"}
    process.join()
    return result


def _send(pipe: Any, path: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
    pipe.send(fate(path))


def fate(path: Path) -> dict[str, Any]:
    """What becomes of a deck: rejected and why, read, or solved."""
    try:
        deck = read_deck(path)
        deck.validate()
    except RefusedError as error:
        return {"fate": "rejected", "why": _first(error, path)}
    start = time.process_time()
    try:
        answer = solve_deck(deck)
    except RefusedError as error:
        return {"fate": "read, not solved", "why": _first(error, path)}
    moved = answer.measures["max_displacement"]
    found = {
        "fate": "solved",
        "why": "; ".join(deck.model.notes)[:110],
        "u [mm]": moved.value,
        "±": moved.error,
        "CPU s": time.process_time() - start,
    }
    if deck.dialect is Dialect.CALCULIX:
        found |= _judged(deck, path, answer)
    return found


def _first(error: Exception, path: Path) -> str:
    return str(error).replace(f"{path}: ", "").replace(f"{path.parent}/", "").partition("; exp")[0]


def _judged(deck: InputDeck, path: Path, answer: Answer) -> dict[str, Any]:
    """Differences of displacements and contact pressures [%], or why there is none."""
    moved = ours(deck_nodes(deck), answer)
    nodes, reference = deck_nodes(deck), path.with_name(f"{path.stem}.dat.ref")
    found: dict[str, Any] = {}
    where, values = printed(nodes, reference) if reference.exists() else ([], None)
    if len(where):
        found["off .dat.ref [%]"] = difference(moved[where], values)
    stresses = printed_pressures(reference) if reference.exists() else None
    if stresses is not None:
        found |= _pressed(".dat.ref", *pressures(deck, answer, *stresses))
    theirs = _tried(lambda: original(nodes, path))
    again = _tried(lambda: written_again(nodes, deck))
    if isinstance(theirs, str):
        return found | {"off CalculiX [%]": theirs}
    found["off CalculiX [%]"] = difference(moved, theirs.displacements)
    if len(theirs.pressures):
        slaves = theirs.slave_nodes + 1, theirs.slave_sides, theirs.pressures
        found |= _pressed("CalculiX", *pressures(deck, answer, *slaves))
    found["written again [%]"] = (
        again if isinstance(again, str) else difference(theirs.displacements, again)
    )
    return found


def _pressed(other: str, mine: np.ndarray, theirs: np.ndarray) -> dict[str, float]:
    """Difference of the largest pressures, and root of the mean square of all, over theirs [%]."""
    largest = float(theirs.max(initial=0.0)) or 1.0
    return {
        f"p off {other} [%]": 100.0 * abs(float(mine.max(initial=0.0)) - largest) / largest,
        f"p rms {other} [%]": 100.0 * float(np.sqrt(((mine - theirs) ** 2).mean())) / largest,
    }


def _tried(run: Callable[[], Any]) -> Any:
    """A result, or the reason for none."""
    try:
        return run()
    except (RefusedError, CalculixError) as error:
        return str(error).partition(";")[0][:60]
