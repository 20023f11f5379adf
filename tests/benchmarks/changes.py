"""What tests let pass: random small changes of mechanics, each beside the tests that run its line.

``python -m tests.benchmarks.changes [--count 80] [--seed 20261129] [--seconds 60]``: a copy of the
last commit is changed in one place at a time, an operator, a comparison, a constant or a sign. The
tests of the same room that run the line are repeated, the most special ones first, until one fails.
A test that calls a compiled function runs all its lines and those of the functions it calls.
"""

from __future__ import annotations

import argparse
import ast
import functools
import inspect
import itertools
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from geometry.compilation import Kernel

ROOMS = ("geometry", "mbd", "fem")
#: No mechanics: how functions are compiled, and how text of other programs is read.
LEFT_OUT = ("geometry/compilation/", "geometry/files/", "fem/decks/read/")
#: No results: what work costs, how it is stopped.
NO_RESULTS = "geometry/machine/"
#: In place of a test: what is run while modules are read.
READ = "read"
#: What tests of one change may take with it [s].
LIMIT = 300.0
SWAPS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.Lt: (ast.LtE, ast.Gt), ast.Gt: (ast.GtE, ast.Lt), ast.LtE: (ast.Lt, ast.GtE),
    ast.GtE: (ast.Gt, ast.LtE), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.And: (ast.Or,), ast.Or: (ast.And,),
}  # fmt: skip


def changed(node: ast.AST) -> Iterator[str]:
    """Text of an expression after each small change of its outermost part."""
    match node:
        case ast.BinOp(left, operator, right):
            new = SWAPS.get(type(operator), ())
            yield from (ast.unparse(ast.BinOp(left, swap(), right)) for swap in new)
        case ast.BoolOp(operator, values):
            yield from (ast.unparse(ast.BoolOp(s(), values)) for s in SWAPS[type(operator)])
        case ast.Compare(left, [first, *rest], right):
            new = SWAPS.get(type(first), ())
            yield from (ast.unparse(ast.Compare(left, [s(), *rest], right)) for s in new)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield ast.unparse(operand)
        case ast.Constant(value) if type(value) is int:
            yield repr(value + 1)
        case ast.Constant(value) if type(value) is float:
            yield repr(1.1 * value or 1.0)


def places(node: ast.AST, statement: ast.AST) -> Iterator[tuple[ast.expr, ast.AST, str]]:
    """Expressions, the statements that hold them, and their text after a change."""
    if isinstance(node, ast.stmt):
        statement = node
    for text in changed(node):
        yield node, statement, f"({text})"  # type: ignore[misc]
    for name, field in ast.iter_fields(node):
        for child in field if isinstance(field, list) else [field]:
            # Neither words of messages nor types.
            words = isinstance(child, ast.JoinedStr | ast.Raise | ast.Assert)
            if isinstance(child, ast.AST) and not words and name not in ("annotation", "returns"):
                yield from places(child, statement)


class Change:
    """One expression of one file with other text."""

    def __init__(self, file: str, node: ast.expr, statement: ast.AST, text: str) -> None:
        self.file, self.text = file, text
        self.place = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        self.lines = range(statement.lineno, statement.end_lineno + 1)
        if not isinstance(statement, ast.Assign | ast.AugAssign | ast.Return | ast.Expr):
            self.lines = range(node.lineno, (node.end_lineno or 0) + 1)
        self.old = ""

    def apply(self, source: str) -> str:
        first, start, last, end = self.place
        lines = source.encode().splitlines(keepends=True)
        head, tail = b"".join(lines[: first - 1]), b"".join(lines[last:])
        within = b"".join(lines[first - 1 : last])
        stop = len(within) - len(lines[last - 1]) + end
        self.old = within[start:stop].decode()
        return (head + within[:start] + self.text.encode() + within[stop:] + tail).decode()


def changes(tree: Path) -> list[Change]:
    """All small changes of the rooms, in the order of their files."""
    files = sorted(f for room in ROOMS for f in (tree / room).rglob("*.py"))
    names = [
        name for f in files if not (name := f.relative_to(tree).as_posix()).startswith(LEFT_OUT)
    ]
    parsed = ((name, ast.parse((tree / name).read_text("utf-8"))) for name in names)
    return [Change(name, *found) for name, module in parsed for found in places(module, module)]


