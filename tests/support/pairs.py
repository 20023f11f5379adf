"""Effects on small assemblies, none, one or two at a time, solved by each method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fem import (
    Explicit,
    ExponentialLaw,
    LinearPenalty,
    PairLaws,
    Problem,
    Static,
    concrete,
    solve_explicit,
    solve_static,
)
from geometry import (
    Answer,
    Assembly,
    HeldFace,
    LoadCase,
    PressureLoad,
    convex_polyhedron,
    tube,
)
from geometry.families.boxes import ColumnBox, box_column
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import SineTube
from geometry.loads import TractionLoad
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import Plane, Where
from mbd import Rigid, analyse
from tests.support.blocks import tsb
from validation import Case

X, Y, Z = np.eye(3)
_EDGE = 40.0
_BLOCK = tsb()
_MESH = (12, 1, 2)


@dataclass(frozen=True)
class Stated:
    """A statement that effects change."""

    blocks: AnyBlocks
    faces: Mapping[str, tuple[Where, ...]]
    """Faces of its free blocks, one each, by what may act there."""
    of: Mapping[str, tuple[int, ...]]
    """Blocks of these faces."""
    joints: tuple[tuple[int, int], ...]
    """Pairs of blocks that may have laws of their own."""
    loads: tuple[Any, ...] = ()
    held: tuple[HeldFace, ...] = ()
    problem: Mapping[str, Any] = field(default_factory=dict)
    method: Mapping[str, Any] = field(default_factory=dict)
    checkpoint: bool = False

    def stating(self, **values: Any) -> Stated:
        """With other parts of the problem."""
        return replace(self, problem={**self.problem, **values})

    def solving(self, **values: Any) -> Stated:
        """With other options."""
        return replace(self, method={**self.method, **values})

    def holding(self, at: str, **values: Any) -> Stated:
        """With supports at the faces of a name."""
        more = (HeldFace(b, f, **values) for b, f in zip(self.of[at], self.faces[at], strict=True))
        return replace(self, held=(*self.held, *more))

    def loaded(self, at: str, make: Callable[[Any, Where], Any]) -> Stated:
        """With a load on each of the faces of a name."""
        more = (make(np.array([b]), f) for b, f in zip(self.of[at], self.faces[at], strict=True))
        return replace(self, loads=(*self.loads, *more))

    def case(self, loads: Iterable[Any]) -> LoadCase:
        """Load case with these loads."""
        return LoadCase(self.blocks, "case", tuple(loads), self.blocks.fixed, self.held)

    @property
    def stated(self) -> Problem:
        """The problem."""
        return Problem(self.blocks, self.case(self.loads), concrete, **self.problem)


def column() -> Stated:
    """Two cubes on a fixed one between guides, pressed from above and aside."""
    blocks = box_column([ColumnBox((_EDGE,) * 3, (2, 2, 2))] * 3)
    guides = tuple(HeldFace(b, _side(blocks, b, -n), n[None]) for b in (1, 2) for n in (X, Y))
    places = {"spring": (2, X), "move": (2, Y), "push": (1, X), "live": (1, Y)}
    faces = {name: (_side(blocks, b, axis),) for name, (b, axis) in places.items()}
    of = {name: (b,) for name, (b, _) in places.items()}
    press = TractionLoad(np.array([2]), _side(blocks, 2, Z), np.array([0.05, 0.0, -0.1]))
    return Stated(blocks, faces, of, ((1, 2),), (press,), guides)


def _side(blocks: AnyBlocks, block: int, axis: Any) -> Plane:
    return Plane(blocks.centroids[block] + 0.5 * _EDGE * axis, axis)


def prisms() -> Stated:
    """A triangular prism on a fixed one between guides, which are filled with tetrahedra."""
    ends = [[0.0, 0.0], [_EDGE, 0.0], [0.0, _EDGE]]
    levels = [(k * _EDGE, (k + 1) * _EDGE) for k in range(2)]
    corners = [np.array([[*end, z] for z in level for end in ends]) for level in levels]
    solids = [convex_polyhedron(f"prism {k}", of) for k, of in enumerate(corners)]
    blocks = Assembly.from_blocks(solids, fixed=0)
    guides = tuple(HeldFace(1, Plane(np.zeros(3), -n), n[None]) for n in (X, Y))
    places = {
        "spring": Plane(np.zeros(3), -X),
        "move": Plane(np.zeros(3), -Y),
        "push": Plane(_EDGE * X, np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)),
        "live": Plane(2.0 * _EDGE * Z, Z),
    }
    faces = {name: (place,) for name, place in places.items()}
    press = TractionLoad(np.array([1]), places["live"], np.array([0.05, 0.0, -0.1]))
    of = dict.fromkeys(faces, (1,))
    return Stated(blocks, faces, of, ((0, 1),), (press,), guides, {"size": 200.0})


def _round(blocks: Assembly) -> Stated:
    free = np.flatnonzero((blocks.originals == np.arange(blocks.n_blocks)) & ~blocks.fixed)
    names = {"spring": "outer", "move": "inner", "push": "outer", "live": "inner"}
    faces = {name: (face,) * len(free) for name, face in names.items()}
    of = dict.fromkeys(faces, tuple(free.tolist()))
    found = blocks.interfaces
    pairs = np.unique(np.stack([found.block_m, found.block_s], axis=1), axis=0)
    inside = np.isin(pairs, free).all(axis=1) & np.equal(*blocks.layer[pairs].T)
    joints = tuple((int(m), int(s)) for m, s in pairs[inside])
    outer = PressureLoad(free, "outer", 0.01)
    return Stated(blocks, faces, of, joints, (outer,))


def ring() -> Stated:
    """One layer of a tube under external pressure between rigid rings."""
    return _round(tube(_BLOCK, layers=1, mesh=_MESH))


def cell() -> Stated:
    """Two layers that a long tube repeats, under external pressure."""
    return _round(SineTube(_BLOCK, SineBlockDivisions(*_MESH), 1).cell())


class Stiffening:
    """A contact law of one's own."""

    def pressure(self, overclosure: Any) -> Any:
        x = np.maximum(overclosure, 0.0)
        return 40.0 * x + 2e3 * x**2

    def stiffness(self, overclosure: Any) -> Any:
        x = np.maximum(overclosure, 0.0)
        return (40.0 + 4e3 * x) * (overclosure > 0.0)


