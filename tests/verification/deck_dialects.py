"""Forty-odd ways to write a deck, each solved here and by CalculiX on the same text.

``python -m tests.verification deck-dialects``: two cubes under a pressure, with one thing written
otherwise in each deck; beams; a block in its fit. *Same*: displacements of all nodes within 2 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fem.decks.read.deck import deck_of_lines
from fem.decks.read.words import Dialect
from geometry import RefusedError
from tests.support.ccx import CalculixError, calculix_available
from tests.support.cubes_deck import CUBES, changed
from tests.support.decks import solved
from tests.support.press_fit import block
from tests.verification.deck_oracle import deck_nodes, difference, original, ours
from tests.verification.macneal_harder import beam_lines

#: Difference that counts as none [%]: CalculiX presses at nodes, with tension at open springs.
_SAME = 2.0
_LOAD = "UPPER, P2, 2."
_HEAVY = changed("*Elastic", "*Density\n1e-10\n*Elastic", CUBES)
_ROUGH = changed("500.\n", "500.\n*Friction\n0.2, 5000.\n", CUBES)
_SECOND = "*End Step\n*Step\n*Static\n*Dload{}\n{}\n*End Step"


def _law(words: str) -> list[str]:
    return changed("LINEAR\n500.", words)


def decks() -> dict[str, list[str]]:
    """Decks by what is written otherwise."""
    pushed = changed(_LOAD, f"{_LOAD}\n*Cload\n15, 1, 0.02\n18, 1, 0.02", _ROUGH)
    table = "*Amplitude, name=A\n0., 0., 1., 0.5\n*Step"
    steel = "*Material, name=N\n*Elastic\n2000., 0.\n*Material"
    along = "GRAV, 1e10, 0., 0., -1."
    return {
        "as it is": CUBES,
        "lower case, blanks": [line.lower().replace(",", " , ") for line in CUBES],
        "keyword lines that go on": changed("*Contact Pair, ", "*Contact Pair,\n"),
        "linear law, softer": _law("LINEAR\n250."),
        "exponential law": _law("EXPONENTIAL\n0.01, 2.0"),
        "law as a table": _law("TABULAR\n0., 0.\n1., 0.002\n4., 0.006"),
        "node to surface": changed("SURFACE TO SURFACE", "NODE TO SURFACE"),
        "small sliding": changed("type=SURFACE", "small sliding, type=SURFACE"),
        "adjust=0.": changed("interaction=I,", "interaction=I, adjust=0.,"),
        "clearance": changed(
            "*Boundary", "*Clearance, master=TOP, slave=UNDER, value=0.001\n*Boundary"
        ),
        "friction": _ROUGH,
        "friction, pushed aside": pushed,
        "friction without a slope": changed("0.2, 5000.", "0.2", pushed),
        "two materials": changed(
            "UPPER, material=M", "UPPER, material=N", changed("*Material", steel)
        ),
        "Poisson's ratio": changed("1000., 0.", "1000., 0.3"),
        "C3D8I": [line.replace("C3D8", "C3D8I") for line in CUBES],
        "C3D8R": [line.replace("C3D8", "C3D8R") for line in CUBES],
        "pressure by the number of the element": changed(_LOAD, "2, P2, 2."),
        "pressure on a surface": changed(
            f"*Dload\n{_LOAD}",
            "*Dsload\nLID, P, 2.",
            changed("*Material", "*Surface, name=LID\nUPPER, S2\n*Material"),
        ),
        "pressure from aside": changed(_LOAD, f"{_LOAD}\nUPPER, P6, 0.05"),
        "forces on nodes": changed(
            f"*Dload\n{_LOAD}", "*Cload\n15, 3, -0.5\n16, 3, -0.5\n17, 3, -0.5\n18, 3, -0.5"
        ),
        "forces on a set": changed(
            f"*Dload\n{_LOAD}",
            "*Cload\nLID, 3, -0.5",
            changed("*Boundary", "*Nset, nset=LID, generate\n15, 18, 1\n*Boundary"),
        ),
        "gravity of both": changed(_LOAD, f"UPPER, {along}\nLOWER, {along}", _HEAVY),
        "gravity of one": changed(_LOAD, f"{_LOAD}\nUPPER, {along}", _HEAVY),
        "force per volume": changed(_LOAD, f"{_LOAD}\nUPPER, BZ, -1."),
        "a support that moves": changed("*Dload", "*Boundary\nFOOT, 3, 3, -0.001\n*Dload"),
        "sets of sets": changed(
            "*Boundary\nFOOT",
            "*Nset, nset=HALF\n1, 2\n*Nset, nset=BASE\nHALF, 3, 4\n*Boundary\nBASE",
        ),
        "generated sets": changed("nset=FOOT\n1, 2, 3, 4", "nset=FOOT, generate\n1, 4, 1"),
        "an amplitude": changed("*Dload", "*Dload, amplitude=A", changed("*Step", table)),
        "an amplitude of a support": changed(
            "*Dload", "*Boundary, amplitude=A\nFOOT, 3, 3, -0.001\n*Dload", changed("*Step", table)
        ),
        "a second step": changed("*End Step", _SECOND.format("", "UPPER, BZ, -1.")),
        "a second step, stated anew": changed("*End Step", _SECOND.format("", "UPPER, P2, 1.")),
        "a second step, op=NEW": changed("*End Step", _SECOND.format(", op=NEW", "2, P2, 3.")),
        "times of the step": changed("*Static", "*Static\n0.25, 2., 1e-5, 0.5"),
        "nlgeom": changed("*Step", "*Step, nlgeom"),
        "an orientation": changed(
            "elset=UPPER, m",
            "elset=UPPER, orientation=O, m",
            changed("*Material", "*Orientation, name=O\n0., 1., 0., 1., 0., 0.\n*Material"),
        ),
        "density": _HEAVY,
        "a pusher with friction, two steps": block(6),
        **{
            f"beam of {shape}, {kind}": beam_lines(shape, kind)
            for shape in ("regular", "trapezoids", "parallelograms")
            for kind in ("C3D8I", "C3D8")
        },
    }


def rows(every: int = 1) -> Iterator[dict[str, Any]]:
    """Verdict on ``every`` so-many-th deck, and how many have each."""
    if not calculix_available():
        return
    verdicts: dict[str, int] = {}
    for name, lines in list(decks().items())[::every]:
        row = {"deck": name, **_judged(lines)}
        verdicts[row["verdict"]] = verdicts.get(row["verdict"], 0) + 1
        yield row
    for verdict, count in verdicts.items():
        yield {"deck": f"{count} decks", "verdict": verdict}


def _judged(lines: list[str]) -> dict[str, Any]:
    try:
        deck = deck_of_lines(lines, dialect=Dialect.CALCULIX)
        answer = solved(deck)
    except RefusedError as error:
        return {"verdict": "rejected here", "why": str(error)[:90]}
    nodes = deck_nodes(deck)
    moved = ours(nodes, answer)
    with TemporaryDirectory() as folder:
        path = Path(folder, "deck.inp")
        path.write_text("\n".join([*lines, ""]), "utf-8")
        try:
            theirs = original(nodes, path).displacements
        except (CalculixError, OSError, ValueError) as error:
            return {"verdict": "CalculiX has no answer", "why": str(error)[-90:]}
    off = difference(moved, theirs)
    return {"verdict": "same" if off <= _SAME else "other", "off [%]": off}
