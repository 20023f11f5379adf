"""Compiled code that is kept is that of the sources in the tree, whatever ran before."""

import os
import shutil
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from geometry.compilation import njit
from geometry.compilation.cache import KernelCache, source_digest
from geometry.compilation.clocks import compiling, stages, summed

ROOT = Path(__file__).parents[2]
CHOICES = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")

FILES = {
    "pack/__init__.py": "",
    "pack/constants.py": "OPTIONS = {'error_model': 'numpy'}\nFACTOR = 2.0\n",
    "pack/helper.py": (
        "from geometry.compilation import njit\nfrom .constants import FACTOR, OPTIONS\n"
        "@njit(**OPTIONS)\ndef scaled(x):\n    return FACTOR * x\n"
    ),
    "pack/kernel.py": (
        "from geometry.compilation import njit\nfrom pack.helper import scaled\n"
        "from numba import prange\n"
        "@njit(cache=True)\ndef total(n):\n"
        "    s = 0.0\n    for i in prange(n):\n        s += scaled(1.0)\n    return s\n"
        "serial = total\n"
        "@njit(cache=True, parallel=True)\ndef total(n):\n"
        "    s = 0.0\n    for i in prange(n):\n        s += scaled(1.0)\n    return s\n"
    ),
}
RUN = (
    "from pack.kernel import serial, total\n"
    "print(serial(3), total(3), sum(f._cache_hits.total() for f in (serial, total)))"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose kernel calls a helper with a constant of a third file."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def run(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the kernel in a new process; source files are read, never yesterday's bytecode."""
    return subprocess.run(
        [sys.executable, "-c", RUN],
        env={
            **{k: v for k, v in os.environ.items() if k not in CHOICES},
            "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
            "PYTHONDONTWRITEBYTECODE": "1",
            **environment,
        },
        capture_output=True,
        text=True,
        check=True,
    )


def test_processes_that_start_together_compile_each_form_once(package: Path) -> None:
    """Both forms are loaded by the process that came second; they were compiled by both."""
    with ThreadPoolExecutor() as pool:
        together = list(pool.map(lambda _: run(package).stdout.split(), range(2)))
    assert [answer[:2] for answer in together] == [["6.0", "6.0"]] * 2
    assert sum(int(answer[2]) for answer in together) == 2
    assert not list(package.rglob("*.lock"))


def kernels(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.kernel"))


def test_an_edit_of_a_helpers_constant_changes_the_answer(package: Path) -> None:
    """The kernel's own file stays as it is; with numba's cache both runs gave 6."""
    assert run(package).stdout.split() == ["6.0", "6.0", "0"]
    assert run(package).stdout.split() == ["6.0", "6.0", "2"]
    constants = package / "pack" / "constants.py"
    constants.write_text(constants.read_text().replace("FACTOR = 2.0", "FACTOR = 5.0"))
    assert run(package).stdout.split() == ["15.0", "15.0", "0"]
    # Nothing will ask for the code of the older sources: one file for each of the two forms.
    assert len(kernels(package)) == 2


CLOSURES = """
import math
import sys

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


if __name__ == "__main__":
    import closures
    import numpy as np

    for name in sys.argv[1:]:
        values = np.ones(4)
        getattr(closures, name)(values, 0)
        print(name, *values.astype(int))
"""


def test_code_of_two_processes_is_not_mixed(tmp_path: Path) -> None:
    """Closures of one factory differ in nothing but a number that each process counted anew.

    The code that was loaded second called the closures of the first: 2 2 3 3 twice.
    """
    file = tmp_path / "closures.py"
    file.write_text(CLOSURES)
    environment = {k: v for k, v in os.environ.items() if k not in CHOICES}
    environment |= {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    answers = {"ascending": "ascending 2 2 3 3", "descending": "descending 3 3 2 2"}
    for names in (["ascending"], ["descending"], [*answers]):
        command = [sys.executable, str(file), *names]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.splitlines() == [answers[name] for name in names]


def test_damaged_files_are_compiled_anew(package: Path) -> None:
    run(package)
    files = kernels(package)
    flipped = bytearray(files[0].read_bytes())
    flipped[len(flipped) // 2] ^= 1
    files[0].write_bytes(flipped)
    files[1].write_bytes(b"")
    assert run(package).stdout.split() == ["6.0", "6.0", "0"]
    assert run(package).stdout.split() == ["6.0", "6.0", "2"]


def test_where_nothing_can_be_written_beside_the_program_code_is_kept_elsewhere(
    package: Path, tmp_path: Path
) -> None:
    """A file in the place of a folder: no one can write there, a superuser neither."""
    (package / "pack" / "__pycache__").write_text("")
    first = run(package, HOME=str(tmp_path / "home"))
    assert first.stdout.split() == ["6.0", "6.0", "0"]
    assert first.stderr.count("cannot be written") == len(first.stderr.splitlines()) == 1
    second = run(package, HOME=str(tmp_path / "home"))
    assert (second.stdout.split(), second.stderr) == (["6.0", "6.0", "2"], "")


def test_without_a_home_code_is_kept_in_a_private_temporary_folder_or_not_at_all(
    package: Path, tmp_path: Path
) -> None:
    (package / "pack" / "__pycache__").write_text("")
    (tmp_path / "file").write_text("")
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    no_home = {"HOME": str(tmp_path / "file"), "TMPDIR": str(temporary)}
    run(package, **no_home)
    assert run(package, **no_home).stdout.split() == ["6.0", "6.0", "2"]
    (private,) = temporary.iterdir()
    assert stat.S_IMODE(private.stat().st_mode) == 0o700
    # A folder that others may write to is not trusted with code.
    private.chmod(0o777)
    answer = run(package, **no_home)
    assert answer.stdout.split() == ["6.0", "6.0", "0"]
    assert "every run compiles anew" in answer.stderr


def test_every_kernel_of_the_program_has_its_helpers_in_its_key() -> None:
    from fem.explicit.contact.sliding_kernel import sliding_forces
    from fem.explicit.kernels.stiffness import stiffness_product

    assert isinstance(stiffness_product.serial._cache, KernelCache)
    assert isinstance(stiffness_product.parallel._cache, KernelCache)
    assert isinstance(sliding_forces._cache, KernelCache)
    assert njit()(lambda x: 2 * x)(3) == 6


def test_an_edit_of_the_contact_law_changes_the_key_of_the_loop_that_calls_it(
    tmp_path: Path,
) -> None:
    """On a copy of the program: the loop over sliding points stays, the law is edited."""
    for name in ("geometry", "fem"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.kernel"))
    law = tmp_path / "fem" / "contact" / "law.py"
    law.write_text(law.read_text() + "\n# edited\n")
    script = "import geometry.compilation.cache as c, fem; print(c.source_digest({!r}))"
    for module, changes in (
        ("fem.explicit.contact.sliding_kernel", True),
        ("geometry.polyhedra.triangle_kernels", False),
    ):
        command = [sys.executable, "-c", script.format(module)]
        answer = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.strip()
        assert (answer != source_digest(module)) is changes


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

    with stages() as cold:
        assert turned(0.25) == 0.75
        cold.lap("solve")
    with stages() as warm:
        assert turned(0.5) == 0.5
        warm.lap("solve")
    seconds = cold.seconds()
    assert seconds["compile"] > 0.0
    assert seconds["solve"] + seconds["compile"] <= seconds["total"]
    assert seconds["solve"] < seconds["compile"]  # it is one subtraction
    assert "compile" not in warm.seconds()
    assert summed({"solve": 1.0}, {"build": 2.0, "solve": 0.5}) == {"solve": 1.5, "build": 2.0}


@pytest.mark.parametrize(
    ("command", "module"),
    [
        (["mbd", "tsb1-pipe"], "validation.solving"),
        (["fem", "tsb1-pipe", "--accuracy", "u=50%"], "fem.static.linear_step.grid"),
    ],
)
def test_rigid_and_curved_blocks_load_no_compiler(command: list[str], module: str) -> None:
    script = """
import sys
from validation.cli.app import main
module, *sys.argv = sys.argv[1:]
try:
    main()
finally:
    assert module in sys.modules
    assert not {"numba", "llvmlite"} & set(sys.modules)
"""
    given = ["tubelock", *command, "--set", "assembly.layers=1", "--json", "-"]
    line = [sys.executable, "-c", script, module, *given]
    done = subprocess.run(line, check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_static_solution_in_python_loads_no_compiler() -> None:
    script = """
import sys
from fem import Problem, Static, concrete, solve_static
from geometry import SineBlock, pipe, tube
block = SineBlock(
    height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
)
problem = Problem(tube(block, layers=1, mesh=(12, 1, 4)), pipe(0.01), concrete)
answer = solve_static(problem, Static(accuracy={"u": 0.5}))
assert answer.as_dict()["measures"]["p_max"]["error"] > 0.0
assert not {"numba", "llvmlite"} & set(sys.modules)
"""
    line = [sys.executable, "-c", script]
    done = subprocess.run(line, check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
