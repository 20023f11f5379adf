"""Energies of an explicit run, consistent in time with the central differences; their history.

All are taken at the time of the forces, t_n. The kinetic energy is ½ v_{n-½} · M v_{n+½}: with
it, ½ u_n · K u_n and work by the mean velocity of the two half steps, a linear undamped run
keeps its energy to round-off, so the balance shows errors of the model and not of bookkeeping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np

from fem.explicit.body import LaneBody
from fem.explicit.kernels import dot_lanes
from fem.explicit.kernels.layout import aligned_zeros
from fem.explicit.state import BodyState
from fem.explicit.step import Loop
from geometry.mesh import FloatArray


@dataclass(frozen=True)
class Energies:
    """Energies at one time [N mm = mJ]."""

    kinetic_energy: float
    """½ v_{n-½} · M v_{n+½}."""
    strain_energy: float
    """½ u · K u in the block frames, hourglass energy included."""
    hourglass_energy: float
    """Part of the strain energy that the hourglass control of reduced elements holds."""
    contact_energy: float
    """Stored in the contact springs."""
    external_work: float
    """Of loads, moving supports and gravity."""
    mass_damping_dissipation: float
    """Of mass-proportional damping."""
    stiffness_damping_dissipation: float
    """Of stiffness-proportional damping."""
    bulk_viscosity_dissipation: float
    """Of bulk viscosity."""
    frictional_dissipation: float
    """Of the interactions."""

    @property
    def viscous_dissipation(self) -> float:
        """Of all damping and viscosity."""
        return (
            self.mass_damping_dissipation
            + self.stiffness_damping_dissipation
            + self.bulk_viscosity_dissipation
        )

    @property
    def total(self) -> float:
        """The quantity that must stay constant."""
        stored = self.kinetic_energy + self.strain_energy + self.contact_energy
        return stored + self.viscous_dissipation + self.frictional_dissipation - self.external_work

    @property
    def turnover(self) -> float:
        """Scale of the balance: energy stored, dissipated and put in, without signs."""
        stored = abs(self.kinetic_energy) + abs(self.strain_energy) + abs(self.contact_energy)
        lost = abs(self.viscous_dissipation) + abs(self.frictional_dissipation)
        return max(stored + lost, abs(self.external_work))

    def times(self, copies: int) -> Energies:
        """Energies of so many copies: of the whole where a sector was computed."""
        return Energies(**{f.name: copies * getattr(self, f.name) for f in fields(self)})


#: Names of the columns of the history.
ENERGY_NAMES = tuple(f.name for f in fields(Energies))


def energies(loop: Loop) -> Energies:
    """Energies at the beginning of the step that was just done with ``sample``."""
    states = [body.now for body in loop.bodies]
    # `update` left ½ v₋ · M v₊ with the v₊ before the supports corrected it.
    half = 0.0 if loop.mass_damping is None else 0.5 * loop.mass_damping * loop.time_step
    supports = sum(now.support_work.latest_before for now in states) / (1.0 + half)
    return Energies(
        kinetic_energy=sum(float(now.kinetic.sum()) for now in states) + supports,
        strain_energy=sum(float(now.strain_energy.sum()) for now in states),
        hourglass_energy=sum(hourglass_energy(loop, body) for body in loop.bodies),
        contact_energy=sum(i.energy() for i in loop.interactions),
        external_work=sum(
            body.now.external_work.now
            + body.now.support_work.now
            + _load_work(body.now)
            + gravity_work(loop, body)
            for body in loop.bodies
        ),
        mass_damping_dissipation=sum(_mass_damping(now) for now in states),
        stiffness_damping_dissipation=sum(_stiffness_damping(loop, now) for now in states),
        bulk_viscosity_dissipation=sum(
            float(now.viscous.dissipated.sum()) for now in states if now.viscous is not None
        ),
        frictional_dissipation=sum(i.dissipation() for i in loop.interactions),
    )


def _load_work(now: BodyState) -> float:
    loads = now.loads
    return 0.0 if loads is None else float(loads.work[:, 0].sum() - loads.work[:, 1].sum())


def _mass_damping(now: BodyState) -> float:
    work = now.mass_damping_work
    if work is None:
        return 0.0
    return float(work[:, 0].sum() - work[:, 1].sum()) + now.support_loss.now


def _stiffness_damping(loop: Loop, now: BodyState) -> float:
    before, damping = now.elastic_before, now.stiffness_damping
    if before is not None:
        done = float(before.work[:, 0].sum() - before.work[:, 1].sum())
        return loop.time_step * (done + before.support_loss.now)
    if damping is None:
        return 0.0
    # Without block frames the kernel was given the velocity as the increment.
    scale = loop.time_step if now.frame is None else 1.0
    return scale * float(damping.dissipated.sum())


def gravity_work(loop: Loop, body: LaneBody) -> float:
    """Work of gravity since the undeformed state, Σ m g · u_n [N mm].

    Gravity that changes in time has no potential: its work is with that of the loads.
    """
    if body.acceleration is None or loop.stated.effects.gravity_amplitude is not None:
        return 0.0
    mass, now = body.mass, body.now
    moved = np.einsum("n,njk->jk", mass, now.displacement)
    moved -= loop.time_step * np.einsum("n,njk->jk", mass, now.velocity)
    return float((moved * body.acceleration).sum())


def hourglass_energy(loop: Loop, body: LaneBody) -> float:
    """½ u · K_hourglass u, of the displacement in the block frame [N mm].

    The displacement of small rotation has moved on by one step since the forces were taken:
    it is stepped back.
    """
    rows, now = body.hourglass, body.now
    if rows is None:
        return 0.0
    local = now.local_displacement
    if now.frame is None:
        local = local - loop.time_step * now.velocity
    force = aligned_zeros(local.shape)
    flat = local.ravel(), force.ravel()
    loop.kernels.stiffness_product(*rows.packed, *flat, None, body.lanes)
    total = np.zeros(body.lanes)
    dot_lanes(local, force, total)
    return 0.5 * float(total.sum())


def copy_energies(now: BodyState) -> FloatArray:
    """Strain energy plus magnitude of the kinetic energy of each copy, (lanes,) [N mm]."""
    return now.strain_energy + np.abs(now.kinetic.sum(axis=0))


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
    pushes: list[tuple[float, ...]] = field(default_factory=list)
    """Time [s] and the force of each support that moves [N], of the whole, per sample."""

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
            pushes=self.pushes,
        )

    @property
    def energies(self) -> Energies | None:
        """At the last sample; None before the first."""
        return Energies(*self.rows[-1][2:-3]) if self.rows else None

    @property
    def residual(self) -> float | None:
        """At the last sample; None where the run does not watch it."""
        last = self.rows[-1][-1] if self.rows else math.nan
        return None if math.isnan(last) else last

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
