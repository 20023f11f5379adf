"""The site: what its pages name exists, what they show is accepted, what they compute runs."""

from __future__ import annotations

import ast
import json
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from mdit_py_plugins.colon_fence import colon_fence_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from mdit_py_plugins.front_matter import front_matter_plugin

from validation import builtin_names, load_case

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))

from ext.commands import app  # noqa: E402
from ext.fields import keys  # noqa: E402
from ext.scenes import SCENE_TYPES  # noqa: E402

#: Folders and pages that the build writes.
GENERATED = ("gallery", "scenes", "results", "api", "_build", "commands.md")
PAGES = [
    path for path in sorted(DOCS.rglob("*.md")) if path.relative_to(DOCS).parts[0] not in GENERATED
]
#: The first key of a study in place of a scene.
STUDY = {"scene", "quantity", "parameters", "settings"}


def _blocks(language: str) -> Iterator[tuple[Path, str]]:
    for page in [*PAGES, ROOT / "README.md"]:
        for text in re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
            yield page, text


def _resolves(name: str) -> bool:
    """Whether a dotted name is a package, a module, or defined in one; read, not imported."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:end])
        module = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        if module.is_file():
            inside = ".".join(parts[end:])
            return not inside or inside in _defined(module) or _elsewhere(module, parts[end:])
    return False


def _elsewhere(module: Path, parts: list[str]) -> bool:
    """Whether a module imports the first part from where the others are defined."""
    places = [
        n.module
        for n in ast.walk(ast.parse(module.read_text("utf-8")))
        if isinstance(n, ast.ImportFrom) and parts[0] in [a.asname or a.name for a in n.names]
    ]
    return any(place and _resolves(".".join((place, *parts))) for place in places)


@cache
def _defined(module: Path) -> set[str]:
    """Names that a module defines or imports, and those of its classes."""
    return set(_names(ast.parse(module.read_text("utf-8")).body, ""))


def _names(body: list[ast.stmt], before: str) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.If):  # public names of a package, for type checkers
            yield from _names(node.body, before)
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield before + node.name
        if isinstance(node, ast.ClassDef):
            yield from _names(node.body, f"{before}{node.name}.")
        if isinstance(node, ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)
        if isinstance(node, ast.AnnAssign | ast.Assign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (before + t.id for t in targets if isinstance(t, ast.Name))


def test_every_name_of_code_exists() -> None:
    name = re.compile(r"`((?:geometry|mbd|fem|validation)(?:\.[A-Za-z_]\w*)+)`")
    pages = [*PAGES, *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md"))]
    named = {(page.name, n) for page in pages for n in name.findall(page.read_text("utf-8"))}
    # `fem.method` and the like are keys of scenes, written as they are set.
    scene_keys = {".".join(path) for path in _paths()}
    missing = sorted(n for n in named if n[1] not in scene_keys and not _resolves(n[1]))
    assert len(named) > 50
    assert missing == []
    file = re.compile(r"`((?:geometry|mbd|fem|validation|tests|docs)/[\w./]+)`")
    files = {(page.name, n) for page in pages for n in file.findall(page.read_text("utf-8"))}
    assert len(files) > 20
    # Placeholders of who adds a family or a command, and what `make docs` builds.
    made = re.compile("NAME|GROUP|_build")
    assert {f for f in files if not (ROOT / f[1]).exists() and not made.search(f[1])} == set()


@cache
def _paths() -> set[tuple[str, ...]]:
    """Every key of every scene, as a path."""
    return {path for scene in set(SCENE_TYPES.values()) for path in _below(scene)}


@cache
def _below(section: type) -> tuple[tuple[str, ...], ...]:
    """Keys of a section and of those inside it, as paths."""
    found = []
    for key in keys(section):
        found.append((key.name,))
        if key.section is not None:
            found += [(key.name, *rest) for rest in _below(key.section)]
    return tuple(found)


def _lines() -> Iterator[tuple[Path, list[str]]]:
    """Calls of the command in shell blocks, split into words."""
    for page, text in _blocks("sh"):
        for line in text.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["tubelock"]:
                yield page, words[1:]


@cache
def _commands() -> Any:
    return typer.main.get_command(app)


def _command(words: list[str]) -> tuple[Any, list[str]]:
    """The command that words call, and what is left of them."""
    command = _commands()
    while words and hasattr(command, "commands") and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    return command, words


def test_every_command_option_and_scene_exists() -> None:
    wrong, paths = [], _paths()
    found = list(_lines())
    assert len(found) > 30
    for page, words in found:
        command, rest = _command(words)
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
        for place, word in enumerate(rest):
            if word.startswith("-") and word != "-" and word not in options:
                wrong.append((page.name, word, " ".join(words)))
            if word == "--set" and tuple(rest[place + 1].split("=")[0].split(".")) not in paths:
                wrong.append((page.name, rest[place + 1], "no scene has this key"))
            if re.fullmatch(r"(tsb|thb)\d-[a-z]+", word) and word not in builtin_names():
                wrong.append((page.name, word, "no such scene"))
        if hasattr(command, "commands") and rest and not rest[0].startswith("-"):
            wrong.append((page.name, rest[0], "no such command"))
    assert wrong == []


def _leaves(table: dict[str, Any], before: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*before, key))
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for entry in value:
                yield from _leaves(entry, (*before, key))
        else:
            yield (*before, key)


def _without_own_names(path: tuple[str, ...]) -> tuple[str, ...]:
    """A path without the names that a scene gives: of materials, combinations and their loads."""
    given = {"materials": slice(2, None), "combinations": slice(3, None)}
    return (*path[:1], *path[given[path[0]]]) if path[0] in given else path


def test_every_key_of_a_scene_exists_and_scenes_and_their_parts_are_accepted() -> None:
    """Sections without a block are those of a tube."""
    paths, whole, parts = _paths(), 0, 0
    tube = load_case("tsb1-pipe").keys
    for page, text in _blocks("toml"):
        table = tomllib.loads(text)
        if set(table) & STUDY:
            continue
        found = [_without_own_names(path) for path in _leaves(table)]
        unknown = [path for path in found if path not in paths and path[-1] != "when"]
        assert unknown == [], page
        if "block" in table:
            load_case(table)
            whole += 1
        elif "parts" not in table:
            load_case(
                tube
                | {k: tube.get(k, {}) | v if isinstance(v, dict) else v for k, v in table.items()}
            )
            parts += 1
    assert whole > 1
    assert parts > 3


def _rendered(text: str) -> Iterator[tuple[str, list[str]]]:
    """Text of each paragraph, heading and cell of a page, code as 0, and its links."""
    parser = MarkdownIt("commonmark").enable("table").use(colon_fence_plugin)
    parser.use(dollarmath_plugin).use(front_matter_plugin)
    for token in parser.parse(text):
        inside = token.children or []
        words = ["0" if t.type in {"code_inline", "math_inline"} else t.content for t in inside]
        assert all(t.content.strip() for t in inside if t.type == "code_inline"), words
        yield "".join(words), [str(t.attrs["href"]) for t in inside if t.type == "link_open"]


#: Pages beside the manual: read in a clone, without a build.
BESIDE = sorted(ROOT.glob("*.md"))


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, str]:
    """Text of the pages of commands, scene keys and public names by the place of each in docs."""
    from ext.pages import write_reference

    folder = tmp_path_factory.mktemp("docs")
    write_reference(folder)
    pages = folder.rglob("*.md")
    return {DOCS / page.relative_to(folder): page.read_text("utf-8") for page in pages}


def _flaws(page: Path, text: str, pages: dict[Path, str]) -> Iterator[str]:
    """Torn sentences, and links that lead to none of the pages and no other file."""
    for words, links in _rendered(text):
        if re.search(r"(^|[.!?] )[;,.:)](?!\.)", words):
            yield words
        for target in (link for link in links if "://" not in link):
            path, _, anchor = target.partition("#")
            leads_to = (page.parent / path).resolve() if path else page
            there = pages.get(leads_to)
            lost = there is None and (leads_to.suffix == ".md" or not leads_to.exists())
            if lost or (anchor and anchor not in _anchors(there or "")):
                yield target


def test_no_page_has_an_empty_name_a_dead_link_or_a_torn_sentence(
    reference: dict[Path, str],
) -> None:
    """Pages beside the manual lead to what a clone has, its own pages to the reference too."""
    clone = {page: page.read_text("utf-8") for page in (*PAGES, *BESIDE)}
    assert len(reference) > 15
    for page, text in {**clone, **reference}.items():
        pages = clone if page in BESIDE else clone | reference
        assert list(_flaws(page, text, pages)) == [], page


def test_every_picture_of_the_readme_is_in_the_repository() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text) + re.findall(r'<img src="([^"]+)"', text)
    assert len(pictures) > 1
    assert [p for p in pictures if not (ROOT / p).is_file()] == []


@cache
def _anchors(text: str) -> set[str]:
    """Names that links may lead to: headings, as GitHub and MyST write them, and labels."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}
    return slugs | set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE))


def test_the_notebook_has_the_code_of_its_page() -> None:
    page = DOCS / "tutorials" / "notebook.md"
    code = re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    cells = json.loads(page.with_suffix(".ipynb").read_text("utf-8"))["cells"]
    stored = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert stored == [text.rstrip() for text in code], "run `make pages`"


@pytest.mark.parametrize(
    "page",
    [p for p in [*PAGES, ROOT / "README.md"] if "```python" in p.read_text("utf-8")],
    ids=lambda p: str(p.relative_to(ROOT)),
)
@pytest.mark.usefixtures("small_meshes")
def test_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one layer where it has two."""
    monkeypatch.chdir(tmp_path)
    code = "\n".join(re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL))
    code = code.replace("layers=2", "layers=1").replace('layers": 2', 'layers": 1')
    exec(compile(code, str(page), "exec"), {"__name__": "page"})
