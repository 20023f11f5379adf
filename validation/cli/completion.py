"""Shell completion: names of scenes and studies, keys of `--set`, effects.

The shell runs this at every TAB, so imports are deferred until they are needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from validation.scene.builtin import builtin_names


def complete_scenes(incomplete: str) -> list[str]:
    """Names of built-in scenes; the shell offers files by itself where none fits."""
    return [name for name in builtin_names() if name.startswith(incomplete)]


def complete_studies(incomplete: str) -> list[str]:
    """Names of built-in studies."""
    return [name for name in builtin_names("study") if name.startswith(incomplete)]


def complete_effects(incomplete: str) -> list[str]:
    """Names of effects that can be decided."""
    from validation.scene.deformable import EffectName

    return [name for name in EffectName if name.startswith(incomplete)]


def complete_flavours(incomplete: str) -> list[str]:
    """Flavours of decks."""
    return [word for word in ("general", "standard", "calculix") if word.startswith(incomplete)]


def complete_settings(ctx: Any, incomplete: str) -> list[str]:
    """Keys that the scene on the command line may have, as ``section.key=``."""
    keys = _keys_of(ctx.params.get("scene"))
    return [f"{key}=" for key in keys if key.startswith(incomplete)]


def _keys_of(scene: str | None) -> list[str]:
    """All keys of one kind of scene; of every kind where the scene is not known."""
    from validation.errors import InputError
    from validation.scene.read import SCENE_TYPES, scene_data

    kinds = list(SCENE_TYPES.values())
    if scene is not None:
        with suppress(InputError, KeyError, TypeError):
            kinds = [SCENE_TYPES[scene_data(scene)[1]["block"]["type"]]]
    return sorted({key for kind in kinds for key in _keys(kind)})


def _keys(model: Any, above: str = "") -> Iterator[str]:
    """``section.key`` of every value below a section, ``[effects.friction]`` included."""
    from typing import get_args

    from pydantic import BaseModel

    for name, field in model.model_fields.items():
        place = f"{above}.{name}" if above else name
        kinds = (field.annotation, *get_args(field.annotation))
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        if inner:
            yield from _keys(inner[0], place)
        elif above:
            yield place
