"""What the tests let pass: small changes, one at a time, each with the tests of its subject.

``make mutation`` tries a random sample; ``python tests/mutation.py --subject mbd --count 40`` does
it of one subject.
The changes are those of cosmic-ray, whose own driver starts a process per change: importing what
does not change would take most of the time here, so each is tried in a fork that has it.
A change that leaves the program the same but for annotations is not counted; others that change no
answer must be judged by people: they are printed.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("geometry", "mbd", "fem", "validation", "tests", "docs")

#: Modules of each subject, and the tests that must notice.
SUBJECTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "mbd": (
        ("mbd/*.py",),
        (
            "mbd/test_equilibrium.py",
            "mbd/test_mechanism.py",
            "mbd/test_any_block.py",
            "mbd/test_sliding_collapse.py",
            "mbd/test_resultants.py",
            "mbd/test_force_range.py",
            "mbd/test_constants.py",
            "verification/test_paper.py",
        ),
    ),
    "law": (("fem/contact/law.py",), ("fem/test_contact_law.py", "fem/test_contact.py")),
    "contact": (
        ("fem/contact/surfaces.py", "fem/contact/friction.py"),
        ("fem/test_contact.py", "fem/test_friction.py", "fem/test_explicit_contact.py"),
    ),
    "kernels": (("tests/support/reference_kernels.py",), ("fem/test_kernels.py",)),
    "high-order elements": (
        ("fem/element/lagrange.py", "fem/element/lagrange_mesh.py"),
        ("fem/test_lagrange.py", "fem/test_lagrange_mesh.py", "fem/test_lagrange_fields.py"),
    ),
    "general contact": (
        ("fem/contact/cuts.py", "fem/contact/search.py"),
        (
            "fem/test_contact_bounds.py",
            "fem/test_contact_cuts.py",
            "fem/test_sliding_contact.py",
            "fem/test_static_searched.py",
        ),
    ),
    "error bars": (
        ("fem/accuracy/errors.py", "fem/accuracy/ladder.py", "fem/accuracy/facets.py"),
        (
            "fem/test_ladder.py",
            "cases/test_accuracy.py",
            "verification/test_error_bars.py",
            "cases/test_error_estimate.py",
        ),
    ),
    "decks": (
        ("fem/decks/*.py", "validation/build/deck.py"),
        (
            "fem/test_deck_laws.py",
            "fem/test_problem_deck.py",
            "cases/test_deck.py",
            "cases/test_one_problem.py",
            "fem/test_abaqus.py",
        ),
    ),
    "decks that are read": (
        ("fem/decks/read/*.py",),
        ("fem/test_decks_read.py", "fem/test_tetrahedral_decks.py"),
    ),
    "geometry": (
        (
            "geometry/mesh.py",
            "geometry/interface.py",
            "geometry/parts/measures.py",
            "geometry/families/sine_block.py",
            "geometry/polyhedra/facet_contact.py",
        ),
        (
            "geometry/test_measures.py",
            "geometry/test_mesh.py",
            "geometry/test_matching.py",
            "geometry/test_numbering.py",
            "geometry/test_tube.py",
            "mbd/test_constants.py",
        ),
    ),
    "stores": (
        ("validation/study/rowfile.py",),
        ("study/test_store.py",),
    ),
}
#: Seed of the published sample, written down before its run.
SEED = 31
#: Changes of cosmic-ray that are tried: one for each kind of slip.
OPERATORS = (
    *(
        f"core/ReplaceBinaryOperator_{pair}"
        for pair in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul",
                     "Mod_Mul", "BitOr_BitAnd", "BitAnd_BitOr")
    ),
    *(
        f"core/ReplaceComparisonOperator_{pair}"
        for pair in ("Eq_NotEq", "NotEq_Eq", "Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_GtE",
                     "Gt_LtE", "LtE_Gt", "GtE_Lt", "Is_IsNot", "IsNot_Is")
    ),
    "core/ReplaceUnaryOperator_Delete_USub",
    "core/ReplaceUnaryOperator_Delete_Invert",
    "core/ReplaceUnaryOperator_Delete_Not",
    "core/AddNot",
    "core/ReplaceTrueWithFalse",
    "core/ReplaceFalseWithTrue",
    "core/ReplaceAndWithOr",
    "core/ReplaceOrWithAnd",
    "core/ReplaceBreakWithContinue",
    "core/ReplaceContinueWithBreak",
    "core/NumberReplacer",
    "core/ZeroIterationForLoop",
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One change of one file."""

    path: str
    """Of the file, from the root."""
    operator: str
    number: int
    """Which place in the file."""
    line: int
    source: str
    """The whole changed file."""

    @property
    def words(self) -> str:
        """Where it is, and the line before and after."""
        before = (ROOT / self.path).read_text("utf-8").splitlines()
        after = self.source.splitlines()
        pairs = enumerate(zip(before, after, strict=False))
        at = next((k for k, (old, new) in pairs if old != new), 0)
        return f"{self.path}:{at + 1}\n    - {before[at].strip()}\n    + {after[at].strip()}"


