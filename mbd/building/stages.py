"""Whether an assembly stands at each stage of its construction, and what must be propped.

At a stage some blocks are placed; their weight alone acts. Forces of the joints balance it, with
friction or without, or props must help: upward forces at corners of a block's free underside, or
forces along the normals of these faces (a centering). The least propping is the least sum of the
vertical parts of these forces, a cone program beside that of the joints. It is unique; its shares
are not: those printed are in the middle of what is possible.

References: Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block, "Coupled rigid-block analysis",
Computer-Aided Design 146 (2022); Wilson and Latombe, "Geometric reasoning about mechanical
assembly", Artificial Intelligence 71 (1994).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.machine.work import allowance, budget, clock
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.balance import of_fixed_blocks, together
from geometry.parts.block_selection import numbers_of
from geometry.parts.measures import joint_resultants
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, first_of, grouped, number
from mbd.analysis import RigidStatement, Stated, rubbing
from mbd.building.take_out import Removal, WayOut, take_out
from mbd.contact_jacobian import Contacts, contact_jacobian, contact_wrenches
from mbd.equilibrium import column_weights, equilibrium
from mbd.friction import FrictionalContacts, admissible_cones
from mbd.loading import MOST_SECONDS
from mbd.mechanism import Classification, MechanismClass
from mbd.options import Along, Rigid, Stages
from mbd.parts import Question
from mbd.programs import Work, least_conic
from mbd.squeeze import squeeze
from mbd.supports import support_wrenches

if TYPE_CHECKING:
    from geometry.answer import Answer

#: Props below this part of the weight that is placed are none.
NO_PROP = 1e-6
#: Reference seconds of all stages but the last for whether joints are pressed beforehand.
_SQUEEZES = 15.0
#: Stages that are printed at most.
_SHOWN = 24
#: Forces below this part of the weight are printed as none.
_NOTHING = 1e-9
#: Props below this part of the largest one of a stage are not named.
_NAMED = 1e-3
#: Faces whose normal points down by more than this can be propped (cosine).
_DOWN = 0.05
#: Faces of which joints cover more than this part are not free.
_COVERED = 0.99
#: Heights that differ by less than this part of a block's length are one layer.
_LEVEL = 1e-3


class StagesError(RefusedError):
    """An order that cannot be followed; the message names the block."""


class Stands(StrEnum):
    """What becomes of a stage."""

    STANDS = "stands"
    PRESSED = "stands only if pressed (unproved)"
    PROPS = "needs props"
    FALLS = "falls: these props do not hold it"


@dataclass(frozen=True)
class _Order:
    """What is stated, of some blocks."""

    stated: Stages
    blocks: AnyBlocks
    fixed: BoolArray

    def placed(self, tell: Callable[[str], None]) -> list[tuple[int, ...]]:
        """Blocks that each stage places."""
        if self.stated.order == "layers":
            return _layers(self.blocks, self.fixed)
        if self.stated.order == "found":
            out = take_out(self.blocks, tell)
            if out.left:
                raise StagesError(f"stages.order: 'found' finds none: {out.words}; state a list")
            return list(out.assembly_order)
        result: list[tuple[int, ...]] = []
        for one in self.stated.order:
            several = one if isinstance(one, tuple) else (one,)
            stage = [k for each in several for k in self._numbers("order", each)]
            again = [k for k in stage if any(k in other for other in result) or stage.count(k) > 1]
            if again:
                raise StagesError(
                    f"stages.order: got block {self.blocks.named(again[0])} twice; expected each "
                    "once"
                )
            if not stage:
                raise StagesError(
                    "stages.order: got a stage without blocks; expected a block, or a list of them"
                )
            result.append(tuple(stage))
        known = {k for stage in result for k in stage}
        missing = [k for k in np.flatnonzero(~self.fixed).tolist() if k not in known]
        if missing:
            raise StagesError(
                f"stages.order: block {self.blocks.named(missing[0])} is in no stage"
                + (f", nor are {len(missing) - 1} more" if len(missing) > 1 else "")
                + "; expected every free block once"
            )
        return result

    def may_be_propped(self) -> BoolArray:
        """Which blocks may be propped, (n_blocks,)."""
        result = np.full(self.blocks.n_blocks, self.stated.props is None)
        for one in self.stated.props or ():
            result[self._numbers("props", one)] = True
        return result

    def _numbers(self, key: str, one: int | str) -> list[int]:
        names = self.blocks.names or ("",) * self.blocks.n_blocks
        return numbers_of(f"stages.{key}", one, names)


def _layers(blocks: AnyBlocks, fixed: BoolArray) -> list[tuple[int, ...]]:
    """Blocks of each layer, or of each height, the lowest first; a last fixed layer last."""
    if isinstance(blocks, Assembly):
        level = blocks.layer
    else:
        height = blocks.centroids[:, 2]
        order = np.argsort(height, kind="stable")
        step = np.diff(height[order], prepend=height[order[0]])
        level = np.empty(len(order), np.int64)
        level[order] = np.cumsum(step > _LEVEL * blocks.characteristic_length)
    first = level[~fixed].min()
    stages = []
    for one in np.unique(level):
        here = np.flatnonzero(level == one)
        # Fixed blocks among free ones and below them are there before.
        late = here if one > level[~fixed].max() else here[~fixed[here]]
        if one >= first and len(late):
            stages.append(tuple(late.tolist()))
    return stages


@dataclass(frozen=True)
class Stage:
    """One stage: what is placed, whether it stands, and on what."""

    number: int
    """Counted from 1."""
    new: tuple[int, ...]
    """Blocks that it places."""
    there: BoolArray
    """Blocks that are placed, fixed ones included, (n_blocks,)."""
    stands: Stands
    props: FloatArray
    """Least propping: force on each block, (n_blocks, 3) [N]; zeros where none is needed."""
    weight: FloatArray
    """Of the free blocks that are placed, (3,) [N]."""
    thrust: float
    """Largest horizontal thrust of a support or fixed block; nan where nothing holds [N]."""
    largest_force: float
    """Largest normal force between two blocks; nan where nothing holds [N]."""
    residual: float
    """Of the balance with props, over the weight [-]."""
    solve: Callable[[], Answer] = field(repr=False)
    """Solves the stage as a problem of its own."""
    named: Callable[[int], str] = field(repr=False)
    """Name of a block."""
    blocked: tuple[WayOut, ...] = ()
    """Blocks that do not reach their place past those already there."""

    @cached_property
    def answer(self) -> Answer:
        """Rigid answer of what is placed under its weight, without props."""
        return self.solve()

    @property
    def contacts(self) -> Any:
        """`Answer.contacts` of it."""
        return self.answer.contacts

    @property
    def propping(self) -> float:
        """Sum of the vertical parts of the props [N]."""
        return float(self.props[:, 2].sum())

    @cached_property
    def propped(self) -> list[int]:
        """Blocks with a prop, the largest force first."""
        size = np.linalg.norm(self.props, axis=1)
        order = np.argsort(-np.round(size / (size.max(initial=0.0) or 1.0), 9), kind="stable")
        return order[size[order] > _NAMED * size.max(initial=0.0)].tolist()

    @property
    def words(self) -> str:
        """Verdict, and what it takes."""
        words = str(self.stands)
        if self.stands is Stands.PROPS:
            shares = (
                f"{number(float(np.linalg.norm(self.props[k])))} N under block {self.named(k)}"
                for k in self.propped
            )
            words += f": {number(self.propping)} N in all, {first_of(shares, 3)}"
        if not np.isnan(self.largest_force):
            words += f"; thrust {number(self.thrust)} N, largest joint force "
            words += f"{number(self.largest_force)} N"
        for way in self.blocked[:2]:
            others = ", ".join(map(self.named, way.met[:3]))
            who = ", ".join(map(self.named, way.blocks[:3]))
            words += f"; block {who} does not reach its place: {others} in the way"
        return words

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "stage": self.number,
            "blocks": list(self.new),
            "stands": str(self.stands),
            "propping": self.propping,
            "props": {str(k): self.props[k].tolist() for k in self.propped},
            "weight": self.weight.tolist(),
            "thrust": None if np.isnan(self.thrust) else self.thrust,
            "largest_joint_force": None if np.isnan(self.largest_force) else self.largest_force,
            "residual": self.residual,
            "does_not_reach": [way.as_json() for way in self.blocked],
        }


def _number(stage: Stage) -> int:
    return stage.number


@dataclass(frozen=True)
class StageResults(Sequence[Stage]):
    """All stages, counted from 0 as a sequence."""

    stages: tuple[Stage, ...]
    along: Along
    named: Callable[[int], str] = field(repr=False)

    def __len__(self) -> int:
        """Number of stages."""
        return len(self.stages)

    def __getitem__(self, k: Any) -> Any:
        """One stage, or some."""
        return self.stages[k]

    @cached_property
    def until(self) -> dict[int, int]:
        """Last stage at which each block needs its prop, by block."""
        return {k: stage.number for stage in self.stages for k in stage.propped}

    @property
    def words(self) -> str:
        """Whether it can be built in this order, and with which props."""
        falls = [s for s in self.stages if s.stands is Stands.FALLS]
        if falls:
            what = "a centering does" if self.along is Along.NORMAL else "upward props do"
            instead = "" if self.along is Along.NORMAL else '; a centering may (along = "normal")'
            words = f"{what} not hold stage {falls[0].number}"
            return f"{words}{f', nor {len(falls) - 1} more' if len(falls) > 1 else ''}{instead}"
        stuck = [s for s in self.stages if s.blocked]
        words = "can be built in this order"
        if stuck:
            who = self.named(stuck[0].blocked[0].blocks[0])
            words = (
                "stands in this order, but blocks do not reach their places by straight motions: "
                f"block {who} at stage {stuck[0].number}"
            )
        propped = [s for s in self.stages if s.stands is Stands.PROPS]
        if not propped:
            words += "; no stage needs props"
        else:
            first, last = propped[0].number, propped[-1].number
            what = "centering" if self.along is Along.NORMAL else "props"
            at = f"stages {first} to {last}" if last > first else f"stage {first}"
            if 1 < len(propped) < last - first + 1:
                at = f"{len(propped)} of {at}"
            most = max(propped, key=lambda s: float(np.linalg.norm(s.props, axis=1).max()))
            block = most.propped[0]
            force = float(np.linalg.norm(most.props[block]))
            words += (
                f"; {what} needed for {at}, at most {number(force)} N under block "
                f"{self.named(block)}"
            )
            if last < len(self.stages):
                words += f"; it stands without from stage {last + 1} on"
            else:
                words += "; it does not stand without them when it is complete"
        pressed = [s.number for s in self.stages if s.stands is Stands.PRESSED]
        if pressed:
            words += f"; {len(pressed)} stages stand only if pressed (unproved), first {pressed[0]}"
        return words

    @property
    def _shown(self) -> list[Stage]:
        """All stages, of many those at which the verdict changes and the last ones."""
        if len(self.stages) <= _SHOWN:
            return list(self.stages)
        pairs = itertools.pairwise(self.stages)
        turns = [late for early, late in pairs if late.stands is not early.stands]
        chosen = [self.stages[0], *turns[: _SHOWN // 2]]
        return sorted({s.number: s for s in (*chosen, *self.stages[-3:])}.values(), key=_number)

    @property
    def rows(self) -> list[Row]:
        """The verdict, each stage, and until when each prop stays."""
        rows = []
        for stage in self._shown:
            new = first_of(map(self.named, stage.new), 4)
            rows.append(Row(f"stage {stage.number}", f"places {new}: {stage.words}"))
        if len(self._shown) < len(self.stages):
            left = len(self.stages) - len(self._shown)
            rows.append(Row("stages", f"{left} more, in the report"))
        if self.until:
            each = (f"{self.named(k)} until {n}" for k, n in sorted(self.until.items()))
            rows.append(Row("props stay", f"block {first_of(each, 8)}"))
        exact = (
            f"under weight alone, on faces alone; props below {NO_PROP:g} of the weight are "
            "none; their sum is the least, their shares are not unique"
        )
        return grouped(
            verdict=[Row("construction", self.words)],
            measures=rows,
            evidence=[Row("stages", exact)],
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "words": self.words,
            "along": str(self.along),
            "stages": [stage.as_json() for stage in self.stages],
            "props_until": {str(k): n for k, n in self.until.items()},
        }


def judged(
    problem: RigidStatement,
    stated: Stages,
    method: Rigid,
    tell: Callable[[str], None],
    solve: Callable[[RigidStatement, Rigid], Answer],
) -> StageResults:
    """Judge every stage; ``solve`` answers one as a problem of its own.

    ``tell`` is called with what is being found; errors are those of `mbd.stages`.
    """
    build = _Building(problem, stated, method, tell, solve)
    # What presses joints beforehand is sought within the limit of work of all stages together.
    with budget(method.max_work, clock(method.max_seconds)):
        return StageResults(tuple(build.stages()), stated.along, build.blocks.named)


@dataclass
class _Building:
    """One construction."""

    problem: RigidStatement
    stated: Stages
    method: Rigid
    tell: Callable[[str], None]
    solve: Callable[[RigidStatement, Rigid], Answer]
    left: float = _SQUEEZES
    """Reference seconds for what presses joints beforehand."""

    @cached_property
    def blocks(self) -> AnyBlocks:
        """All of them, on the contacts that count."""
        blocks = self.problem.rigid_blocks
        if (blocks.originals != np.arange(blocks.n_blocks)).any():
            raise StagesError("stages: a periodic cell is a part of a tube; expected all of it")
        return blocks if isinstance(blocks, Assembly) else blocks.bearing()  # type: ignore[attr-defined]

    @cached_property
    def fixed(self) -> BoolArray:
        return self.problem.rigid_load.fixed

    @cached_property
    def weight(self) -> FloatArray:
        """Of each block, (n_blocks, 6) [N, N mm]."""
        weight = self.problem.rigid_weight
        if weight is None or not weight.any():
            raise StagesError(
                "stages: no weight acts, and stages are judged under the weight of what is placed; "
                "expected gravity"
            )
        total = weight[:, :3].sum(axis=0)
        if total[2] >= 0.0:
            raise StagesError(
                f"stages: weight acts along ({', '.join(map(number, total))}) N, and props push "
                "along z; expected gravity with a part along -z"
            )
        return weight

    @cached_property
    def search(self) -> Removal:
        return Removal(self.blocks)

    def stages(self) -> Iterable[Stage]:
        """Judge one after the other."""
        _ = self.weight
        stated = _Order(self.stated, self.problem.rigid_blocks, self.fixed)
        order, may = stated.placed(self.tell), stated.may_be_propped()
        late = {k for stage in order for k in stage}
        there = self.fixed & ~np.isin(np.arange(len(self.fixed)), list(late))
        for n, new in enumerate(order, 1):
            self.tell(f"stage {n} of {len(order)}")
            blocked = tuple(self._unreached(new, there))
            there = there.copy()
            there[list(new)] = True
            yield replace(self._stage(n, new, there, may), blocked=blocked)

    def _unreached(self, new: Sequence[int], there: BoolArray) -> Iterable[WayOut]:
        """Blocks that cannot leave again, together or one after the other."""
        present = there.copy()
        present[list(new)] = True
        if not there.any() or self.search.way_out(new, present).free:
            return
        waiting = list(new)
        while waiting and len(new) > 1:
            out = [k for k in waiting if self.search.way_out([k], present).free]
            if not out:
                break
            present[out] = False
            waiting = [k for k in waiting if k not in out]
        for block in waiting:
            yield self.search.way_out([block], present)

    def _stage(self, n: int, new: tuple[int, ...], there: BoolArray, may: BoolArray) -> Stage:
        """Judge what is placed; ways to the places are not looked at."""
        blocks = self.blocks.only(there)
        load = self._weight_of(blocks, there)
        self._check_air(blocks, load, there, may)
        question = self._question(blocks, load)
        balance, props = question.balance, np.zeros((blocks.n_blocks, 6))
        stands, forces = Stands.STANDS, None
        if balance is None and question.smooth.holds:
            normal = question.smooth.forces
            forces = np.column_stack([normal, np.zeros((len(normal), 2))])
        elif balance is not None and balance.holds:
            forces = balance.forces
            stands = self._pressed(question, forces, last=bool(there.all()))
        else:
            forces, props, stands = self._propped(question, there & may)
        weight = load.wrenches[~load.fixed, :3].sum(axis=0)
        thrust = largest = residual = np.nan
        if forces is not None:
            size = float(np.linalg.norm(weight))
            thrust, largest, residual = (
                x if x > _NOTHING * size else 0.0 for x in _held(question, forces, props)
            )
            residual /= size or 1.0

        def solve() -> Answer:
            whole = self.problem.rigid_blocks.only(there)
            alone = replace(load, assembly=whole, body_wrenches=None)
            alone_by = replace(self.method, stages=None, take_out=False)
            return self.solve(Stated(whole, alone, load.wrenches, self.problem.coulomb), alone_by)

        return Stage(
            number=n,
            new=new,
            there=there,
            stands=stands,
            props=props[:, :3],
            weight=weight,
            thrust=thrust,
            largest_force=largest,
            residual=residual,
            solve=solve,
            named=self.blocks.named,
        )

    def _weight_of(self, blocks: AnyBlocks, there: BoolArray) -> LoadCase:
        """Weight of what is placed, and its supports."""
        stated = self.problem.rigid_load
        return replace(
            stated,
            assembly=blocks,
            name="weight",
            faces=(),
            lines=(),
            nodes=(),
            fixed=self.fixed | ~there,
            held=tuple(s for s in stated.held if there[s.block] and not s.is_push),
            body_wrenches=self.weight * there[:, None],
        )

    def _pressed(self, question: Question, forces: FloatArray, *, last: bool) -> Stands:
        """Whether the weight itself presses the joints that need friction.

        Within what is left for all stages; the last one, which is the verdict of the whole, has its
        own limit.
        """
        if question.smooth.holds:
            return Stands.STANDS
        if self.left <= 0.0 and not last:
            return Stands.PRESSED
        before = allowance().work
        found = squeeze(
            question.contacts,
            question.frictional,
            question.all_loads,
            forces,
            weights=question.weights,
            limit=MOST_SECONDS if last else self.left,
        )
        self.left -= before - allowance().work
        return Stands.STANDS if found.needed is False else Stands.PRESSED

    def _question(self, blocks: AnyBlocks, load: LoadCase) -> Question:
        coulomb, method, weight = rubbing(self.problem.coulomb), self.method, load.wrenches
        contacts = contact_jacobian(blocks, load.fixed, load.held)
        smooth = equilibrium(
            contacts.jacobian,
            contacts.rows(weight),
            solver=method.solver,
            weights=column_weights(method.norm, contacts.areas),
        )
        return Question(
            blocks=blocks,
            load=load,
            wrenches=(weight, np.zeros_like(weight)),
            method=method,
            friction=None if coulomb is None else coulomb.coefficient,
            of_pairs=() if coulomb is None else coulomb.of_pairs,
            smooth=smooth,
            frictionless=Classification(MechanismClass.UNDECIDED, None),
            tell=lambda _: None,
        )

    def _check_air(
        self, blocks: AnyBlocks, load: LoadCase, there: BoolArray, may: BoolArray
    ) -> None:
        """Reject blocks that nothing holds and nothing may prop."""
        found, n = blocks.interfaces, blocks.n_blocks
        graph = sp.coo_array((np.ones(len(found.block_m)), (found.block_m, found.block_s)), (n, n))
        _, of = connected_components(graph.tocsr(), directed=False)
        held = there & (self.fixed | may)
        held[[support.block for support in load.held]] = True
        alone = there & ~np.isin(of, of[held])
        if alone.any():
            block = int(np.argmax(alone))
            raise StagesError(
                f"stages: block {self.blocks.named(block)} is placed where it touches nothing that "
                "is held, and it may not be propped; place its neighbours before it, or name it "
                "among the props"
            )

    def _unit_props(
        self, blocks: AnyBlocks, may: BoolArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Block, direction (n, 3) and wrench about the block's centroid (n, 6) of each prop."""
        covered = self._covered(blocks)
        sweeps, owner, ways, wrenches = self.search.sweeps, [], [], []
        for block in np.flatnonzero(may & ~self.fixed).tolist():
            shape = sweeps.shapes[int(blocks.shape_of[block])]
            normals = shape.plane_normals @ blocks.rotations[block].T
            share = covered.get(block, np.zeros(len(normals))) / shape.plane_areas
            planes = np.flatnonzero((normals[:, 2] < -_DOWN) & (share < _COVERED))
            rows = np.concatenate(
                [
                    np.column_stack([np.unique(shape.triangles[shape.plane_of == p]), [p] * k])
                    for p in planes.tolist()
                    if (k := len(np.unique(shape.triangles[shape.plane_of == p])))
                ]
                or [np.zeros((0, 2), np.int64)]
            )
            if self.stated.along is Along.UP:
                corners = np.unique(rows[:, 0])
                along = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
            else:
                corners, along = rows[:, 0], -normals[rows[:, 1]]
            arm = sweeps.points[block][corners] - blocks.centroids[block]
            owner += [block] * len(corners)
            ways.append(along)
            wrenches.append(np.hstack([along, np.cross(arm, along)]))
        none = np.zeros((0, 3))
        return (
            np.array(owner, np.int64),
            np.concatenate([none, *ways]),
            np.concatenate([np.zeros((0, 6)), *wrenches]),
        )

    def _covered(self, blocks: AnyBlocks) -> dict[int, FloatArray]:
        """Area of the joints on each plane of the blocks that touch others, by block."""
        found, sweeps = blocks.interfaces, self.search.sweeps
        result: dict[int, FloatArray] = {}
        for own, sign in ((found.block_m, 1.0), (found.block_s, -1.0)):
            for block in np.unique(own).tolist():
                shape = sweeps.shapes[int(blocks.shape_of[block])]
                normals = shape.plane_normals @ blocks.rotations[block].T
                at = np.flatnonzero(own == block)
                first = np.zeros(len(normals), np.int64)
                first[shape.plane_of[::-1]] = np.arange(len(shape.plane_of))[::-1]
                base = sweeps.points[block][shape.triangles[first, 0]]
                away = np.einsum("cpi,pi->cp", found.centroids[at][:, None] - base, normals)
                turned = 1.0 - (sign * found.normals[at]) @ normals.T
                plane = (np.abs(away) / blocks.characteristic_length + turned).argmin(axis=1)
                area = np.bincount(plane, found.areas[at], len(normals))
                result[block] = result.get(block, 0.0) + area
        return result

    def _propped(
        self, question: Question, may: BoolArray
    ) -> tuple[FloatArray | None, FloatArray, Stands]:
        """Forces of the joints, props about mass centroids (n_blocks, 6), and the verdict."""
        blocks, contacts, load = question.blocks, question.contacts, question.all_loads
        props = np.zeros((blocks.n_blocks, 6))
        owner, along, wrenches = self._unit_props(blocks, may)
        if not len(owner):
            return None, props, Stands.FALLS
        columns = _columns(contacts, owner, wrenches)
        found = _least_propping(question.frictional, columns, along[:, 2], load)
        if found is None:
            return None, props, Stands.FALLS
        forces, sizes = found
        np.add.at(props, owner, sizes[:, None] * wrenches)
        weight = question.load.wrenches[:, :3].sum(axis=0)
        needed = props[:, 2].sum() > NO_PROP * np.linalg.norm(weight)
        return forces, props, Stands.PROPS if needed else Stands.STANDS


