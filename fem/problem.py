"""The statement of a problem: blocks, load, material and what acts between blocks, stated once.

Rigid, static and explicit answers are asked of the same statement; an answer that cannot have part
of it rejects it by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from fem.contact.friction import CoulombFriction
from fem.contact.law import ContactLaw, ExponentialLaw
from fem.contact.normals import ContactNormals
from fem.contact.own_law import PressureLaw, as_law
from fem.contact.pair_laws import PairLaws
from fem.element.hexahedron import ElementType
from fem.element.material import (
    FASTEST_SOUND,
    SLOWEST_SOUND,
    Material,
    MaterialError,
    each_material,
    one_strength,
)
from geometry.assembly import Assembly, check_mesh_overlaps, spacing_offsets
from geometry.block import Block
from geometry.errors import RefusedError, is_number
from geometry.loads import Load, LoadCase, PressureLoad
from geometry.mesh import BoolArray, FloatArray, IntArray, check_mesh
from geometry.parts.pairs import OfPairs, check_pairs
from geometry.parts.placed import AnyBlocks, PlacedBlocks, UnmatchedJoint

if TYPE_CHECKING:
    from fem.contact.surfaces import MatchedFacets
    from fem.system.body import Body
    from fem.system.system import System

#: Depth that is no overlap, in block lengths ∛V: meshes of curved faces that do not match.
_LEAST_OVERLAP = 1e-3
#: Highest degree of elements that anybody has use for.
_HIGHEST_DEGREE = 8
#: Most elements along an edge of a solid.
_MOST_DIVISIONS = 1000


class Frames(StrEnum):
    """How the blocks that the load case holds are modelled."""

    RIGID = "rigid"
    """They do not move or deform."""
    DEFORMABLE = "deformable"
    """They deform and are held at their outer faces."""


class ProblemError(RefusedError):
    """A statement that an answer cannot have: which part, and what to do."""


@dataclass(frozen=True)
class Motion:
    """Rigid motion of every block at time 0."""

    velocity: FloatArray
    """(3,) [mm/s]"""
    angular_velocity: FloatArray
    """About the mean of the block's nodes, (3,) [rad/s]."""

    def velocities(self, bodies: Sequence[Body]) -> tuple[FloatArray, ...]:
        """Of all nodes of each body, (n_copies, n_nodes, 3) [mm/s]."""
        result = []
        for body in bodies:
            positions = body.reference_positions()
            arm = positions - positions.mean(axis=1, keepdims=True)
            result.append(self.velocity + np.cross(self.angular_velocity, arm))
        return tuple(result)


#: What the parts of a problem are.
_KINDS: dict[str, Any] = {
    "blocks": PlacedBlocks,
    "load": Load | LoadCase | None,
    "clearance": Real,
    "spacing": Real,
    "friction": CoulombFriction | Real | None,
}

#: Accelerations below this are m/s² in all likelihood [mm/s²].
LEAST_GRAVITY = 50.0