def meaning(source: str) -> str:
    """What a module does: its tree without annotations and decorators, which cache or compile."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(0)
        elif isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef):
            node.returns, node.decorator_list = None, []
        elif isinstance(node, ast.Assign) and "TypeAlias" in ast.dump(node):
            node.value = ast.Constant(0)
    return ast.dump(tree)


def changes(patterns: tuple[str, ...]) -> Iterator[tuple[str, str, int]]:
    """File, operator and place of every change of some files."""
    for pattern in patterns:
        for path in sorted(ROOT.glob(pattern)):
            tree = get_ast(path.read_text("utf-8"))
            for name in OPERATORS:
                operator = get_operator(name)()
                places = sum(
                    1 for node in ast_nodes(tree) for _ in operator.mutation_positions(node)
                )
                for number in range(places):
                    yield str(path.relative_to(ROOT)), name, number


def made(path: str, operator: str, number: int) -> Change | None:
    """Make a change; nothing where the program stays the same."""
    source = (ROOT / path).read_text("utf-8")
    changed = mutate_code(source.encode(), get_operator(operator)(), number)
    if changed is None:
        return None
    text = changed.decode() if isinstance(changed, bytes) else changed
    with contextlib.suppress(SyntaxError):  # it may take the / of a signature for a division
        return None if meaning(text) == meaning(source) else Change(path, operator, number, 0, text)
    return None


def passed(folder: Path, tests: tuple[str, ...], limit: float, quick: bool) -> tuple[bool, float]:
    """Whether tests pass in a folder, and their CPU time [s]; those that do not end do not pass."""
    start = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if not child:
        _test(folder, tests, limit, quick)
    _, status = os.waitpid(child, 0)
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
    return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0, used


def _test(folder: Path, tests: tuple[str, ...], limit: float, quick: bool) -> None:
    output = os.open(folder / "output", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 5))
    os.chdir(folder)
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(folder))
    import pytest

    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow"]
    options += ["--timeout=0", *(f"tests/{name}" for name in tests)]
    os._exit(int(pytest.main(options, plugins=[_Quick()] if quick else [])))


class _Quick:
    """Only quick tests, without their limit of CPU time: ``-m quick`` would watch it."""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if item.get_closest_marker("quick") is not None]


def _warm() -> None:
    """Import what no change touches, once for all forks."""
    import hypothesis  # noqa: F401
    import meshio  # noqa: F401
    import numba  # noqa: F401
    import pydantic  # noqa: F401
    import pytest  # noqa: F401
    import rich.console  # noqa: F401
    import scipy.optimize
    import scipy.sparse.linalg
    import scipy.spatial  # noqa: F401
    import skfem  # noqa: F401
    import typer.testing  # noqa: F401


def try_subject(subject: str, count: int, seed: int, quick: bool) -> tuple[int, int]:
    """Try a sample of the changes of a subject; how many were tried, and how many noticed."""
    patterns, tests = SUBJECTS[subject]
    every = list(changes(patterns))
    Random(f"{seed}/{subject}").shuffle(every)
    tried = noticed = 0
    with tempfile.TemporaryDirectory() as made_folder:
        folder = Path(made_folder)
        for name in FOLDERS:
            # With the machine code, which is named by its sources: compiling takes minutes.
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.pyc"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        holds, seconds = passed(folder, tests, 900.0, quick)
        print(
            f"{subject}: {len(every)} changes; tests pass: {holds}, {seconds:.1f} CPU s", flush=True
        )
        if not holds:
            raise SystemExit((folder / "output").read_text("utf-8"))
        for place in every:
            if tried == count:
                break
            change = made(*place)
            if change is None:
                continue
            tried += 1
            target = folder / change.path
            kept = target.read_text("utf-8")
            target.write_text(change.source, "utf-8")
            survived, used = passed(folder, tests, 3.0 * seconds + 20.0, quick)
            target.write_text(kept, "utf-8")
            noticed += not survived
            fate = "passed unnoticed" if survived else "noticed"
            print(f"{subject}: {fate} ({used:.0f} s): {change.words}", flush=True)
    return tried, noticed


def main() -> None:
    """Print what passed unnoticed, and the share that was noticed with its standard error."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--subject", choices=SUBJECTS, action="append")
    parser.add_argument("--count", type=int, default=20, help="changes of each subject")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="judge by quick tests alone")
    asked = parser.parse_args()
    os.environ.setdefault("MPLBACKEND", "Agg")
    sys.path = [
        entry for entry in sys.path if Path(entry or ".").resolve() not in (ROOT, ROOT / "tests")
    ]
    _warm()
    total = caught = 0
    for subject in asked.subject or SUBJECTS:
        start = time.monotonic()
        tried, noticed = try_subject(subject, asked.count, asked.seed, asked.quick)
        total, caught = total + tried, caught + noticed
        print(
            f"{subject}: {noticed} of {tried} noticed, {time.monotonic() - start:.0f} s", flush=True
        )
    share = caught / max(total, 1)
    error = (share * (1.0 - share) / max(total, 1)) ** 0.5
    print(f"{caught} of {total} noticed: {100 * share:.0f} ± {100 * error:.0f} %")


if __name__ == "__main__":
    main()
