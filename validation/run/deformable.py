"""Deformable tubes of a scene: the model, and a result in terms that pictures and JSON use."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from fem.assembly.contact_state import ContactState
from fem.assembly.deformable import (
    DeformableAssembly,
    Frames,
)
from fem.assembly.measures import CapAction, ContactMeasures, cap_action, contact_measures
from fem.assembly.peaks import StressPeaks, stress_peaks
from fem.assembly.statement import Problem
from fem.contact.friction import CoulombFriction, FrictionError
from fem.contact.law import ContactLaw, ContactLawError, ExponentialLaw, LinearPenalty
from fem.contact.surfaces import ContactNormals
from fem.problem.model import Formulation
from fem.problem.recovery import recover
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.load_case import LoadCase
from geometry.mesh import FloatArray, IntArray
from validation.build.blocks import HexahedralBlocks, build_blocks, build_load, require_matching
from validation.build.box import build_material
from validation.build.cell import build_cell, is_cell
from validation.errors import InputError
from validation.run.measures import Measure, joints_json, run_measures
from validation.run.slip import largest_slip
from validation.run.words import load_words
from validation.scene.deformable import ContactSection, EffectsSection, FemSection, Method
from validation.scene.family import AssemblyScene, RoundScene
from validation.scene.polyhedra import MeshScene
from validation.scene.read import DeformableScene

#: Why a sector asked for is refused.
NO_SECTOR = (
    'fem.symmetry: got "sector", but the load or the supports are not the same on every block of a '
    'layer; expected "auto" or "none"'
)


def contact_law(section: ContactSection) -> ContactLaw:
    """Contact law of a scene.

    Raises
    ------
    InputError
        For constants that make no law.
    """
    try:
        if section.law == "linear":
            assert section.stiffness is not None
            return LinearPenalty(section.stiffness)
        cap = section.maximum_stiffness
        return ExponentialLaw(
            section.clearance_at_zero_pressure,
            section.pressure_at_zero_clearance,
            math.inf if cap is None else cap,
        )
    except ContactLawError as error:
        raise InputError(str(error)) from None


def gap_words(section: ContactSection | None) -> str:
    """Gaps before the load acts, to follow other words; nothing where there are none."""
    if section is None:
        return ""
    given = (("clearance", section.clearance), ("spacing", section.spacing))
    return "".join(f", {name} {value:g} mm" for name, value in given if value)


def fem_section(scene: DeformableScene, name: str) -> FemSection:
    """How the scene is to be solved.

    Raises
    ------
    InputError
        When a section is missing.
    """
    for section in ("material", "contact", "fem"):
        if getattr(scene, section) is None:
            raise InputError(
                f"{name}: [{section}] is missing: deformable blocks need it "
                "(`tubelock scenes tsb1-pipe` shows one)"
            )
    assert scene.fem is not None
    if scene.effects.auto is not None:
        raise InputError(
            f"{name}: effects.auto is decided by `tubelock fem` and `compare`; here, write the "
            "effects that it names and remove effects.auto"
        )
    if scene.fem.degree > 1:
        raise InputError(
            f"{name}: fem.degree: got {scene.fem.degree}; curved elements are solved by `tubelock "
            "fem` alone: expected 1"
        )
    if scene.fem.formulation is Formulation.RATE_FORM:
        raise InputError(
            f'{name}: fem.formulation: got "rate form", which has no contact; expected "shared '
            'stiffness" (boxes take both)'
        )
    return scene.fem


def build_friction(effects: EffectsSection) -> CoulombFriction | None:
    """Friction of a scene; None where it names none.

    Raises
    ------
    InputError
        For a coefficient that cannot be used.
    """
    section = effects.friction
    if section is None:
        return None
    try:
        if section.stick_stiffness is None:
            return CoulombFriction(section.coefficient)
        return CoulombFriction(section.coefficient, section.stick_stiffness)
    except FrictionError as error:
        raise InputError(str(error)) from None


def build_hexahedra(scene: DeformableScene, name: str) -> HexahedralBlocks:
    """Build the blocks and the load of a scene, every block with hexahedra.

    Raises
    ------
    InputError
        When it describes nothing that can be built, or blocks without hexahedra.
    """
    if is_cell(scene):
        cell = build_cell(scene, name)
        return HexahedralBlocks(cell, scene_load(scene, name, cell), ())
    if isinstance(scene, MeshScene):
        from validation.build.own_blocks import build_own_blocks

        return build_own_blocks(scene, name)
    return build_blocks(scene)


def held_at_faces(scene: DeformableScene) -> bool:
    """Whether held blocks deform and are held at their outer faces; else they are rigid.

    A column of boxes stands on its bottom face: no block of it is rigid.
    """
    return scene.effects.elastic_frame or (isinstance(scene, AssemblyScene) and scene.stands)


def scene_load(scene: DeformableScene, name: str, assembly: Assembly) -> LoadCase:
    """Build the load of a scene on blocks already built.

    Raises
    ------
    InputError
        When the blocks cannot take it.
    """
    if isinstance(scene, MeshScene):
        from validation.build.own_blocks import own_load

        return own_load(scene, name, assembly)
    return build_load(scene, assembly)


def build_problem(scene: DeformableScene, name: str, blocks: HexahedralBlocks) -> Problem:
    """State the problem of a scene on its blocks, whatever is to solve it: a method or a deck.

    Where facets do not match, or the scene asks for it, contact searches facets that face each
    other (`Contact.finite_sliding`): explicit runs only.

    Raises
    ------
    InputError
        When it describes nothing that can be solved.
    """
    fem = fem_section(scene, name)
    assert scene.material is not None
    assert scene.contact is not None
    _check_load(name, blocks.load, scene.material.young_modulus)
    return Problem(
        blocks.assembly,
        blocks.load,
        build_material(scene.material),
        element=fem.element,
        law=contact_law(scene.contact),
        normals=ContactNormals.CURRENT,
        clearance=scene.contact.clearance,
        spacing=scene.contact.spacing,
        frames=Frames.DEFORMABLE if held_at_faces(scene) else Frames.RIGID,
        friction=build_friction(scene.effects),
        finite_sliding=scene.effects.finite_sliding or bool(blocks.unmatched),
        finite_rotation=scene.effects.finite_rotation,
        gravity=scene.effects.gravity,
    )


def build_deformable(scene: DeformableScene, name: str) -> DeformableAssembly:
    """Build the deformable blocks of a scene.

    Raises
    ------
    InputError
        When it describes nothing that can be solved.
    """
    blocks = build_hexahedra(scene, name)
    if fem_section(scene, name).method is Method.STATIC:
        _check_static(scene, name, blocks)
    problem = build_problem(scene, name, blocks)
    try:
        return problem.deformable
    except RefusedError as error:
        raise InputError(f"{name}: {error}") from None


def _check_load(name: str, load: LoadCase, young_modulus: float) -> None:
    """Refuse a load beyond the modulus: strains would be of the order of one."""
    acting = np.abs(load.pressure if load.tractions is None else load.tractions)
    largest = float(acting.max(initial=0.0)) if acting.ndim else float(acting)
    if largest > young_modulus:
        raise InputError(
            f"{name}: load.pressure: got {largest:g} MPa, more than material.young_modulus = "
            f"{young_modulus:g} MPa; expected less, for strains would be larger than one: "
            "give both in MPa"
        )


def _check_static(scene: DeformableScene, name: str, blocks: HexahedralBlocks) -> None:
    """Refuse a static run of blocks whose contact has to be searched."""
    if scene.effects.finite_sliding:
        raise InputError(
            f'{name}: effects.finite_sliding needs an explicit run: set fem.method = "explicit", '
            "or leave it out where blocks slide by less than a facet"
        )
    require_matching(
        name,
        blocks.unmatched,
        'a static run needs matching facets: mesh both alike there, or set fem.method = "explicit"',
    )


class ContactSearch(StrEnum):
    """Whether and why a run searches the facets that face each other."""

    NONE = "none (facets match and stay paired)"
    ASKED = "finite sliding"
    NEEDED = "finite sliding (joints do not match)"


@dataclass(frozen=True)
class TubeRun:
    """A deformable tube and its solution."""

    name: str
    scene: DeformableScene
    method: Method
    deformable: DeformableAssembly
    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm], world axes."""
    contact_state: ContactState
    """Facets in contact at the end, with pressures and overclosures."""
    solver: dict[str, Any]
    """Numbers of the solver: residual, iterations or steps, energies, …"""
    cpu_seconds: dict[str, float]
    """CPU time of each stage [s]."""
    errors: dict[str, float] = field(default_factory=dict)
    """Estimated error of discretisation of each measure, in its unit; empty where none was asked
    for."""

    @cached_property
    def _principal(self) -> tuple[FloatArray, ...]:
        finite = self.scene.effects.finite_rotation
        groups = self.deformable.model.groups
        return tuple(
            recover(group, u, finite_rotation=finite).principal
            for group, u in zip(groups, self.displacements, strict=True)
        )

    def displacement(self, block: int) -> FloatArray:
        """Nodal displacements of a deformable block, (n_nodes, 3) [mm]."""
        d = self.deformable
        u: FloatArray = self.displacements[int(d.group_of[block])][int(d.copy_of[block])]
        return u

    def principal(self, block: int) -> FloatArray:
        """Principal stresses at the nodes of a deformable block, (n_nodes, 3) [MPa]."""
        d = self.deformable
        sigma: FloatArray = self._principal[int(d.group_of[block])][int(d.copy_of[block])]
        return sigma

    def positions(self, block: int) -> FloatArray:
        """Nodes of a block before the load acts, spacing included, (n_nodes, 3) [mm]."""
        placed: FloatArray = self.deformable.assembly.nodes(block) + self.deformable.offsets[block]
        return placed

    @property
    def contact_search(self) -> ContactSearch:
        """Whether and why facets that face each other were searched."""
        if not self.deformable.contact.finite_sliding:
            return ContactSearch.NONE
        asked = self.scene.effects.finite_sliding
        return ContactSearch.ASKED if asked else ContactSearch.NEEDED

    @property
    def slip(self) -> dict[str, float] | None:
        """Largest slip and the size of its facet [mm]; None where facets are searched.

        Facets that stay paired as built give no answer beyond a slip of one facet.
        """
        if self.contact_search is not ContactSearch.NONE or not self.contact_state.n_facets:
            return None
        slip, size = largest_slip(self.deformable, self.displacements, self.contact_state.pressures)
        return {"largest": slip, "facet_size": size}

    @property
    def contact_index(self) -> IntArray:
        """Position of each contact facet in the assembly's interfaces, (n_facets,).

        Raises
        ------
        ValueError
            For a run with finite sliding, whose facets are no interfaces.
        """
        index = self.contact_state.interface
        if index is None:
            raise ValueError(f"{self.name}: facets that a search found are no interfaces")
        return index

    @property
    def facet_pressures(self) -> FloatArray:
        """Mean contact pressure of each facet, (n_facets,) [MPa]."""
        return self.contact_state.pressures

    @cached_property
    def contact(self) -> ContactMeasures:
        """The paper's measures of the contact pressures, and more."""
        return contact_measures(self.deformable.assembly, self.contact_state)

    @cached_property
    def stress_peaks(self) -> StressPeaks:
        """Extremes of the stresses inside elements."""
        assert self.scene.material is not None
        return stress_peaks(
            self.deformable,
            self.displacements,
            averaging_radius=self.scene.material.averaging_radius,
            finite_rotation=self.scene.effects.finite_rotation,
        )

    @cached_property
    def measures(self) -> dict[str, Measure]:
        """What the run answers: each number with its error, unit and place."""
        return run_measures(self)

    @cached_property
    def cap(self) -> CapAction | None:
        """Where the maximum stiffness of the contact law acted; None for a law without one."""
        return cap_action(self.deformable.contact.law, self.contact_state)

    @property
    def largest_displacement(self) -> float:
        """Largest nodal displacement [mm]."""
        return max(float(np.linalg.norm(u, axis=2).max()) for u in self.displacements)

    @property
    def drawing_scale(self) -> float:
        """Round factor that makes the displacement visible in a picture."""
        largest = self.largest_displacement
        if largest == 0.0:
            return 1.0
        reach = 0.15 * self.deformable.assembly.characteristic_length
        scale = 10.0 ** np.floor(np.log10(reach / largest))
        return float(max(scale, 1.0))

    @property
    def title(self) -> str:
        """Scene, load, method and mesh, for pictures."""
        gap = gap_words(self.scene.contact)
        if not self.is_tube:
            blocks = len(self.deformable.deformable_blocks)
            plural = "s" if blocks > 1 else ""
            return (
                f"{self.name}, {blocks} deformable block{plural}: {load_words(self.scene)}; "
                f"{self.method} FEM, "
                f"{self.deformable.model.n_elements} elements{gap}"
            )
        layers = self.deformable.assembly.n_layers
        elements = self.deformable.model.groups[0].mesh.n_elements
        part = f"{layers} layer{'s' if layers > 1 else ''}"
        if self.deformable.assembly.image_of is not None:
            part = "periodic cell"
        return (
            f"{self.name}, {part}: {load_words(self.scene)}; {self.method} FEM, "
            f"{elements} elements per block{gap}"
        )

    @property
    def is_tube(self) -> bool:
        """Whether the blocks stand round an axis, with inner and outer faces."""
        return isinstance(self.scene, RoundScene)


