"""What an input deck says: blocks, material, joints, supports, loads and one step.

The statement of a problem for another program, independent of how that program spells it:
`fem.decks.abaqus` and `fem.decks.calculix` turn it into text, `fem.decks.read.deck`
reads it back, `fem.decks.model` makes a model for the solvers of this package of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TypeAlias, cast

import numpy as np

from fem.contact.law import ContactLaw
from fem.contact.pair_laws import PairLaws
from fem.decks.keywords import DeckError, safe_names
from fem.decks.meshes import SerendipityMesh
from fem.element.hexahedron import ELEMENTS, ElementType
from fem.element.material import Material, each_material
from fem.problem import Motion
from fem.system.build import block_load_forces
from fem.system.effects import Effects
from geometry.assembly import Assembly, spacing_offsets
from geometry.block import Block
from geometry.loads import FaceLoad, LoadCase, PressureLoad
from geometry.mesh import FloatArray, IntArray
from geometry.parts.pairs import OfPairs
from geometry.parts.regions import Where


class Flavour(StrEnum):
    """For which program a deck is written."""

    GENERAL = "general"
    """Abaqus/Explicit: parts, instances, general contact."""
    STANDARD = "standard"
    """Abaqus/Standard: static, parts, instances, one contact pair for each joint."""
    CALCULIX = "calculix"
    """CalculiX: flat, what its input has no word for written otherwise."""


class Procedure(StrEnum):
    """What the one step computes."""

    EXPLICIT = "explicit"
    """Explicit dynamics."""
    STATIC = "static"
    """Static equilibrium."""


@dataclass(frozen=True)
class BodyForceLoad:
    """Uniform force per volume on some blocks: its resultant acts at the mass centroid."""

    blocks: IntArray
    """(n,)"""
    force_density: FloatArray
    """World axes, (n, 3) [N/mm³]."""


@dataclass(frozen=True)
class NodalForceLoad:
    """Dead forces on nodes, one entry for each loaded node."""

    blocks: IntArray
    """Block of each node, (n,)."""
    nodes: IntArray
    """Node in the block's mesh, (n,)."""
    forces: FloatArray
    """World axes, (n, 3) [N]."""


DeckLoad: TypeAlias = FaceLoad | BodyForceLoad | NodalForceLoad


def named_face(where: Where) -> str:
    """Name of a region, as a deck has it.

    Raises
    ------
    DeckError
        A region without a name.
    """
    if isinstance(where, str):
        return where
    raise DeckError(f"got a load or a support on {where}; a deck names faces: expected a face")


@dataclass(frozen=True)
class Hold:
    """Nodes of one block that do not move in some world directions."""

    block: int
    """Held block."""
    face: str | None = None
    """Face whose nodes are held; None: all nodes."""
    components: tuple[int, ...] = (0, 1, 2)
    """Held world components, consecutive."""
    nodes: tuple[int, ...] | None = None
    """Nodes in the block's mesh, where a region without a name is held; None: those of the face."""
    region: str = ""
    """Name of their set."""
    displacement: float = 0.0
    """By which they move, one component alone [mm]; 0: they stay."""
    path: tuple[tuple[float, float], ...] = ()
    """Times [s] and shares of it; (): with the loads."""
    axes: tuple[float, ...] | None = None
    """First and second axis of its components, six numbers; None: world axes."""

    @property
    def whole(self) -> bool:
        """Whether it holds every node of its block in all directions."""
        return self.face is None and self.nodes is None and self.components == (0, 1, 2)


@dataclass(frozen=True)
class GroundSpring:
    """Spring between a node and the ground along one world component."""

    block: int
    """Its block."""
    node: int
    """Node in the block's mesh."""
    component: int
    """World component."""
    stiffness: float
    """[N/mm]"""


