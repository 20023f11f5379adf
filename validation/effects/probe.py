"""Cheap versions of a scene that tell what an effect changes: static, on a coarse mesh."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fem.assembly.contact_state import contact_measures
from fem.assembly.deformable import DeformableAssembly
from fem.problem.recovery import best_rotations
from fem.static.linear_step.condensed import FlexibilityStore
from fem.static.result import StaticResult
from fem.static.rotation import finite_rotation_loads, solve_static_with_rotation
from fem.static.solve import StaticOptions, solve_static
from geometry.errors import RefusedError
from validation.build.deformable import build_deformable
from validation.errors import InputError
from validation.run.deformable import DeformableRun
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene

#: Residual at which a probe stops: three digits beyond what it has to tell.
_TOLERANCE = 1e-5
#: Most elements of a block in the probe: four a wave (or an edge), two through the wall, four in
#: the remaining direction.
_PER_WAVE, _THROUGH, _OTHER = 4, 2, 4


@dataclass(frozen=True)
class Answer:
    """The quantities by which effects are judged."""

    p_max: float
    """Mean of the block maxima of the contact pressure [MPa]."""
    p_eff: float
    """Effective mean contact pressure [MPa]."""
    displacement: float
    """Largest displacement [mm]."""

    @property
    def values(self) -> tuple[float, float, float]:
        """All three."""
        return self.p_max, self.p_eff, self.displacement


class Change(Answer):
    """Relative change of each quantity [-]."""

    @property
    def largest(self) -> float:
        """Largest of the three, in size."""
        return max(map(abs, self.values))


def answer_of(run: DeformableRun) -> Answer:
    """Quantities of a run."""
    return Answer(run.contact.p_max, run.contact.p_eff, run.largest_displacement)


def change(before: Answer, after: Answer) -> Change:
    """Relative change from one answer to another; one, a hundred per cent, where it was zero."""

    def relative(a: float, b: float) -> float:
        if a == b:
            return 0.0
        return b / a - 1.0 if a else 1.0

    return Change(*map(relative, before.values, after.values))


@dataclass(frozen=True)
class Solved:
    """A probe and its static state."""

    deformable: DeformableAssembly
    result: StaticResult
    cpu_seconds: float
    """[s]"""

    @cached_property
    def answer(self) -> Answer:
        """The quantities."""
        found = contact_measures(self.deformable.assembly, self.result.contact_state)
        return Answer(found.p_max, found.p_eff, self.result.max_displacement)


def solve_probe(scene: DeformableScene, name: str, store: FlexibilityStore | None = None) -> Solved:
    """Static state of a probe; probes that share a store condense the same blocks once.

    Raises
    ------
    InputError
        When it has none.
    """
    start = time.process_time()
    deformable = build_deformable(without_motion(scene), name)
    result = _static_state(deformable, name, whole=scene.fem.symmetry == "none", store=store)
    return Solved(deformable, result, time.process_time() - start)


def _static_state(
    deformable: DeformableAssembly,
    name: str,
    *,
    whole: bool,
    start: StaticResult | None = None,
    store: FlexibilityStore | None = None,
) -> StaticResult:
    options = StaticOptions(symmetry=1 if whole else None, tolerance=_TOLERANCE)
    try:
        result = solve_static(deformable, options, start=start, store=store)
    except RefusedError as error:
        raise InputError(_unsolved(name, str(error))) from None
    if not result.converged:
        raise InputError(_unsolved(name, result.status))
    return result


def _unsolved(name: str, why: str) -> str:
    return (
        f"{name}: effects.auto: the probe has no static state ({why}); expected one that can be "
        "probed: remove effects.auto, and every effect acts as written"
    )


def probe_scene(scene: DeformableScene, name: str, *, fineness: int = 1) -> DeformableScene:
    """Return the scene as a static problem on a mesh that is as coarse as its blocks allow.

    Layers, loads and contact stay: what an effect does to a tall tube shows only in a tall tube.

    Parameters
    ----------
    scene, name
        The scene.
    fineness
        Times as many elements along each edge as the coarsest mesh has.
    """
    still = {"rayleigh": None, "bulk_viscosity": None, "auto": None}
    static = scene.changed({"fem": {"method": Method.STATIC, "frames": 0}, "effects": still})
    for factor in (fineness, 2 * fineness, 4 * fineness):
        coarse = _coarse_mesh(scene, factor)
        if not coarse:
            break
        probe = static.changed({"mesh": coarse})
        try:
            build_deformable(without_motion(probe), name)
        except RefusedError:
            continue
        return probe
    return static


def without_motion(scene: DeformableScene) -> DeformableScene:
    """Scene without the effects that no static problem has."""
    return scene.changed({"effects": {"finite_rotation": False, "finite_sliding": False}})


def _coarse_mesh(scene: DeformableScene, fineness: int) -> dict[str, Any]:
    """Values of ``[mesh]`` that are lower in the probe; none where the mesh is given."""
    found = scene.coarse_mesh(fineness * _PER_WAVE, fineness * _THROUGH, fineness * _OTHER)
    own = scene.element_counts
    return {key: value for key, value in found.items() if value != own[key]}


def refinement(scene: DeformableScene, probe: DeformableScene) -> float:
    """How many times as many elements the scene has along an edge of a block, at most."""
    fine, coarse = scene.element_counts, probe.element_counts
    if not fine:
        return 1.0
    return max(float(np.max(np.divide(fine[key], coarse[key]))) for key in fine)


def mesh_words(scene: DeformableScene) -> str:
    """Elements of a block."""
    counts = scene.element_counts
    if not counts:
        return "its own mesh"
    flat = np.concatenate([np.atleast_1d(v) for v in counts.values()]).tolist()
    return " × ".join(str(v) for v in flat) + f" elements per block ({', '.join(counts)})"


# ---------------------------------------------------------------------------------------------
# What has no switch in a static solver


def without_finite_rotation(
    solved: Solved, name: str, store: FlexibilityStore | None = None
) -> Change:
    """Change of a static answer when blocks stop turning freely.

    The probe itself treats rotations as small; it is solved again with them. Where they are too
    large for a static solver, the forces that they add to the first solution tell that the change
    is large (`fem.static.rotation`).

    Raises
    ------
    InputError
        When neither problem has a solution.
    """
    deformable, result = solved.deformable, solved.result
    whole = result.symmetry == 1
    options = StaticOptions(symmetry=1 if whole else None, tolerance=_TOLERANCE)
    try:
        again = solve_static_with_rotation(deformable, options, store=store)
    except RefusedError:
        model = deformable.model
        added = finite_rotation_loads(model, result.displacements)
        turning = replace(deformable, model=replace(model, loads=(*model.loads, *added)))
        again = _static_state(turning, name, whole=whole, start=result, store=store)
    return change(Solved(deformable, again, 0.0).answer, solved.answer)


def largest_rotation(solved: Solved) -> float:
    """Largest rotation of any block [rad]."""
    largest = 0.0
    for group, u in zip(solved.deformable.model.groups, solved.result.displacements, strict=True):
        turn = best_rotations(group, u)
        # |R - 1| = 2 √2 sin(angle / 2): exact for small angles too, unlike the trace.
        size = np.linalg.norm(turn - np.eye(3), axis=(1, 2)) / np.sqrt(8.0)
        largest = max(largest, float(2.0 * np.arcsin(np.minimum(size, 1.0)).max()))
    return largest
