"""JSON schema of scenes, for editors: keys, types, ranges and what they mean, from the models."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from validation.scene.keys.quantities import field_docstrings, unit_of
from validation.scene.read import SCENE_TYPES

#: Version of the schema's dialect that editors of TOML know.
DIALECT = "http://json-schema.org/draft-07/schema#"


class _WithDocstrings(GenerateJsonSchema):
    """The docstring below a field is the description of its key."""

    def model_schema(self, schema: Any) -> JsonSchemaValue:
        return _described(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: Any) -> JsonSchemaValue:
        return _described(super().dataclass_schema(schema), schema["cls"])


def _described(found: JsonSchemaValue, section: type) -> JsonSchemaValue:
    about = field_docstrings(section)
    keys = found.get("properties", {})
    for name in keys:
        key = keys[name] = _without_null(keys[name])
        if name in about:
            # In draft 7 a reference hides what stands beside it.
            if "$ref" in key:
                key["allOf"] = [{"$ref": key.pop("$ref")}]
            key["description"] = about[name].replace("``", "`")
            if unit_of(about[name]) is not None:
                keys[name] = _with_units(key)
    return found


def _with_units(key: JsonSchemaValue) -> JsonSchemaValue:
    """Schema of a key whose numbers may also be texts with a unit."""
    changed = {
        word: value for word, value in key.items() if word not in ("prefixItems", "items", "anyOf")
    }
    for word in ("prefixItems", "items", "anyOf"):
        value = key.get(word)
        if isinstance(value, dict):
            changed[word] = _with_units(value)
        elif isinstance(value, list):
            changed[word] = [_with_units(part) for part in value]
    if key.get("type") != "number":
        return changed
    outside: JsonSchemaValue = {
        word: changed.pop(word) for word in ("default", "description") if word in changed
    }
    return {"anyOf": [changed, {"type": "string", "pattern": "^[-+.0-9]"}], **outside}


def _without_null(key: JsonSchemaValue) -> JsonSchemaValue:
    """Schema of a key that may be absent: TOML has no null to write."""
    parts = [part for part in key.get("anyOf", ()) if part != {"type": "null"}]
    if len(parts) == len(key.get("anyOf", ())):
        return key
    rest = {word: value for word, value in key.items() if word != "anyOf" and value is not None}
    return {**rest, **parts[0]} if len(parts) == 1 else {**rest, "anyOf": parts}


def scene_schema() -> dict[str, Any]:
    """Schema of all scenes: the type of the block decides which keys the others have.

    Returns
    -------
    dict
        JSON schema (draft 7). What sections check together, such as that one of two keys is
        given, is not in it: reading the scene says that.
    """
    kinds: dict[str, dict[str, Any]] = {}
    definitions: dict[str, Any] = {}
    for kind, model in SCENE_TYPES.items():
        result = TypeAdapter(model).json_schema(
            ref_template="#/definitions/{model}", schema_generator=_WithDocstrings
        )
        definitions.update(result.pop("$defs", {}))
        kinds[kind] = result
        definitions[f"scene-{kind}"] = result
    return {
        "$schema": DIALECT,
        "title": "tubelock scene",
        "description": "A topological interlocking assembly: blocks, supports, load, method.",
        "type": "object",
        "required": ["block"],
        "properties": {
            "block": {
                "type": "object",
                "required": ["type"],
                "properties": {"type": {"enum": list(kinds), "description": "Kind of block."}},
            }
        },
        "allOf": [
            {
                "if": {
                    "properties": {
                        "block": {"properties": {"type": {"const": kind}}, "required": ["type"]}
                    },
                    "required": ["block"],
                },
                "then": {"$ref": f"#/definitions/scene-{kind}"},
            }
            for kind in kinds
        ],
        "definitions": definitions,
    }
