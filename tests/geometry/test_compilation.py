"""Compiled code that is kept is that of the sources in the tree, whatever ran before."""

import ast
import importlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from geometry.compilation import njit
from geometry.machine.work import compiling, summed, timed_stages

ROOT = Path(__file__).parents[2]

FILES = {
    "pack/__init__.py": "",
    "pack/constants.py": "OPTIONS = {'error_model': 'numpy'}\nFACTOR = 2.0\n",
    "pack/helper.py": (
        "from geometry.compilation import njit\nfrom pack.constants import (\n    FACTOR,\n"
        "    OPTIONS,\n)\n@njit(**OPTIONS)\ndef scaled(x):\n    return FACTOR * x\n"
    ),
    "pack/kernel.py": (
        "from geometry.compilation import njit\nfrom pack import (\n    helper,\n)\n"
        "from numba import prange\nscaled = helper.scaled\n"
        "def total(x):\n"
        "    s = 0.0 * x\n    for i in prange(3):\n        s += scaled(x)\n    return s\n"
        "serial = njit(cache=True)(total)\n"
        "parallel = njit(cache=True, parallel=True)(total)\n"
    ),
}
#: Both sums, and how many forms were loaded that another process had compiled.
RUN = (
    "import sys\nfrom pack.kernel import serial, parallel\n"
    "number = eval(sys.argv[1])\nprint(serial(number), parallel(number), "
    "sum(f._cache_hits.total() for f in (serial, parallel)))"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose kernel calls a helper with a constant of a third file."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def run(folder: Path, number: str = "1.0", program: str = RUN) -> subprocess.CompletedProcess[str]:
    """Run a program in a new process; source files are read, never yesterday's bytecode."""
    return subprocess.run(
        [sys.executable, "-c", program, *number.split()],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(folder / "kept"),
        },
        capture_output=True,
        text=True,
        check=True,
    )


def folders(package: Path) -> list[Path]:
    return sorted((package / "kept").iterdir())


def test_a_change_of_any_source_changes_the_folder_and_the_answer(package: Path) -> None:
    """The kernel's own file stays as it is; with numba's own folders all runs gave 6."""
    assert run(package).stdout.split() == ["6.0", "6.0", "0"]
    assert run(package).stdout.split() == ["6.0", "6.0", "2"]
    (before,) = folders(package)
    constants = package / "pack" / "constants.py"
    constants.write_text(constants.read_text().replace("FACTOR = 2.0", "FACTOR = 5.0"))
    os.utime(before, (0, 0))  # used last in 1970
    assert run(package).stdout.split() == ["15.0", "15.0", "0"]
    (after,) = folders(package)
    assert after != before


@pytest.mark.thorough
def test_processes_that_start_together_all_answer(package: Path) -> None:
    """Each compiles for another type, and adds its code to the same index."""
    answers = {"1.0": ["6.0", "6.0"], "1j": ["6j", "6j"]}
    for _ in range(2):
        with ThreadPoolExecutor() as pool:
            given = list(pool.map(lambda number: run(package, number).stdout.split(), answers))
        assert [words[:2] for words in given] == [*answers.values()]


def test_an_index_that_two_processes_write_leads_to_no_code_of_another_form(tmp_path: Path) -> None:
    """Both read it, both write it, and the first to write it writes its code last."""
    from geometry.compilation.compiler import KernelCache

    kernel = njit()(lambda x: x + x)
    assert (kernel(1.0), kernel(1)) == (2.0, 2)
    forms = list(kernel.overloads.values())
    first, second, third = (KernelCache(kernel.py_func, {}, tmp_path) for _ in range(3))
    write = first._files._save_data

    def write_last(*given: object) -> None:
        second.save_overload(forms[1].signature, forms[1])
        write(*given)

    first._files._save_data = write_last
    second._files._load_index = dict
    first.save_overload(forms[0].signature, forms[0])
    loaded = [third.load_overload(form.signature, kernel.targetctx) for form in forms]
    assert loaded[0] is None
    assert loaded[1].signature == forms[1].signature


@pytest.mark.thorough
def test_where_nothing_can_be_written_every_run_compiles_and_says_so(package: Path) -> None:
    """A file in the place of a folder: no one can write there, a superuser neither."""
    (package / "kept").write_text("")
    for _ in range(2):
        answer = run(package)
        assert answer.stdout.split() == ["6.0", "6.0", "0"]
        assert answer.stderr.count("every run compiles anew") == 1
        assert len(answer.stderr.splitlines()) == 1


@pytest.mark.thorough
def test_damaged_files_are_compiled_anew(package: Path) -> None:
    run(package)
    for file in folders(package)[0].glob("*.nbc"):
        file.write_bytes(b"")
    assert run(package).stdout.split() == ["6.0", "6.0", "0"]
    assert run(package).stdout.split() == ["6.0", "6.0", "2"]


