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
from geometry.mesh import FloatArray, IntArray

#: Steps between two looks for interfaces that can sleep.
_INTERVAL = 32

#: A margin must last for so many looks at the present speed, or sleep does not pay.
_LEAST_LOOKS = 4

#: At least this share of the units must sleep, or watching costs more than they do (measured).
_LEAST_SHARE = 0.5


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
        counts = [body.n_copies for body in bodies]
        self._first = np.cumsum([0, *counts])
        self._travel = np.zeros(self._first[-1])
        self._allowed = np.zeros(len(data.units))
        sides = [side for unit in range(len(data.units)) for side in self._moving_sides(unit)]
        self._unit_of_side = np.array([unit for unit, _ in sides], dtype=np.int64)
        self._copy = np.concatenate([np.empty(0, np.int64), *(copies for _, copies in sides)])
        lengths = [len(copies) for _, copies in sides]
        self._first_of_side = np.cumsum([0, *lengths])[:-1].astype(np.int64)
        self._calls = 0

    @property
    def asleep(self) -> int:
        """Number of units that sleep."""
        return int((self._work.awake == 0).sum())

    def wake(self, state: State, time_step: float) -> None:
        """Before the forces: count the last step's motion and wake who might touch."""
        awake = self._work.awake
        if awake.all():
            return
        self._add_travel(state, time_step, self._travel)
        awake[(awake == 0) & (self._way(self._travel) >= self._allowed)] = 1

    def put_to_sleep(self, state: State, time_step: float) -> None:
        """After the forces: now and then let units sleep that are far from touching."""
        self._calls += 1
        if self._calls % _INTERVAL or not len(self._data.units):
            return
        awake = self._work.awake
        least = np.minimum.reduceat(self._work.gap, self._data.units[:, 5])
        margins = np.where(awake, least - self._reach, 0.0)
        if not (margins > 0.0).any():
            return
        step = np.zeros_like(self._travel)
        self._add_travel(state, time_step, step)
        tired = 0.5 * margins > _LEAST_LOOKS * _INTERVAL * self._way(step)
        if (tired | (awake == 0)).mean() >= _LEAST_SHARE:
            awake[tired] = 0
            self._allowed[tired] = (self._way(self._travel) + 0.5 * margins)[tired]

    def _add_travel(self, state: State, time_step: float, travel: FloatArray) -> None:
        """Add the way that each copy goes in a step."""
        for k, now in enumerate(state.bodies):
            mine = travel[self._first[k] : self._first[k + 1]]
            add_travel(self._surface[k], now.velocity, time_step, mine)

    def _moving_sides(self, unit: int) -> list[tuple[int, IntArray]]:
        """The unit and the copies that move on its sides, numbered through all groups."""
        kind, _, real, lane, *_ = self._data.units[unit]
        first, last = self._data.alike[kind, 0], self._data.alike[kind + 1, 0]
        return [
            (
                unit,
                self._first[self._data.alike[kind, 2 + side]]
                + self._data.copies[side, lane : lane + real],
            )
            for side in (0, 1)
            if (self._data.rows[first:last, side] >= 0).any()
        ]

    def _way(self, travel: FloatArray) -> FloatArray:
        """Largest sum of what the blocks of each unit have travelled, (n_units,) [mm]."""
        most = np.maximum.reduceat(travel[self._copy], self._first_of_side)
        return np.bincount(self._unit_of_side, most, len(self._data.units)).astype(np.float64)
