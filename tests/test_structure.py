"""Which files of tests import what: a room knows the inside of what it tests, and no other."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick

TESTS = Path(__file__).parent
PACKAGES = ("geometry", "mbd", "fem", "validation")
_LAWS = ("geometry", "mbd", "fem")
#: Inner modules that a room may import: those of what it tests. Other rooms have public names.
ROOMS = {
    "geometry": _LAWS,
    "mbd": _LAWS,
    "fem": _LAWS,
    "support": _LAWS,
    # Programs that print tables.
    "benchmarks": (*_LAWS, "validation.output"),
    # Searches among designs whose answers are all known are verified there too.
    "verification": (*_LAWS, "validation.paper", "validation.study.optimisation"),
    # What studies keep their rows in.
    "study": ("validation.study",),
    "pages": ("validation.pages", "validation.output"),
    "robustness": ("validation.stability", "validation.statement"),
    "cli/test_explode.py": (*_LAWS, "validation.output.explosion"),
    "cli": ("validation.cli", "validation.scene", "validation.output"),
    # What tests leave out of commands, because it takes long.
    "fixtures/commands.py": ("fem.accuracy", "validation.output.outputs"),
}


@cache
def imports() -> tuple[tuple[Path, str], ...]:
    """Each file of tests with each module that it imports, or name of a module."""
    return tuple(
        (path, module)
        for path in sorted(TESTS.rglob("*.py"))
        for module in _modules(ast.parse(path.read_text("utf-8")))
    )


def _modules(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            assert node.module is not None
            yield node.module
            # `from package import module` imports a module too.
            yield from (f"{node.module}.{name.name}" for name in node.names)


def is_inner(name: str) -> bool:
    """Whether this is a module inside a package, or a name in one; public names are not."""
    package, _, rest = name.partition(".")
    return package in PACKAGES and bool(rest) and rest not in dir(import_module(package))


def room(path: Path) -> str:
    """Folder of a file in tests; conftest.py is shared as `support` is."""
    inside = path.relative_to(TESTS)
    if inside.as_posix() in ROOMS:
        return inside.as_posix()
    return {"conftest.py": "support"}.get(path.name, inside.parts[0])


def listed(wrong: Iterator[tuple[Path, str]]) -> list[str]:
    return sorted({f"{path.relative_to(TESTS)} imports {module}" for path, module in wrong})


def test_no_test_imports_from_another_test() -> None:
    # `python -m tests.verification` is a command, which runs some tests.
    assert not listed(
        (path, module)
        for path, module in imports()
        if path.name != "__main__.py"
        and module.startswith("tests.")
        and any(part.startswith(("test_", "conftest")) for part in module.split("."))
    )


def test_inner_names_are_imported_where_they_are_tested() -> None:
    assert not listed(
        (path, module)
        for path, module in imports()
        if is_inner(module)
        and not f"{module}.".startswith(tuple(f"{own}." for own in ROOMS.get(room(path), ())))
    )


#: What pictures, tables and pages of the paper are made with: no part of the public face.
DRAWING = ("validation.output.", "validation.pages.", "geometry.machine.")


def test_the_paper_is_computed_from_public_names() -> None:
    """Tables, claims and errata show that public names suffice; only what is drawn needs more.

    What is stated and chosen by name is shared with the robustness suite: it computes nothing.
    """
    paper = TESTS.parent / "validation" / "paper"
    wrong = {
        f"{path.relative_to(paper)} imports {module}"
        for path in paper.rglob("*.py")
        for module in _modules(ast.parse(path.read_text("utf-8")))
        if is_inner(module)
        and not f"{module}.".startswith(("validation.paper.", "validation.statement."))
        and not (path.parent.name == "shown" and f"{module}.".startswith(DRAWING))
    }
    assert wrong == set()
