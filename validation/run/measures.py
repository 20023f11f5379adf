"""Measures of a deformable run: value, error, unit and place of each, under one name each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from fem.assembly.contact_state import ContactMeasures, ContactState
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.peaks import (
    Peak,
    StressPeaks,
    largest_displacement,
    largest_pressure,
    mean_of_block_maxima,
)
from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from validation.scene.read import DeformableScene


class Answered(Protocol):
    """What measures need of a run, `validation.run.deformable.DeformableRun`."""

    @property
    def scene(self) -> DeformableScene:
        """What was asked."""

    @property
    def deformable(self) -> DeformableAssembly:
        """Blocks and their contact."""

    @property
    def displacements(self) -> tuple[FloatArray, ...]:
        """Of each group, (n_copies, n_nodes, 3) [mm]."""

    @property
    def contact_state(self) -> ContactState:
        """Facets in contact at the end."""

    @property
    def contact(self) -> ContactMeasures:
        """The paper's measures of the contact pressures."""

    @property
    def stress_peaks(self) -> StressPeaks:
        """Extremes of the stresses inside elements."""

    @property
    def errors(self) -> dict[str, float]:
        """Estimated error of each measure."""

    @property
    def measures(self) -> dict[str, Measure]:
        """The measures themselves."""

    @property
    def is_tube(self) -> bool:
        """Whether the blocks stand about an axis."""


@dataclass(frozen=True)
class Measure:
    """One number of an answer."""

    value: float
    """In its unit."""
    unit: str
    """``MPa`` or ``mm``."""
    error: float | None = None
    """Estimate of the error of discretisation, in the same unit; None where none was asked for."""
    place: dict[str, Any] | None = None
    """Where the value is, of measures that have a place."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data; a place only where there is one."""
        found: dict[str, Any] = {"value": self.value, "error": self.error, "unit": self.unit}
        return found if self.place is None else found | {"place": self.place}


def run_measures(run: Answered) -> dict[str, Measure]:
    """Measure a run: what the paper prints, and what converges.

    `p_eff` and `p_max` are the paper's means over facets. `p_max_point` is the largest pressure at
    a point, `sigma_1_max` and `sigma_3_min` are principal stresses sampled inside elements,
    `sigma_1_averaged` is that of the stress averaged over a ball of `averaging_radius`.
    """
    found = _values(run)
    return {name: replace(measure, error=run.errors.get(name)) for name, measure in found.items()}


def _values(run: Answered) -> dict[str, Measure]:
    deformable, scene = run.deformable, run.scene
    assert scene.material is not None
    radius = scene.material.averaging_radius
    stress = run.stress_peaks

    def at(peak: Peak, unit: str = "MPa") -> Measure:
        return Measure(peak.value, unit, place=place(run, peak))

    averaged = at(stress.sigma_1_averaged)
    assert averaged.place is not None
    averaged.place["averaging_radius"] = radius
    pressures = {}
    if deformable.meets:
        largest = largest_pressure(deformable, deformable.contact.law, run.contact_state)
        pressures = {
            "p_eff": Measure(run.contact.p_eff, "MPa"),
            "p_max": Measure(run.contact.p_max_face, "MPa"),
            "p_max_point": Measure(0.0, "MPa") if largest is None else at(largest),
        }
    return pressures | {
        "sigma_1_max": at(stress.sigma_1),
        "sigma_3_min": at(stress.sigma_3),
        "sigma_1_averaged": averaged,
        "max_displacement": at(largest_displacement(deformable, run.displacements), "mm"),
    }


def bracketed(run: Answered) -> dict[str, float]:
    """How far both sides of each peak lie apart in the run itself [MPa].

    Means over facets and integration points against corners of facets, integration points against
    corners of elements.
    """
    law, state, found = run.deformable.contact.law, run.contact_state, run.measures
    stress, pressures = run.stress_peaks, {}
    if run.deformable.meets:
        corners = mean_of_block_maxima(run.deformable, law, state)
        pressures = {
            "p_max": abs(corners - found["p_max"].value),
            "p_max_point": abs(found["p_max_point"].value - run.contact.p_max_point),
        }
    return pressures | {
        "sigma_1_max": abs(stress.sigma_1_at_corners - stress.sigma_1.value),
        "sigma_3_min": abs(stress.sigma_3_at_corners - stress.sigma_3.value),
    }


def place(run: Answered, peak: Peak) -> dict[str, Any]:
    """Say where a value is: blocks, layer, face and position, of tubes also about their axis."""
    assembly = run.deformable.assembly
    found: dict[str, Any] = {
        "blocks": list(peak.blocks),
        "layer": int(assembly.layer[peak.blocks[0]]),
        "face": peak.face,
        "position": peak.position.tolist(),
    }
    return found | (about_axis(assembly, peak.position) if run.is_tube else {})


def about_axis(assembly: Assembly, position: FloatArray) -> dict[str, float]:
    """Radius [mm], angle [degrees] and height [mm] of a point of a tube."""
    from_axis = position - assembly.origin
    height = float(from_axis @ assembly.axis)
    radial = from_axis - height * assembly.axis
    angle = float(np.degrees(np.arctan2(radial[1], radial[0]))) % 360.0
    return {"radius": float(np.linalg.norm(radial)), "angle": angle, "height": height}


def place_words(measure: Measure) -> str:
    """Where a value is, in words; nothing for measures without a place."""
    where = measure.place
    if where is None:
        return ""
    blocks = " and ".join(str(b) for b in where["blocks"])
    words = f"block{'s' if len(where['blocks']) > 1 else ''} {blocks}, layer {where['layer']}"
    if where["face"] is not None:
        words += f", face {where['face']}"
    if "radius" in where:
        return f"{words}, r {where['radius']:.1f}, {where['angle']:.1f}°, z {where['height']:.1f}"
    return f"{words}, at ({', '.join(f'{x:.1f}' for x in where['position'])})"


def value_words(measure: Measure) -> str:
    """Value with its error and unit: digits that the error leaves out are not printed."""
    value, error = measure.value, measure.error
    if error is None or not error > 0.0:
        return f"{value:.5g} {measure.unit}"
    digits = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{digits}f} ± {error:.{digits}f} {measure.unit}"


def drawing_scale(largest: float, size: float) -> float:
    """Power of ten that makes a displacement visible against a size, both [mm]; at least one."""
    if largest == 0.0:
        return 1.0
    return float(max(10.0 ** np.floor(np.log10(0.15 * size / largest)), 1.0))
