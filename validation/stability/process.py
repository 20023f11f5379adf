"""Robustness cases of the process: killed, interrupted, files that lie."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from fem.explicit.output.checkpoint import CheckpointError
from fem.explicit.solve import Output, Progress, Run, solve
from geometry.machine.system import KILL
from validation.stability.case import Cases, Check, Finding, refusal
from validation.stability.explicit import free_cube, noise

CASES = Cases("process")

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

whole_run(checkpoint=Path(sys.argv[1]), progress=die)
"""


def whole_run(
    *, checkpoint: Path | None = None, resume: Path | None = None, progress: object = None
) -> Run:
    """Run a free cube for some hundred steps, checkpoints at every one."""
    model = free_cube()
    critical = model.critical.critical_time_step
    reported = progress if callable(progress) else None
    return solve(
        model,
        end_time=_STEPS * 0.9 * critical,
        velocities=noise(model, 100.0),
        output=Output(progress=reported, checkpoint=checkpoint, checkpoint_seconds=0.0),
        resume=resume,
    )


@CASES.add("killed", "SIGKILL in the middle of a run: it continues to the same bits", slow=True)
def _killed() -> Finding:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.npz"
        killed = subprocess.run(
            [sys.executable, "-c", _VICTIM, str(file)], check=False, capture_output=True
        )
        continued = whole_run(resume=file)
        left = [path.name for path in Path(folder).iterdir() if path != file]
    unbroken = whole_run()
    same = np.array_equal(continued.displacements[0], unbroken.displacements[0])
    same &= np.array_equal(continued.history.table(), unbroken.history.table(), equal_nan=True)
    return Finding(
        Check("signal that ended the victim", abs(killed.returncode), KILL, KILL),
        Check("same bits", same, 1, 1),
        Check("files left over", len(left), 0),
    )


@CASES.add("interrupted-anywhere", "Stopped after any sample: continues to the same bits")
def _anywhere() -> Finding:
    unbroken = whole_run()
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        for stop in (1, 51, 101, 251):
            file = Path(folder) / f"{stop}.npz"

            def give_up(told: Progress, stop: int = stop) -> None:
                if told.step > stop:
                    raise _StoppedError

            try:
                whole_run(checkpoint=file, progress=give_up)
            except _StoppedError:
                continued = whole_run(resume=file)
                same = np.array_equal(continued.displacements[0], unbroken.displacements[0])
                different += not same
    return Finding(Check("runs with other bits, of 4", different, 0))


class _StoppedError(Exception):
    """Ends a run from its own callback."""


@CASES.add("checkpoint-truncated", "Half a checkpoint: rejected before anything runs")
def _truncated() -> Finding:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.npz"
        whole_run(checkpoint=file)
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        return refusal(lambda: whole_run(resume=file), CheckpointError, "not a readable checkpoint")