def contact_report(run: TubeRun) -> dict[str, float]:
    """Contact numbers of a run, without the values of each block."""
    return {
        number.name: getattr(run.contact, number.name)
        for number in fields(run.contact)
        if number.name != "per_block"
    }


def tube_json(run: TubeRun, peak_memory_mb: float) -> dict[str, Any]:
    """Return the result as plain data, numbers in full precision."""
    model = run.deformable.model
    principal = [run.principal(b) for b in run.deformable.deformable_blocks.tolist()]
    return {
        "scene": run.name,
        "method": str(run.method),
        "n_blocks": len(run.deformable.deformable_blocks),
        "n_elements": model.n_elements,
        "n_nodes": model.n_nodes,
        "contact_search": str(run.contact_search),
        "slip": run.slip,
        "n_contacts": run.contact_state.n_facets,
        "max_displacement": run.largest_displacement,
        "principal_stress": {
            "max": max(float(p[:, 0].max()) for p in principal),
            "min": min(float(p[:, 2].min()) for p in principal),
        },
        "measures": {name: measure.as_json() for name, measure in run.measures.items()},
        "joints": joints_json(run),
        "contact": contact_report(run),
        "contact_cap": None if run.cap is None else asdict(run.cap),
        **run.solver,
        "cpu_seconds": run.cpu_seconds,
        "peak_memory_mb": peak_memory_mb,
    }