@dataclass(frozen=True)
class Joint:
    """How faces that meet act on each other."""

    law: ContactLaw
    """Pressure as a function of overclosure."""
    friction: float | None = None
    """Coulomb coefficient; None: frictionless."""
    stick_stiffness: float | None = None
    """Tangential slope while sticking [MPa/mm]; None: the program's default."""
    finite_sliding: bool = False
    """Whether contact pairs follow blocks that slide by more than a facet."""
    of_pairs: OfPairs = ()
    """Coefficients between some pairs of blocks; 0: frictionless."""
    face_to_face: bool = False
    """Whether CalculiX presses on faces, not at nodes."""

    @property
    def has_pairs(self) -> bool:
        """Whether pairs of blocks have friction or a law of their own."""
        return bool(self.of_pairs) or len(self.law.members) > 1

    @cached_property
    def interactions(self) -> dict[tuple[int, float | None], str]:
        """Distinct laws and coefficients, and what the deck calls their surface interactions.

        Laws by their place in `ContactLaw.members`.
        """
        named = [pair[:2] for pair in self.of_pairs]
        named += [pair[:2] for pair in self.law.of_pairs] if isinstance(self.law, PairLaws) else []
        values = dict.fromkeys([(0, self.friction or None), *(self._between(*p) for p in named)])
        return {value: f"{JOINT}-{k}" if k else JOINT for k, value in enumerate(values)}

    def _between(self, block_m: int, block_s: int) -> tuple[int, float | None]:
        """Place of the law in `ContactLaw.members` and coefficient of two blocks."""
        own = {frozenset(pair[:2]): pair[2] for pair in self.of_pairs}
        friction = own.get(frozenset((block_m, block_s)), self.friction) or None
        law = self.law.on(np.array([block_m]), np.array([block_s]))
        return self.law.members.index(law), friction

    def interaction(self, block_m: int, block_s: int) -> str:
        """Name of the surface interaction of two blocks."""
        return self.interactions[self._between(block_m, block_s)]


@dataclass(frozen=True)
class DeckStep:
    """The one step of a deck."""

    procedure: Procedure
    """What is computed."""
    end_time: float
    """Duration [s]; of a static step only the unit of its amplitude."""
    ramp_time: float = 0.0
    """Duration of the smooth step of the loads [s]; 0: at once."""
    time_step: float | None = None
    """Fixed time step of an explicit step [s]; None: chosen by the program."""
    safety_factor: float | None = None
    """Fraction of the critical time step that the program takes; None: its default."""
    scaled_time_step: float | None = None
    """Time step that mass scaling lets every element allow [s]; None: no mass scaling."""
    large_rotations: bool = True
    """Whether forces and strains are taken in the deformed position (NLGEOM)."""
    field_intervals: int = 20
    """Fields written over the step."""
    history_intervals: int = 200
    """Samples of the energies over the step."""


