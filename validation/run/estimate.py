"""Error of discretisation of every measure of a deformable run, from two coarser meshes.

A run on a mesh with 1/r of the elements along every edge differs from the run by Δ. If the error
falls like the size of an element, that of the run is Δ / (r - 1); measures of higher order have
less. Coarse meshes need not lie in their asymptotic range, and a difference may vanish by chance:
so two of them are solved, about two thirds and half as fine, the larger estimate counts, and a
factor of safety (as in Roache's grid convergence index) comes on top.

Peaks are known from two sides (`DeformableRun.bracketed`). Contact forces are in balance
on facets, so means over them lie below a peak of pressure and values at their corners, continued
outwards by a steep law, above it: an estimate is at least the distance. Stresses inside elements
and at their corners lie on the same side: what an element hides comes on top of what the mesh
leaves out.

Elements of degree two and more are judged by the same elements of one degree less, with the same
factor: means over facets are those over the same facets then. Either change may vanish by chance:
all else has the larger estimate of degrees and of meshes. Stresses at a point gain least: what the
degree and what the mesh leave out add up.

With friction the way to the load counts: what half as many load steps change is added
(`DeformableRun.load_step_change`).

References: P. J. Roache, Perspective: a method for uniform reporting of grid refinement studies,
J. Fluids Eng. 116 (1994) 405-413.
"""

from __future__ import annotations

from geometry.errors import RefusedError
from validation.run.deformable import DeformableRun
from validation.run.solve import run_scene

#: Elements along an edge of the coarser meshes over those of the run.
SHARES = (2.0 / 3.0, 0.5)

#: Factor of safety; `tests/test_validation_error_estimate.py` measures how often it suffices.
SAFETY = 1.5

#: Peaks that lie inside elements.
_INSIDE = ("sigma_1_max", "sigma_3_min")
#: What coarser meshes judge beside them in elements of degree two or more.
_OF_MESHES = ("sigma_1_averaged", "p_max_point", "max_displacement")


def estimated_errors(run: DeformableRun) -> dict[str, float]:
    """Estimate the error of each measure, in its unit; empty where no coarser mesh can be solved.

    Coarser meshes are solved by the method of the run.
    """
    steps = run.load_step_change if run.scene.effects.friction is not None else {}
    curved = run.scene.fem is not None and run.scene.fem.degree > 1
    degrees = _degree_changes(run) if curved else {}
    meshes: dict[str, list[float]] = {}
    scenes = [run.scene.coarser(share) for share in SHARES]
    for k, scene in enumerate(scenes):
        if scene is None or scene in scenes[:k]:
            continue
        try:
            coarse = run_scene(run.name, scene)
        except RefusedError:
            continue
        ratio = run.deformable.model.n_elements / coarse.deformable.model.n_elements
        refinement = ratio ** (1.0 / 3.0)
        if not refinement > 1.0:
            continue
        for name, measure in run.measures.items():
            change = abs(measure.value - coarse.measures[name].value)
            meshes.setdefault(name, []).append(SAFETY * change / (refinement - 1.0))
    of_meshes = {name: max(found) for name, found in meshes.items()}
    if curved:
        bars = {name: _both(name, bar, of_meshes.get(name, 0.0)) for name, bar in degrees.items()}
    else:
        sides = run.bracketed
        bars = {
            name: (sum if name in _INSIDE else max)((bar, sides.get(name, 0.0)))
            for name, bar in of_meshes.items()
        }
    return {name: steps.get(name, 0.0) + bar for name, bar in bars.items()}


def _both(name: str, degrees: float, meshes: float) -> float:
    """Estimate of elements of degree two or more from those of degrees and of meshes."""
    if name in _INSIDE:
        return degrees + meshes
    return max(degrees, meshes) if name in _OF_MESHES else degrees


def _degree_changes(run: DeformableRun) -> dict[str, float]:
    """Estimates from the same elements of one degree less."""
    assert run.scene.fem is not None
    scene = run.scene.changed({"fem.degree": run.scene.fem.degree - 1})
    less = run_scene(run.name, scene).measures
    return {n: SAFETY * abs(m.value - less[n].value) for n, m in run.measures.items()}
