"""A problem as a program takes it, and the names that its deck gives to blocks and what they have.

`fem.decks.problem` makes it, `fem.decks.abaqus` and `fem.decks.calculix` turn it into text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import accumulate

import numpy as np

from fem.contact.law import LinearPenalty, counted_stiffness
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import label, safe_names
from fem.element.hexahedron import ELEMENTS
from fem.element.material import Material
from fem.method import Explicit, Static
from fem.problem import Problem, before_motion
from fem.system.effects import Effects
from fem.system.time_step import characteristic_time_step
from geometry.assembly import Assembly, spacing_offsets
from geometry.mesh import FloatArray, IntArray


class Flavour(StrEnum):
    """For which program a deck is written."""

    GENERAL = "general"
    """Abaqus/Explicit: parts, instances, general contact."""
    STANDARD = "standard"
    """Abaqus/Standard: static, parts, instances, one contact pair for each joint."""
    CALCULIX = "calculix"
    """CalculiX: flat, what its input has no word for written otherwise."""


# Names that the parts of a deck refer to each other by.
ALL = "ALL"
CONTACT = "CONTACT"
MATERIAL = "BLOCK-MATERIAL"
JOINT = "JOINT"
GAP = "GAP"
LOADING = "LOADING"
CYLINDRICAL = "TUBE-AXIS"
FRAME = "FRAME"
TUBE = "TUBE"
HOURGLASS = "HOURGLASS"
EVERY_NODE = "NALL"
EVERY_ELEMENT = "EALL"

#: Names of sets of several blocks, which no block has.
_RESERVED = ("all", "eall", "nall", "frame", "tube")
#: Length of a static step [s], the unit of its amplitudes.
_STATIC_TIME = 1.0
#: Increments above which Abaqus recommends to keep all numbers in double precision.
_SINGLE_PRECISION = 3.0e5


@dataclass(frozen=True)
class Deck:
    """A problem for a program, on blocks, names and elements that it has."""

    name: str
    """Of the scene."""
    flavour: Flavour
    """For which program."""
    problem: Problem
    """On blocks whose rotations survive writing, of one material for each shape."""
    method: Static | Explicit
    """How the program solves it: a static step, or an explicit one with its end and ramp."""
    notes: tuple[str, ...] = ()
    """Where the deck differs from the problem, one line each."""

    # -----------------------------------------------------------------------------------------
    # Steps

    @cached_property
    def stages(self) -> tuple[Problem, ...]:
        """Problem of each step; where friction remembers which comes first, loads before motions.

        Each is on the same blocks.
        """
        stages = self.problem.stages
        earlier = None
        if self.in_time is None and self.problem.coulomb is not None:
            earlier = before_motion(stages[0], loaded=True)
        return stages if earlier is None else (earlier, *stages)

    @property
    def in_time(self) -> Explicit | None:
        """Method of an explicit step; None: the steps are static."""
        return self.method if isinstance(self.method, Explicit) else None

    @property
    def effects(self) -> Effects:
        """Damping, bulk viscosity and gravity; of static steps gravity alone."""
        gravity, moves = self.problem.acceleration, self.problem.motion is not None
        if self.in_time is None:
            return Effects(gravity=gravity)
        return self.in_time.effects(moves=moves, gravity=gravity)

    @property
    def end_time(self) -> float:
        """Length of a step [s]; of a static one only the unit of its amplitudes."""
        return _STATIC_TIME if self.in_time is None else self.in_time.end_time or 0.0

    @property
    def ramp_time(self) -> float:
        """Smooth step of the loads [s]; 0: at once."""
        return _STATIC_TIME if self.in_time is None else self.in_time.ramp_time or 0.0

    @property
    def program(self) -> str:
        """Program that runs it."""
        if self.is_flat:
            return "CalculiX"
        return "Abaqus/Standard" if self.in_time is None else "Abaqus/Explicit"

    def element_time_step(self) -> float:
        """Least time step of an element as Abaqus/Explicit estimates it, without contact [s]."""
        viscosity = self.effects.bulk_viscosity
        linear = 0.0 if viscosity is None else viscosity.linear_bulk_viscosity
        return min(
            characteristic_time_step(
                self.assembly.shapes[k].mesh, self.materials[k], linear_bulk_viscosity=linear
            )
            for k in np.unique(self.assembly.shape_of).tolist()
        )

    @cached_property
    def increments(self) -> tuple[float, float] | None:
        """Number of increments of an explicit step and their length [s]; None: of a static one."""
        run = self.in_time
        if run is None:
            return None
        increment = run.time_step or run.safety_factor * self.element_time_step()
        return self.end_time / increment, increment

    @property
    def needs_double(self) -> bool:
        """Whether an explicit step has so many increments that single precision loses digits."""
        counted = self.increments
        return not self.is_flat and counted is not None and counted[0] > _SINGLE_PRECISION

    # -----------------------------------------------------------------------------------------
    # Contact

    @property
    def stick(self) -> float:
        """Stiffness of points that stick, as our own run of the method has it [MPa/mm]."""
        friction, law = self.problem.coulomb, self.problem.contact_law
        assert friction is not None
        deforming = np.unique(self.assembly.shape_of[self.problem.deforming]).tolist()
        modulus = max(self.materials[shape].young_modulus for shape in deforming)
        most = math.inf if self.in_time is None else counted_stiffness(law)
        return friction.stick(modulus, self.assembly.characteristic_length, most)

    @cached_property
    def searched(self) -> bool:
        """Whether facets of blocks that may meet do not match: whole faces meet."""
        problem, fixed = self.problem, self.problem.load_case.fixed
        moving = (not (fixed[one.block_m] and fixed[one.block_s]) for one in problem.unmatched)
        return any(moving) or (problem.searches and not self.assembly.interfaces.n_contacts)

    @cached_property
    def meets(self) -> bool:
        """Whether blocks of which one deforms meet."""
        joints, deforms = self.assembly.interfaces, self.problem.deforming
        return self.problem.searches or bool(
            (deforms[joints.block_m] | deforms[joints.block_s]).any()
        )

    @property
    def stays_paired(self) -> bool:
        """Whether facets that match press on each other without friction, and slide little."""
        slides = self.problem.finite_sliding or self.searched
        return self.meets and not slides and self.problem.coulomb is None

    @property
    def on_faces(self) -> bool:
        """Whether CalculiX can press on faces: laws that are linear, without a clearance."""
        linear = all(isinstance(law, LinearPenalty) for law in self.problem.contact_law.members)
        return linear and self.problem.clearance == 0.0

    @property
    def has_pairs(self) -> bool:
        """Whether pairs of blocks have friction or a law of their own."""
        friction, law = self.problem.coulomb, self.problem.contact_law
        return len(law.members) > 1 or (friction is not None and bool(friction.of_pairs))

    @cached_property
    def interactions(self) -> dict[tuple[int, float | None], str]:
        """Names of surface interactions, by place in `ContactLaw.members` and coefficient."""
        friction, law = self.problem.coulomb, self.problem.contact_law
        named = [] if friction is None else [pair[:2] for pair in friction.of_pairs]
        named += [pair[:2] for pair in law.of_pairs] if isinstance(law, PairLaws) else []
        default = 0, None if friction is None else friction.coefficient or None
        values = dict.fromkeys([default, *(self._between(*pair) for pair in named)])
        return {value: f"{JOINT}-{k}" if k else JOINT for k, value in enumerate(values)}

    def _between(self, block_m: int, block_s: int) -> tuple[int, float | None]:
        friction, law = self.problem.coulomb, self.problem.contact_law
        own = law.members.index(law.on(np.array([block_m]), np.array([block_s])))
        if friction is None:
            return own, None
        of_pairs = {frozenset(pair[:2]): pair[2] for pair in friction.of_pairs}
        return own, of_pairs.get(frozenset((block_m, block_s)), friction.coefficient) or None

    def interaction(self, block_m: int, block_s: int) -> str:
        """Name of the surface interaction of two blocks."""
        return self.interactions[self._between(block_m, block_s)]

    # -----------------------------------------------------------------------------------------
    # Blocks and materials

    @property
    def is_flat(self) -> bool:
        """Whether nodes and elements are numbered through all blocks, without instances."""
        return self.flavour is Flavour.CALCULIX

    @property
    def assembly(self) -> Assembly:
        """Blocks in their conforming places."""
        assembly: Assembly = self.problem.blocks
        return assembly

    @cached_property
    def offsets(self) -> FloatArray:
        """Translation of each block from its conforming place, (n_blocks, 3) [mm]."""
        return spacing_offsets(self.assembly, self.problem.spacing)

    def nodes(self, block: int) -> FloatArray:
        """World coordinates of a block's nodes, spacing included, (n_nodes, 3) [mm]."""
        nodes: FloatArray = self.assembly.nodes(block) + self.offsets[block]
        return nodes

    @cached_property
    def sets(self) -> dict[str, IntArray]:
        """Blocks of the sets FRAME, the fixed ones, and TUBE, all others; none is empty."""
        fixed = self.assembly.fixed
        sets = {FRAME: np.flatnonzero(fixed), TUBE: np.flatnonzero(~fixed)}
        return {name: blocks for name, blocks in sets.items() if len(blocks)}

    @property
    def elements(self) -> dict[str, str]:
        """The program's names of the hexahedra that it has, by ours."""
        names = ((e, of.calculix if self.is_flat else of.abaqus) for e, of in ELEMENTS.items())
        return {element.value: name for element, name in names if name}

    @property
    def element(self) -> str:
        """Name of the elements."""
        return self.elements[self.problem.element.value]

    @cached_property
    def materials(self) -> tuple[Material, ...]:
        """Of each shape, (n_shapes,)."""
        _, first = np.unique(self.assembly.shape_of, return_index=True)
        return tuple(self.problem.materials[block] for block in first.tolist())

    @property
    def material_names(self) -> dict[Material, str]:
        """Distinct materials and what the deck calls them."""
        distinct = tuple(dict.fromkeys(self.materials))
        if len(distinct) == 1:
            return {distinct[0]: MATERIAL}
        return {material: f"{MATERIAL}-{k}" for k, material in enumerate(distinct, start=1)}

    # -----------------------------------------------------------------------------------------
    # Names

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each block, (n_blocks,): its own, else such as L01-B03 and FRAME-TOP-B01."""
        assembly = self.assembly
        if assembly.names:
            known = safe_names((*_RESERVED, *assembly.names))[len(_RESERVED) :]
            return tuple(name.upper() for name in known)
        result = [""] * assembly.n_blocks
        for layer in np.unique(assembly.layer).tolist():
            blocks = np.flatnonzero(assembly.layer == layer)
            for fixed in (True, False):
                mine = blocks[assembly.fixed[blocks] == fixed].tolist()
                title = _frame_title(assembly, layer) if fixed else f"L{layer:02d}"
                for position, block in enumerate(mine, start=1):
                    alone = title.startswith(f"{FRAME}-") and len(mine) == 1
                    result[block] = title if alone else f"{title}-B{position:02d}"
        return tuple(result)

    def of_block(self, block: int, name: str) -> str:
        """What the deck calls a set or surface of a block."""
        return f"{self.labels[block]}{'_' if self.is_flat else '.'}{name}"

    def face(self, block: int, face: str) -> str:
        """What the deck calls the surface of a face of a block."""
        return self.of_block(block, label(face))

    def node(self, block: int, node: int) -> str:
        """What the deck calls a node of a block."""
        if self.is_flat:
            return str(self.first_node[block] + node + 1)
        return f"{self.labels[block]}.{node + 1}"

    @cached_property
    def first_node(self) -> list[int]:
        """First node of each block in flat numbering, from 0, and their number, (n_blocks + 1,)."""
        return self._starts([shape.mesh.n_nodes for shape in self.assembly.shapes])

    @cached_property
    def first_element(self) -> list[int]:
        """The same of elements."""
        return self._starts([shape.mesh.n_elements for shape in self.assembly.shapes])

    def _starts(self, counts: list[int]) -> list[int]:
        return [0, *accumulate(counts[shape] for shape in self.assembly.shape_of.tolist())]


def _frame_title(assembly: Assembly, layer: int) -> str:
    """Name of the fixed blocks of a layer: of several layers the first is below, the last above."""
    layers = np.unique(assembly.layer[assembly.fixed]).tolist()
    if len(layers) < 2:
        return FRAME
    ends = {layers[0]: f"{FRAME}-BOTTOM", layers[-1]: f"{FRAME}-TOP"}
    return ends.get(layer, f"{FRAME}-L{layer:02d}")