def _columns(contacts: Contacts, owner: IntArray, wrenches: FloatArray) -> sp.csc_array:
    """Wrenches (n, 6) of unit props in the rows of the free blocks, (n_rows, n)."""
    number_of = np.full(int(contacts.free_blocks.max()) + 1, -1)
    number_of[contacts.free_blocks] = np.arange(len(contacts.free_blocks))
    scaled = wrenches * np.repeat([1.0, 1.0 / contacts.length], 3)
    rows = 6 * number_of[owner][:, None] + np.arange(6)
    columns = np.repeat(np.arange(len(owner)), 6)
    shape = 6 * len(contacts.free_blocks), len(owner)
    result = sp.coo_array((scaled.ravel(), (rows.ravel(), columns)), shape).tocsc()
    motions = contacts.jacobian.motions
    if motions is not None:
        result = sp.block_diag([sp.csc_array(each) for each in motions], format="csc") @ result
    return result


def _least_propping(
    frictional: FrictionalContacts, props: sp.csc_array, cost: FloatArray, load: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Forces of the joints (n_contacts, 3) and props (n,) of least cost; None: nothing balances."""
    import clarabel

    n, k, size = 3 * frictional.n_contacts, len(cost), float(np.linalg.norm(load))
    rows, cones = admissible_cones(frictional)
    solution = least_conic(
        quadratic=sp.csc_array((n + k, n + k)),
        cost=np.concatenate([np.zeros(n), cost]),
        equal=sp.hstack([frictional.matrix, props]),
        target=-load / size,
        rows=sp.block_diag([rows, sp.eye_array(k)]) if n else sp.eye_array(k),
        cones=[*cones, clarabel.NonnegativeConeT(k)],
        work=Work(),
    )
    x = np.asarray(solution.x)
    if not np.isfinite(x).all():
        return None
    forces, sizes = frictional.projected(x[:n].reshape(-1, 3)), np.maximum(x[n:], 0.0)
    left = frictional.matrix @ forces.ravel() + props @ sizes + load / size
    if np.linalg.norm(left) > NO_PROP:
        return None
    return size * forces, size * sizes


def _held(question: Question, forces: FloatArray, props: FloatArray) -> tuple[float, float, float]:
    """Largest thrust of a support, largest normal force of a joint, imbalance [N]."""
    blocks, load, contacts = question.blocks, question.load, question.contacts
    result, index = blocks.interfaces, contacts.index
    world = question.frictional.world(forces, result.normals[index])
    joints = joint_resultants(result, index, world, None)
    acting = load.wrenches + props
    held, taken = support_wrenches(blocks, load, acting + contact_wrenches(blocks, index, world))
    fixed = of_fixed_blocks(blocks, joints, np.flatnonzero(load.fixed), taken)
    rest = question.frictional.matrix @ forces.ravel() + contacts.rows(acting)
    return (
        float(together(held, fixed).thrusts.max(initial=0.0)),
        float(joints.normal_force.max(initial=0.0)),
        float(np.linalg.norm(rest)),
    )