def imported(file: Path) -> set[str]:
    """Modules and names that a file imports when it is read itself."""
    names = set()
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, file
            names |= {node.module or "", *(f"{node.module}.{a.name}" for a in node.names)}
    return names


def test_every_kernel_of_the_program_has_all_that_it_imports_in_the_name_of_its_folder() -> None:
    """The files are found by the words of their imports; here by those of the language."""
    from geometry.compilation.compiler import sources

    kernels = []
    for file in (*ROOT.glob("geometry/**/*.py"), *ROOT.glob("fem/**/*.py")):
        if "geometry.compilation" not in imported(file):
            continue
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        importlib.import_module(module)
        kernels.append(module)
        found = sources(module)
        assert found[module] == file
        for source in found.values():
            for name in imported(source):
                ours = name.partition(".")[0] in {"geometry", module.partition(".")[0]}
                assert not ours or name in found or name not in sys.modules, (module, name)
    assert "fem.explicit.contact.paired_kernel" in kernels
    law = "fem.contact.law"
    assert law in sources("fem.explicit.contact.sliding_kernel")
    assert law not in sources("geometry.polyhedra.near.triangle_kernels")


CLOSURES = """
import math

from geometry.compilation import njit


def make(factor):
    @njit()
    def scaled(values, i):
        if values[i] > 9.0:  # too long to be inlined
            values[i] = math.sin(values[i]) * math.exp(-values[i]) + math.cos(values[i] + i)
            for k in range(i):
                values[i] += math.cos(values[k] + k) * math.tan(values[i])
        elif values[i] < -9.0:
            values[i] = math.cos(values[i]) / math.exp(values[i]) - math.sin(values[i] - i)
            for k in range(i):
                values[i] -= math.sin(values[k] + k) * math.tan(values[i])
        else:
            values[i] *= factor
    return scaled


twice, thrice = make(2.0), make(3.0)


@njit(cache=True)
def ascending(values, i):
    twice(values, i)
    twice(values, i + 1)
    thrice(values, i + 2)
    thrice(values, i + 3)


@njit(cache=True)
def descending(values, i):
    thrice(values, i)
    thrice(values, i + 1)
    twice(values, i + 2)
    twice(values, i + 3)
"""
CALLS = """
import sys
import closures
import numpy as np

for name in sys.argv[1:]:
    values = np.ones(4)
    getattr(closures, name)(values, 0)
    print(name, *values.astype(int))
"""


@pytest.mark.thorough
def test_code_of_two_processes_is_not_mixed(tmp_path: Path) -> None:
    """Closures of one factory differ in nothing but a number that each process counted anew.

    The code that was loaded second called the closures of the first: 2 2 3 3 twice.
    """
    (tmp_path / "closures.py").write_text(CLOSURES)
    answers = {"ascending": "ascending 2 2 3 3", "descending": "descending 3 3 2 2"}
    for names in (["ascending"], ["descending"], [*answers]):
        done = run(tmp_path, " ".join(names), CALLS)
        assert done.stdout.splitlines() == [answers[name] for name in names]


def test_compilation_is_counted_and_told_once() -> None:
    told: list[str] = []

    @njit()
    def inner(x: float) -> float:
        return 2.0 * x

    @njit()
    def outer(x: float) -> float:
        return inner(x) + 1.0

    with compiling(lambda: told.append("now")) as first:
        assert outer(1.0) == 3.0
    assert told == ["now"]
    assert first.cpu_seconds > 0.0
    with compiling(lambda: told.append("again")) as second:
        assert outer(2.0) == 5.0
    assert told == ["now"]
    assert second.cpu_seconds == 0.0


def test_stages_of_a_run_leave_compilation_out() -> None:
    """Work and compilation add up to the total; the stages are a part of it."""

    @njit()
    def turned(x: float) -> float:
        return 1.0 - x

    with timed_stages() as cold:
        assert turned(0.25) == 0.75
        cold.lap("solve")
    with timed_stages() as warm:
        assert turned(0.5) == 0.5
        warm.lap("solve")
    seconds = cold.seconds()
    assert seconds["compile"] > 0.0
    assert seconds["solve"] + seconds["compile"] <= seconds["total"]
    assert seconds["solve"] < seconds["compile"]  # it is one subtraction
    assert "compile" not in warm.seconds()
    assert summed({"solve": 1.0}, {"build": 2.0, "solve": 0.5}) == {"solve": 1.5, "build": 2.0}


def test_curved_blocks_load_no_compiler() -> None:
    script = """
import sys
from validation.cli.app import main
sys.argv = "tubelock fem tsb1-pipe --accuracy u=50% --set assembly.layers=1 --json -".split()
try:
    main()
finally:
    assert "fem.static.linear_step.grid" in sys.modules
    assert not {"numba", "llvmlite"} & set(sys.modules)
"""
    line = [sys.executable, "-c", script]
    done = subprocess.run(line, check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
