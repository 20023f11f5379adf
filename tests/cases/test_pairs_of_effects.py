"""Every two effects together, by every method: one law that both hold, or one line that rejects."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import pytest

from geometry import RefusedError
from tests.support.pairs import (
    BLOCKS,
    EFFECTS,
    LIMITS,
    METHODS,
    NEXT_TO_NONE,
    blocks_of,
    check,
    numbers,
)

_PRESSES = "loads: follows_block needs finite rotation"
_TURNS = "springs: got blocks that may turn by any angle"
#: Effects that a method rejects, with words of its line.
REFUSED: dict[str, dict[str, str]] = {
    "rigid": {
        "finite sliding": "finite_sliding: got True",
        "finite rotation": "finite_rotation: got True",
        "gap": "spacing: got 0.002 mm",
        "moving support": "got a support that moves",
        "springs": "got springs",
    },
    "static": {
        "finite rotation": "finite_rotation: got True",
        "following load": "got a pressure that turns with its block",
    },
    "explicit": {
        "degree > 1": "degree: got 2",
        "own law": "law: got Stiffening",
        "stage before": "after: explicit runs begin at rest",
        "following load": _PRESSES,
    },
}
#: Pairs that every method rejects, and some that one method does.
PAIRS: dict[frozenset[str], str] = {
    frozenset({"finite sliding", "periodic cell"}): "cannot slide on to other images",
    frozenset({"gap", "tetrahedra"}): "for solids, which have no layers to move apart",
}
PAIRS_OF: dict[str, dict[frozenset[str], str]] = {
    "rigid": {},
    "static": {
        frozenset({"gravity", "periodic cell"}): "move the periodic cell as a whole",
        frozenset({"sector", "tetrahedra"}): 'symmetry: got "sector"',
    },
    "explicit": {
        frozenset({"gravity", "periodic cell"}): "move the periodic cell as a whole",
        frozenset({"sector", "tetrahedra"}): 'symmetry: got "sector"',
        frozenset({"finite rotation", "springs"}): _TURNS,
        frozenset({"following load", "springs"}): _TURNS,
    },
}
#: Pairs that go together although a method rejects one alone.
TOGETHER = {("explicit", frozenset({"following load", "finite rotation"}))}
#: Effects that change no number: symmetry, a run that goes on, loads on the way without friction,
#: and what rigid blocks have no use for.
EQUAL: dict[str, set[str]] = {
    "rigid": {"degree > 1", "own law", "laws of pairs", "stage before"},
    "static": {"sector", "stage before"},
    "explicit": {"sector", "checkpoint"},
}
#: Effects to whose answer the way belongs: slips, and the force along the way of a support.
HISTORY = {"friction", "moving support", "push"}
#: What a method has no option for.
NO_OPTION = {"rigid": {"sector", "checkpoint"}, "static": {"checkpoint"}, "explicit": set[str]()}
#: Two solutions of one state, each to a residual of 1e-8: the softest motion of a cell, which no
#: frame holds, amplifies it some hundred times.
_SAME = 1e-5
#: Points at edges where surfaces end come and go with rounding: searches end while blocks move by
#: parts of the skin, and a sector then differs from the whole.
_SEARCHED = 1e-3
#: An effect that nobody looks at changes no bit.
_COUNTS = 1e-10
#: Least scale of forces: loads are of hundreds of newtons, and forces far below are round-off.
_LEAST = ("N", 1.0)
#: A share of an effect changes a number by no more than so many times this share.
_STEEPEST = 100.0
#: Largest imbalance of a block that an answer may have.
_BALANCED = 1e-6


#: Effects of which two take most work, and each near the limits of all others.
_DEAR = {"degree > 1", "periodic cell", "sector", "stage before", "tetrahedra"}


def _case(method: str, *effects: str) -> Any:
    """Of pairs of deformable blocks `make test` has every second one, with each effect."""
    places = [list(EFFECTS).index(effect) for effect in effects]
    second = method != "rigid" and len(places) == 2 and sum(places) % 2 == 1
    dear = second or (method == "static" and {*effects} <= _DEAR)
    return pytest.param(method, *effects, marks=[pytest.mark.thorough] * dear)


def _cases() -> list[Any]:
    return [
        _case(method, a, b)
        for method in METHODS
        for a, b in combinations(EFFECTS, 2)
        if not {a, b} & NO_OPTION[method] and {a, b} != {"periodic cell", "tetrahedra"}
    ]


def refusals(method: str, pair: frozenset[str]) -> list[str]:
    """Words of lines that reject a pair."""
    words = PAIRS | PAIRS_OF[method]
    if pair in words:
        return [words[pair]]
    if (method, pair) in TOGETHER:
        return []
    return [line for effect, line in REFUSED[method].items() if effect in pair]


def difference(
    one: Mapping[str, tuple[str, float]], other: Mapping[str, tuple[str, float]]
) -> float:
    """Largest difference of two answers over the largest number of its unit; inf: of names."""
    if one.keys() != other.keys():
        return float("inf")
    size: dict[str, float] = {}
    for unit, value in (*one.values(), *other.values()):
        size[unit] = max(size.get(unit, 0.0), abs(value))
    return max(
        abs(value - other[name][1]) / (size[unit] or 1.0)
        for name, (unit, value) in one.items()
        if name != "imbalance"
    )


def equals(method: str, pair: frozenset[str]) -> set[str]:
    """Effects of a pair that change no number."""
    equal = EQUAL[method] & pair
    if method == "static" and pair == {"degree > 1", "tetrahedra"}:
        equal |= {"degree > 1"}  # tetrahedra have degree 2
    if method == "static" and pair & HISTORY:
        equal -= {"stage before"}
    return equal


@pytest.mark.parametrize(("method", "a", "b"), _cases())
def test_two_effects_act_together_or_are_rejected(method: str, a: str, b: str) -> None:
    pair, on = frozenset({a, b}), blocks_of((a, b))
    lines = refusals(method, pair)
    if lines:
        for refuse in (check, numbers):
            with pytest.raises(RefusedError) as caught:
                refuse(pair, method, on)
            assert any(line in str(caught.value) for line in lines)
            assert "\n" not in str(caught.value)
        return
    both = numbers(pair, method, on)
    assert both["imbalance"][1] <= _BALANCED
    equal = equals(method, pair)
    for effect in pair - BLOCKS.keys() | equal:
        rest = pair - {effect}
        if effect == "sector":
            rest = frozenset(rest - BLOCKS.keys())  # the blocks alone, all computed
        if refusals(method, rest) or (method == "rigid" and on == "periodic cell"):
            continue  # a cell without a frame is not carried
        change = difference(both, numbers(rest, method, on))
        if effect in equal:
            searched = method == "static" and pair == {"sector", "finite sliding"}
            assert change <= (_SEARCHED if searched else _SAME), effect
        else:
            assert change > _COUNTS, effect


def _near(method: str, effect: str) -> list[set[str]]:
    """Effects near their limits beside another: all that leave free what was free, then others."""
    alone = {"rigid": [], "static": ["moving support", "stiff springs"]}
    supports = alone.get(method, ["moving support"])
    others = LIMITS.keys() - {effect, "moving support", "stiff springs"}
    if effect == "periodic cell":
        others -= {"springs"}  # soft ones hold a cell that is free: rounding is above the residual
    sets = [others, *({one} for one in supports if one != effect)]
    return [{one for one in s if not refusals(method, frozenset({one, effect}))} for s in sets]


@pytest.mark.parametrize(
    ("method", "effect"),
    [_case(m, e) for m in METHODS for e in EFFECTS if not ({e} & NO_OPTION[m] or e in REFUSED[m])],
)
def test_effects_near_their_limits_leave_another_alone(method: str, effect: str) -> None:
    """μ, gap, prestress, gravity, loads, motion and soft springs → 0; stiff springs → a support."""
    on, same = blocks_of((effect,)), {effect} | ({"equal steps"} if method == "explicit" else set())
    for near in _near(method, effect):
        both = numbers(frozenset({*same, *(f"{one} near its limit" for one in near)}), method, on)
        limit = numbers(frozenset({*same, *(f"limit of {one}" for one in near)}), method, on)
        # Rigid answers name in words what acts; a second support that moves renames work.
        names = [name for name in limit if name in both and limit[name][0] != "row"]
        ends = ({"least": _LEAST, **{k: of[k] for k in names}} for of in (both, limit))
        change = difference(*ends)
        assert change <= _STEEPEST * NEXT_TO_NONE, near
