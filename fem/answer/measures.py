"""Measures of a state of deformable blocks: fixed names, each with its unit and place.

`p_eff` and `p_max` are the paper's means over facets, `p_max_facet` is the largest mean over a
facet, `p_max_point` the largest pressure at a point. `sigma_1_max`, `sigma_3_min` and `mises_max`
are sampled inside elements, `sigma_1_averaged` is the first principal stress of the stress averaged
over a ball of `Material.averaging_radius`. Where meshes do not match and joints have friction,
`largest_joint_force` is the largest normal force between two blocks.

How far blocks move tells whether a state is what it is taken for.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.answer.forces import joints_of, push_curves_of, work_of_motion
from fem.answer.pressures import (
    LARGEST_FACTOR,
    ContactMeasures,
    contact_measures,
    largest_pressure,
    pressure_between_nodes,
)
from fem.state import State, once
from fem.stresses.recovery import (
    Peak,
    block_displacements,
    nearest_face,
    nodal_stress_range,
    stress_peaks,
)
from fem.system.contact_state import corner_displacements
from fem.system.loose import loose_blocks
from fem.system.reactions import PushCurve
from geometry.answer import (
    Array,
    Lazy,
    Measure,
    facet_sides,
    interface_contacts,
    largest_facet_mean,
    place,
)
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, IntArray, lengths
from geometry.parts.measures import facet_measures, first_largest

if TYPE_CHECKING:
    from fem.explicit.setup.quasi_static import QuasiStaticReport

#: Blocks move far where their displacement is this share of their size: relative errors of a
#: geometry that stays as built are as large.
_FAR = 0.05
#: Of sums of time steps [-].
_ROUND_OFF = 1e-9
#: Changes by load steps below which no stresses are searched: a hundredth of those tolerated [-].
_NEGLIGIBLE = 1e-4


def measures_of(
    state: State,
    errors: Mapping[str, float] | None = None,
    *,
    facets: tuple[Assembly, FloatArray] | None = None,
    remarks: Mapping[str, str] | None = None,
) -> Lazy[Measure]:
    """Measures of a state, each computed when it is read: see `fem.answer.answer.answer_of`."""
    makers = {
        "max_displacement": lambda: _measure(state, _largest_displacement(state), "mm")
    } | _stresses(state)
    if state.whole.meets:
        makers |= _pressures(state, facets)
    makers |= _of_motion(state)
    bars, notes = errors or {}, remarks or {}

    def told(name: str) -> Callable[[], Measure]:
        def measure() -> Measure:
            found, bar = makers[name](), bars.get(name)
            if found.error is not None:  # of the steps, on top of that of the mesh
                bar = found.error + (bar or 0.0)
            return replace(found, error=bar, remark=notes.get(name, ""))

        return measure

    return Lazy({name: told(name) for name in makers})


def _largest_displacement(state: State) -> Peak:
    """Node that moves most, and by how much [mm]."""
    whole = state.whole
    blocks = whole.deformable_blocks.tolist()
    sizes = [lengths(state.displacement_of(block)) for block in blocks]
    largest = np.array([size.max() for size in sizes])
    first, value = first_largest(largest), float(largest.max())
    where = whole.positions(blocks[first])[first_largest(sizes[first])]
    return Peak(value, (blocks[first],), where, nearest_face(whole, blocks[first], where))


def _of_motion(state: State) -> dict[str, Callable[[], Measure]]:
    """Of the support that moves against the largest force; nothing where none does."""
    curves = push_curves_of(state)
    if not curves:
        return {}
    curve = max(curves, key=lambda c: c.peak[0])
    force, displacement = curve.peak
    place = {"support": curve.name, "displacement": displacement}
    result = {
        "push_peak": lambda: Measure(force, "N", place=place),
        "push_stiffness": lambda: Measure(curve.stiffness, "N/mm"),
        "push_work": lambda: _work(state, curve),
    }
    if state.run is not None:  # a run begins with waves
        del result["push_stiffness"]
    return result


def _work(state: State, curve: PushCurve) -> Measure:
    """Work of a support that moves; with what its steps leave open where they count."""
    balanced = work_of_motion(state)
    if balanced is None:
        return Measure(curve.work, "N mm", error=curve.work_error)
    steps = abs(balanced - curve.work) if state.whole.contact.friction is not None else None
    return Measure(balanced, "N mm", error=steps)


def _stresses(state: State) -> dict[str, Callable[[], Measure]]:
    return {
        "sigma_1_max": lambda: _measure(state, stress_peaks(state).sigma_1),
        "sigma_3_min": lambda: _measure(state, stress_peaks(state).sigma_3),
        "mises_max": lambda: _measure(state, stress_peaks(state).mises),
        "sigma_1_averaged": lambda: _measure(
            state,
            stress_peaks(state).sigma_1_averaged,
            averaging_radius=stress_peaks(state).averaging_radius,
            averaged_over=stress_peaks(state).averaged_over,
        ),
    }


def _pressures(
    state: State, facets: tuple[Assembly, FloatArray] | None
) -> dict[str, Callable[[], Measure]]:
    def at_a_point() -> Measure:
        largest = largest_pressure(state)
        return Measure(0.0, "MPa") if largest is None else _measure(state, largest)

    def largest_mean() -> Measure:
        assembly = state.whole.assembly if facets is None else facets[0]
        return largest_facet_mean(assembly, contacts_of(state, facets))

    @cache
    def of_paper() -> ContactMeasures:
        return contact_on(state, facets)

    # With friction, pressures at sharp edges seldom converge, forces of joints do.
    friction = state.whole.contact.friction is not None
    joints = {}
    if friction and state.contact_state.position_s is not None:
        joints = {"largest_joint_force": lambda: _largest_joint_force(state)}
    return joints | {
        "p_eff": lambda: Measure(of_paper().p_eff, "MPa"),
        "p_max": lambda: Measure(of_paper().p_max, "MPa"),
        "p_max_facet": largest_mean,
        "p_max_point": at_a_point,
    }


def _largest_joint_force(state: State) -> Measure:
    """Largest normal force of a joint, at the centroid of its facets."""
    joints = joints_of(state)
    if not len(joints.block_m):
        return Measure(0.0, "N")
    k = first_largest(joints.normal_force)
    pair = int(joints.block_m[k]), int(joints.block_s[k])
    where = place(state.whole.assembly, pair, joints.centroids[k])
    return Measure(float(joints.normal_force[k]), "N", place=where)


def contact_on(state: State, facets: tuple[Assembly, FloatArray] | None = None) -> ContactMeasures:
    """The paper's measures of a state, over other facets where these are given.

    What is measured at points is that of the mesh that was solved.
    """
    result = contact_measures(state)
    if facets is None:
        return result
    assembly, pressures = facets
    per_block, overall = facet_measures(assembly, np.arange(len(pressures)), pressures)
    shared = {name: value for name, value in vars(overall).items() if hasattr(result, name)}
    return replace(result, **shared, per_block=per_block)


def contacts_of(state: State, facets: tuple[Assembly, FloatArray] | None = None) -> Lazy[Array]:
    """Contact facets of a state (`Answer.contacts`), or of other facets where these are given.

    They come in the order of the interfaces that they are. Facets that a search found are none:
    they come in the order of their blocks and of the facets of the second one.
    """
    if facets is not None:
        return Lazy(_interfaces_of(*facets))
    return Lazy(_facets_of(state) if state.whole.meets else {})


def _facets_of(state: State) -> dict[str, Callable[[], Array]]:
    """Facets as they are solved."""
    contact, assembly = state.contact_state, state.whole.assembly
    values: dict[str, Callable[[], Array]] = {
        "pressure": lambda: contact.pressures,
        "force": lambda: contact.forces,
        "gap": lambda: -contact.deepest,
        "slip": lambda: contact.slips,
    }
    if contact.interface is not None:
        result = values | interface_contacts(assembly, contact.interface)
        return result | {"area": lambda: contact.areas}
    assert contact.position_s is not None
    position = contact.position_s
    order = np.lexsort((position, contact.block_s, contact.block_m))

    blocks = np.column_stack([contact.block_m, contact.block_s])
    values |= {
        "area": lambda: contact.areas,
        "blocks": lambda: blocks,
        "layer": lambda: assembly.layer[blocks],
        **facet_sides(
            assembly, (contact.block_m, contact.block_s), (np.full_like(position, -1), position)
        ),
        "centroid": lambda: contact.centroids,
        "normal": lambda: contact.mean_normals,
        "corners": lambda: contact.corners,
    }
    return {name: _ordered(maker, order) for name, maker in values.items()}


def _ordered(maker: Callable[[], Array], order: Array) -> Callable[[], Array]:
    return lambda: maker()[order]


def _interfaces_of(assembly: Assembly, pressures: FloatArray) -> dict[str, Callable[[], Array]]:
    """Interfaces of a mesh with pressures given for all of them; frames do not press on frames."""
    result = assembly.interfaces
    index = np.flatnonzero(~(assembly.fixed[result.block_m] & assembly.fixed[result.block_s]))
    values: dict[str, Callable[[], Array]] = {"pressure": lambda: pressures[index]}
    return values | interface_contacts(assembly, index)


def _measure(state: State, peak: Peak, unit: str = "MPa", **beside: Any) -> Measure:
    """Value and place of a peak, and what stands beside the place."""
    where = place(state.whole.assembly, peak.blocks, peak.position, peak.face)
    return Measure(peak.value, unit, place=where | beside, resolved=peak.resolved)


def load_step_change(state: State) -> dict[str, float]:
    """Change of each measure by half as many load steps, in its unit; empty if not known.

    The stresses of a state take as long to search as the state itself: where all else changes by a
    negligible share, they count as changed by that.
    """
    coarse = state.evidence.coarser
    if coarse is None:
        return {}
    before, after = measures_of(coarse), measures_of(state)

    def changes(names: Collection[str]) -> dict[str, float]:
        return {name: abs(after[name].value - before[name].value) for name in names}

    stresses = _stresses(state).keys()
    result = changes([name for name in after if name not in stresses])
    shares = [change / abs(after[n].value) for n, change in result.items() if after[n].value]
    share = max(shares, default=1.0)
    if share > _NEGLIGIBLE:
        return result | changes(stresses)
    return result | {name: share * abs(after[name].value) for name in stresses}


def hidden_between_nodes(state: State) -> dict[str, float]:
    """What nodes may hide of the pressure at a point, in its unit; empty without contact."""
    return {"p_max_point": pressure_between_nodes(state)} if state.whole.meets else {}


def facet_step(state: State, share: float) -> float:
    """What one facet more or less of each block may change of `p_eff` [MPa].

    It is a mean over a whole number of facets, the participation ratio (Σ p)² / Σ p² rounded down.
    Pressures known to a ``share`` leave twice that of the ratio open, which may pass a whole one.
    """
    of = contact_measures(state).per_block
    open_ones = np.floor(np.outer([1.0 - 2.0 * share, 1.0 + 2.0 * share], of.participation_ratio))
    return float(np.where((open_ones != of.participation).any(axis=0), of.p_eff_step, 0.0).mean())


def bracketed(state: State) -> dict[str, float]:
    """How far both sides of each peak lie apart in the state itself [MPa].

    Integration points against corners of facets and of elements.
    """
    stress, result, pressures = stress_peaks(state), measures_of(state), {}
    if state.whole.meets:
        pressures = {
            "p_max_point": _peak_distance(state, result["p_max_point"]),
        }
    return pressures | {
        "sigma_1_max": abs(stress.sigma_1_at_corners - stress.sigma_1.value),
        "sigma_3_min": abs(stress.sigma_3_at_corners - stress.sigma_3.value),
        "mises_max": abs(stress.mises_at_corners - stress.mises.value),
    }


def _peak_distance(state: State, peak: Measure) -> float:
    """Distance from the largest pressure to the integration points, or beyond them [MPa].

    Where these do not resolve the pressure at an edge, it is larger than theirs by
    `LARGEST_FACTOR` or more.
    """
    if not peak.resolved:
        return (LARGEST_FACTOR - 1.0) * peak.value
    return abs(peak.value - contact_measures(state).p_max_point)


# ---------------------------------------------------------------------------------------------
# How far blocks move: displacements, turns, slips, and blocks that nothing holds


def largest_turn(state: State) -> float:
    """Largest angle by which a block turns, of the nearest rigid motion [rad]."""
    largest = 0.0
    for body, moved in zip(state.whole.bodies, state.displacements, strict=True):
        arm = body.mesh.nodes - body.mesh.nodes.mean(axis=0)
        gradients = np.einsum("cni,nj->cij", moved, np.linalg.pinv(arm).T)
        spins = 0.5 * (gradients - gradients.transpose(0, 2, 1))
        turns = np.linalg.norm(spins, axis=(1, 2)) / np.sqrt(2.0)
        largest = max(largest, float(turns.max(initial=0.0)))
    return largest


def turns_as_small(state: State) -> bool:
    """Whether a block turns by an angle that is not small, and it is counted as if it were."""
    return not state.finite_rotation and largest_turn(state) > _FAR


def turned_within(state: State) -> float | None:
    """Largest angle by which an element turns in the frame of its block [rad], finite rotations.

    None where its square is no strain beside those of the stresses: a frame takes away the rotation
    of its block, and what elements turn beyond it by θ counts as a strain of θ²/2.
    """
    if not state.finite_rotation:
        return None
    largest, apparent = 0.0, 0.0
    for body, moved in zip(state.whole.bodies, state.displacements, strict=True):
        local, _ = block_displacements(body, moved, finite_rotation=True)
        arms = body.mesh.nodes[body.mesh.elements]
        inverse = np.linalg.pinv(arms - arms.mean(axis=1, keepdims=True))
        gradients = np.einsum("eia,ceaj->ceji", inverse, local[:, body.mesh.elements])
        spins = 0.5 * (gradients - gradients.swapaxes(2, 3))
        turn = float(np.linalg.norm(spins, axis=(2, 3)).max(initial=0.0)) / np.sqrt(2.0)
        largest = max(largest, turn)
        apparent = max(apparent, 0.5 * body.material.young_modulus * turn**2)
    stress = max(map(abs, nodal_stress_range(state)))
    return largest if apparent > _FAR * stress else None


def large_motion(state: State) -> float | None:
    """Largest displacement over the size of blocks that meet [-]; None where it is small.

    None as well where it is counted as it is: with finite sliding, and with finite rotation or
    of blocks that hardly turn.
    """
    whole = state.whole
    if not whole.meets or (whole.contact.finite_sliding and not turns_as_small(state)):
        return None
    share = state.largest_displacement / whole.assembly.characteristic_length
    return share if share > _FAR else None


def slip(state: State) -> dict[str, float] | None:
    """Largest slip between facets that press and the size of its facet [mm].

    None where facets are searched. Facets that stay paired as built give no answer beyond a
    slip of one facet.
    """
    whole, contact = state.whole, state.contact_state
    if whole.contact.finite_sliding or not contact.n_facets:
        return None
    surfaces, pressing = whole.surfaces, contact.pressures > 0.0
    on_m, on_s = np.split(corner_displacements(whole, state.displacements), 2, axis=1)
    jump: FloatArray = on_s - on_m
    normal = surfaces.normals.mean(axis=1)
    normal /= lengths(normal)[:, None]
    along = np.einsum("fai,fi->fa", jump, normal)
    slips = lengths(jump - along[:, :, None] * normal[:, None]).max(axis=1)
    size = np.sqrt(surfaces.areas)
    worst = int(np.argmax(np.where(pressing, slips / size, 0.0)))
    largest = float(slips[worst]) if pressing.any() else 0.0
    return {"largest": largest, "facet_size": float(size[worst])}


def unrestrained_blocks(state: State) -> IntArray:
    """Blocks that no pressing contact holds in every direction, (n,).

    Pressures are determined, the places of these blocks are not. Not judged: friction, and
    explicit runs with searched facets or to another end than the static state.
    """
    contact = state.whole.contact
    if state.run is None:
        return state.evidence.loose_blocks
    stated = state.run.stated
    if stated.times.recommended is None or contact.friction is not None or contact.finite_sliding:
        return np.zeros(0, dtype=np.int64)
    everyone = np.arange(state.whole.assembly.n_blocks)
    where = state.whole, state.displacements
    return loose_blocks(*where, state.pressures, state.points, everyone)


def reached(state: State) -> bool:
    """Whether supports that move have arrived where they are prescribed."""
    if state.run is None:
        return state.evidence.stopped is None
    arrival = state.run.stated.times.settled if state.whole.supports.tables else 0.0
    return state.run.time >= (1.0 - _ROUND_OFF) * arrival


@once
def quasi_static(state: State) -> QuasiStaticReport | None:
    """How static the end of an explicit run is; None where nothing recommends a frequency."""
    if state.run is None:
        return None
    # Loaded here: it brings the compiler along, which static runs do without.
    from fem.explicit.setup.quasi_static import quasi_static_report

    return quasi_static_report(state)
