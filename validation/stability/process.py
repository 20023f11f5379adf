"""Robustness cases of the process: killed, interrupted, files that lie."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fem.explicit.output.checkpoint import CheckpointError
from fem.explicit.solve import Output, Progress, run_explicit
from fem.state import State
from geometry.machine.system import KILL
from validation.stability.case import CaseVerdict, case, case_verdict, rejected
from validation.stability.explicit import free_cube, noise

_STEPS = 300
#: Run in a process of its own that kills itself without warning at step 150, between the moment
#: a checkpoint is written and the next.
_VICTIM = """
import os, sys
from pathlib import Path
from geometry.machine.system import KILL
from validation.stability.process import whole_run

def die(told):
    if told.step > 150:
        os.kill(os.getpid(), KILL)

whole_run(Path(sys.argv[1]), die)
"""


def whole_run(
    checkpoint: Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: Path | None = None,
) -> State:
    """Run a free cube for some hundred steps, checkpoints at every one."""
    model = free_cube()
    end, start = _STEPS * 0.9 * model.critical.critical_time_step, noise(model, 100.0)
    output = Output(progress=progress, checkpoint=checkpoint, checkpoint_seconds=0.0)
    return run_explicit(model.until(end, velocities=start), output=output, resume=resume)


@case(slow=True)
def killed() -> CaseVerdict:
    """SIGKILL in the middle of a run: it continues to the same bits."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.npz"
        command = [sys.executable, "-c", _VICTIM, str(file)]
        victim = subprocess.run(command, check=False, capture_output=True)
        continued = whole_run(resume=file)
        left = [path.name for path in Path(folder).iterdir() if path != file]
    unbroken = whole_run()
    same = np.array_equal(continued.displacements[0], unbroken.displacements[0])
    assert continued.run is not None
    assert unbroken.run is not None
    rows, expected = continued.run.history.table(), unbroken.run.history.table()
    same &= np.array_equal(rows, expected, equal_nan=True)
    return case_verdict(
        ("signal that ended the victim", abs(victim.returncode), "==", KILL),
        ("same bits", same, "==", 1),
        ("files left over", len(left), 0),
    )


@case()
def interrupted_anywhere() -> CaseVerdict:
    """Stopped after any sample: continues to the same bits."""
    unbroken = whole_run()
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        for stop in (1, 51, 101, 251):
            file = Path(folder) / f"{stop}.npz"

            def give_up(told: Progress, stop: int = stop) -> None:
                if told.step > stop:
                    raise _StoppedError

            try:
                whole_run(file, give_up)
            except _StoppedError:
                continued = whole_run(resume=file)
                same = np.array_equal(continued.displacements[0], unbroken.displacements[0])
                different += not same
    return case_verdict(("runs with other bits, of 4", different, 0))


class _StoppedError(Exception):
    """Ends a run from its own callback."""


@case()
def checkpoint_truncated() -> CaseVerdict:
    """Half a checkpoint: rejected before anything runs."""
    words = "not a readable checkpoint"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.npz"
        whole_run(file)
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        return rejected(lambda: whole_run(resume=file), CheckpointError, words)
