"""Kernels of general contact as plain Python, where an index beyond an array is an error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import numpy as np
from fem.static.solve import static_state
from tests.support.searched_stack import stack

found = static_state(stack((2, 2, 1), (3, 3, 1)))
np.testing.assert_allclose(found.pressures, 0.5, rtol=1e-7)
"""


def test_no_kernel_of_general_contact_reaches_beyond_its_arrays() -> None:
    """Machine code would read or overwrite what lies there, with or without other results."""
    root = str(Path(__file__).parents[2])
    uncompiled = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": root}
    subprocess.run([sys.executable, "-c", PROGRAM], env=uncompiled, check=True, cwd=root)
