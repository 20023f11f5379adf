"""The history of a run: one row for each sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fem.explicit.output.energy import ENERGY_NAMES, Energies
from geometry.mesh import FloatArray

#: Columns of the table.
COLUMNS = ("time", "step", *ENERGY_NAMES, "energy_balance", "mass_damping", "residual")


@dataclass
class History:
    """Samples in the order of time."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    """One tuple per sample, in the order of `COLUMNS`."""
    initial_total: float | None = None
    """`Energies.total` of the first sample, which must stay."""
    turnover: float = 0.0
    """Largest energy turned over so far [N mm]."""
    put_in: float = 0.0
    """Initial energy and the largest work of loads so far [N mm]."""

    def observe(self, energies: Energies) -> None:
        """Remember what the balance and the watchdog compare with."""
        if self.initial_total is None:
            self.initial_total = energies.total
            stored = energies.strain_energy + energies.contact_energy
            self.put_in = abs(energies.kinetic_energy) + stored
        self.put_in = max(self.put_in, abs(energies.external_work))
        self.turnover = max(self.turnover, energies.turnover)

    def balance(self, energies: Energies) -> float:
        """Return (total - initial total) / largest turnover so far."""
        if self.initial_total is None or self.turnover == 0.0:
            return 0.0
        return (energies.total - self.initial_total) / self.turnover

    def append(
        self, time: float, step: int, energies: Energies, mass_damping: float, residual: float
    ) -> None:
        """Add an observed sample."""
        values = tuple(getattr(energies, name) for name in ENERGY_NAMES)
        balance = self.balance(energies)
        self.rows.append((time, float(step), *values, balance, mass_damping, residual))

    def times(self, copies: int) -> History:
        """History of so many copies: of the whole where a sector was computed."""
        energy = [name in ENERGY_NAMES for name in COLUMNS]
        factors = [copies if scaled else 1 for scaled in energy]
        return History(
            rows=[tuple(f * v for f, v in zip(factors, row, strict=True)) for row in self.rows],
            initial_total=None if self.initial_total is None else copies * self.initial_total,
            turnover=copies * self.turnover,
            put_in=copies * self.put_in,
        )

    def table(self) -> FloatArray:
        """All samples, (n_samples, len(COLUMNS))."""
        return np.array(self.rows, dtype=np.float64).reshape(-1, len(COLUMNS))

    def column(self, name: str) -> FloatArray:
        """One column by its name."""
        return self.table()[:, COLUMNS.index(name)]

    def csv(self) -> str:
        """Return the table as text with a header line."""
        lines = [",".join(COLUMNS)]
        lines += [",".join(f"{value:.17g}" for value in row) for row in self.rows]
        return "\n".join(lines) + "\n"