@functools.cache
def compiled_lines(kernel: Kernel) -> frozenset[tuple[str, int]]:
    """Files and lines of a compiled function and of those that it calls."""
    found, left = set[tuple[str, int]](), [kernel]
    known = set(left)
    while left:
        function = left.pop().__wrapped__
        lines, first = inspect.getsourcelines(function)
        found |= {(function.__code__.co_filename, n) for n in range(first, first + len(lines))}
        named = inspect.getclosurevars(function)
        parts = [*named.globals.values(), *named.nonlocals.values()]
        new = {part for part in parts if isinstance(part, Kernel)} - known
        known |= new
        left += new
    return frozenset(found)


class Lines:
    """Lines that each test runs (a plugin of pytest; `sys.monitoring` tells a line once a test)."""

    def __init__(self, tree: Path) -> None:
        self.top = f"{tree}{os.sep}"
        self.rooms = tuple(f"{self.top}{room}{os.sep}" for room in ROOMS)
        self.seen: set[tuple[str, int]] = set()
        self.shared: dict[Any, set[tuple[str, int]]] = {}
        self.tests: dict[str, Any] = {}
        self.failed: set[str] = set()

        def call(kernel: Kernel, *arguments: Any) -> Any:
            self.seen |= compiled_lines(kernel)
            return kernel.dispatcher(*arguments)

        Kernel.__call__ = call

    def line(self, code: Any, number: int) -> Any:
        if code.co_filename.startswith(self.rooms):
            self.seen.add((code.co_filename, number))
        return sys.monitoring.DISABLE

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        before, self.seen = self.seen, set()
        sys.monitoring.restart_events()
        result = yield
        self.shared[fixturedef] = self.seen
        self.seen = before
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if READ not in self.tests:
            self.keep(READ, 0.0, self.seen)
        self.seen.clear()
        sys.monitoring.restart_events()
        start = time.process_time()
        result = yield
        fixtures = item._fixtureinfo.name2fixturedefs.values()
        of_fixtures = (self.shared.get(f, set()) for several in fixtures for f in several)
        spent = time.process_time() - start
        self.keep(item.nodeid, spent, self.seen.union(*of_fixtures))
        return result

    def keep(self, test: str, seconds: float, seen: set[tuple[str, int]]) -> None:
        lines: dict[str, list[int]] = defaultdict(list)
        for file, number in seen:
            lines[file[len(self.top) :]].append(number)
        self.tests[test] = {"seconds": seconds, "lines": lines}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.add(report.nodeid)


def watch(out: Path, words: list[str]) -> None:
    """Run tests of the folder and keep which lines each one runs."""
    plugin = Lines(Path.cwd())
    sys.monitoring.use_tool_id(sys.monitoring.COVERAGE_ID, "changes")
    line = sys.monitoring.events.LINE
    sys.monitoring.register_callback(sys.monitoring.COVERAGE_ID, line, plugin.line)
    sys.monitoring.set_events(sys.monitoring.COVERAGE_ID, line)
    pytest.main(["-q", "-p", "no:cacheprovider", *words], plugins=[plugin])
    sys.monitoring.set_events(sys.monitoring.COVERAGE_ID, 0)
    passed = {name: seen for name, seen in plugin.tests.items() if name not in plugin.failed}
    out.write_text(json.dumps(passed))


def _holders(file: Path) -> dict[int, tuple[str, bool]]:
    tree, result = ast.parse(file.read_text("utf-8")), dict[int, tuple[str, bool]]()
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else node
        target = getattr(target, "target", target)
        name = getattr(target, "id", getattr(target, "name", ""))
        result |= dict.fromkeys(range(node.lineno, (node.end_lineno or 0) + 1), (name, False))
        for part in ast.walk(node):
            if isinstance(part, ast.FunctionDef):
                body = range(part.body[0].lineno, (part.end_lineno or 0) + 1)
                result |= dict.fromkeys(body, (name, True))
    return result