@dataclass(frozen=True)
class Problem:
    """Boundary value problem: blocks with supports, loads and material, for all three solvers.

    Lengths are in mm, forces in N, stresses in MPa, times in s, masses in t. All but the first
    three are keywords; ``dataclasses.replace(problem, friction=0.3)`` is a variant.

    Parameters
    ----------
    blocks
        All blocks, fixed ones included: of `geometry.tube`, any `geometry.Assembly`, or solids such
        as those of `geometry.Assembly.from_blocks`, which deformable answers and decks mesh
        (`meshed`).
    load
        Loads and fixed blocks: a load case such as `geometry.pipe`, or a
        `geometry.loads.LoadCase` for facets of one's own. None: none but gravity, and the fixed
        blocks of ``blocks``.
    material
        Density [t/mm³], modulus [MPa], Poisson's ratio [-], radius of the averaged tension [mm];
        `fem.concrete` is the paper's. One for all blocks, or a sequence with one for each, such as
        ``[steel if k in (0, 3) else concrete for k in range(blocks.n_blocks)]``.
    element
        Hexahedron of degree 1. Default: incompatible modes.
    degree
        Polynomial degree of the elements [-]. Default 1. Degrees 2 to 8 (static analyses only) are
        isoparametric, with nodes on the exact shape of the block where it has one. Solids that are
        meshed with tetrahedra have degree 2 in static analyses; ``problem.meshed`` has degree 1.
    law
        Contact pressure [MPa] as a function of overclosure [mm]: `ExponentialLaw` (default, with
        the paper's constants), `LinearPenalty`, `TabularLaw`, or an object of one's own with the
        methods ``pressure`` and ``stiffness`` (`fem.contact.own_law`). `PairLaws`: pairs of blocks
        with their own.
    normals
        Normals along which gaps are measured. Default: those of the current surfaces.
    clearance
        Gap along the normal of every facet before the load acts [mm]: every block is too small by
        half of it; negative: an interference fit. Default 0.
    spacing
        Distance by which neighbours are moved apart, their size kept [mm]
        (`geometry.assembly.spacing_offsets`): inclined faces open by less or more. Default 0. Both
        gaps may be given: they add up.
    frames
        Model of the fixed blocks: `Frames.RIGID` (default), or `Frames.DEFORMABLE` and fixed at
        their outer faces.
    friction
        Friction of all joints: its coefficient [-], or `CoulombFriction`, in which pairs of blocks
        may have others. Default: frictionless.
    finite_sliding
        Finite sliding with a contact search; else small sliding of fixed pairs of matching facets.
        Default False: a search where facets do not match alone.
    finite_rotation
        Whether blocks may turn by any angle, in explicit runs alone. Default False: small
        rotations.
    gravity
        Uniform acceleration, (3,) [mm/s²], such as ``(0, 0, -9810)``. Default None: absent.
    motion
        Rigid motion of every block at time 0, of explicit runs alone. Default None: at rest.
    after
        Statement of the same blocks whose static state this one begins at: its loads and supports
        change in equal increments into these, and slips of friction stay. Of static analyses
        alone. Default None: from rest.
    divisions
        Elements along each edge of a solid with six flat sides of four corners, where blocks are
        solids without hexahedra. Default 4.
    size
        Edge of the tetrahedra of any other solid [mm], each of which is split into four hexahedra.
        Default None: ∛V of the solid.
    check_units
        Whether implausible wave speeds √(E/ρ) and gravity are rejected. Default True.
    check_blocks
        Whether blocks that overlap, do not match, are not held, or whose hexahedra are inverted are
        rejected. Default True.

    Raises
    ------
    ProblemError
        What is no load, constants or loads in other units, a gravity that is no finite
        vector, clearances that are not finite, a degree or effects that cannot go together.
    AssemblyError, MeshError
        Blocks that overlap, both named with the depth, facets that do not match, inverted elements.
    DeformableAssemblyError
        Nothing to deform, or blocks that nothing can hold.
    ContactError
        Negative gaps deeper than the contact law.
    ContactLawError
        What is no contact law.
    """

    blocks: Any
    load: Load | LoadCase | None
    material: Material | Sequence[Material]
    _: KW_ONLY
    element: ElementType = ElementType.INCOMPATIBLE
    degree: int = 1
    law: ContactLaw | PressureLaw = field(default_factory=ExponentialLaw)
    normals: ContactNormals = ContactNormals.CURRENT
    clearance: float = 0.0
    spacing: float = 0.0
    frames: Frames = Frames.RIGID
    friction: CoulombFriction | float | None = None
    finite_sliding: bool = False
    finite_rotation: bool = False
    gravity: Sequence[float] | FloatArray | None = None
    motion: Motion | None = None
    after: Problem | None = None
    divisions: int = 4
    size: float | None = None
    check_units: bool = True
    check_blocks: bool = True

    def __post_init__(self) -> None:
        for name, kinds in _KINDS.items():
            value = getattr(self, name)
            if not isinstance(value, kinds) or isinstance(value, bool):
                raise ProblemError(
                    f"{name}: got a {type(value).__name__}; expected blocks and load, "
                    "numbers for clearance, spacing and friction"
                )
        for material in dict.fromkeys(self.materials):
            self._check_units_of(material)
        _ = self.contact_law, self.coulomb  # what is no law is rejected here
        for key, of_pairs in self._of_pairs:
            check_pairs(key, of_pairs, self.blocks.n_blocks)
        self._check_options()
        for name in ("clearance", "spacing"):
            value = getattr(self, name)
            if not np.isfinite(value):
                raise ProblemError(f"{name}: got {value}, expected a finite length in mm")
        gravity = self.acceleration
        if gravity is not None and (gravity.shape != (3,) or not np.isfinite(gravity).all()):
            raise ProblemError(f"gravity: got {self.gravity}, expected three finite mm/s²")
        size = 0.0 if gravity is None else float(np.linalg.norm(gravity))
        if self.check_units and 0.0 < size < LEAST_GRAVITY:
            raise ProblemError(
                f"gravity: got {self.gravity} mm/s², a thousandth of the earth's or less; did you "
                "mean m/s²? Expected (0, 0, -9810) there (to override: check_units=False)"
            )
        if self.check_blocks:
            self._check_blocks()
        if self.after is not None:
            self._check_after(self.after)

    def __repr__(self) -> str:
        """The values that differ from the defaults, without arrays."""
        given = [f"{self.blocks!r}", f"load {self.load_case.name!r}"]
        for part in fields(self)[3:]:
            value = getattr(self, part.name)
            default = part.default_factory() if callable(part.default_factory) else part.default
            if value is not default and str(value) != str(default):
                given.append(f"{part.name}={value}")
        return f"Problem({', '.join(given)})"

    def _check_options(self) -> None:
        """Reject options that no solver has, and such as exclude each other."""
        for name in ("finite_sliding", "finite_rotation"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise ProblemError(f"{name}: got {getattr(self, name)!r}; expected True or False")
        if self.degree not in range(1, _HIGHEST_DEGREE + 1) or isinstance(self.degree, bool):
            raise ProblemError(
                f"degree: got {self.degree!r}; expected a whole number from 1 to {_HIGHEST_DEGREE}"
            )
        for name, kind in (
            ("element", ElementType),
            ("normals", ContactNormals),
            ("frames", Frames),
        ):
            value = getattr(self, name)
            if not isinstance(value, kind):
                expected = ", ".join(f"{kind.__name__}.{member.name}" for member in kind)
                raise ProblemError(f"{name}: got {value!r}; expected one of {expected}")
        if self.degree > 1 and self.element is not ElementType.INCOMPATIBLE:
            raise ProblemError(
                f'element: got "{self.element.value}" with degree {self.degree}, whose elements '
                "have one kind; remove it, or take degree 1"
            )
        if self.divisions not in range(1, _MOST_DIVISIONS + 1):
            raise ProblemError(
                f"divisions: got {self.divisions!r}; expected a whole number from 1 to "
                f"{_MOST_DIVISIONS}"
            )
        if self.size is not None and not (is_number(self.size) and self.size > 0.0):
            raise ProblemError(f"size: got {self.size!r}; expected a positive length in mm")
        if self.is_solid and self.spacing:
            raise ProblemError(
                f"spacing: got {self.spacing:g} mm for solids, which have no layers to move apart; "
                "expected a clearance, or blocks with gaps"
            )
        if not self.is_solid and self.blocks.image_of is not None:
            from fem.system.build import check_cell

            rigid = self.frames is Frames.RIGID
            check_cell(self.blocks, rigid=rigid, finite_sliding=self.finite_sliding)

    def _check_blocks(self) -> None:
        """Reject blocks that no solver has a state of; solvers go on with what is found here."""
        blocks, load = self.blocks, self.load_case
        if load.assembly.n_blocks != blocks.n_blocks:
            raise ProblemError(
                f"load: got one of {load.assembly.n_blocks} blocks for {blocks.n_blocks} blocks; "
                "expected a load on the blocks of the problem"
            )
        if self.is_solid:
            from geometry.polyhedra.overlap import check_contacts

            check_contacts(blocks, _supported(load))
            return
        from fem.system.build import check_held

        for shape in blocks.shapes:
            if shape.charts is None:  # those of families are checked when they are made
                check_mesh(shape.mesh, shape.name)
        least = _LEAST_OVERLAP * blocks.characteristic_length
        check_mesh_overlaps(blocks, max(self.contact_law.largest_initial_overclosure, least))
        deforms = self.deforming
        if self.searches:
            return
        if blocks.interfaces.n_contacts:
            check_held(blocks, load)
        if self.clearance < 0.0 or self.spacing:
            self._surfaces(blocks, deforms)

    def _check_after(self, before: Problem) -> None:
        """Reject a statement of other blocks, contact or fixed blocks as what comes before."""
        alike = (
            before.blocks.n_blocks == self.blocks.n_blocks
            and before.is_solid == self.is_solid
            and all(
                np.array_equal(_nodes(one), _nodes(other))
                for one, other in zip(self.blocks.shapes, before.blocks.shapes, strict=False)
            )
            and np.array_equal(before.blocks.shape_of, self.blocks.shape_of)
            and np.array_equal(before.load_case.fixed, self.load_case.fixed)
        )
        same = ["materials", "degree", "element", "normals", "clearance", "spacing", "frames"]
        same += ["finite_sliding", "coulomb"]
        others = [name for name in same if getattr(self, name) != getattr(before, name)]
        if not alike or others or before.contact_law != self.contact_law:
            raise ProblemError(
                f"after: got a statement that differs in {', '.join(others) or 'blocks or law'}; "
                "expected the same blocks, materials and contact, with other loads and supports"
            )

    @property
    def stages(self) -> tuple[Problem, ...]:
        """All statements from rest on, this one last."""
        return (*(() if self.after is None else self.after.stages), self)

    @property
    def deforming(self) -> BoolArray:
        """Whether each block deforms, (n_blocks,)."""
        load, n = self.load_case, self.blocks.n_blocks
        deforms = ~load.fixed if self.frames is Frames.RIGID else np.ones(n, dtype=np.bool_)
        if not deforms.any():
            from fem.system.build import DeformableAssemblyError

            raise DeformableAssemblyError(
                f"{self.blocks.name}: every block is fixed; expected at least one that can deform"
            )
        return deforms

    def _surfaces(self, assembly: Assembly, deforms: BoolArray) -> MatchedFacets:
        """Facets that touch, with the gaps before the load acts."""
        from fem.system.build import touching_surfaces

        offsets = spacing_offsets(assembly, self.spacing)
        facets = touching_surfaces(assembly, deforms, offsets, self.clearance, self.contact_law)
        current = self.normals is ContactNormals.CURRENT
        return facets if current else facets.with_reference_normals

    def _check_units_of(self, material: Material) -> None:
        """Reject constants and loads that no solid in mm, N, MPa and t has."""
        if self.check_units and not SLOWEST_SOUND <= material.bar_wave_speed <= FASTEST_SOUND:
            slips = (
                ("young_modulus in GPa", 1e3, 1.0),
                ("young_modulus in Pa", 1e-6, 1.0),
                ("density in kg/m³", 1.0, 1e-12),
                ("density in g/cm³", 1.0, 1e-9),
            )
            likely = (
                f": {slip}?"
                for slip, modulus, density in slips
                if 1e6 < material.bar_wave_speed * (modulus / density) ** 0.5 < 1e7
            )
            raise ProblemError(
                f"material: implausible wave speed √(E/ρ) = {material.bar_wave_speed:.3g} mm/s; "
                f"expected {SLOWEST_SOUND:g} to {FASTEST_SOUND:g}{next(likely, '')} (MPa and t/mm³)"
            )
        largest = self.load_case.largest_traction
        if largest > material.young_modulus:
            raise ProblemError(
                f"pressure: got {largest:g} MPa, more than `young_modulus` = "
                f"{material.young_modulus:g} MPa; expected less, or strains exceed 1: give both "
                "in MPa"
            )

    @property
    def acceleration(self) -> FloatArray | None:
        """Gravity, (3,) [mm/s²]; None: absent."""
        if self.gravity is None:
            return None
        try:
            return np.asarray(self.gravity, dtype=np.float64)
        except (TypeError, ValueError):
            raise ProblemError(
                f"gravity: got {self.gravity!r}, expected three finite mm/s²"
            ) from None

    @cached_property
    def materials(self) -> tuple[Material, ...]:
        """Of each block, (n_blocks,)."""
        try:
            return each_material(self.material, self.blocks.n_blocks)
        except MaterialError as error:
            raise ProblemError(str(error)) from None

    @property
    def densities(self) -> FloatArray:
        """Of each block, (n_blocks,) [t/mm³]."""
        return np.array([material.density for material in self.materials])

    @cached_property
    def contact_law(self) -> ContactLaw:
        """The law with all that solvers ask of one."""
        return as_law(self.law)

    @property
    def _of_pairs(self) -> list[tuple[str, OfPairs]]:
        """What pairs of blocks have of their own, by its key, where any have."""
        law, friction = self.contact_law, self.coulomb
        result = [] if friction is None else [("friction", friction.of_pairs)]
        result += [("law", law.numbers)] if isinstance(law, PairLaws) else []
        return [(key, of_pairs) for key, of_pairs in result if of_pairs]

    @property
    def coulomb(self) -> CoulombFriction | None:
        """Friction with its constants; None: absent."""
        friction = self.friction
        if friction is None or isinstance(friction, CoulombFriction):
            return friction
        return CoulombFriction(float(friction)) if friction else None

    @property
    def is_solid(self) -> bool:
        """Whether blocks are solids, without hexahedra."""
        return not isinstance(self.blocks, Assembly)

    @cached_property
    def meshed(self) -> Problem:
        """The same problem on blocks with hexahedra; itself where they have them.

        Raises
        ------
        MeshError
            A solid for which there are no hexahedra.
        AssemblyError
            Hexahedra of which no two touch, or that overlap.
        """
        if not self.is_solid:
            return self
        from geometry.files.hexahedral_solids import with_hexahedra

        supported = _supported(self.load_case)
        meshed = with_hexahedra(self.blocks, self.divisions, self.size, lambda _: supported)
        return self._on(meshed)

    def _on(self, blocks: Assembly) -> Problem:
        """The same problem on the same blocks with hexahedra, which were checked."""
        load = None if self.load is None else replace(self.load_case, assembly=blocks)
        after = None if self.after is None else self.after._on(blocks)
        return replace(self, blocks=blocks, load=load, after=after, check_blocks=False)

    @cached_property
    def unmatched(self) -> tuple[UnmatchedJoint, ...]:
        """Joints where facets do not match corner on corner: their contact is searched."""
        blocks: Assembly = self.meshed.blocks
        if blocks.unmatched is not None:
            return blocks.unmatched
        if not blocks.unmatched_allowed:
            return ()
        from geometry.polyhedra.assembly import as_polyhedral
        from geometry.polyhedra.near_joints import unmatched_joints

        return tuple(
            joint
            for joint in unmatched_joints(blocks, as_polyhedral(blocks))
            if all(len(blocks.shape(b).contact_quads) for b in (joint.block_m, joint.block_s))
        )

    @property
    def searches(self) -> bool:
        """Whether contact is searched: for finite sliding, or where facets do not match."""
        return self.finite_sliding or bool(self.unmatched)

    @cached_property
    def rigid_blocks(self) -> AnyBlocks:
        """Blocks on the contacts of rigid ones: where facets do not match those that face others.

        Raises
        ------
        AssemblyError
            Contact facets without partner.
        """
        if self.is_solid or not self.unmatched:
            return cast("AnyBlocks", self.blocks)
        from fem.system.facing_blocks import facing_blocks  # it loads a compiler

        return facing_blocks(self.blocks)

    @cached_property
    def load_case(self) -> LoadCase:
        """Tractions on facets, and what is held while they act."""
        if self.load is None:
            return LoadCase(self.blocks, "none", (), self.blocks.fixed)
        if self.is_solid and isinstance(self.load, Load):
            raise ProblemError(
                f"load: got {self.load.case.name!r}, a load of tubes, for {self.blocks!r}; "
                "expected a geometry.loads.LoadCase, or None and gravity"
            )
        return self.load.on(self.blocks) if isinstance(self.load, Load) else self.load

    @property
    def rigid_load(self) -> LoadCase:
        """Loads and supports of rigid blocks, whose weight is `rigid_weight`.

        Elasticity, element, law, normals and frames say how blocks deform: no rigid answer has
        them, and fixed blocks are held as a whole.

        Raises
        ------
        ProblemError
            For what rigid blocks do not have.
        """
        for name in ("clearance", "spacing"):
            if getattr(self, name) > 0.0:
                raise ProblemError(
                    f"{name}: got {getattr(self, name):g} mm; rigid blocks have no gaps to close: "
                    "expected none, or deformable blocks"
                )
        for name in ("finite_sliding", "finite_rotation"):
            if getattr(self, name):
                raise ProblemError(
                    f"{name}: got True; rigid blocks move by small amounts: expected it off (other "
                    "facets than matching ones are found without), or deformable blocks"
                )
        self.refuse_motion()
        return self.load_case

    @cached_property
    def rigid_weight(self) -> FloatArray | None:
        """Weight of each block about its mass centroid, (n_blocks, 6) [N, N mm]; None: absent.

        Fixed blocks that do not deform are ground, which weighs nothing.
        """
        if self.acceleration is None:
            return None
        weight = np.zeros((self.blocks.n_blocks, 6))
        weight[:, :3] = np.outer(self.densities * self.blocks.volumes, self.acceleration)
        if self.frames is Frames.RIGID:
            weight[self.load_case.fixed] = 0.0
        return weight

    @property
    def interference(self) -> float:
        """By which joints are squeezed before the load acts [mm]."""
        return max(0.0, -self.clearance)

    @property
    def compressive_strength(self) -> float | None:
        """Of all blocks [MPa]; None: not stated."""
        strengths = (material.compressive_strength for material in self.materials)
        return one_strength("compressive_strength", strengths)

    @property
    def acts(self) -> bool:
        """Whether anything deforms the blocks: load, weight, motion, interference or a start."""
        load, weight = self.load_case, self.acceleration
        return (
            self.after is not None
            or self.motion is not None
            or self.clearance < 0.0
            or (weight is not None and bool(weight.any()))
            or bool(load.facet_forces.any())
            or (load.body_wrenches is not None and bool(load.body_wrenches.any()))
            or any(held.moves for held in load.held)
        )

    def require_action(self) -> None:
        """Reject a problem in which nothing acts: all its answers are zero.

        Raises
        ------
        ProblemError
            Saying so.
        """
        if not self.acts:
            raise ProblemError(
                "load: nothing acts: got no load, weight, motion of supports, interference or "
                "start velocity, so that deformable blocks stay as they are; expected one of them "
                "(rigid blocks have a kinematic class without)"
            )

    def refuse_motion(self) -> None:
        """Reject an initial motion, which no static state has.

        Raises
        ------
        ProblemError
            Saying so.
        """
        if self.motion is not None:
            raise ProblemError("motion: a static state has none; expected solve_explicit")

    def require_static(self) -> None:
        """Reject what no static state has, in this statement and in those before it.

        Raises
        ------
        ProblemError
            An initial motion, blocks that turn by any angle, or a pressure that turns with them.
        """
        for stage in self.stages:
            stage.refuse_motion()
            if stage.finite_rotation:
                raise ProblemError(
                    "finite_rotation: got True; static states have small rotations: expected it "
                    'off, or an explicit run (fem.method = "explicit")'
                )
            if any(isinstance(f, PressureLoad) and f.follows_block for f in stage.load_case.faces):
                raise ProblemError(
                    "load: got a pressure that turns with its block (follows_block); loads of "
                    "static states keep their direction: expected follows_block=False, or an "
                    "explicit run with finite_rotation"
                )

    @cached_property
    def system(self) -> System:
        """Deformable blocks in contact, for the static and the explicit solver.

        Surfaces that slide need not conform, so blocks that nothing holds are then not looked for.

        Raises
        ------
        ContactError
            Blocks that overlap at the start by more than the law's range.
        DeformableAssemblyError
            Nothing to deform, blocks that nothing can hold, or fixed blocks without an outer face.
        AssemblyError
            Contact facets without partner.
        FrictionError
            A coefficient that cannot be used.
        """
        if self.is_solid:
            return self.meshed.system
        from fem.system.build import (
            block_groups,
            check_held,
            curved,
            force_rows,
            ground_loads,
            support_rows,
        )
        from fem.system.system import Contact, System

        assembly, load, sliding = self.blocks, self.load_case, self.searches
        if self.degree > 1:
            assembly = curved(assembly, self.degree)
        deforms = self.deforming
        if sliding:
            assembly = replace(assembly, unmatched_allowed=True)
        elif assembly.interfaces.n_contacts:
            check_held(assembly, load)
        offsets = spacing_offsets(assembly, self.spacing)
        surfaces = self._surfaces(assembly, deforms)
        for key, of_pairs in self._of_pairs if not sliding else ():
            joints = surfaces.block_m, surfaces.block_s
            check_pairs(key, of_pairs, assembly.n_blocks, joints)
        bodies, body_number, copy_of = block_groups(
            assembly, deforms, offsets, self.materials, self.element, held=load.held
        )
        return System(
            assembly=assembly,
            bodies=bodies,
            body_number=body_number[assembly.originals],
            copy_of=copy_of[assembly.originals],
            offsets=offsets,
            surfaces=surfaces,
            contact=Contact(self.contact_law, self.normals, self.coulomb, sliding),
            supports=support_rows(assembly, load, rigid=self.frames is Frames.RIGID),
            forces=force_rows(assembly, load, deforms),
            gravity=self.acceleration,
            on_ground=ground_loads(assembly, load, body_number),
        )


def _supported(load: LoadCase) -> IntArray:
    """Numbers of the blocks that supports of a load hold."""
    return np.array(sorted({held.block for held in load.held}), dtype=np.int64)


def _nodes(shape: Any) -> FloatArray:
    """Nodes of a shape in its own frame, (n, 3) [mm]."""
    nodes: FloatArray = shape.mesh.nodes if isinstance(shape, Block) else shape.points
    return nodes


def require_problem(problem: object) -> Problem:
    """Reject what is no statement of a problem; solids get hexahedra."""
    if not isinstance(problem, Problem):
        raise ProblemError(
            f"problem: got a {type(problem).__name__}; expected "
            "Problem(blocks, pipe(0.01), concrete)"
        )
    return problem.meshed


def before_motion(problem: Problem, *, loaded: bool) -> Problem | None:
    """Statement with supports where they are before they move, with the loads or without.

    None where no support moves, or nothing else acts, no load and no interference.
    """
    load = problem.load_case
    moves = any(held.moves for held in load.held)
    loads = len(load.block) or load.body_wrenches is not None or problem.gravity is not None
    if not moves or not (loads or problem.clearance < 0.0):
        return None
    still = tuple(replace(held, displacement=None, path=()) for held in load.held)
    if loaded:
        return replace(problem, load=replace(load, held=still))
    rest = replace(load, faces=(), lines=(), nodes=(), body_wrenches=None, held=still)
    return replace(problem, load=rest, gravity=None)
