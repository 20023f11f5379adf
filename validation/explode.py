"""`tubelock explode`: does the tube explode, to first order and how far; numbers and pictures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from geometry.assembly import Assembly, AssemblyError
from geometry.explosion import FiniteExplosion, follow_explosion, outward_directions
from geometry.mesh import FloatArray
from geometry.overlap import SignedDistance
from geometry.polyhedral_assembly import PolyhedralAssembly, as_polyhedral
from geometry.triangle_search import overlapping_boxes
from mbd import MechanismClass, classify, contact_jacobian
from mbd.explosion import FirstOrderExplosion, first_order_explosion
from validation.build import build_assembly, require_assembly
from validation.errors import InputError
from validation.rendering import BLUE, GREY, SKY, VERMILION, place, render, save_figure
from validation.scene import SceneFile, TubeScene
from validation.scene_families import HexagonTubeScene

#: Displacements looked at, in wall thicknesses.
STEPS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 0.75, 1.0)
#: Depth that counts as touching, in wall thicknesses.
TOLERANCE = 1e-3
#: Panels of the strip, in wall thicknesses.
PANELS = (0.0, 0.25, 0.5, 1.0)
_EYE = (2.4, -1.6, 0.9)


@dataclass(frozen=True)
class Explosion:
    """Everything `tubelock explode` found."""

    name: str
    assembly: Assembly
    surfaces: PolyhedralAssembly
    """The blocks of the finite motion: three layers, for they repeat."""
    directions: FloatArray
    """Outward unit vector of each of those, (n_blocks, 3)."""
    thickness: float
    """Wall thickness [mm]."""
    first: FirstOrderExplosion
    held: MechanismClass
    """Class of the outward push with the frame held."""
    finite: FiniteExplosion
    cpu_seconds: float

    @property
    def explodes(self) -> bool:
        """Whether nothing stops the outward motion, to the last step looked at."""
        return self.first.admissible and self.finite.first_overlap is None


def _surface_scene(scene: TubeScene | HexagonTubeScene) -> TubeScene | HexagonTubeScene:
    """Return three layers with a mesh fine enough for surfaces, coarse enough for many distances.

    Layers repeat with period two, so more of them show no other pair of neighbours.
    """
    mesh = scene.mesh.model_dump()
    if isinstance(scene, TubeScene):
        waves = round(2 * scene.block.frequency)
        most = {"around": 12 * waves, "radial": 6, "axial": 8}
    else:
        most = {"edge": 12, "radial": 6}
    coarser = {key: min(mesh[key], limit) for key, limit in most.items()}
    layers = scene.assembly.model_copy(update={"layers": min(scene.assembly.layers, 3)})
    mesh_section = scene.mesh.model_copy(update=coarser)
    return scene.model_copy(update={"mesh": mesh_section, "assembly": layers})


def run_explosion(file: SceneFile) -> Explosion:
    """Judge the explosion of a tube.

    Raises
    ------
    InputError
        For scenes that are no tubes.
    """
    start = time.process_time()
    scene = require_assembly(file.scene, file.name, "explode")
    if not isinstance(scene, TubeScene | HexagonTubeScene):
        raise InputError(
            f"{file.name}: block.type {scene.block.type!r} makes no tube; `tubelock explode` needs "
            'one: block.type = "sine" or "hexagon"'
        )
    assembly = build_assembly(scene)
    try:
        directions = outward_directions(assembly)
    except AssemblyError as error:
        raise InputError(str(error)) from None
    first = first_order_explosion(assembly, directions)
    contacts = contact_jacobian(assembly)
    push = np.zeros((len(contacts.free_blocks), 6))
    push[:, :3] = directions[contacts.free_blocks]
    held = classify(contacts.jacobian, push.ravel()).mechanism
    short = build_assembly(_surface_scene(scene))
    surfaces, outward = as_polyhedral(short), outward_directions(short)
    thickness = scene.block.thickness
    finite = follow_explosion(surfaces, outward, thickness * np.array(STEPS), TOLERANCE * thickness)
    seconds = time.process_time() - start
    return Explosion(
        file.name, assembly, surfaces, outward, thickness, first, held, finite, seconds
    )


def explosion_json(run: Explosion) -> dict[str, Any]:
    """Return the result as plain data."""
    overlap = run.finite.first_overlap
    return {
        "scene": run.name,
        "explodes": run.explodes,
        "first_order": {
            "admissible": run.first.admissible,
            "smallest_gap_rate": run.first.smallest_gap_rate,
            "closing_area_percent": run.first.closing_area_percent,
            "opening_area_percent": run.first.opening_area_percent,
        },
        "outward_push": {
            "frame_held": str(run.held),
            "nothing_held": "carried" if run.first.held_together else "drives a motion",
        },
        "finite": {
            "free_distance": run.finite.free_distance,
            "tolerance": run.finite.tolerance,
            "distances": run.finite.distances.tolist(),
            "depths": run.finite.depths.tolist(),
            "first_overlap": None if overlap is None else [overlap.block_a, overlap.block_b],
        },
        "cpu_seconds": run.cpu_seconds,
    }


def print_explosion(run: Explosion, console: Console) -> None:
    """Print the verdict and its numbers."""
    first, finite = run.first, run.finite
    table = Table(title=f"{run.name}: explosion", show_header=False, title_justify="left")
    table.add_column(justify="left")
    table.add_column(justify="left")
    table.add_row("verdict", "explodes" if run.explodes else "does not explode")
    words = "admissible" if first.admissible else "not admissible"
    table.add_row(
        "first order, frame released",
        f"{words}: smallest gap rate {first.smallest_gap_rate:.4g} mm per mm outward; "
        f"{first.closing_area_percent:.1f} % of the contact area closes, "
        f"{first.opening_area_percent:.1f} % opens",
    )
    last = finite.distances[-1]
    if finite.first_overlap is None:
        words = f"free up to {last:g} mm (one wall thickness), the last distance looked at"
    else:
        words = (
            f"free up to {finite.free_distance:.3g} mm, then blocks are more than "
            f"{finite.tolerance:g} mm in each other; {finite.depths[-1]:.3g} mm deep at {last:g} mm"
        )
    table.add_row("finite motion", words)
    table.add_row("outward push, frame held", f"{run.held}")
    table.add_row(
        "outward push, nothing held",
        "carried by the contacts alone"
        if first.held_together
        else "drives a motion (turning and lengthening of the tube allowed)",
    )
    table.add_row("CPU seconds", f"{run.cpu_seconds:.2f}")
    console.print(table)


def _inside_parts(
    surfaces: PolyhedralAssembly, translations: FloatArray, tolerance: float
) -> list[tuple[int, FloatArray]]:
    """Block and (triangles, 3) corner coordinates of what lies inside another block."""
    points = [
        surfaces.shape(b).points @ surfaces.rotations[b].T + translations[b]
        for b in range(surfaces.n_blocks)
    ]
    low = np.array([p.min(axis=0) for p in points])
    high = np.array([p.max(axis=0) for p in points])
    pairs = overlapping_boxes(low, high, low, high)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    distance = [SignedDistance(shape) for shape in surfaces.shapes]
    parts = []
    for a, b in pairs.tolist():
        local = (points[a] - translations[b]) @ surfaces.rotations[b]
        near = ((points[a] > low[b]) & (points[a] < high[b])).all(axis=1)
        deep = np.zeros(len(local), dtype=bool)
        deep[near] = distance[int(surfaces.shape_of[b])](local[near]) < -tolerance
        triangles = surfaces.shape(a).triangles
        inside = triangles[deep[triangles].all(axis=1)]
        if len(inside):
            parts.append((a, points[a][inside]))
    return parts


def _panel(run: Explosion, distance: float) -> Callable[[Any], None]:
    import pyvista

    surfaces = run.surfaces
    translations = surfaces.translations + distance * run.directions

    def add(plotter: Any) -> None:
        inside = _inside_parts(surfaces, translations, run.finite.tolerance) if distance > 0 else []
        for block in range(surfaces.n_blocks):
            shape = surfaces.shape(block)
            points = shape.points @ surfaces.rotations[block].T + translations[block]
            mesh = pyvista.PolyData(points, np.insert(shape.triangles, 0, 3, axis=1).ravel())
            colour = GREY if surfaces.fixed[block] else (BLUE, SKY)[block % 2]
            plotter.add_mesh(mesh, color=colour, ambient=0.4, opacity=0.35 if inside else 1.0)
            edges = mesh.extract_feature_edges(
                feature_angle=40, boundary_edges=False, non_manifold_edges=False
            )
            plotter.add_mesh(edges, color="#303030", line_width=1.2)
        for _, corners in inside:
            count = len(corners)
            faces = np.insert(np.arange(3 * count).reshape(-1, 3), 0, 3, axis=1).ravel()
            plotter.add_mesh(
                pyvista.PolyData(corners.reshape(-1, 3), faces), color=VERMILION, lighting=False
            )

    return add


def draw_explosion(run: Explosion, path: Path) -> None:
    """Draw a strip of growing outward displacements, and the depth over the displacement.

    Parameters
    ----------
    run
        Result of `run_explosion`.
    path
        PNG to write.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    figure = plt.figure(figsize=(17, 9.5))
    ratios = [*[1.0] * len(PANELS), 0.2, 1.4]  # an empty column keeps the axis labels apart
    grid = figure.add_gridspec(1, len(ratios), width_ratios=ratios)
    for k, part in enumerate(PANELS):
        distance = part * run.thickness
        image = render(_panel(run, distance), _EYE)
        place(figure.add_subplot(grid[0, k]), image, f"{distance:g} mm outward")
    axes = figure.add_subplot(grid[0, -1])
    axes.plot(
        np.concatenate([[0.0], run.finite.distances]),
        np.concatenate([[0.0], run.finite.depths]),
        marker="o",
        color=VERMILION,
        clip_on=False,
    )
    axes.set_xlabel("outward displacement of every block [mm]")
    axes.set_ylabel("depth of the deepest overlap [mm]")
    axes.set_xlim(0.0, None)
    axes.set_ylim(0.0, max(1.0, 1.05 * float(run.finite.depths.max())))
    axes.spines[["top", "right"]].set_visible(False)
    verdict = "explodes" if run.explodes else "does not explode"
    figure.suptitle(
        f"{run.name}: {verdict}; first-order gap rate {run.first.smallest_gap_rate:.3g}, free up "
        f"to {run.finite.free_distance:.3g} mm",
        fontsize=14,
        x=0.03,
        ha="left",
    )
    figure.legend(
        handles=[
            Patch(color=BLUE, label="blocks"),
            Patch(color=GREY, label="frame, released"),
            Patch(color=VERMILION, label="surface inside another block"),
        ],
        loc="lower center",
        ncols=3,
        frameon=False,
    )
    figure.subplots_adjust(left=0.02, right=0.98, top=0.9, bottom=0.12, wspace=0.12)
    save_figure(figure, path)
