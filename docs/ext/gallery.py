"""One page for each built-in scene: picture, scene, commands, what they print, their time."""

from __future__ import annotations

import os
import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ext.runs import Run, emptied, run, shown
from validation.scene.builtin import builtin_about, builtin_names, builtin_text

PLAN = Path(__file__).parents[1] / "gallery.toml"


@dataclass(frozen=True)
class Page:
    """A page of the gallery."""

    name: str
    about: str
    """First comment of the scene."""
    poster: str | None
    """Picture for the overview, beside the page."""


def write_gallery(folder: Path) -> None:
    """Write the overview and one page for each built-in scene."""
    emptied(folder)
    plan = tomllib.loads(PLAN.read_text("utf-8"))
    wanted = os.environ.get("GALLERY_ONLY", "").split()
    names = [name for name in builtin_names() if not wanted or name in wanted]
    pages = {name: _page(name, plan, folder) for name in names}
    groups = [(g["title"], [n for n in g["scenes"] if n in pages]) for g in plan["group"]]
    placed = {name for _, scenes in groups for name in scenes}
    groups.append(("More", [name for name in names if name not in placed]))
    (folder / "index.md").write_text(_overview(groups, pages), "utf-8")


def _overview(groups: list[tuple[str, list[str]]], pages: dict[str, Page]) -> str:
    lines = [
        "# Gallery",
        "",
        "Results of every built-in scene. `tubelock scenes` lists them; `tubelock scenes NAME >",
        "mine.toml` writes a copy for your own scene.",
        "",
    ]
    for title, names in groups:
        if not names:
            continue
        lines += [f"## {title}", "", "::::{grid} 1 2 3 3", ":gutter: 2", ""]
        for name in names:
            page = pages[name]
            lines += [f":::{{grid-item-card}} {name}", f":link: {name}", ":link-type: doc"]
            if page.poster:
                lines.append(f":img-top: {page.poster}")
            lines += ["", page.about, ":::", ""]
        lines += ["::::", ""]
    lines += ["```{toctree}", ":hidden:", "", *pages, "```", ""]
    return "\n".join(lines)


def _page(name: str, plan: dict[str, Any], folder: Path) -> Page:
    own = plan["scene"].get(name, {})
    text = builtin_text(name)
    about = builtin_about(name)
    lines = [f"# {name}", "", about, ""]
    poster: str | None = None
    for words in own.get("runs", plan["runs"]):
        command = words.replace("SCENE", name)
        result = run(command)
        pictures = [] if result is None else _copied(result, name, command.split()[0], folder)
        poster = poster or (pictures[0] if pictures else None)
        lines += [shown(result, command, pictures), ""]
        if result is not None and own.get("view") and own["view"] in words:
            lines += _view(result, name, folder)
    lines += ["## The scene", "", "```toml", text.rstrip(), "```", ""]
    lines += [own["note"], ""] if "note" in own else []
    (folder / f"{name}.md").write_text("\n".join(lines), "utf-8")
    return Page(name, about, poster)


def _copied(found: Run, name: str, verb: str, folder: Path) -> list[str]:
    """Pictures of a run beside the page, by name."""
    copied = []
    for picture in found.files(".png"):
        target = f"{name}-{verb}-{picture.stem}.png"
        shutil.copyfile(picture, folder / target)
        copied.append(target)
    return copied


def _view(found: Run, name: str, folder: Path) -> list[str]:
    """Contact pressures to turn, from the field file of a run; nothing without trame-vtk."""
    from ext.view import write_view

    fields = [path for path in found.files(".vtu") if "pressure" in path.name]
    if not fields or not write_view(fields[0], folder / f"{name}-view.html"):
        return []
    return [
        "## Interactive view",
        "",
        "Contact pressures on the joints; drag to rotate, scroll to zoom.",
        "",
        "```{raw} html",
        f'<iframe class="view" loading="lazy" title="{name}: interactive contact pressures" '
        f'src="{name}-view.html"></iframe>',
        "```",
        "",
    ]
