"""Scene reference: every key with type, range, unit and default, from the models that check it."""

from __future__ import annotations

import inspect
from collections import Counter
from pathlib import Path

from ext.fields import Key, keys
from ext.runs import emptied
from validation.scene.builtin import builtin_names, builtin_text
from validation.scene.read import SCENE_TYPES

_HEADS = "| key | type and range | unit | default | |\n|---|---|---|---|---|"


def write_scenes(folder: Path) -> None:
    """Write one page for each block type and one of the sections that they share."""
    emptied(folder)
    counts = Counter(
        key.section for kind in set(SCENE_TYPES.values()) for key in keys(kind) if key.section
    )
    shared = [section for section, count in counts.items() if count > 1]
    for kind, scene in SCENE_TYPES.items():
        (folder / f"{kind}.md").write_text(_type_page(kind, scene, shared), "utf-8")
    (folder / "shared.md").write_text(_shared_page(shared), "utf-8")
    (folder / "index.md").write_text(_index(), "utf-8")


def _index() -> str:
    rows = [f"| [`{kind}`]({kind}.md) | {_about(scene)} |" for kind, scene in SCENE_TYPES.items()]
    names = "\n".join(SCENE_TYPES)
    return f"""# Scene reference

A scene is a TOML file. The `type` of its `[block]` determines its sections. Optional effects that
it does not list are inactive. An unknown key is rejected; the error names the most similar key.
`--set section.key=value` overrides a key from the command line. Units are mm, N, MPa, s, tonne.

| `[block] type` | description |
|---|---|
{chr(10).join(rows)}

Several types share the sections `[load]`, `[rigid]`, `[material]`, `[contact]`, `[effects]`,
`[fem]` and others, listed on [one page](shared.md).

```{{toctree}}
:hidden:

shared
{names}
```
"""


def _about(section: type) -> str:
    words = inspect.cleandoc(section.__doc__ or "").split("\n\n")[0]
    return " ".join(words.split()).replace("``", "`").replace("|", "\\|")


def _type_page(kind: str, scene: type, shared: list[type]) -> str:
    lines = [f"# {kind}", "", _about(scene), ""]
    for key in keys(scene):
        if key.section in shared:
            lines += [f"`[{key.name}]`: [{_must(key)}](shared.md#{_anchor(key.section)})", ""]
        elif key.section:
            lines += _section(key.section, key.name, key, level=2)
        else:
            lines += [f"## `[{key.name}]`", "", f"{key.type}. {key.about}", ""]
    examples = [name for name in builtin_names() if f'type = "{kind}"' in builtin_text(name)]
    if examples:
        text = builtin_text(examples[0]).rstrip()
        lines += ["## An example", "", f"`{examples[0]}`", "", "```toml", text, "```", ""]
    if len(examples) > 1:
        lines += ["Others: " + ", ".join(f"`{name}`" for name in examples[1:]), ""]
    return "\n".join(lines)


def _must(key: Key) -> str:
    return "required, its keys" if key.default == "required" else "its keys"


def _anchor(section: type) -> str:
    return f"section-{section.__name__.lower()}"


def _shared_page(shared: list[type]) -> str:
    names: dict[type, Key] = {}
    for scene in SCENE_TYPES.values():
        for key in keys(scene):
            if key.section in shared:
                names.setdefault(key.section, key)
    lines = ["# Shared sections", "", "Sections that several block types share.", ""]
    often = Counter(key.name for key in names.values())
    for section, key in names.items():
        users = [kind for kind, scene in SCENE_TYPES.items() if section in _sections(scene)]
        table = _section(section, key.name, None, level=2)
        if often[key.name] > 1:
            table[0] += f" of {', '.join(users)}"
        lines += [f"({_anchor(section)})=", *table]
        lines += [f"Of block types {', '.join(f'`{u}`' for u in users)}.", ""]
    return "\n".join(lines)


def _sections(scene: type) -> set[type]:
    return {key.section for key in keys(scene) if key.section}


def _section(section: type, path: str, key: Key | None, level: int) -> list[str]:
    """Table of a section, and of the sections inside it."""
    brackets = f"[[{path}]]" if key is not None and key.many else f"[{path}]"
    lines = [f"{'#' * level} `{brackets}`", "", _about(section), ""]
    if key is not None and key.about:
        lines += [key.about, ""]
    rows, inside = [], []
    for entry in keys(section):
        kind = f"section `[{path}.{entry.name}]`" if entry.section else entry.type
        rows.append(
            f"| `{entry.name}` | {kind} | {entry.unit} | {_code(entry.default)} | {entry.about} |"
        )
        if entry.section:
            inside += _section(entry.section, f"{path}.{entry.name}", entry, level + 1)
    return [*lines, _HEADS, *rows, "", *inside] if rows else [*lines, *inside]


def _code(default: str) -> str:
    return default if default in {"required", "absent", "as its keys"} else f"`{default}`"
