"""Frames of a run: when they are due, and those of static runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fem.explicit.solve import Frame
from geometry.mesh import FloatArray
from validation.scene.deformable import Damping, FemSection

#: Parts of the longest run, for a run that may end early and has no ramp it must pass.
_FINE = 200.0


def frame_interval(fem: FemSection, end_time: float, ramp_time: float) -> float:
    """Time between two frames [s].

    A run that is damped to the static state may end any time after the ramp: frames come so
    often that as many as were asked for lie in the ramp, and the writer thins them out.

    Parameters
    ----------
    fem
        ``[fem]`` of the scene.
    end_time
        Latest end of the run [s].
    ramp_time
        End of the loading [s].
    """
    intervals = max(fem.frames - 1, 1)
    if fem.damping is not Damping.STATIC:
        return end_time / intervals
    first = ramp_time if ramp_time > 0.0 else end_time / _FINE
    return min(first, end_time) / intervals


def static_frames(
    count: int, steps: Sequence[tuple[float, tuple[FloatArray, ...]]]
) -> Iterator[Frame]:
    """Frames of a static run: the state without load, then those of the load steps.

    Parameters
    ----------
    count
        Frames asked for; fewer where there were fewer load steps.
    steps
        Part of the load and displacements of each group, the whole load last.
    """
    rest = tuple(np.zeros_like(u) for u in steps[-1][1])
    states = [(0.0, rest), *steps]
    chosen = np.unique(np.round(np.linspace(len(states) - 1, 0, min(count, len(states)))))
    for place, k in enumerate(chosen.astype(int)):
        share, displacements = states[k]
        yield Frame(place, share, displacements, last=place == len(chosen) - 1)
