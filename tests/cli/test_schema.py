"""The JSON schema of scenes says what reading them says."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from typing import Any

import jsonschema
import pytest

from validation import InputError, builtin_names, builtin_text, load_case
from validation.scene.keys.schema import scene_schema
from validation.scene.keys.toml_text import toml_text
from validation.scene.read import SCENE_TYPES, check_scene


@pytest.fixture(scope="module")
def judge() -> jsonschema.Draft7Validator:
    schema = scene_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def changed(name: str, section: str, key: str, value: Any) -> dict[str, Any]:
    data = tomllib.loads(builtin_text(name))
    data.setdefault(section, {})[key] = value
    return data


@pytest.mark.parametrize("name", builtin_names())
def test_schema_accepts_every_builtin_scene(judge: jsonschema.Draft7Validator, name: str) -> None:
    assert not list(judge.iter_errors(tomllib.loads(builtin_text(name))))


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("block", "heigth", 200.0),
        ("block", "type", "sphere"),
        ("block", "height", -1.0),
        ("mesh", "around", 0),
        ("mesh", "around", 2.5),
        ("load", "case", "pipeline"),
        ("material", "poisson_ratio", 0.5),
        ("fem", "method", "implicit"),
    ],
)
def test_schema_refuses_what_reading_refuses(
    judge: jsonschema.Draft7Validator, section: str, key: str, value: Any
) -> None:
    data = changed("tsb1-pipe", section, key, value)
    assert list(judge.iter_errors(data))
    with pytest.raises(InputError):
        check_scene(data)


@pytest.mark.parametrize(("key", "value"), [("auto", 0.01), ("friction", 0.4)])
def test_schema_accepts_the_short_ways_of_writing(
    judge: jsonschema.Draft7Validator, key: str, value: Any
) -> None:
    data = changed("tsb1-pipe", "effects", key, value)
    check_scene(data)
    assert not list(judge.iter_errors(data))


def test_every_key_with_a_docstring_is_described() -> None:
    # Editors show it: of the block of a tube every key has one.
    block = scene_schema()["definitions"]["SineTubeBlock"]["properties"]
    assert all(key.get("description") for name, key in block.items() if name != "type")


def test_command_prints_the_schema_that_builtin_scenes_name() -> None:
    printed = subprocess.run(
        [sys.executable, "-m", "validation.cli", "scenes", "--schema"],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout
    schema = json.loads(printed)
    assert schema == json.loads(json.dumps(scene_schema()))
    assert set(schema["properties"]["block"]["properties"]["type"]["enum"]) == set(SCENE_TYPES)
    for name in builtin_names():
        assert builtin_text(name).startswith("#:schema scene.json\n")


def test_toml_text_is_read_back() -> None:
    case = load_case("wall")
    assert load_case(tomllib.loads(toml_text(case.keys))).scene == case.scene
    odd = {"a": {"b c": 'so "called"\n', "d": [1, 2.5e-9, {"e": True}]}, "list": [[1], [2]]}
    assert tomllib.loads(toml_text(odd)) == odd
