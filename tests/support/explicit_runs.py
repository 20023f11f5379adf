"""Explicit runs of stated systems."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fem.explicit.solve import Output, run_explicit
from fem.explicit.timed import TimedSystem
from fem.method import Explicit
from fem.state import State
from geometry.mesh import FloatArray


def explicit_run(
    stated: TimedSystem,
    *,
    end_time: float,
    settled: float | None = None,
    displacements: Sequence[FloatArray] | None = None,
    velocities: Sequence[FloatArray] | None = None,
    output: Output | None = None,
    resume: Path | None = None,
    **options: Any,
) -> State:
    """State at an end [s], from a start; options are fields of the method.

    Only where a residual is among them a run may stop at its static state, once it has ``settled``.
    """
    model = stated.until(end_time, displacements=displacements, velocities=velocities)
    if settled is None:
        settled = model.times.settled if "residual" in options else math.inf
    model = replace(model, times=replace(model.times, settled=settled))
    return run_explicit(model, Explicit(**options), output, resume=resume)
