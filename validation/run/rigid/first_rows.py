"""What a rigid answer is read for first: largest pressure and where, joint forces, reaction.

Plain data, each with ``value``, ``unit`` and mostly ``place``. The paper's measures are means over
blocks and facets; these act on one facet, in one joint, and on the supports.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.answer import about_axis, face_names
from geometry.assembly import AnyBlocks, Assembly
from geometry.measures import JointResultants
from geometry.mesh import BoolArray, FloatArray, IntArray
from validation.scene.family import RoundScene

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}


def measure(value: float, unit: str, place: dict[str, Any]) -> dict[str, Any]:
    """Return a measure as plain data."""
    return {"value": value, "unit": unit, "place": place}


def largest_facet_pressure(
    assembly: Assembly, index: IntArray, pressures: FloatArray, *, tube: bool
) -> dict[str, Any] | None:
    """Largest mean pressure over a facet, and where; None without contacts.

    Pressures are those of the contacts at places ``index`` of the interfaces, (n,) [MPa]. Of tubes
    the place is given about their axis as well.
    """
    if not len(index):
        return None
    found, worst = assembly.interfaces, int(np.argmax(pressures))
    contact = int(index[worst])
    blocks = [int(found.block_m[contact]), int(found.block_s[contact])]
    position = found.centroids[contact]
    place: dict[str, Any] = {
        "blocks": blocks,
        "layer": int(assembly.layer[blocks[0]]),
        "face": face_names(assembly, found.block_m[[contact]], found.facet_m[[contact]]).item(),
        "position": position.tolist(),
    }
    place |= about_axis(assembly, position) if tube else {}
    area = float(found.areas[contact])
    return measure(float(pressures[worst]), "MPa", place) | {"facet_area": area}


def joint_extremes(joints: JointResultants) -> dict[str, dict[str, Any]]:
    """Least and largest normal force between two blocks; nothing where none touch."""
    if not len(joints.block_m):
        return {}
    force = joints.normal_force
    found = {}
    for name, k in (
        ("least_joint_force", int(np.argmin(force))),
        ("largest_joint_force", int(np.argmax(force))),
    ):
        blocks = [int(joints.block_m[k]), int(joints.block_s[k])]
        place = {"blocks": blocks, "position": joints.centroids[k].tolist()}
        found[name] = measure(float(force[k]), "N", place)
    return found


def total_reaction(
    assembly: AnyBlocks, index: IntArray, forces: FloatArray, held: BoolArray
) -> dict[str, Any]:
    """Force of all held blocks on the free ones, which balances load and weight.

    ``forces`` act on block s of the contacts at places ``index`` of the interfaces, (n, 3) [N];
    ``held`` (n_blocks,).
    """
    found = assembly.interfaces
    sign = held[found.block_m[index]].astype(float) - held[found.block_s[index]].astype(float)
    force = (sign[:, None] * forces).sum(axis=0)
    return {"value": float(np.linalg.norm(force)), "unit": "N", "force": force.tolist()}


def ring_pressure(scene: object) -> dict[str, Any] | None:
    """Mean hoop stress p·r/t of a closed ring, by hand; None but for tubes under pressure."""
    if not isinstance(scene, RoundScene) or scene.load.case not in _RINGS:
        return None
    face, sense = _RINGS[scene.load.case]
    pressure, thickness = scene.load.pressure, scene.thickness
    radius = float(scene.block.inner_radius)  # type: ignore[attr-defined]
    radius += thickness * (face == "outer")
    return {
        "value": abs(pressure) * radius / thickness,
        "unit": "MPa",
        "radius": radius,
        "sense": sense if pressure >= 0.0 else _OPPOSITE[sense],
    }
