"""The answer to a scene of deformable blocks, in terms that pictures, tables and JSON read."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from fem.answer import Answer
from fem.assembly.contact_state import CapAction, ContactMeasures, ContactState, cap_action
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.peaks import (
    Peak,
    StressPeaks,
    joint_forces,
    largest_displacement,
    largest_pressure,
    mean_of_block_maxima,
    stress_peaks,
)
from fem.element.lagrange_mesh import in_pieces
from fem.explicit.setup.quasi_static import QuasiStaticReport, quasi_static_report
from fem.explicit.solve import ExplicitResult
from fem.problem.time_step import added_mass_share
from fem.static.result import StaticResult
from geometry.assembly import Assembly
from geometry.measures import JointResultants
from geometry.mesh import FloatArray, IntArray
from validation.run.measures import FrictionSet, Measure, drawing_scale, largest_slip, place
from validation.run.stages import peak_memory_mb
from validation.scene.deformable import Method
from validation.scene.family import RoundScene
from validation.scene.polyhedra import STRAIGHT_EDGES
from validation.scene.read import DeformableScene


class ContactSearch(StrEnum):
    """Whether and why a run searches the facets that face each other."""

    NONE = "none (facets match and stay paired)"
    ASKED = "finite sliding"
    NEEDED = "finite sliding (joints do not match)"


@dataclass(frozen=True)
class DeformableRun:
    """The deformable blocks of a scene, and the answer to what it asks."""

    name: str
    scene: DeformableScene
    answer: Answer
    """Displacements, stresses, contact, and what the solver says of itself."""
    cpu_seconds: dict[str, float]
    """CPU time of each stage [s]."""
    errors: dict[str, float] = field(default_factory=dict)
    """Estimated error of each measure, in its unit: of the mesh, with friction also of the load
    steps; empty where none was asked for."""
    left_out: frozenset[str] = frozenset()
    """Measures that are another number on this mesh than on the scene's, and not told."""
    friction: FrictionSet | None = None
    """Which member of the set of answers with friction this is; None without friction, or where
    that was not asked for."""

    @property
    def deformable(self) -> DeformableAssembly:
        """What was solved."""
        return self.answer.deformable

    @property
    def displacements(self) -> tuple[FloatArray, ...]:
        """Of each group, (n_copies, n_nodes, 3) [mm], world axes."""
        return self.answer.group_displacements

    @property
    def contact_state(self) -> ContactState:
        """Facets in contact at the end, with pressures and overclosures."""
        return self.answer.contact_state

    @property
    def static(self) -> StaticResult | None:
        """What the static solver says of itself; None for an explicit run."""
        return self.answer.static

    @property
    def explicit(self) -> ExplicitResult | None:
        """What the explicit run says of itself; None for a static one."""
        return self.answer.explicit

    @property
    def method(self) -> Method:
        """How the scene was solved."""
        return Method.EXPLICIT if self.static is None else Method.STATIC

    @property
    def meets(self) -> bool:
        """Whether blocks meet; else they are single bodies."""
        return self.deformable.meets

    @cached_property
    def drawn(self) -> Assembly:
        """Blocks of straight pieces between the nodes of their elements, for pictures."""
        assembly = self.deformable.assembly
        if self.scene.fem is None or self.scene.fem.degree == 1:
            return assembly
        return replace(assembly, shapes=tuple(in_pieces(shape) for shape in assembly.shapes))

    def displacement(self, block: int) -> FloatArray:
        """Nodal displacements of a deformable block, (n_nodes, 3) [mm]."""
        d = self.deformable
        return self.displacements[int(d.group_of[block])][int(d.copy_of[block])]

    def principal(self, block: int) -> FloatArray:
        """Principal stresses at the nodes of a deformable block, (n_nodes, 3) [MPa]."""
        d = self.deformable
        found = self.answer.recovered[int(d.group_of[block])]
        return found.principal[int(d.copy_of[block])]

    def positions(self, block: int) -> FloatArray:
        """Nodes of a block before the load acts, spacing included, (n_nodes, 3) [mm]."""
        return self.deformable.assembly.nodes(block) + self.deformable.offsets[block]

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

    @property
    def contact(self) -> ContactMeasures:
        """The paper's measures of the contact pressures, and more."""
        return self.answer.measures

    @cached_property
    def joints(self) -> JointResultants:
        """Resultants of the contact forces between each two blocks; friction is not in them."""
        return joint_forces(self.contact_state)

    @cached_property
    def stress_peaks(self) -> StressPeaks:
        """Extremes of the stresses inside elements."""
        return stress_peaks(
            self.deformable,
            self.displacements,
            averaging_radius=self._averaging_radius,
            finite_rotation=self.scene.effects.finite_rotation,
        )

    @property
    def _averaging_radius(self) -> float:
        assert self.scene.material is not None
        return self.scene.material.averaging_radius

    @cached_property
    def measures(self) -> dict[str, Measure]:
        """What the run answers: each number with its error, unit and place.

        `p_eff` and `p_max` are the paper's means over facets. `p_max_point` is the largest pressure
        at a point, `sigma_1_max` and `sigma_3_min` are principal stresses sampled inside elements,
        `sigma_1_averaged` is that of the stress averaged over a ball of `averaging_radius`.
        """
        stress = self.stress_peaks
        averaged = self._measure(stress.sigma_1_averaged, averaging_radius=self._averaging_radius)
        pressures = self._pressures if self.meets else {}
        found = pressures | {
            "sigma_1_max": self._measure(stress.sigma_1),
            "sigma_3_min": self._measure(stress.sigma_3),
            "sigma_1_averaged": averaged,
            "max_displacement": self._measure(
                largest_displacement(self.deformable, self.displacements), "mm"
            ),
        }
        return {
            name: replace(measure, error=self.errors.get(name))
            for name, measure in found.items()
            if name not in self.left_out
        }

    @property
    def _pressures(self) -> dict[str, Measure]:
        law = self.deformable.contact.law
        largest = largest_pressure(self.deformable, law, self.contact_state)
        return {
            "p_eff": Measure(self.contact.p_eff, "MPa"),
            "p_max": Measure(self.contact.p_max_face, "MPa"),
            "p_max_point": Measure(0.0, "MPa") if largest is None else self._measure(largest),
        }

    def _measure(self, peak: Peak, unit: str = "MPa", **beside: float) -> Measure:
        """Value and place of a peak, and what stands beside the place."""
        where = place(self.deformable.assembly, peak, tube=self.is_tube)
        return Measure(peak.value, unit, place=where | beside)

    @property
    def load_step_change(self) -> dict[str, float]:
        """Change of each measure by half as many load steps, in its unit; empty if not known."""
        coarse = None if self.static is None else self.static.coarser_loading
        if coarse is None:
            return {}
        answer = replace(
            self.answer,
            solver=coarse,
            group_displacements=coarse.displacements,
            contact_state=coarse.contact_state,
        )
        before = replace(self, answer=answer, errors={}).measures
        return {name: abs(m.value - before[name].value) for name, m in self.measures.items()}

    @property
    def bracketed(self) -> dict[str, float]:
        """How far both sides of each peak lie apart in the run itself [MPa].

        Means over facets and integration points against corners of facets, integration points
        against corners of elements.
        """
        stress, found, pressures = self.stress_peaks, self.measures, {}
        if self.meets:
            law = self.deformable.contact.law
            corners = mean_of_block_maxima(self.deformable, law, self.contact_state)
            pressures = {
                "p_max": abs(corners - found["p_max"].value),
                "p_max_point": abs(found["p_max_point"].value - self.contact.p_max_point),
            }
        return pressures | {
            "sigma_1_max": abs(stress.sigma_1_at_corners - stress.sigma_1.value),
            "sigma_3_min": abs(stress.sigma_3_at_corners - stress.sigma_3.value),
        }

    @cached_property
    def cap(self) -> CapAction | None:
        """Where the maximum stiffness of the contact law acted; None for a law without one."""
        state = self.contact_state
        law = self.deformable.contact.law
        return cap_action(law, state.point_pressures, state.point_areas)

    @cached_property
    def quasi_static(self) -> QuasiStaticReport | None:
        """How static the end of an explicit run is; None where nothing recommends a frequency."""
        result, stated = self.explicit, self.answer.statement
        if result is None or stated is None or stated.recommended is None:
            return None
        assert self.scene.fem is not None
        return quasi_static_report(
            result,
            ramp_time=stated.ramp_time,
            frequency=stated.recommended.frequency,
            largest_residual=self.scene.fem.residual,
        )

    @property
    def released_at_start(self) -> float | None:
        """Energy that contact holds before any load acts, over the largest work of the loads [-].

        None where it is less than that work, as it is unless the law presses hard at zero
        clearance.
        """
        if self.explicit is None:
            return None
        history = self.explicit.history
        held, work = history.column("contact_energy")[:1], np.abs(history.column("external_work"))
        return float(held[0] / work.max()) if held.size and held[0] > work.max() > 0.0 else None

    @property
    def energy_balance(self) -> float | None:
        """Error of the balance of energies [-]; None for static blocks in contact."""
        if self.explicit is not None:
            return self.explicit.energy_balance
        if self.static is None or self.meets:
            return None
        strain = self.static.strain_energy
        return abs(self.static.external_work - strain) / max(strain, 1e-300)

    @property
    def largest_displacement(self) -> float:
        """Largest nodal displacement [mm]."""
        return max(float(np.linalg.norm(u, axis=2).max()) for u in self.displacements)

    @property
    def drawing_scale(self) -> float:
        """Round factor that makes the displacement visible in a picture."""
        size = self.deformable.assembly.characteristic_length
        return drawing_scale(self.largest_displacement, size)

    @property
    def title(self) -> str:
        """Scene, load, method and mesh, for pictures."""
        d, fem, each = self.deformable, self.scene.fem, ""
        degree = f" of degree {fem.degree}" if fem is not None and fem.degree > 1 else ""
        if self.is_tube:
            count, what = d.assembly.n_layers, "layer"
            elements, each = d.model.groups[0].mesh.n_elements, " per block"
        else:
            count, what, elements = len(d.deformable_blocks), "deformable block", d.model.n_elements
        part = f"{count} {what}{'s' if count > 1 else ''}"
        if d.assembly.image_of is not None:
            part = "periodic cell"
        return (
            f"{self.name}, {part}: {self.scene.load_words}; {self.method} FEM, "
            f"{elements} elements{degree}{each}{self.scene.gap_words}"
        )

    @property
    def straightened(self) -> bool:
        """Whether files have nodes between corners, which elements of degree 1 have no use for."""
        return self.scene.straightened(self.deformable.assembly)

    @property
    def is_tube(self) -> bool:
        """Whether the blocks stand round an axis, with inner and outer faces."""
        return isinstance(self.scene, RoundScene)


