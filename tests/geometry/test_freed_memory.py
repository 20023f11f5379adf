"""Memory that is freed is kept for what is asked for next."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.quick

#: Share of the pages of 54 MB, in arrays too small for large pages, that are made anew again.
_PROGRAM = """
import resource
import numpy as np
from geometry.machine.system import keep_freed_memory
keep_freed_memory()
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones(375_000) for _ in range(18)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
first, *others = [faults() for _ in range(5)]
print(max(others) / first)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="mallopt is of glibc")
def test_pages_of_freed_arrays_are_used_again() -> None:
    """By default all come anew each time."""
    program = [sys.executable, "-c", _PROGRAM]
    result = subprocess.run(program, check=True, capture_output=True, text=True)
    assert float(result.stdout) < 0.1