@dataclass(frozen=True)
class Deck:
    """A complete problem."""

    name: str
    """Of the scene."""
    flavour: Flavour
    """For which program."""
    assembly: Assembly
    """Blocks in their conforming places."""
    material: Material | tuple[Material, ...]
    """Of all blocks, or of each shape."""
    element: ElementType
    """Of all blocks of eight nodes."""
    step: DeckStep
    """What is computed."""
    holds: tuple[Hold, ...] = ()
    """Supports."""
    loads: tuple[DeckLoad, ...] = ()
    """Loads, all with the amplitude of the step."""
    springs: tuple[GroundSpring, ...] = ()
    """Between nodes and the ground."""
    joint: Joint | None = None
    """Contact; None where blocks do not meet."""
    effects: Effects = field(default_factory=Effects)
    """Rayleigh damping, bulk viscosity and gravity."""
    motion: Motion | None = None
    """Initial motion; None: at rest."""
    clearance: float = 0.0
    """Gap along the normal of every facet before the load acts [mm]."""
    searched: bool = False
    """Whether joints do not match corner on corner: whole faces meet, wherever they are."""
    spacing: float = 0.0
    """Distance by which neighbours are moved apart [mm] (`geometry.assembly`)."""
    notes: tuple[str, ...] = ()
    """Where the deck differs from the scene, one line each."""
    before: Deck | None = None
    """Statement of the same blocks whose supports and loads are a step before; None: from rest."""

    @property
    def stages(self) -> tuple[Deck, ...]:
        """Statements of all steps, this one last."""
        return (*(() if self.before is None else self.before.stages), self)

    @property
    def every_hold(self) -> tuple[Hold, ...]:
        """Supports of all steps."""
        return tuple(hold for stage in self.stages for hold in stage.holds)

    @cached_property
    def leaning(self) -> tuple[Hold, ...]:
        """Supports whose nodes have axes of their own."""
        return tuple(hold for hold in self.every_hold if hold.axes is not None)

    @property
    def every_load(self) -> tuple[DeckLoad, ...]:
        """Loads of all steps."""
        return tuple(load for stage in self.stages for load in stage.loads)

    @cached_property
    def offsets(self) -> FloatArray:
        """Translation of each block from its conforming place, (n_blocks, 3) [mm]."""
        return spacing_offsets(self.assembly, self.spacing)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of the instance of each block, (n_blocks,)."""
        return _labels(self.assembly)

    @cached_property
    def sets(self) -> dict[str, IntArray]:
        """Blocks of the sets FRAME, the fixed ones, and TUBE, all others; none is empty."""
        fixed = self.assembly.fixed
        sets = {FRAME: np.flatnonzero(fixed), TUBE: np.flatnonzero(~fixed)}
        return {name: blocks for name, blocks in sets.items() if len(blocks)}

    @property
    def program(self) -> str:
        """Program that runs it."""
        if self.flavour is Flavour.CALCULIX:
            return "CalculiX"
        static = self.step.procedure is Procedure.STATIC
        return "Abaqus/Standard" if static else "Abaqus/Explicit"

    @property
    def materials(self) -> tuple[Material, ...]:
        """Of each shape, (n_shapes,)."""
        return each_material(self.material, len(self.assembly.shapes))

    @property
    def material_names(self) -> dict[Material, str]:
        """Distinct materials and what the deck calls them."""
        distinct = tuple(dict.fromkeys(self.materials))
        if len(distinct) == 1:
            return {distinct[0]: MATERIAL}
        return {material: f"{MATERIAL}-{k}" for k, material in enumerate(distinct, start=1)}

    @property
    def held_blocks(self) -> IntArray:
        """Blocks of which every node is held in all directions, (n,)."""
        held = {h.block for h in self.holds if h.whole}
        return np.array(sorted(held), dtype=np.int64)


def loads_of_case(case: LoadCase) -> tuple[DeckLoad, ...]:
    """Loads of a case, as a deck states them.

    Raises
    ------
    DeckError
        Moments, which no deck can carry.
    """
    if case.body_wrenches is not None:
        raise DeckError(
            f"load {case.name!r}: got forces and moments on whole blocks; expected loads on faces "
            "(a deck has gravity and body forces, no moment on a solid block)"
        )
    if case.without_couple:
        return (_surface_node_forces(case),)
    named = tuple(load for load in case.faces if isinstance(load.face, str))
    regions = tuple(load for load in case.faces if not isinstance(load.face, str))
    if any(isinstance(load, PressureLoad) and load.follows_block for load in regions):
        raise DeckError(
            f"load {case.name!r}: got a pressure that turns with its block on a region without a "
            "name; expected a named face, or a dead load"
        )
    if not (regions or case.lines or case.nodes):
        return named
    return (*named, _consistent_forces(replace(case, faces=regions)))


def _consistent_forces(case: LoadCase) -> NodalForceLoad:
    """Loads as consistent forces on nodes."""
    assembly = cast("Assembly", case.assembly)
    blocks, nodes, forces = [], [], []
    size = float(np.abs(case.facet_forces).max(initial=0.0)) or 1.0
    for block in np.unique(case.block).tolist():
        local = block_load_forces(assembly, case, block)
        assert local is not None
        where = np.flatnonzero(local.any(axis=1))
        blocks.append(np.full(len(where), block))
        nodes.append(where)
        # Rounded, so that what is read and written again is the same.
        world = local[where] @ assembly.rotations[block].T
        forces.append(np.round(world, 13 - int(np.ceil(np.log10(size)))) + 0.0)
    return NodalForceLoad(np.concatenate(blocks), np.concatenate(nodes), np.concatenate(forces))


def _surface_node_forces(case: LoadCase) -> NodalForceLoad:
    """Spread each block's resultant evenly over its surface nodes."""
    assembly = case.assembly
    total = np.zeros((assembly.n_blocks, 3))
    np.add.at(total, case.block, case.facet_forces)
    blocks = np.unique(case.block)
    nodes = [assembly.shape(int(b)).surface_nodes for b in blocks]
    shares = [np.tile(total[b] / len(n), (len(n), 1)) for b, n in zip(blocks, nodes, strict=True)]
    count = [len(n) for n in nodes]
    return NodalForceLoad(np.repeat(blocks, count), np.concatenate(nodes), np.concatenate(shares))