def _laws_of_pairs(one: Stated) -> Stated:
    law, stiff = one.problem.get("law", ExponentialLaw()), LinearPenalty(500.0)
    return one.stating(law=PairLaws(law, tuple((m, s, stiff) for m, s in one.joints)))


def _own_law(one: Stated) -> Stated:
    return one.stating(law=Stiffening())


def _stage_before(one: Stated) -> Stated:
    """Twice the loads come first, supports where they are before they move."""
    still = tuple(replace(held, displacement=None) for held in one.held)
    load = replace(one, held=still).case(map(_twice, one.loads))
    return one.stating(after=Problem(one.blocks, load, concrete, **one.problem))


def _twice(load: Any) -> Any:
    name = "pressure" if isinstance(load, PressureLoad) else "traction"
    return replace(load, **{name: 2.0 * getattr(load, name)})


#: Blocks that some effects need.
BLOCKS: dict[str, Callable[[], Stated]] = {
    "tetrahedra": prisms,
    "periodic cell": cell,
    "sector": ring,
}
#: What each changes in a statement, in the order in which they are stated.
EFFECTS: dict[str, Callable[[Stated], Stated]] = {
    "friction": lambda one: one.stating(friction=0.1),
    "finite sliding": lambda one: one.stating(finite_sliding=True),
    "finite rotation": lambda one: one.stating(finite_rotation=True),
    "gap": lambda one: one.stating(spacing=0.002),
    "prestress": lambda one: one.stating(clearance=-0.002),
    "gravity": lambda one: one.stating(gravity=(0.0, 0.0, -9810.0)),
    "live load": lambda one: one.loaded("live", lambda b, f: PressureLoad(b, f, 0.005)),
    "following load": lambda one: one.loaded(
        "live", lambda b, f: PressureLoad(b, f, 0.005, follows_block=True)
    ),
    "moving support": lambda one: one.holding("move", directions=Z[None], displacement=-0.002 * Z),
    "push": lambda one: one.holding(
        "push", directions=Z[None], displacement=-0.002 * Z, name="push"
    ),
    "springs": lambda one: one.holding("spring", spring=2.0),
    "degree > 1": lambda one: one.stating(degree=2),
    "own law": _own_law,
    "laws of pairs": _laws_of_pairs,
    "periodic cell": lambda one: one.solving(symmetry="auto"),
    "sector": lambda one: one.solving(symmetry="sector"),
    "tetrahedra": lambda one: one,
    "checkpoint": lambda one: replace(one, checkpoint=True),
    "stage before": _stage_before,
}
METHODS = ("rigid", "static", "explicit")

#: Share of an effect that is next to none.
NEXT_TO_NONE = 1e-5


def _moving(share: float) -> Callable[[Stated], Stated]:
    return lambda one: one.holding("move", directions=Z[None], displacement=-0.002 * share * Z)


