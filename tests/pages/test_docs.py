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
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from mdit_py_plugins.colon_fence import colon_fence_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from mdit_py_plugins.front_matter import front_matter_plugin

from tests.fixtures.commands import undrawn
from tests.support.commands import command
from validation import builtin_names, load_case, solve

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
#: Pages beside the manual: read in a clone, without a build.
BESIDE = sorted(ROOT.glob("*.md"))
#: What the command line raises where it does not accept a call: typer has its own click.
USAGE_ERROR = typer.BadParameter.__base__ or Exception
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


def _lines(text: str) -> Iterator[list[str]]:
    """Calls of the command in a shell block, split into words."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["tubelock"]:
            yield words[1 : words.index(">") if ">" in words else None]


@cache
def _commands() -> Any:
    return typer.main.get_command(app)


def _command(words: list[str]) -> tuple[Any, list[str]]:
    """The command that words call, and what is left of them."""
    command = _commands()
    while words and hasattr(command, "commands") and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    return command, words


def _calls() -> Iterator[tuple[Path, list[str]]]:
    """Calls of the command on all pages, in shell blocks and in sentences."""
    for page, text in _blocks("sh"):
        yield from ((page, words) for words in _lines(text))
    for page in [*PAGES, *BESIDE]:
        for line in re.findall(r"`(tubelock [^`|]+)`", page.read_text("utf-8").replace("\n", " ")):
            yield from ((page, words) for words in _lines(line))


def test_every_command_is_accepted_with_its_options_and_scene() -> None:
    """The command line reads each call; scenes that are built in take each setting."""
    wrong, paths = [], _paths()
    calls = list(_calls())
    assert len(calls) > 100
    for page, words in calls:
        command, rest = _command(words)
        if not rest:  # the name of a command
            continue
        try:
            read = command.make_context(command.name, list(rest)).params
        except typer.Exit:  # of --help and --version
            continue
        except USAGE_ERROR as error:
            wrong.append((page.name, " ".join(words), str(error)))
            continue
        settings = [s for s in read.get("settings") or [] if "…" not in s]
        wrong += [
            (page.name, s, "no scene has this key")
            for s in settings
            if tuple(s.split("=")[0].split(".")) not in paths
        ]
        scene = read.get("scene")
        if scene in builtin_names():
            load_case(scene, settings)
        elif re.fullmatch(r"(tsb|thb)\d-[a-z]+", str(scene)):
            wrong.append((page.name, scene, "no such scene"))
    assert wrong == []


def test_every_target_and_program_of_the_tests_exists() -> None:
    """`make TARGET`, `python -m tests.PROGRAM` and the tables of `tests.verification`."""
    text = "\n".join(page.read_text("utf-8") for page in (*PAGES, *BESIDE))
    made = re.findall(r"^([\w-]+):(?!=)", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    targets = set(re.findall(r"(?:^|`)make ([a-z]+)", text, re.MULTILINE))
    assert len(targets) > 8
    assert targets - set(made) == set()
    programs = {name.replace(".", "/") for name in re.findall(r"python -m (tests\.[\w.]+)", text)}
    assert len(programs) > 3
    files = (f"{name}{end}" for name in programs for end in (".py", "/__main__.py"))
    assert sum((ROOT / file).is_file() for file in files) == len(programs)
    tables = (ROOT / "tests" / "verification" / "__main__.py").read_text("utf-8")
    named = re.findall(r"python -m tests\.verification ([a-z0-9\- ]+)", text)
    names = {name for line in named for name in line.split()}
    assert len(names) > 5
    assert names - set(re.findall(r'^    "([\w-]+)": \(', tables, re.MULTILINE)) == set()


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


def test_a_cell_and_the_command_beside_it_print_one_table(capsys: pytest.CaptureFixture) -> None:
    """All but CPU times, which stand last."""
    text = (DOCS / "start/index.md").read_text("utf-8")
    (cell,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    after = text[text.index(cell) :]
    (words,) = _lines(re.findall(r"```sh\n(.*?)```", after, re.DOTALL)[0])
    exec(compile(cell, "cell", "exec"), {"__name__": "cell"})
    table = capsys.readouterr().out.rpartition("├")[0]
    status, _, printed = command(*words, "--json", "-")
    assert status == 0
    assert "carried with friction" in table
    assert table in printed


def test_every_picture_of_the_readme_is_in_the_repository() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text) + re.findall(r'<img src="([^"]+)"', text)
    assert len(pictures) > 1
    assert [p for p in pictures if not (ROOT / p).is_file()] == []


def test_every_page_begins_with_the_question_that_it_answers() -> None:
    """In its title or the sentence below it; the paper in docs/joss is no page of the manual."""
    for page in (page for page in PAGES if page.parent.name != "joss"):
        title, first, *_ = (text for text, _ in _rendered(page.read_text("utf-8")) if text)
        assert "?" in title + first, page


def test_measured_numbers_are_printed_by_a_test_or_carry_their_date() -> None:
    """CPU times, memory, error bars and changes in per cent, section by section."""
    measured = re.compile(r"\d CPU (?:s|min)|\d GB|± ?\d|[+−]\d+(?:\.\d+)? ?%")
    date = re.compile(r"[A-Z][a-z]+ 20\d\d")
    dated = 0
    for page in [*PAGES, ROOT / "README.md"]:
        for section in re.split(r"^#+ ", page.read_text("utf-8"), flags=re.MULTILINE):
            told = re.sub(r"```(?:python|toml).*?```", "", section, flags=re.DOTALL)
            if measured.search(told) and "```text" not in told:
                assert date.search(told), (page, section.partition("\n")[0])
                dated += 1
    assert dated > 15


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


def _run(page: Path, code: str) -> None:
    exec(compile(code, str(page), "exec"), {"__name__": "page"})


def _python() -> dict[Path, str]:
    """Python of each page that has any, its blocks one after the other."""
    found: dict[Path, str] = {}
    for page, text in _blocks("python"):
        found[page] = found.get(page, "") + text
    return found


def _shown() -> Iterator[tuple[Path, str, str, str]]:
    """Page, language, code and what is shown below the code as its output."""
    for page in [*PAGES, ROOT / "README.md"]:
        inside = r"((?:(?!```).)*)"
        shown = rf"```(sh|python)\n{inside}```\s*```text\n{inside}```"
        for language, code, output in re.findall(shown, page.read_text("utf-8"), re.DOTALL):
            yield page, language, code, output


#: Pages whose Python is shown with its output: run as it stands.
PRINTING = sorted({page for page, language, _, _ in _shown() if language == "python"})


@pytest.mark.parametrize(
    "page", [p for p in _python() if p not in PRINTING], ids=lambda p: str(p.relative_to(ROOT))
)
@pytest.mark.usefixtures("small_meshes")
def test_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one layer where it has two."""
    monkeypatch.chdir(tmp_path)
    code = _python()[page]
    _run(page, code.replace("layers=2", "layers=1").replace('layers": 2', 'layers": 1'))


