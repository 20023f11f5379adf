"""Read the step: procedure, amplitude, output intervals and loads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem.decks.keywords import DeckError, name_of
from fem.decks.read.cards import Card, floats
from fem.decks.read.sections import Sections, block_entry
from fem.decks.statement import BodyForceLoad, DeckLoad, DeckStep, NodalForceLoad, Procedure
from geometry.loads.case import CircumferentialLoad, PressureLoad, TractionLoad
from geometry.mesh import FloatArray, IntArray


def read_step(sections: Sections) -> DeckStep:
    """Read what is computed, with the amplitude and the output intervals."""
    amplitude = sections.maybe("AMPLITUDE")
    ramp = 0.0 if amplitude is None else _ramp(amplitude)
    large = sections.step[0].parameters.get("NLGEOM", "").upper() != "NO"
    static = sections.maybe("STATIC")
    if static is not None:
        values = static.numbers()
        if len(values) != 4:
            raise DeckError(f"line {static.line}: expected four times under *Static")
        return DeckStep(Procedure.STATIC, float(values[1]), ramp, large_rotations=large)
    dynamic = sections.one("DYNAMIC")
    row = next(iter(dynamic.rows()), (dynamic.line, []))[1]
    if len(row) != 2:
        raise DeckError(f"line {dynamic.line}: expected a time step (or nothing) and an end time")
    end_time = floats(dynamic.line, row[1:])[0]
    factor = dynamic.parameters.get("SCALE FACTOR")
    fields, history = _output_intervals(sections, end_time)
    return DeckStep(
        Procedure.EXPLICIT,
        end_time,
        ramp,
        time_step=floats(dynamic.line, row[:1])[0] if row[0] else None,
        safety_factor=None if factor is None else floats(dynamic.line, [factor])[0],
        large_rotations=large,
        field_intervals=fields,
        history_intervals=history,
    )


def _ramp(card: Card) -> float:
    values = card.numbers()
    kind = card.parameters.get("DEFINITION", "").upper()
    if (
        kind != "SMOOTH STEP"
        or values.shape != (4,)
        or (values[[0, 1, 3]] != (0.0, 0.0, 1.0)).any()
    ):
        raise DeckError(f"line {card.line}: expected a smooth step from 0 at time 0 to 1")
    return float(values[2])


def _output_intervals(sections: Sections, end_time: float) -> tuple[int, int]:
    fields, history = 20, 200
    for card in sections.all("OUTPUT"):
        if "NUMBER INTERVAL" in card.parameters:
            fields = int(floats(card.line, [card.parameters["NUMBER INTERVAL"]])[0])
        if "TIME INTERVAL" in card.parameters:
            interval = floats(card.line, [card.parameters["TIME INTERVAL"]])[0]
            history = round(end_time / interval) if interval > 0.0 else 0
    return fields, history


def read_loads(sections: Sections, blocks: dict[str, int]) -> Iterator[DeckLoad]:
    """Read loads but gravity; ``blocks`` numbers the instances by name."""
    for card in sections.step:
        rows = list(card.rows()) if card.keyword in {"DSLOAD", "DLOAD", "CLOAD"} else []
        if not rows:
            continue
        if card.keyword == "CLOAD":
            yield _nodal_force(rows, blocks)
            continue
        line, row = rows[0]
        kind = row[1].upper() if len(row) > 1 else ""
        if card.keyword == "DLOAD" and kind == "GRAV":
            continue
        where = [block_entry(number, r[0], blocks) for number, r in rows]
        loaded = np.array(list(dict.fromkeys(block for block, _ in where)), dtype=np.int64)
        face = name_of(where[0][1])
        if card.keyword == "DLOAD" and kind in {"BX", "BY", "BZ"}:
            yield _body_force(rows, loaded, blocks)
        elif card.keyword == "DSLOAD" and kind == "P":
            yield PressureLoad(loaded, face, floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC" and "ORIENTATION" in card.parameters:
            yield CircumferentialLoad(loaded, face, floats(line, row[2:3])[0])
        elif card.keyword == "DSLOAD" and kind == "TRVEC":
            yield _traction(rows, loaded, face)
        else:
            raise DeckError(
                f"line {line}: got load {kind!r}; expected P or TRVEC under *Dsload, GRAV, BX, BY "
                "or BZ under *Dload"
            )


def _body_force(
    rows: list[tuple[int, list[str]]], loaded: IntArray, blocks: dict[str, int]
) -> BodyForceLoad:
    density = np.zeros((len(loaded), 3))
    position = {block: k for k, block in enumerate(loaded.tolist())}
    for line, row in rows:
        block, _ = block_entry(line, row[0], blocks)
        axis = "XYZ".find(row[1].upper()[1:])
        density[position[block], axis] = floats(line, row[2:3])[0]
    return BodyForceLoad(loaded, density)


def _nodal_force(rows: list[tuple[int, list[str]]], blocks: dict[str, int]) -> NodalForceLoad:
    forces: dict[tuple[int, int], FloatArray] = {}
    for line, row in rows:
        block, node = block_entry(line, row[0], blocks)
        component, value = floats(line, row[1:3]) if len(row) == 3 else (0.0, 0.0)
        if not node.isdigit() or component not in {1.0, 2.0, 3.0}:
            raise DeckError(f"line {line}: expected INSTANCE.NODE, a component and a force")
        forces.setdefault((block, int(node) - 1), np.zeros(3))[int(component) - 1] = value
    keys = np.array(list(forces), dtype=np.int64)
    return NodalForceLoad(keys[:, 0], keys[:, 1], np.array(list(forces.values())))


def _traction(rows: list[tuple[int, list[str]]], loaded: IntArray, face: str) -> TractionLoad:
    traction = np.zeros(3)
    for line, row in rows:
        if len(row) != 6:
            raise DeckError(f"line {line}: expected a surface, TRVEC, a magnitude and a direction")
        value, *direction = floats(line, row[2:])
        traction[int(np.argmax(direction))] = value
    return TractionLoad(loaded, face, traction)
