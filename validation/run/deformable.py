"""Deformable tubes of a scene: the model, and a result in terms that pictures and JSON use."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from fem.assembly.contact_state import ContactState
from fem.assembly.deformable import (
    DeformableAssembly,
)
from fem.assembly.measures import CapAction, ContactMeasures, cap_action, contact_measures
from fem.assembly.peaks import StressPeaks, stress_peaks
from fem.problem.recovery import recover
from geometry.mesh import FloatArray, IntArray
from validation.build.deformable import gap_words
from validation.run.measures import Measure, joints_json, run_measures
from validation.run.slip import largest_slip
from validation.run.words import load_words
from validation.scene.deformable import Method
from validation.scene.family import RoundScene
from validation.scene.read import DeformableScene


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
