"""Whatever stands at a key of a scene: it is read, or refused in one line."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from geometry import RefusedError
from tests.support.wrong_input import PLACES, keys, kind_of
from validation import InputError, builtin_text, load_case, sweep
from validation.scene.read import check_scene

EXPLICIT = 'fem.method="explicit"'

NUMBERS = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([0, -1, 10**29, 10**400, 2**63, 5e-324, 1e308, math.inf, math.nan, -0.0]),
)
WORDS = st.one_of(
    st.text(max_size=12),
    st.sampled_from(["$x^{2$", "[/x]", "auto", "nan", "1e999", "1e400 mm", "-9.81 m/s2", "\x00"]),
)
VALUES = st.recursive(
    st.one_of(NUMBERS, WORDS, st.booleans(), st.none()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=6), inner, max_size=2)
    ),
    max_leaves=5,
)


def refusal(work: Callable[[], object]) -> str:
    """What is said where something is refused; nothing where it is done. No other error passes."""
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


@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(place=st.sampled_from(PLACES), value=VALUES)
def test_every_value_of_every_key_is_read_or_refused_in_one_line(
    place: tuple[str, tuple[str, ...]], value: Any
) -> None:
    words = refusal(lambda: check_scene(changed(*place, value), "scene"))
    assert words.startswith("scene: ") or not words
    assert "\n" not in words
    assert "expected one of  " not in words


#: Scenes that are built in a blink, and places whose values change what is built.
SMALL = {
    "tsb1-pipe": ["assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=2"],
    "thb0-pipe": ["assembly.layers=1", "mesh.edge=2", "mesh.radial=1"],
    "brick-stack": ["mesh.divisions=[2,1,1]"],
    "planar-sine": ["assembly.columns=1", "assembly.layers=1", "mesh.divisions=[12,2,2]"],
    "osteomorphic": ["assembly.columns=1", "assembly.layers=1", "mesh.divisions=[4,2,2]"],
    "arch": ["assembly.voussoirs=4"],
    "wall": ["assembly.rows=1", "assembly.columns=2"],
    "octahedra": ["assembly.rings=0"],
}
BUILT = [
    (name, path)
    for name in SMALL
    for path in keys(kind_of(name))
    if len(path) == 2 and path[0] in {"block", "load", "assembly", "detection", "mesh"}
]


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    place=st.sampled_from(BUILT),
    value=st.one_of(
        st.floats(allow_nan=False, allow_infinity=False),
        st.integers(-1, 6),
        st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3),
    ),
)
@example(place=("thb0-pipe", ("block", "inner_radius")), value=1.4320280237946012e103)
def test_what_is_read_is_built_or_refused_in_one_line(
    place: tuple[str, tuple[str, ...]], value: Any
) -> None:
    name, path = place
    key = ".".join(path)

    def build() -> None:
        _ = load_case(name, [*SMALL[name], f"{key}={value!r}"]).problem

    assert "\n" not in refusal(build)


def test_scenes_beyond_the_memory_of_a_machine_are_refused() -> None:
    for name, change, remedy in (
        ("tsb1-pipe", "mesh.radial=1000000", "fewer elements"),
        ("tsb1-pipe", "assembly.layers=100000000000000000000000000000", "fewer blocks"),
        ("wall", "assembly.columns=100000000", "fewer of them"),
        ("octahedra", "assembly.rings=1000000", "fewer of them"),
        ("cantilever", "mesh.divisions=[100000, 10000, 1000]", "fewer elements"),
        ("arch", "assembly.voussoirs=10000000", "fewer of them"),
    ):
        with pytest.raises(InputError, match=f"GB of memory.*{remedy}"):
            load_case(name, [change])


def test_deformable_blocks_beyond_the_memory_of_a_machine_are_refused() -> None:
    for name, changes in (
        ("tsb1-pipe", ["mesh.around=1200", "mesh.radial=100", "mesh.axial=200"]),
        ("tsb1-pipe", ["mesh.around=1200", "mesh.radial=100", "mesh.axial=200", EXPLICIT]),
        ("cantilever", ["mesh.divisions=[500, 300, 300]", 'fem.method="static"']),
    ):
        case = load_case(name, changes)
        with pytest.raises(RefusedError, match=r"GB of memory.*fewer elements"):
            _ = case.problem


def test_studies_without_end_are_refused_at_once() -> None:
    ranges = {key: {"from": 1, "to": 3000, "step": 1} for key in ("amplitude", "height")}
    with pytest.raises(InputError, match=r"3000 × 3000 × 2 = 1\.8e\+07 designs.*fewer values"):
        sweep("tsb1-pipe", {"block": ranges, "assembly.layers": [1, 2]})
