"""Measures of a deformable run: value, error, unit and place of each, under one name each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fem.assembly.contact_state import corner_displacements
from fem.assembly.deformable import DeformableAssembly
from fem.assembly.peaks import Peak
from geometry.assembly import Assembly
from geometry.mesh import FloatArray


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


@dataclass(frozen=True)
class FrictionSet:
    """Where an answer with friction lies among those that the laws admit."""

    member: str
    """How the load was applied."""
    change: dict[str, float]
    """Of each measure when half as many load steps are taken, in its unit; empty where only one
    number of them was solved."""
    width: dict[str, float]
    """Of each measure after the way past the load and back, relative to that straight up, less
    one [-]; empty where that way has no end."""
    remark: str
    """Why there is no width, or where it was found."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "member": self.member,
            "change_by_load_steps": self.change,
            "past_and_back": self.width,
            "remark": self.remark,
        }


def largest_slip(
    deformable: DeformableAssembly, displacements: Sequence[FloatArray], pressures: FloatArray
) -> tuple[float, float]:
    """Largest slip between facets that press on each other, and the size of its facet [mm].

    Displacements are those of each group, (n_copies, n_nodes, 3) [mm], pressures those of facets as
    built, (n_facets,) [MPa].
    """
    surfaces = deformable.surfaces
    on_m, on_s = np.split(corner_displacements(deformable, tuple(displacements)), 2, axis=1)
    jump: FloatArray = on_s - on_m
    normal = surfaces.normals.mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along = np.einsum("fai,fi->fa", jump, normal)
    slip = np.linalg.norm(jump - along[:, :, None] * normal[:, None], axis=2).max(axis=1)
    size = np.sqrt(surfaces.areas)
    pressing = pressures > 0.0
    worst = int(np.argmax(np.where(pressing, slip / size, 0.0)))
    return float(slip[worst]) if pressing.any() else 0.0, float(size[worst])


def place(assembly: Assembly, peak: Peak, *, tube: bool) -> dict[str, Any]:
    """Say where a value is: blocks, layer, face and position, of tubes also about their axis."""
    found: dict[str, Any] = {
        "blocks": list(peak.blocks),
        "layer": int(assembly.layer[peak.blocks[0]]),
        "face": peak.face,
        "position": peak.position.tolist(),
    }
    return found | (about_axis(assembly, peak.position) if tube else {})


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