#: Abaqus' name of each element that has one.
ELEMENT_NAMES = {kind: found.abaqus for kind, found in ELEMENTS.items() if found.abaqus}


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


def element_name(deck: Deck, elements: Mapping[ElementType, str], shape: Block) -> str:
    """Name of the elements of a shape: by their nodes, hexahedra of eight by their kind."""
    return "C3D20" if isinstance(shape.mesh, SerendipityMesh) else elements[deck.element]


def block_label(deck: Deck, block: int) -> str:
    """Name of the instance of a block."""
    return deck.labels[block]


#: Names of sets of several blocks, which no block has.
_RESERVED = ("all", "eall", "nall", "frame", "tube")


def _labels(assembly: Assembly) -> tuple[str, ...]:
    """Names of blocks: their own, else by layer and position, such as L01-B03 and FRAME-TOP-B01."""
    if assembly.names:
        return tuple(name.upper() for name in safe_names((*_RESERVED, *assembly.names)))[
            len(_RESERVED) :
        ]
    result = [""] * assembly.n_blocks
    for layer in np.unique(assembly.layer).tolist():
        blocks = np.flatnonzero(assembly.layer == layer)
        for fixed in (True, False):
            mine = blocks[assembly.fixed[blocks] == fixed].tolist()
            if not mine:
                continue
            title = _frame_title(assembly, layer) if fixed else f"L{layer:02d}"
            for position, block in enumerate(mine, start=1):
                alone = title.startswith(f"{FRAME}-") and len(mine) == 1
                result[block] = title if alone else f"{title}-B{position:02d}"
    return tuple(result)


def _frame_title(assembly: Assembly, layer: int) -> str:
    """Name of the fixed blocks of a layer: of several layers the first is below, the last above."""
    layers = np.unique(assembly.layer[assembly.fixed]).tolist()
    if len(layers) == 1:
        return FRAME
    ends = {layers[0]: f"{FRAME}-BOTTOM", layers[-1]: f"{FRAME}-TOP"}
    return ends.get(layer, f"{FRAME}-L{layer:02d}")


def check_deck(deck: Deck, elements: Mapping[ElementType, str] = ELEMENT_NAMES) -> None:
    """Refuse what no deck can express, and elements that the program does not have.

    Raises
    ------
    DeckError
        By name.
    """
    if deck.element not in elements:
        raise DeckError(
            f"fem.element: got {deck.element.value!r}, which a deck of flavour {deck.flavour} has "
            "no name for (C3D8 averages the dilatation in Abaqus, not in CalculiX); expected one "
            f"of {', '.join(repr(e.value) for e in elements)}"
        )
    _check_references(deck)
    if deck.step.procedure is Procedure.STATIC and deck.motion is not None:
        raise DeckError(
            "initial: a static step has no initial motion; remove it, or choose --flavour general"
        )
    for hold in deck.every_hold:
        first, last = hold.components[0], hold.components[-1]
        if hold.components != tuple(range(first, last + 1)):
            raise DeckError(f"support of block {hold.block}: components are not consecutive")
    if deck.motion is not None and deck.leaning:
        raise DeckError(
            "initial: got a motion beside supports along directions that lean; expected one of the "
            "two, or supports along x, y or z"
        )
    if deck.effects.adaptive_mass_damping is not None:
        raise DeckError(
            "fem.damping: adaptive mass damping is a device of this program; expected "
            "constant Rayleigh damping in a deck"
        )


def _check_references(deck: Deck) -> None:
    """Refuse supports and loads on faces or nodes that a block does not have."""
    shape = deck.assembly.shape
    named = [(hold.block, hold.face) for hold in deck.every_hold if hold.face is not None]
    for load in deck.every_load:
        if isinstance(load, NodalForceLoad):
            for block, node in zip(load.blocks.tolist(), load.nodes.tolist(), strict=True):
                if not 0 <= node < shape(block).mesh.n_nodes:
                    raise DeckError(f"load: block {block} has no node {node + 1}")
        elif not isinstance(load, BodyForceLoad):
            named += [(block, named_face(load.face)) for block in load.blocks.tolist()]
    for block, face in named:
        if face not in shape(block).faces:
            raise DeckError(
                f"block {block} ({shape(block).name}) has no face {face!r}; expected one of "
                f"{', '.join(shape(block).faces)}"
            )