def contact_report(run: DeformableRun) -> dict[str, float]:
    """Contact numbers of a run, without the values of each block."""
    return {name: value for name, value in vars(run.contact).items() if name != "per_block"}


def run_json(run: DeformableRun) -> dict[str, Any]:
    """Return the result as plain data, numbers in full precision."""
    model = run.deformable.model
    principal = [run.principal(b) for b in run.deformable.deformable_blocks.tolist()]
    return {
        "scene": run.name,
        "method": str(run.method),
        "n_blocks": len(run.deformable.deformable_blocks),
        "n_elements": model.n_elements,
        "n_nodes": model.n_nodes,
        **({"edges": STRAIGHT_EDGES} if run.straightened else {}),
        "max_displacement": run.largest_displacement,
        "principal_stress": {
            "max": max(float(p[:, 0].max()) for p in principal),
            "min": min(float(p[:, 2].min()) for p in principal),
        },
        "measures": {name: measure.as_json() for name, measure in run.measures.items()},
        **({} if run.friction is None else {"friction": run.friction.as_json()}),
        **(_contact_json(run) if run.meets else {"faces": face_displacements(run)}),
        **_static_json(run),
        **_explicit_json(run),
        "cpu_seconds": run.cpu_seconds,
        "peak_memory_mb": peak_memory_mb(),
    }