def _said(text: str) -> list[str]:
    """Lines of an output; round-off, which depends on the processor, as 0."""
    return [re.sub(r"\d(\.\d+)?e-(09|1\d)", "0", line.rstrip()) for line in text.splitlines()]


def _missing(shown: str, output: str) -> list[str]:
    """Lines that are shown and not printed, in this order; … stands for lines that are left out."""
    left = iter(_said(output))
    return [line for line in _said(shown) if line.strip(" │") not in {"", "…"} and line not in left]


@pytest.mark.parametrize("page", PRINTING, ids=lambda p: str(p.relative_to(ROOT)))
def test_python_of_a_page_prints_what_is_shown(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    _run(page, _python()[page])
    output = capsys.readouterr().out
    for where, language, _, shown in _shown():
        if (where, language) == (page, "python"):
            assert _missing(shown, output) == [], output


@pytest.mark.parametrize(
    ("page", "code", "shown"),
    [(page, code, shown) for page, language, code, shown in _shown() if language == "sh"],
    ids=lambda p: str(p.relative_to(ROOT)) if isinstance(p, Path) else "",
)
def test_commands_of_a_page_print_what_is_shown(
    page: Path, code: str, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with undrawn():
        runs = [command(*words) for words in _lines(code)]
    output = "".join(out for _, out, _ in runs)
    assert {status for status, _, _ in runs} == {0}
    assert _missing(shown, output) == [], output


def test_the_gallery_asks_rigid_blocks_of_no_supports_that_they_refuse() -> None:
    plan = tomllib.loads((DOCS / "gallery.toml").read_text("utf-8"))
    (group,) = (one for one in plan["group"] if one["title"].startswith("Supports"))
    for name in group["scenes"]:
        runs = plan["scene"].get(name, {}).get("runs", plan["runs"])
        if any(words.startswith("mbd") for words in runs):
            solve(load_case(name, method="rigid"))


def test_what_the_build_of_the_site_imports_exists() -> None:
    """Also where it is imported when a page with runs is written."""
    named = {
        (str(node.module), name.name)
        for path in [*(DOCS / "ext").glob("*.py"), DOCS / "conf.py"]
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom)
        for name in node.names
        if str(node.module).partition(".")[0] in {"geometry", "mbd", "fem", "validation"}
    }
    assert named
    assert not [pair for pair in named if not hasattr(import_module(pair[0]), pair[1])]
