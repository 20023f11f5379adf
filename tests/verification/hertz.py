"""Balls and rollers that are pressed together, beside Hertz and Cattaneo–Mindlin.

Closed forms are those of half-spaces at the *measured* force: with 1/E* = Σ (1 - ν²)/E and
1/R* = Σ 1/R,

    balls:    a = (3 F R* / 4 E*)^(1/3),    p₀ = 3 F / 2π a²
    rollers:  a = (4 P R* / π E*)^(1/2),    p₀ = 2 P / π a,     c = a (1 - Q/μP)^(1/2)

with p = p₀ √(1 - r²/a²) and tractions μ p₀ (√(1 - r²/a²) - c/a √(1 - r²/c²)): K. L. Johnson,
*Contact Mechanics* (1985), sections 4.2 and 7.2. What they leave out is of the order of (a/R)².

Measured are integrals, for pressures at single points carry the noise of chords that cross: a from
the second moment of the pressure (2/5 a² of balls, 1/4 a² of rollers), p₀ by a straight line of p²
over r² within half the contact, c from the second moment of the traction, (a² + c²)/4.

Meshes of the two bodies differ by a quarter, so that no facet faces one of its own; contact is the
search of static runs with a linear law.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fem import CoulombFriction, LinearPenalty, Material, Problem
from fem.state import State
from fem.static.linear_step.flexibility import FlexibilityStore
from fem.static.solve import StaticMethod, StaticOptions, solve_static
from fem.system.body import placed_body
from fem.system.forces import SmoothStepAmplitude
from fem.system.model import Support, fixed_nodes
from fem.system.state import corner_displacements
from fem.system.system import System
from geometry import Assembly, Block, LoadCase
from geometry.families.round_bodies import quarter_disc, round_ended, strip

#: Edge of the other body's elements over that of the first.
_UNLIKE = 1.25
#: Bodies end so far from the axis, in their radius.
_TRIMMED = 0.8
#: A static search finds surfaces in each other by 0.3 of an edge: bodies come closer by less.
_STEP = 0.25
#: Residual at which a step on the way ends, and at the end: what closest points leave.
_ON_THE_WAY, _RESIDUAL = 1e-3, 1e-6

POISSON = 0.3
#: Of the balls and of the roller [mm].
RADIUS = 50.0


def effective_modulus(young: Iterable[float]) -> float:
    """E* of two bodies [MPa]."""
    return 1.0 / sum((1.0 - POISSON**2) / e for e in young)


@dataclass(frozen=True)
class Field:
    """Pressures, or tractions where ``c`` is not 0, beside their closed form."""

    radius: np.ndarray
    """Distance of each point from the middle of the contact, (n,) [mm]."""
    area: np.ndarray
    """(n,) [mm²]; of rollers per thickness."""
    values: np.ndarray
    """(n,) [MPa]."""
    a: float
    """Radius or half width of the contact, closed form [mm]."""
    peak: float
    """p₀, of tractions μ p₀, closed form [MPa]."""
    force: float = 0.0
    """Of the whole contact; of rollers per thickness [N, N/mm]."""
    found_a: float = 0.0
    """Radius from the second moment [mm]."""
    found_p0: float = 0.0
    """Largest pressure by a straight line of p² over r² [MPa]."""
    ratio: float = 0.0
    """Q / μP."""
    c: float = 0.0
    """Half width of the part that sticks, closed form [mm]."""
    found_c: float = 0.0
    """The same from the second moment of the traction [mm]."""

    @property
    def field_error(self) -> float:
        """Difference from the closed form over it, in the mean square over the area."""
        closed = self.a * _ellipse(self.radius / self.a)
        if self.c:
            closed -= self.c * _ellipse(self.radius / self.c)
        closed *= self.peak / self.a
        return math.sqrt(self.area @ (self.values - closed) ** 2 / (self.area @ closed**2))


def _ellipse(share: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(1.0 - share**2, 0.0))


# ---------------------------------------------------------------------------------------------
# Bodies


@dataclass(frozen=True)
class Bodies:
    """Two bodies that are pressed together, the lower one first."""

    deformable: System
    apart: float
    """Way that the upper base goes down [mm]."""
    edge: float
    """Shortest edge where they touch [mm]."""
    symmetric: bool
    """Whether it is a quarter about the planes x = 0 and y = 0; else one slice of plane strain."""

    @property
    def modulus(self) -> float:
        """E* [MPa]."""
        return effective_modulus(g.material.young_modulus for g in self.deformable.bodies)


def _bodies(
    lower: Block,
    upper: Block,
    young: tuple[float, float],
    stiffness: float,
    *,
    apart: float,
    edge: float,
    thickness: float = 0.0,
) -> Bodies:
    """Place two bodies tip on tip; ``lower`` is turned over."""
    quarter = not thickness
    turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]) if quarter else np.diag([1.0, -1, -1])
    assembly = Assembly(
        name="hertz",
        shapes=(lower, upper),
        shape_of=np.arange(2),
        rotations=np.stack([turn, np.eye(3)]),
        translations=np.array([[0.0, thickness, 0.0], [0.0, 0.0, 0.0]]),
        layer=np.arange(2),
        fixed=np.zeros(2, dtype=np.bool_),
        unmatched_allowed=True,
    )
    nothing = LoadCase(assembly, "approach", (), np.zeros(2, dtype=np.bool_))
    materials = [Material(density=7.85e-9, young_modulus=e, poisson_ratio=POISSON) for e in young]
    law = LinearPenalty(stiffness)
    found = Problem(
        assembly, nothing, materials[0], law=law, finite_sliding=True, check_units=False
    ).deformable
    groups = tuple(
        placed_body(g.mesh, m, rotations=g.rotations, translations=g.translations, name=g.name)
        for g, m in zip(found.bodies, materials, strict=True)
    )
    return Bodies(replace(found, bodies=groups), apart, edge, quarter)


def balls(cell: float, *, approach: float, young: float, stiffness: float) -> Bodies:
    """A quarter of two equal balls that come nearer, trimmed to cylinders of 0.8 of their radius.

    Elements of the edge ``cell`` [mm] meet; the planes through the centres ``approach`` by [mm].
    Young's modulus in MPa, the stiffness of the linear contact law in MPa/mm.
    """
    contact = math.sqrt(0.5 * RADIUS * approach)
    lower, upper = (
        round_ended(
            name,
            quarter_disc(edge, contact, _TRIMMED * RADIUS),
            cell=edge,
            contact=contact,
            depth=RADIUS,
            radius=RADIUS,
        )
        for name, edge in (("lower", cell * _UNLIKE), ("upper", cell))
    )
    return _bodies(lower, upper, (young, young), stiffness, apart=approach, edge=cell)


def roller(
    cell: float, *, contact: float, apart: float, young: tuple[float, float], stiffness: float
) -> Bodies:
    """Half of a roller on a block of 200 mm × 200 mm, plane strain, one element thick.

    Elements are cubes of the edge ``cell`` [mm] on the half width ``contact`` that is meant [mm];
    the plane through the roller's centre goes down by ``apart`` [mm]. Young's moduli of block and
    roller in MPa, the stiffness of the linear contact law in MPa/mm.
    """
    block = strip(cell * _UNLIKE, contact, 100.0, thickness=cell)
    half = strip(cell, contact, _TRIMMED * RADIUS, thickness=cell)
    lower = round_ended("block", block, cell=cell * _UNLIKE, contact=contact, depth=200.0)
    upper = round_ended("roller", half, cell=cell, contact=contact, depth=RADIUS, radius=RADIUS)
    return _bodies(lower, upper, young, stiffness, apart=apart, edge=cell, thickness=cell)


def _supports(bodies: Bodies, down: float, aside: float) -> tuple[Support, ...]:
    """Bases held, the upper one moved; symmetry planes, or plane strain."""
    found, ramp = [], SmoothStepAmplitude(1.0)
    assembly = bodies.deformable.assembly
    along = (2,) if bodies.symmetric else (0, 2)
    for block, motion in enumerate(((0.0, 0.0, 0.0), (aside, 0.0, -down))):
        base = np.unique(assembly.shape(block).faces["base"])
        way = np.array(motion)
        found.append(fixed_nodes(block, base, components=along, displacement=way, amplitude=ramp))
        nodes = assembly.nodes(block)
        if bodies.symmetric:
            for k in range(2):
                plane = np.flatnonzero(np.abs(nodes[:, k]) < 1e-9)
                found.append(fixed_nodes(block, plane, components=(k,)))
        else:
            found.append(fixed_nodes(block, np.arange(len(nodes)), components=(1,)))
    return tuple(found)


def _moved(bodies: Bodies, down: float, aside: float = 0.0) -> System:
    return replace(bodies.deformable, supports=_supports(bodies, down, aside))


def pressed_together(bodies: Bodies) -> State:
    """Move the bases towards each other in steps that the search can follow."""
    steps = math.ceil(bodies.apart / (_STEP * bodies.edge))
    # Condensed blocks keep the nodes of symmetry planes; all nodes of a slice are held.
    method = StaticMethod.CONDENSED if bodies.symmetric else StaticMethod.SPARSE
    store, state = FlexibilityStore(), None
    for step in range(1, steps + 1):
        tolerance = _RESIDUAL if step == steps else _ON_THE_WAY
        options = StaticOptions(method=method, symmetry=1, tolerance=tolerance)
        there = _moved(bodies, bodies.apart * step / steps)
        near = None if state is None else state.displacements
        state = solve_static(there, options, start=near, store=store)
    assert state is not None
    assert state.converged, state.evidence.status
    return state


def pushed_aside(bodies: Bodies, normal: State, aside: float, friction: CoulombFriction) -> State:
    """Move the upper base aside, from a state without tangential traction."""
    moved = _moved(bodies, bodies.apart, aside)
    moved = replace(moved, contact=replace(moved.contact, friction=friction))
    options = StaticOptions(method=StaticMethod.SPARSE, symmetry=1, tolerance=_RESIDUAL)
    state = solve_static(moved, options, start=normal.displacements)
    assert state.converged, state.evidence.status
    return state


# ---------------------------------------------------------------------------------------------
# Measures


def pressed_balls(bodies: Bodies, state: State) -> Field:
    """Pressures of two equal balls beside Hertz at the same force."""
    contact, half = state.contact_state, 0.5 * RADIUS
    r = np.linalg.norm(contact.positions[:, :2], axis=1)
    p, area = contact.point_pressures, 4.0 * contact.point_areas
    force = float(area @ p)
    a = (0.75 * force * half / bodies.modulus) ** (1.0 / 3.0)
    return pressed((r, area, p), a, 1.5 * force / (math.pi * a**2), 2.5)


def pressed_roller(bodies: Bodies, state: State) -> Field:
    """Pressures of a roller on a plane beside Hertz at the same force."""
    contact = state.contact_state
    # Elements are as thick as the edge.
    p, area = contact.point_pressures, contact.point_areas / bodies.edge
    x = contact.positions[:, 0]
    force = float(area @ p)
    x = x - float(area @ (p * x)) / force
    a = math.sqrt(4.0 * force * RADIUS / (math.pi * bodies.modulus))
    return pressed((np.abs(x), area, p), a, 2.0 * force / (math.pi * a), 4.0)


def pressed(
    points: tuple[np.ndarray, np.ndarray, np.ndarray], a: float, p0: float, moment: float
) -> Field:
    r, area, p = points
    force = float(area @ p)
    inside = r < 0.5 * a
    line = np.polyfit(r[inside] ** 2, p[inside] ** 2, 1, w=np.sqrt(area[inside]))
    found_a = math.sqrt(moment * float(area @ (p * r**2)) / force)
    return Field(
        r, area, p, a, p0, force=force, found_a=found_a, found_p0=math.sqrt(float(line[1]))
    )


def slipped_roller(bodies: Bodies, normal: State, state: State, friction: CoulombFriction) -> Field:
    """Tractions of a roller pushed aside beside Cattaneo and Mindlin at the same forces."""
    found = state.points
    before, after = (
        corner_displacements(state.deformable, s.displacements, found) for s in (normal, state)
    )
    way = np.einsum("npa,nai->npi", found.functions, after - before)[:, 0]
    slip = np.linalg.norm(np.einsum("nki,ni->nk", found.sides[:, 0], way), axis=1)
    limit = friction.coefficient * state.pressures[:, 0]
    traction = np.minimum(friction.stick_stiffness * slip, limit)
    pressed = pressed_roller(bodies, state)
    area = found.weights[:, 0] / bodies.edge
    own = found.functions[:, 0, 4:]
    x = np.einsum("na,nai->ni", own, found.corners[:, 4:] + after[:, 4:])[:, 0]
    push = float(area @ traction)
    x = x - float(area @ (traction * x)) / push
    ratio = push / (friction.coefficient * pressed.force)
    spread = float(area @ (traction * x**2)) / push
    return Field(
        np.abs(x),
        area,
        traction,
        pressed.a,
        friction.coefficient * pressed.peak,
        ratio=ratio,
        c=pressed.a * math.sqrt(1.0 - ratio),
        found_c=math.sqrt(max(4.0 * spread - pressed.a**2, 0.0)),
    )
