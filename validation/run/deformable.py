"""A scene of deformable blocks and its answer, in terms that pictures, tables and JSON read."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

from fem.answer import answer_of
from fem.assembly.statement import Problem
from fem.element.hexahedron import ElementType
from fem.element.lagrange_mesh import LagrangeMesh
from fem.solution import Solution
from geometry.answer import Answer, Measure
from geometry.assembly import Assembly
from geometry.measures import SectionError, SectionForces
from geometry.mesh import FloatArray
from geometry.system import peak_memory_mb
from validation.build.doubts import doubts
from validation.build.own_blocks import bare_joints
from validation.build.polyhedra import build_polyhedra
from validation.build.sections import scene_planes
from validation.errors import named
from validation.run.measures import FrictionSet, StaticReference
from validation.scene.family import RoundScene
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene
from validation.scene.read import DeformableScene

#: Why a run has no error bars.
NOT_AT_REST = "not at rest: no error bar"
#: Poisson's ratio from which mean stresses oscillate [-]: on TSB1, 24 × 2 × 8 elements, σ₁ of
#: incompatible modes is then twice that of b-bar (1.2 times at 0.2), 12 times at 0.4999.
NEARLY_INCOMPRESSIBLE = 0.49
#: Elements of degree 1 with one mean stress each.
_MEAN_STRESS = (ElementType.B_BAR, ElementType.REDUCED)


class ContactSearch(StrEnum):
    """Whether and why a run searches the facets that face each other."""

    NONE = "matching meshes, fixed pairs (small sliding)"
    ASKED = "finite sliding"
    NEEDED = "finite sliding (non-matching meshes)"


@dataclass(frozen=True)
class DeformableRun:
    """A scene of deformable blocks, what its solver found, and the answer made of it."""

    name: str
    scene: DeformableScene
    problem: Problem
    """What its scene states."""
    solution: Solution
    """Displacements, stresses, contact, and what the solver says of itself."""
    cpu_seconds: dict[str, float]
    """CPU time of each stage [s]."""
    errors: dict[str, float] = field(default_factory=dict)
    """Estimated error of each measure, in its unit: of the mesh, with friction also of the load
    steps; empty where none was asked for."""
    facets: tuple[Assembly, FloatArray] | None = None
    """The mesh of the scene where finer ones were solved, and the mean pressure on each of its
    interfaces, (n,) [MPa]."""
    remarks: dict[str, str] = field(default_factory=dict)
    """Why values are none to use, by measure."""
    factors: dict[str, Measure] = field(default_factory=dict)
    """Load factors at first cracking and crushing; empty without strengths."""
    refinement: dict[str, Any] = field(default_factory=dict)
    """Meshes that were solved to reach an accuracy, as plain data; empty for one mesh."""
    friction: FrictionSet | None = None
    """Which member of the set of answers with friction this is; None without friction, or where
    that was not asked for."""
    reference: StaticReference | None = None
    """The converged static state, beside an explicit run that is damped to the static state."""

    @cached_property
    def answer(self) -> Answer:
        """The answer that does not depend on the solver; its report says more of the scene."""
        return answer_of(
            self.solution,
            self.errors,
            facets=self.facets,
            remarks=self.remarks,
            factors=self.factors,
            problem=self.problem,
            title=self.title,
            beside=self._beside,
        )

    @property
    def sections(self) -> SectionForces | None:
        """Forces through the planes of the scene; None where it has none, or none are known."""
        return self._sections[0]

    @cached_property
    def _sections(self) -> tuple[SectionForces | None, str]:
        """The same, and why they are not known: the state that was solved is an answer without."""
        with named(self.name):
            cut = scene_planes(self.scene, self.solution.deformable.assembly)
        try:
            return None if cut is None else self.solution.sections(cut), ""
        except SectionError as error:
            return None, f"none: {error}"

    def _beside(self) -> dict[str, Any]:
        """What the report says of the scene, and of the process that solved it."""
        friction = {} if self.friction is None else {"friction": self.friction.as_json()}
        static = {}
        if self.reference is not None:
            static["static_reference"] = self.reference.as_json(self.answer.measures)
        return {
            "scene": self.name,
            "load": self.scene.load_words,
            **self.notes,
            **friction,
            **static,
            **self.refinement,
            **({} if self.sections is None else {"sections": self.sections.as_json()}),
            **(
                {"contact_search": str(self.contact_search)}
                if self.solution.deformable.meets
                else {}
            ),
            "cpu_seconds": self.cpu_seconds,
            "peak_memory_mb": peak_memory_mb(),
        }

    @property
    def contact_search(self) -> ContactSearch:
        """Whether and why facets that face each other were searched."""
        if not self.solution.deformable.contact.finite_sliding:
            return ContactSearch.NONE
        requested = self.scene.effects.finite_sliding
        return ContactSearch.ASKED if requested else ContactSearch.NEEDED

    @property
    def title(self) -> str:
        """Scene, load, method and mesh, for pictures."""
        d, each = self.solution.deformable, ""
        solved = d.model.groups[0].mesh
        degree = f" of degree {solved.degree}" if isinstance(solved, LagrangeMesh) else ""
        if isinstance(self.scene, RoundScene):
            count, what = d.assembly.n_layers, "layer"
            elements, each = d.model.groups[0].mesh.n_elements, " per block"
        else:
            count, what, elements = len(d.deformable_blocks), "deformable block", d.model.n_elements
        part = f"{count} {what}{'s' if count > 1 else ''}"
        if d.assembly.image_of is not None:
            part = "periodic cell"
        return (
            f"{self.name}, {part}: {self.scene.load_words}; {self.solution.method} FEM, "
            f"{elements} elements{degree}{each}{self.scene.gap_words}"
        )

    @property
    def is_moving(self) -> bool:
        """Whether a run that is damped to the static state ended before it; not by round-off."""
        state, result = self.solution.quasi_static, self.solution.explicit
        if state is None or result is None or self.scene.damping != "static":
            return False
        return not state.is_static and result.round_off is None

    @cached_property
    def notes(self) -> dict[str, str]:
        """What no key of the scene says of its elements, by the name of the row."""
        assembly = self.solution.deformable.assembly
        why_none = self._sections[1]
        notes: dict[str, str] = {"sections": why_none} if why_none else {}
        if self.is_moving:
            notes["error bars"] = NOT_AT_REST
        if isinstance(self.scene, PolyhedralScene):
            meets = self.solution.deformable.meets
            surfaces = build_polyhedra(self.scene, Path()) if meets else None
            notes |= doubts(self.scene, assembly, Path(), surfaces)
            bare = [] if surfaces is None else bare_joints(surfaces)
            more = f" and {len(bare) - 1} more pairs" if len(bare) > 1 else ""
            if bare:
                notes["edge contacts"] = (
                    f"left out: blocks {assembly.named(bare[0][0])} and "
                    f"{assembly.named(bare[0][1])}{more} touch along an edge or at a point alone"
                )
        groups = self.solution.deformable.model.groups
        bounded = not isinstance(groups[0].mesh, LagrangeMesh) and groups[0].element in _MEAN_STRESS
        ratio = max(group.material.poisson_ratio for group in groups)
        if ratio >= NEARLY_INCOMPRESSIBLE and not bounded:
            notes["nearly incompressible"] = (
                f"ν = {ratio:g}: the mean stress oscillates in these "
                'elements, and σ₁ and σ₃ with it; set fem.element = "b-bar"'
            )
        if self.scene.straightened(assembly):
            notes["edges"] = STRAIGHT_EDGES
        sizes = [shape.tetrahedra for shape in assembly.shapes if shape.tetrahedra is not None]
        if sizes:
            to = f" to {max(sizes):.3g}" if max(sizes) > min(sizes) else ""
            notes["tetrahedra"] = (
                f"size {min(sizes):.3g}{to} mm (mesh.size; by default ∛V), each split into "
                "four hexahedra"
            )
        return notes
