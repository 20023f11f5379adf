"""Whatever stands at a key, and whatever words are typed: it is answered or refused in one line."""

from __future__ import annotations

import contextlib
import json
import math
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geometry import RefusedError
from tests.fixtures.commands import undrawn
from tests.support.coarse_tubes import coarse
from tests.support.commands import command
from tests.support.cubes_deck import CUBES
from tests.support.drawn_blocks import cuboid, write_obj
from tests.support.wrong_input import PLACES
from validation import InputError, builtin_text, load_case, sweep
from validation.cli.app import app
from validation.scene.read import check_scene

#: Scenes that are built and answered in a blink, by what makes them small.
SMALL = {
    "tsb1-pipe": coarse(1, 2),
    "thb0-pipe": ("assembly.layers=1", "mesh.edge=2", "mesh.radial=1"),
    "brick-stack": ("mesh.divisions=[2,1,1]", "assembly.columns=2", "assembly.layers=2"),
    "planar-sine": ("assembly.columns=1", "assembly.layers=1", "mesh.divisions=[12,2,2]"),
    "osteomorphic": ("assembly.columns=1", "assembly.layers=1", "mesh.divisions=[4,2,2]"),
    "arch": ("assembly.voussoirs=5",),
    "wall": ("assembly.rows=1", "assembly.columns=2"),
    "octahedra": ("assembly.rings=0",),
}
NUMBERS = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([0, -1, 10**29, 10**400, 2**63, 5e-324, 1e308, math.inf, math.nan, -0.0]),
)
WORDS = st.one_of(
    st.text(max_size=12),
    st.sampled_from(["$x^{2$", "[/x]", "auto", "1%", "1e400 mm", "-9.81 m/s2", "x" * 300, "\x00"]),
)
VALUES = st.recursive(
    st.one_of(NUMBERS, WORDS, st.booleans(), st.none()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=6), inner, max_size=2)
    ),
    max_leaves=5,
)
SLOW = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])


def refusal(work: Callable[[], object]) -> str:
    """The line that refuses; none where it is done. No other error passes."""
    try:
        work()
    except RefusedError as error:
        return str(error)
    return ""


def changed(name: str, path: tuple[str, ...], value: Any) -> dict[str, Any]:
    data: dict[str, Any] = tomllib.loads(builtin_text(name))
    section: Any = data
    for key in path[:-1]:
        inner = section.setdefault(key, {})
        section = inner if isinstance(inner, dict) else {}
    section[path[-1]] = value
    return data


@settings(SLOW, max_examples=150)
@given(place=st.sampled_from(PLACES), value=VALUES)
def test_every_value_of_every_key_is_read_or_refused_in_one_line(
    place: tuple[str, tuple[str, ...]], value: Any
) -> None:
    line = refusal(lambda: check_scene(changed(*place, value), "scene"))
    assert line.startswith("scene: ") or not line
    assert "\n" not in line
    # What is read is built or refused, where that is cheap.
    name, path = place
    if not line and name in SMALL and path[0] not in {"fem", "rigid", "pictures"}:
        case = load_case(changed(*place, value)).changed(SMALL[name])
        assert "\n" not in refusal(lambda: case.problem)


#: Every command with its options, and files that some read.
COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
READS = {"scene.toml": ("mbd", "export"), "deck.inp": ("deck",), "two.obj": ("check",)}
BOXES = {"low": cuboid((0, 0, 0), (1, 1, 1)), "high": cuboid((0, 0, 1), (1, 1, 2))}
PLACES_TO_WRITE = ("out.json", "scene.toml", "/dev/full", "no/such/folder/a.json", ".", "")


def words_of(draw: Callable[..., Any]) -> list[str]:
    """A command on a small scene, or on a file some of whose bytes are changed; up to 3 options."""
    name = draw(st.sampled_from(list(SMALL)))
    sets = [part for setting in SMALL[name] for part in ("--set", setting)]
    word, subject = draw(st.sampled_from(("mbd", "export", "scenes"))), name
    if draw(st.booleans()):
        subject = draw(st.sampled_from(list(READS)))
        word, path = draw(st.sampled_from(READS[subject])), Path(subject)
        sets = [] if subject != "scene.toml" else sets
        whole = {"scene.toml": builtin_text(name), "deck.inp": "\n".join(CUBES)}
        path.write_text(whole.get(subject, ""), "utf-8")
        if subject == "two.obj":
            write_obj(path, BOXES)
        text = bytearray(path.read_bytes())
        for place in draw(st.lists(st.integers(0, len(text) - 1), max_size=4)):
            text[place] = draw(st.sampled_from(b"\x00\xff\n-09e,"))
        path.write_bytes(text)
    words = [word, subject, *(sets if word != "scenes" else ())]
    words += ["-o", "case.inp"] * (word == "export")
    options = [p for p in COMMANDS[word].params if p.param_type_name == "option"]
    for option in draw(st.lists(st.sampled_from(options), max_size=3)) if options else ():
        words.append(draw(st.sampled_from([*option.opts, *option.secondary_opts])))
        if not option.is_flag:
            words.append(draw(st.one_of(WORDS, st.sampled_from(PLACES_TO_WRITE))))
    return [part.replace("\x00", "") for part in words]  # nobody can type it


@settings(SLOW, max_examples=30)
@given(data=st.data())
def test_every_line_is_answered_or_refused_in_one_line(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), undrawn():
        words = words_of(data.draw)
        status, out, err = command(*words)
        assert not list(Path().rglob(".partial-*")), words
    refused = [line for line in err.splitlines() if line.lower().startswith("error: ")]
    assert (status in {0, 1, 3} and not refused) or (status == 2 and len(refused) == 1), words
    assert "Warning" not in err, words
    if out.startswith("{"):
        json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} in {words}"))


def test_scenes_beyond_the_memory_of_a_machine_are_refused() -> None:
    """Before anything of that size is made."""
    for name, changes in (
        ("tsb1-pipe", ["mesh.radial=1000000"]),
        ("tsb1-pipe", ["assembly.layers=100000000000000000000000000000"]),
        ("wall", ["assembly.columns=100000000"]),
        ("cantilever", ["mesh.divisions=[500, 300, 300]", 'fem.method="static"']),
        ("tsb1-pipe", ["mesh.around=1200", "mesh.radial=100", 'fem.method="explicit"']),
    ):
        assert "GB of memory" in refusal(lambda: load_case(name, changes).problem)  # noqa: B023
    for text in (2000 * "[" + 2000 * "]", 5000 * "9"):
        assert "\n" not in refusal(lambda: load_case("wall", [f"load.pressure={text}"]))  # noqa: B023
    ranges = {key: {"from": 1, "to": 3000, "step": 1} for key in ("amplitude", "height")}
    with pytest.raises(InputError, match=r"1\.8e\+07 designs.*fewer values"):
        sweep("tsb1-pipe", {"block": ranges, "assembly.layers": [1, 2]})
