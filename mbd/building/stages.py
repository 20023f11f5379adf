"""Whether an assembly stands at each stage of its construction, and what must be propped.

At a stage some blocks are placed; their weight alone acts. Forces of the joints balance it, with
friction or without, or props must help: upward forces at corners of a block's free underside, or
forces along the normals of these faces (a centering). The least propping is the least sum of the
vertical parts of these forces (`mbd.building.propping`).

References: Kao, Iannuzzo, Thomaszewski, Coros, Van Mele, Block, "Coupled rigid-block analysis",
Computer-Aided Design 146 (2022); Wilson and Latombe, "Geometric reasoning about mechanical
assembly", Artificial Intelligence 71 (1994).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geometry.assembly import Assembly
from geometry.loads import LoadCase
from geometry.machine.work import allowance, budget, clock
from geometry.mesh import BoolArray, FloatArray, connected_parts
from geometry.parts.measures import joint_resultants
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import Row, finite, first_of, grouped, number
from mbd.building.order import Order, StagesError
from mbd.building.propping import NO_PROP, least_propping
from mbd.building.take_out import Removal, WayOut
from mbd.loading import MOST_SECONDS
from mbd.options import Along, Rigid, Stages
from mbd.system import RigidStatement, RigidSystem, Stated

if TYPE_CHECKING:
    from geometry.answer import Answer
    from mbd.results.rows import DrivenMotion

#: Reference seconds of all stages but the last for whether joints are pressed beforehand.
_SQUEEZES = 15.0
#: Stages that are printed at most.
_SHOWN = 24
#: Forces below this part of the weight are printed as none.
_NOTHING = 1e-9
#: Props above this part of the largest one of all stages are as large.
_SAME = 0.9999
#: Props below this part of the largest one of a stage are not named.
_NAMED = 1e-3


class Stands(StrEnum):
    """What becomes of a stage."""

    STANDS = "stands"
    PRESSED = "stands only if pressed (unproved)"
    PROPS = "needs props"
    FALLS = "falls: these props do not hold it"


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
    sought: float
    """Reference seconds spent on whether joints are pressed beforehand."""
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
    def moves(self) -> DrivenMotion | None:
        """Blocks that move most without props; None where none does."""
        return cast("DrivenMotion | None", self.answer.parts.get("motion"))

    @property
    def propping(self) -> float:
        """Sum of the vertical parts of the props [N]."""
        return float(self.props[:, 2].sum())

    @cached_property
    def propped(self) -> list[int]:
        """Blocks with a prop, the largest force first."""
        size = np.linalg.norm(self.props, axis=1)
        order = np.argsort(-np.round(size / (size.max(initial=0.0) or 1.0), 4), kind="stable")
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
        if self.stands is Stands.FALLS and (motion := self.moves) is not None:
            words += f"; {motion.first}"
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
            "props": {
                str(k): self.props[k].tolist() for k in np.flatnonzero(self.props.any(axis=1))
            },
            "weight": self.weight.tolist(),
            "thrust": finite(self.thrust),
            "largest_joint_force": finite(self.largest_force),
            "residual": finite(self.residual),
            "sought": self.sought,
            "does_not_reach": [way.as_json() for way in self.blocked],
        }


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

    @property
    def table(self) -> dict[str, list[Any]]:
        """Columns by name and unit, a row each stage: ``pandas.DataFrame(stages.table)``."""
        sizes = [np.linalg.norm(stage.props, axis=1) for stage in self.stages]
        return {
            "stage": [stage.number for stage in self.stages],
            "places": [", ".join(map(self.named, stage.new)) for stage in self.stages],
            "verdict": [str(stage.stands) for stage in self.stages],
            "weight_N": [float(np.linalg.norm(stage.weight)) for stage in self.stages],
            "propping_N": [stage.propping for stage in self.stages],
            "largest_prop_N": [float(size.max()) for size in sizes],
            "propped": [", ".join(map(self.named, stage.propped)) for stage in self.stages],
            "thrust_N": [stage.thrust for stage in self.stages],
            "largest_joint_force_N": [stage.largest_force for stage in self.stages],
        }

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
            largest = [float(np.linalg.norm(s.props[s.propped[0]])) for s in propped]
            force = max(largest)
            block = next(
                s.propped[0] for s, f in zip(propped, largest, strict=True) if f > _SAME * force
            )
            words += (
                f"; {what} needed for {at}, at most {number(force)} N under block "
                f"{self.named(block)}"
            )
            if last < len(self.stages):
                words += f"; it stands without from stage {last + 1} on"
            else:
                words += "; it does not stand without them when it is complete"
        pressed = [s.number for s in self.stages if s.stands is Stands.PRESSED]
        if len(pressed) == 1:
            words += f"; stage {pressed[0]} stands only if pressed (unproved)"
        elif pressed:
            words += f"; {len(pressed)} stages stand only if pressed (unproved), first {pressed[0]}"
        return words

    def shown(self, most: int) -> list[Stage]:
        """So many stages: first and last, those at which the verdict changes, others between."""
        last, verdicts = len(self.stages) - 1, [stage.stands for stage in self.stages]
        turns = [k for k in range(1, last + 1) if verdicts[k] is not verdicts[k - 1]]
        picked = {0, last, *turns[: most // 2], *(k - 1 for k in turns[:1])}
        for k in np.linspace(0, last, most).round().astype(int).tolist():
            if len(picked) < most:
                picked.add(k)
        return [self.stages[k] for k in sorted(picked)]

    @property
    def rows(self) -> list[Row]:
        """The verdict, each stage, and until when each prop stays."""
        rows = []
        shown = self.shown(_SHOWN)
        for stage in shown:
            new = first_of(map(self.named, stage.new), 4)
            words = f"places {new}: {stage.words}"
            rows.append(Row(f"stage {stage.number}", words, stage.propping, "N"))
        if left := len(self.stages) - len(shown):
            rows.append(Row("stages", f"{left} more, in the report"))
        if self.until:
            each = (f"{self.named(k)} until {n}" for k, n in sorted(self.until.items()))
            rows.append(Row("props stay", f"block {first_of(each, 8)}"))
        exact = (
            f"under weight alone, on faces alone; props below {NO_PROP:g} of the weight are "
            "none; their sum is the least, and of all shares that have it those of least squares"
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
            "units": {"force": "N", "sought": "s"},
            "stages": [stage.as_json() for stage in self.stages],
            "props_until": {str(k): n for k, n in self.until.items()},
        }


@dataclass
class Construction:
    """One construction, judged stage by stage."""

    problem: RigidStatement
    stated: Stages
    method: Rigid
    tell: Callable[[str], None]
    """Called with what is being found."""
    solve: Callable[[RigidStatement, Rigid], Answer]
    """Answers one stage as a problem of its own."""

    def check(self) -> None:
        """Reject an order and props that are stated wrongly; an order to be found is not sought."""
        _ = self.blocks, self.weight, self._may
        if self.stated.order != "found":
            _ = self.order

    def judged(self) -> StageResults:
        """Judge all stages; errors are those of `mbd.stages`."""
        stages = list[Stage]()
        with budget(ends=clock(self.method.max_seconds)):
            for n in range(1, len(self.order) + 1):
                self.tell(f"stage {n} of {len(self.order)}")
                stages.append(self.stage(n, sum(stage.sought for stage in stages)))
        return self.results(stages)

    def results(self, stages: Iterable[Stage]) -> StageResults:
        """All stages together."""
        return StageResults(tuple(stages), self.stated.along, self.blocks.named)

    @cached_property
    def blocks(self) -> AnyBlocks:
        """All of them, on the contacts that count."""
        blocks = self.problem.rigid_blocks
        if (blocks.originals != np.arange(blocks.n_blocks)).any():
            raise StagesError("stages: a periodic cell is a part of a tube; expected all of it")
        return blocks if isinstance(blocks, Assembly) else blocks.bearing()  # type: ignore[attr-defined]

    @cached_property
    def fixed(self) -> BoolArray:
        """Which blocks are held, (n_blocks,)."""
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
        """Ways to the places of the blocks."""
        return Removal(self.blocks)

    @cached_property
    def order(self) -> list[tuple[int, ...]]:
        """Blocks that each stage places, none of them in the air."""
        _ = self.weight, self._may
        order, there = self._order.placed(self.tell), np.ones(len(self.fixed), np.bool_)
        there[[k for stage in order for k in stage]] = False
        for stage in order:
            there[list(stage)] = True
            self._check_air(there)
        return order

    @cached_property
    def _may(self) -> BoolArray:
        """Which blocks may be propped, (n_blocks,)."""
        return self._order.may_be_propped()

    @cached_property
    def _order(self) -> Order:
        return Order(self.stated, self.problem.rigid_blocks, self.fixed)

    def _there(self, n: int) -> BoolArray:
        """What is placed after so many stages, (n_blocks,)."""
        there = np.ones(len(self.fixed), np.bool_)
        there[[k for stage in self.order[n:] for k in stage]] = False
        return there

    def stage(self, n: int, sought: float) -> Stage:
        """Judge a stage, counted from 1.

        ``sought`` is what those before spent on whether joints are pressed beforehand [s].
        """
        with budget(self.method.max_work):
            found = self._found(self._there(n), min(_SQUEEZES, self.method.max_work) - sought)
        blocked = tuple(self._unreached(self.order[n - 1], self._there(n - 1)))
        return self._made(n, **found, blocked=blocked)

    def restored(self, row: Mapping[str, Any]) -> Stage:
        """Make a stage of its plain data."""
        props = np.zeros((len(self.fixed), 3))
        for block, force in row["props"].items():
            props[int(block)] = force
        ways = [(way, way["direction"]) for way in row["does_not_reach"]]
        names = ("thrust", "largest_joint_force", "residual")
        thrust, largest, residual = (np.nan if row[k] is None else row[k] for k in names)
        return self._made(
            row["stage"],
            stands=Stands(row["stands"]),
            props=props,
            thrust=thrust,
            largest_force=largest,
            residual=residual,
            sought=row["sought"],
            blocked=tuple(
                WayOut(
                    blocks=tuple(way["blocks"]),
                    direction=None if along is None else np.array(along),
                    distance=way["distance"],
                    clear_after=np.nan,
                    met=tuple(way["met"]),
                )
                for way, along in ways
            ),
        )

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

    def _found(self, there: BoolArray, left: float) -> dict[str, Any]:
        """Judge what is placed; ways to the places are not looked at.

        ``left``: reference seconds for whether joints are pressed beforehand.
        """
        blocks = self.blocks.only(there)
        load = self._weight_of(blocks, there)
        system = RigidSystem(Stated(blocks, load, None, self.problem.coulomb), self.method)
        balance, props = system.balance, np.zeros((blocks.n_blocks, 6))
        stands, forces, sought = Stands.STANDS, None, 0.0
        size = float(np.linalg.norm(load.wrenches[~load.fixed, :3].sum(axis=0)))
        if balance is None and system.equilibrium.holds:
            forces = system.equilibrium.with_tangents.forces
        elif balance is not None and balance.holds:
            forces, before = balance.forces, allowance().work
            # The last stage, which is the verdict of the whole, has its own limit.
            left = MOST_SECONDS if there.all() else left
            stands = self._pressed(system, forces, left)
            sought = before - allowance().work
        else:
            may = there & self._may & ~self.fixed
            propped = least_propping(system, self.search.sweeps, may, self.stated.along)
            stands = Stands.FALLS
            if propped is not None:
                forces, props = propped
                needed = props[:, 2].sum() > NO_PROP * size
                stands = Stands.PROPS if needed else Stands.STANDS
        thrust = largest = residual = np.nan
        if forces is not None:
            thrust, largest, residual = (
                x if x > _NOTHING * size else 0.0 for x in _held(system, forces, props)
            )
            residual /= size or 1.0
        return {
            "stands": stands,
            "props": props[:, :3],
            "thrust": thrust,
            "largest_force": largest,
            "residual": residual,
            "sought": sought,
        }

    def _made(self, n: int, **found: Any) -> Stage:
        """Stage of what was found of it."""
        there = self._there(n)

        def solve() -> Answer:
            whole = self.problem.rigid_blocks.only(there)
            load = replace(self._weight_of(whole, there), body_wrenches=None)
            by = replace(self.method, stages=None, take_out=False)
            weight = self.weight * there[:, None]
            return self.solve(Stated(whole, load, weight, self.problem.coulomb), by)

        weight = self.weight[there & ~self.fixed, :3].sum(axis=0)
        return Stage(
            number=n,
            new=self.order[n - 1],
            there=there,
            weight=weight,
            solve=solve,
            named=self.blocks.named,
            **found,
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

    @staticmethod
    def _pressed(system: RigidSystem, forces: FloatArray, left: float) -> Stands:
        """Whether the weight itself presses the joints that need friction, within what is left."""
        if left <= 0.0 and not system.equilibrium.holds:
            return Stands.PRESSED
        pressed = system.squeeze(forces, left)
        return Stands.STANDS if pressed.needed is False else Stands.PRESSED

    def _check_air(self, there: BoolArray) -> None:
        """Reject blocks that nothing holds and nothing may prop."""
        found, n = self.blocks.interfaces, len(there)
        touch = there[found.block_m] & there[found.block_s]
        of = connected_parts(n, found.block_m[touch], found.block_s[touch])
        held = self.fixed | self._may
        held[[s.block for s in self.problem.rigid_load.held if not s.is_push]] = True
        held &= there
        alone = there & ~np.isin(of, of[held])
        if alone.any():
            block = int(np.argmax(alone))
            raise StagesError(
                f"stages: block {self.blocks.named(block)} is placed where it touches nothing that "
                "is held, and it may not be propped; place its neighbours before it, or name it "
                "among the props"
            )


def _held(system: RigidSystem, forces: FloatArray, props: FloatArray) -> tuple[float, float, float]:
    """Largest thrust of a support, largest normal force of a joint, imbalance [N]."""
    world, acting = system.on_s(forces), system.load.wrenches + props
    joints = joint_resultants(system.blocks.interfaces, system.contact_index, world)
    held, _ = system.held_by(joints, acting)
    rest = system.frictional.matrix @ forces.ravel() + system.contacts.rows(acting)
    return (
        float(held.thrusts.max(initial=0.0)),
        float(joints.normal_force.max(initial=0.0)),
        float(np.linalg.norm(rest)),
    )