def _pressed(one: Stated, *, follows: bool = False) -> Stated:
    pressure = 0.005 * NEXT_TO_NONE
    return one.loaded("live", lambda b, f: PressureLoad(b, f, pressure, follows_block=follows))


#: Effects near a limit, and what is there at the limit.
LIMITS: dict[str, tuple[Callable[[Stated], Stated], Callable[[Stated], Stated]]] = {
    **{
        name: (change, lambda one: one)
        for name, change in {
            "friction": lambda one: one.stating(friction=0.1 * NEXT_TO_NONE),
            "gap": lambda one: one.stating(spacing=0.002 * NEXT_TO_NONE),
            "prestress": lambda one: one.stating(clearance=-0.006 * NEXT_TO_NONE),
            "gravity": lambda one: one.stating(
                gravity=(0.0, 0.0, -9810.0 * NEXT_TO_NONE), check_units=False
            ),
            "live load": _pressed,
            "following load": lambda one: _pressed(one, follows=True),
            # Much softer ones end above the bound of the residual: rounding of what they hold.
            "springs": lambda one: one.holding("live", spring=20.0 * NEXT_TO_NONE),
        }.items()
    },
    # In an explicit run all of a block is moved within microseconds.
    "moving support": (_moving(1e-4 * NEXT_TO_NONE), _moving(0.0)),
    "stiff springs": (
        lambda one: one.holding("spring", directions=X[None], spring=1e8),
        lambda one: one.holding("spring", directions=X[None]),
    ),
}
_CHANGES = {
    **{f"{name} near its limit": change for name, (change, _) in LIMITS.items()},
    **{f"limit of {name}": limit for name, (_, limit) in LIMITS.items()},
    "equal steps": lambda one: one.solving(time_step=1e-6),
    **EFFECTS,
}


def blocks_of(effects: Iterable[str]) -> str:
    """The effect that says on which blocks some are; empty: on a column."""
    return next((name for name in BLOCKS if name in effects), "")


def stated(effects: frozenset[str], on: str) -> Stated:
    """Statement of some effects on the blocks of one."""
    result = BLOCKS.get(on, column)()
    for name, change in _CHANGES.items():
        if name in effects:
            result = change(result)
    return result


@cache
def numbers(effects: frozenset[str], method: str, on: str) -> dict[str, tuple[str, float]]:
    """Numbers of an answer with their units, and its imbalance, by name."""
    answer = _solved(stated(effects, on), method)
    result = {name: (m.unit, m.value) for name, m in answer.measures.items() if m.is_number}
    for name, acting in answer.report.get("reactions", {}).items():
        result |= {f"reaction of {name} {k}": ("N", f) for k, f in enumerate(acting["force"])}
    pressures = np.asarray(answer.contacts.get("pressure", 0.0))
    result["contact pressures"] = "MPa", float(np.linalg.norm(pressures))
    if method == "rigid":
        for name, part in answer.parts.items():
            result |= {
                f"{name}: {row.title} {row.words}": ("row", 1.0)
                for row in part.rows
                if name != "work"
            }
    else:
        moved = answer.fields["displacement"]
        result["displacements"] = "mm", float(np.linalg.norm(moved)) / np.sqrt(len(moved))
    left = answer.report.get("imbalance", {"force": 0.0, "moment": 0.0})  # nothing is carried
    result["imbalance"] = "-", max(left["force"], left["moment"])
    return result


def _method(one: Stated, method: str) -> Any:
    """How a statement is solved."""
    if method == "rigid":
        return Rigid()
    symmetry: Any = {"symmetry": "none", **one.method}
    if method == "static":
        fast: Any = {"mesh": "scene", "error_estimate": False, "load_steps": 1, "motion_steps": 2}
        return Static(**fast, **symmetry)
    return Explicit(damping="none", ramp_time=5e-5, end_time=1e-4, sample_interval=5, **symmetry)


def check(effects: frozenset[str], method: str, on: str) -> None:
    """Reject what a method does not answer, as `solve` does before it solves."""
    one = stated(effects, on)
    Case(one.stated, _method(one, method)).check()


def _solved(one: Stated, method: str) -> Answer:
    problem, run = one.stated, _method(one, method)
    if method == "rigid":
        return analyse(problem, run)
    if method == "static":
        return solve_static(problem, run)
    if not one.checkpoint:
        return solve_explicit(problem, run)
    with TemporaryDirectory() as folder:
        kept = Path(folder) / "run.npz"
        solve_explicit(problem, replace(run, max_work=1e-12), checkpoint=kept)
        return solve_explicit(problem, run, resume=kept)
