"""Interfaces that are far from touching are not computed until their blocks could have met.

A unit whose least gap exceeds the reach of the law by a margin sleeps. While anything sleeps,
the way that the fastest surface node of each block has gone is summed up in every step; a unit
wakes before the ways of its two blocks together use up half of its margin (the other half is
for the turning of the normals). So nothing is missed, whatever the blocks do in between.
"""

from __future__ import annotations

import numpy as np

from fem.explicit.body import Body
from fem.explicit.contact.paired_kernel import UnitArrays, UnitWork, add_travel
from fem.explicit.state import State
from geometry.mesh import FloatArray

#: Steps between two looks for interfaces that can sleep.
_INTERVAL = 32

#: A margin must last for so many looks at the present speed, or sleep does not pay.
_LEAST_LOOKS = 4


class Sleepers:
    """Which units sleep; decides nothing about results, so no checkpoint knows it."""

    def __init__(
        self, data: UnitArrays, work: UnitWork, reach: float, bodies: tuple[Body, ...]
    ) -> None:
        """Start with every unit awake.

        Parameters
        ----------
        data, work
            Arrays of the units; ``work.awake`` is kept up to date.
        reach
            Gap n · d below which the law acts [mm].
        bodies
            Groups, to find the rows on their surfaces.
        """
        self._data, self._work, self._reach = data, work, reach
        self._surface = [
            np.empty(0, dtype=np.int64)
            if body.applied_row is None
            else np.flatnonzero(body.applied_row >= 0)
            for body in bodies
        ]
        self._travel = [np.zeros(body.n_copies) for body in bodies]
        self._allowed = np.zeros(len(data.units))
        self._copies = [self._copies_of(unit) for unit in range(len(data.units))]
        self._calls = 0

    @property
    def asleep(self) -> int:
        """Number of units that sleep."""
        return int((self._work.awake == 0).sum())

    def wake(self, state: State, time_step: float) -> None:
        """Before the forces: count the last step's motion and wake who might touch."""
        if self._work.awake.all():
            return
        for rows, now, travel in zip(self._surface, state.bodies, self._travel, strict=True):
            add_travel(rows, now.velocity, time_step, travel)
        for unit in np.flatnonzero(self._work.awake == 0):
            if self._way(int(unit)) >= self._allowed[unit]:
                self._work.awake[unit] = 1

    def put_to_sleep(self, state: State, time_step: float) -> None:
        """After the forces: now and then let units sleep that are far from touching."""
        self._calls += 1
        if self._calls % _INTERVAL:
            return
        margins = self._margins()
        if not (margins > 0.0).any():
            return
        steps = [np.zeros_like(travel) for travel in self._travel]
        for rows, now, step in zip(self._surface, state.bodies, steps, strict=True):
            add_travel(rows, now.velocity, time_step, step)
        for unit in np.flatnonzero(margins > 0.0):
            pace = sum(float(steps[g][c].max()) for g, c in self._copies[unit])
            if 0.5 * margins[unit] > _LEAST_LOOKS * _INTERVAL * pace:
                self._work.awake[unit] = 0
                self._allowed[unit] = self._way(int(unit)) + 0.5 * margins[unit]

    def _margins(self) -> FloatArray:
        """Least gap beyond the reach of the law, of the units that are awake; (n_units,)."""
        gap = self._work.gap
        margins = np.zeros(len(self._data.units))
        for unit, (kind, width, _, _, _, point, *_) in enumerate(self._data.units):
            if self._work.awake[unit]:
                facets = self._data.alike[kind + 1, 1] - self._data.alike[kind, 1]
                margins[unit] = gap[point : point + 4 * width * facets].min() - self._reach
        return margins

    def _copies_of(self, unit: int) -> list[tuple[int, np.ndarray]]:
        """Groups and copies that move in a unit."""
        kind, _, real, lane, *_ = self._data.units[unit]
        first, last = self._data.alike[kind, 0], self._data.alike[kind + 1, 0]
        return [
            (int(self._data.alike[kind, 2 + side]), self._data.copies[side, lane : lane + real])
            for side in (0, 1)
            if (self._data.rows[first:last, side] >= 0).any()
        ]

    def _way(self, unit: int) -> float:
        """Largest sum of what the blocks of a unit have travelled [mm]."""
        return sum(float(self._travel[g][c].max()) for g, c in self._copies[unit])