def _contact_json(run: DeformableRun) -> dict[str, Any]:
    """What only blocks that meet have."""
    return {
        "contact_search": str(run.contact_search),
        "slip": run.slip,
        "n_contacts": run.contact_state.n_facets,
        "joints": run.joints.as_json(),
        **({} if run.left_out else {"contact": contact_report(run)}),
        "contact_cap": None if run.cap is None else asdict(run.cap),
    }


def face_displacements(run: DeformableRun) -> dict[str, dict[str, list[float]]]:
    """Mean displacement of each named face of the first block, weighted by facet area."""
    found = {}
    block = run.deformable.assembly.shape(0)
    for name in block.faces:
        surface = block.surface(name)
        facet = run.displacement(0)[surface.quads].mean(axis=1)
        mean = surface.areas @ facet / surface.areas.sum()
        found[name] = {"mean_displacement": mean.tolist()}
    return found


def _static_json(run: DeformableRun) -> dict[str, Any]:
    """What a static solver says of itself."""
    result = run.static
    if result is None:
        return {}
    energies = ("strain_energy", "contact_energy", "external_work", "frictional_dissipation")
    data = {
        "status": result.status,
        "residual": result.residual,
        "newton_iterations": result.newton_iterations,
        "symmetry": result.symmetry,
        "loose_blocks": result.loose_blocks.tolist(),
        "load_steps": result.load_steps,
        "energies": {name: getattr(result, name) for name in energies},
    }
    return data if run.meets else data | {"energy_balance": run.energy_balance}


def _explicit_json(run: DeformableRun) -> dict[str, Any]:
    """What an explicit run says of itself."""
    result, stated = run.explicit, run.answer.statement
    if result is None or stated is None:
        return {}
    energies = result.energies
    data: dict[str, Any] = {
        "status": str(result.status),
        "n_steps": result.n_steps,
        "time": result.time,
        "time_step": result.time_step,
        "critical_time_step": result.critical.critical_time_step,
        "residual": result.residual,
        "newton_iterations": None,
        "energies": None
        if energies is None
        else asdict(energies)
        | {"viscous_dissipation": energies.viscous_dissipation, "total": energies.total},
        "energy_balance": result.energy_balance,
        "element_updates_per_cpu_second": result.element_updates_per_cpu_second,
        "added_mass": added_mass_share(stated.assembly.model),
        "bytes_per_node": (result.state_bytes + result.constant_bytes)
        / stated.assembly.model.n_nodes,
    }
    if stated.recommended is None:
        return data
    report = run.quasi_static
    assert report is not None
    return data | {
        "counted_pressure": stated.counted_pressure,
        "released_at_start": run.released_at_start,
        "quasi_static": asdict(report),
        "recommended": asdict(stated.recommended),
        "restarts": run.answer.restarts,
    }
