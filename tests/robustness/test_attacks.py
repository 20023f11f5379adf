"""Attacks of users on what they are told: misspelt keys."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry import RefusedError
from tests.support.wrong_input import PLACES, kind_of
from validation import load_case

pytestmark = pytest.mark.quick

#: Keys of a section, in scenes whose sections every such scene has.
LONG = [
    (name, path)
    for name, path in PLACES
    if len(path) == 2
    and len(path[1]) > 4
    # Loads of a box stand below the names of its faces.
    and path[1] in getattr(kind_of(name).model_fields[path[0]].annotation, "model_fields", ())
]


@given(place=st.sampled_from(LONG), at=st.integers(1, 3))
@settings(max_examples=100, deadline=None)
def test_a_key_that_lacks_a_letter_is_answered_with_the_key(
    place: tuple[str, tuple[str, ...]], at: int
) -> None:
    name, (section, key) = place
    slip = key[:at] + key[at + 1 :]
    if slip in kind_of(name).model_fields:
        return
    with pytest.raises(RefusedError) as refused:
        load_case(name, [f"{section}.{slip}=1"])
    words = str(refused.value)
    assert "\n" not in words
    assert f"{section}.{slip}" in words
    assert key in words.replace(f"{section}.{slip}", "")