class Related:
    """Tests of each line."""

    def __init__(self, tree: Path, tests: dict[str, Any]) -> None:
        self.tree, self.tests = tree, tests
        self.by_line: dict[tuple[str, int], set[str]] = defaultdict(set)
        for test, seen in tests.items():
            for file, numbers in seen["lines"].items():
                for number in numbers:
                    self.by_line[file, number].add(test)
        files = {f.relative_to(tree).as_posix(): f for r in ROOMS for f in (tree / r).rglob("*.py")}
        self.holders = {name: _holders(file) for name, file in files.items()}
        self.text = {name: f.read_text("utf-8").splitlines() for name, f in files.items()}

    def of(self, file: str, lines: range) -> set[str]:
        """Tests that run lines; of what is read or compiled once, those that run what names it."""
        holder, inside = self.holder(file, lines.start)
        found = {test for n in lines for test in self.by_line[file, n]}
        if READ not in found and not any(line.startswith("from numba") for line in self.text[file]):
            return found
        found -= {READ}
        known = {(file, holder)}
        level = [] if (inside and found) or not holder else [holder]
        while level and len(known) < 40:
            found, names = set(), re.compile(rf"\b(?:{'|'.join(level)})\b")
            lines_of = [
                (other, n)
                for other, text in self.text.items()
                for n, line in enumerate(text, 1)
                if names.search(line)
            ]
            users = {(other, *self.holder(other, n)): (other, n) for other, n in lines_of}
            for other, n in lines_of:
                if self.holder(other, n)[1]:
                    found |= self.by_line[other, n]
            if found:
                return found
            level = [name for other, name, inside in users if name and (other, name) not in known]
            known |= {(other, name) for other, name, _ in users}
        return found or set().union(*(of for (name, _), of in self.by_line.items() if name == file))

    def holder(self, file: str, line: int) -> tuple[str, bool]:
        """Name that a module gives to what holds a line, and whether calls run the line."""
        return self.holders[file].get(line, ("", False))

    def chosen(self, change: Change, seconds: float) -> list[str]:
        """Tests of the same room, the most special ones first, as many as the seconds allow."""
        room = f"tests/{change.file.partition('/')[0]}/"
        found = [test for test in self.of(change.file, change.lines) if test.startswith(room)]

        def breadth(test: str) -> float:
            lines = sum(map(len, self.tests[test]["lines"].values()))
            return float(lines) * (1.0 + self.tests[test]["seconds"])

        result = sorted(found, key=breadth)
        spent = itertools.accumulate(self.tests[test]["seconds"] for test in result)
        return [test for test, total in zip(result, spent, strict=True) if total <= seconds]


def environment(out: Path) -> dict[str, str]:
    """Variables of a run in the copy, whose compiled functions stay in the folder."""
    cache = {"NUMBA_CACHE_DIR": str(out / "compiled"), "PYTHONDONTWRITEBYTECODE": "1"}
    return {**os.environ, **cache, "PYTHONPATH": str(out / "tree")}


def outcome(out: Path, change: Change, tests: list[str]) -> str:
    """What tells a change: a test that fails, or that they do not end; empty if all pass."""
    file = out / "tree" / change.file
    source = file.read_text("utf-8")
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        file.write_text(change.apply(source), "utf-8")
        run = subprocess.run(
            words,
            cwd=out / "tree",
            env=environment(out),
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "no end"
    finally:
        file.write_text(source, "utf-8")
    if run.returncode == 0:
        return ""
    failed = re.search(r"^(?:FAILED|ERROR) \S+", run.stdout, re.MULTILINE)
    return failed.group() if failed else f"exit status {run.returncode}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--seed", type=int, default=20261129)
    parser.add_argument("--marks", default="not thorough")
    parser.add_argument("--out", type=Path, default=Path("out/changes"))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    commit = subprocess.check_output(["git", "rev-parse", "--short", "HEAD"], text=True)
    out = (asked.out / commit.strip()).resolve()
    tree, seen = out / "tree", out / "lines.json"
    if not seen.exists():
        shutil.rmtree(tree, ignore_errors=True)
        subprocess.run(["git", "clone", "-q", ".", str(tree)], check=True)
        words = ["-m", asked.marks, *(f"tests/{room}" for room in ROOMS)]
        code = (
            f"import sys; sys.path[0] = {str(tree)!r}; from pathlib import Path; "
            f"from tests.benchmarks import changes; changes.watch(Path({str(seen)!r}), {words!r})"
        )
        subprocess.run([sys.executable, "-c", code], cwd=tree, env=environment(out), check=True)
    # What an interrupted run left changed.
    subprocess.run(["git", "checkout", "-q", "."], cwd=tree, check=True)
    related = Related(tree, json.loads(seen.read_text("utf-8")))
    drawn = random.Random(asked.seed).sample(changes(tree), 2 * asked.count)
    found = [change for change in drawn if not change.file.startswith(NO_RESULTS)]
    for number, change in enumerate(found[asked.first : asked.count], asked.first + 1):
        tests = related.chosen(change, asked.seconds)
        change.apply((tree / change.file).read_text("utf-8"))  # which tells what was there
        start = time.monotonic()
        result = (outcome(out, change, tests) or "SURVIVED") if tests else "NO TEST"
        line, took = change.place[0], time.monotonic() - start
        print(f"{number}\t{change.file}:{line}\t{change.old} -> {change.text}\t"
              f"{result}\t{len(tests)}\t{took:.0f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
