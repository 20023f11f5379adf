"""Files of a deformable run: fields for ParaView, history, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.explicit import Frame
from fem.history import History
from fem.model import BlockGroup
from fem.recovery import recover
from geometry.mesh import FloatArray, HexMesh
from geometry.mesh_io import write_hex_mesh
from validation.fem_box import BoxRun
from validation.files import write_whole
from validation.rendering import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    STRESS_MAP,
    VERMILION,
    place,
    polydata,
    render,
    save_figure,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray


def groups_mesh(groups: Sequence[BlockGroup]) -> HexMesh:
    """All copies of all groups as one mesh, undeformed, world axes."""
    nodes, elements, offset = [], [], 0
    for group in groups:
        starts = offset + group.n_nodes * np.arange(group.n_copies)
        elements.append((group.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
        nodes.append(group.reference_positions().reshape(-1, 3))
        offset += group.n_nodes * group.n_copies
    return HexMesh(np.concatenate(nodes), np.concatenate(elements))


def field_data(
    groups: Sequence[BlockGroup], displacements: Sequence[FloatArray], *, finite_rotation: bool
) -> dict[str, NDArray[Any]]:
    """Nodal fields of all groups: displacement, stress and principal stresses."""
    found = [
        recover(group, u, finite_rotation=finite_rotation)
        for group, u in zip(groups, displacements, strict=True)
    ]
    principal = np.concatenate([f.principal.reshape(-1, 3) for f in found])
    return {
        "displacement": np.concatenate([u.reshape(-1, 3) for u in displacements]),
        "stress": np.concatenate([f.stress.reshape(-1, 6) for f in found]),
        "sigma_1": principal[:, 0],
        "sigma_2": principal[:, 1],
        "sigma_3": principal[:, 2],
    }


def point_data(
    groups: Sequence[BlockGroup], displacements: Sequence[FloatArray], *, finite_rotation: bool
) -> dict[str, NDArray[Any]]:
    """Principal stresses at the integration points of each element, (n_elements, n_points)."""
    first, last = [], []
    for group, u in zip(groups, displacements, strict=True):
        found = recover(group, u, finite_rotation=finite_rotation).point_principal
        rows = found.reshape(group.n_copies * group.mesh.n_elements, -1, 3)
        first.append(rows[:, :, 0])
        last.append(rows[:, :, 2])
    return {
        "sigma_1_integration_points": np.concatenate(first),
        "sigma_3_integration_points": np.concatenate(last),
    }


class FrameWriter:
    """Writes frames as ``frame_000.vtu`` … and a ``frames.pvd`` that names their times."""

    def __init__(
        self, folder: Path, groups: Sequence[BlockGroup], *, finite_rotation: bool
    ) -> None:
        self.folder = folder
        self.groups = groups
        self.finite_rotation = finite_rotation
        self.times: dict[str, float] = {}

    def __call__(self, frame: Frame) -> None:
        """Write one frame and bring the collection up to date."""
        name = f"frame_{frame.number:04d}.vtu"
        fields = field_data(self.groups, frame.displacements, finite_rotation=self.finite_rotation)
        write_hex_mesh(self.folder / name, groups_mesh(self.groups), point_data=fields)
        self.times[name] = frame.time
        lines = [
            f'    <DataSet timestep="{time!r}" file="{name}"/>' for name, time in self.times.items()
        ]
        text = "\n".join(
            [
                '<VTKFile type="Collection" version="0.1">',
                "  <Collection>",
                *lines,
                "  </Collection>",
                "</VTKFile>",
            ]
        )
        write_whole(self.folder / "frames.pvd", lambda path: path.write_text(text + "\n", "utf-8"))


def write_box_files(run: BoxRun, folder: Path) -> list[tuple[str, Path]]:
    """Write result, history and pictures; returns what each file is, and its path."""
    group = run.box.model.groups[0]
    finite = run.scene.effects.finite_rotation
    result, picture = folder / "result.vtu", folder / "result.png"
    fields = field_data([group], [run.displacements], finite_rotation=finite)
    points = point_data([group], [run.displacements], finite_rotation=finite)
    write_hex_mesh(result, groups_mesh([group]), point_data=fields, cell_data=points)
    draw_box(run, picture)
    written = [("fields", result), ("picture", picture)]
    if run.explicit is not None:
        history, energies = folder / "history.csv", folder / "energies.png"
        table = run.explicit.history
        write_whole(history, lambda path: path.write_text(table.csv(), "utf-8"))
        draw_energies(table, energies, title=run.name)
        written += [("history", history), ("picture", energies)]
        if (folder / "frames.pvd").exists():
            written.append(("frames", folder / "frames.pvd"))
    return written


def draw_energies(history: History, path: Path, *, title: str) -> None:
    """Plot the energies of a run over time, and the error of their balance."""
    import matplotlib.pyplot as plt

    time = 1e3 * history.column("time")
    dissipation = sum(
        history.column(name)
        for name in (
            "mass_damping_dissipation",
            "stiffness_damping_dissipation",
            "bulk_viscosity_dissipation",
        )
    )
    curves = [
        ("external work", history.column("external_work"), "black", "-"),
        ("strain", history.column("strain_energy"), BLUE, "-"),
        ("kinetic", history.column("kinetic_energy"), VERMILION, "-"),
        ("contact", history.column("contact_energy"), SKY, "-"),
        ("viscous dissipation", dissipation, GREEN, "--"),
        ("frictional dissipation", history.column("frictional_dissipation"), ORANGE, "--"),
        ("hourglass (part of strain)", history.column("hourglass_energy"), GREY, ":"),
    ]
    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(8, 6.5), sharex=True, height_ratios=[3, 1], layout="constrained"
    )
    for label, values, colour, style in curves:
        if np.any(values != 0.0):
            upper.plot(time, values, color=colour, linestyle=style, label=label)
    upper.set_ylabel("energy [N mm]")
    upper.set_title(f"{title}: energies", loc="left")
    upper.legend(frameon=False, ncols=2)
    upper.grid(alpha=0.3)
    lower.plot(time, history.column("energy_balance"), color="black")
    lower.set_ylabel("balance error [–]")
    lower.set_xlabel("time [ms]")
    lower.grid(alpha=0.3)
    save_figure(figure, path)


def draw_box(run: BoxRun, path: Path) -> None:
    """Draw the deformed boxes coloured by displacement, σ₁ and σ₃, and the undeformed outline."""
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    group = run.box.model.groups[0]
    finite = run.scene.effects.finite_rotation
    magnitude = np.linalg.norm(run.displacements, axis=2)
    extent = float(np.ptp(group.reference_positions().reshape(-1, 3), axis=0).max())
    largest = float(magnitude.max())
    # A displacement that a reader could not see is drawn larger, by a round factor.
    scale = 1.0 if finite or largest == 0.0 else 10.0 ** np.floor(np.log10(0.2 * extent / largest))
    scale = max(scale, 1.0)
    principal = run.recovered.principal
    stress = max(float(np.abs(principal).max()), 1e-300)
    panels = [
        ("displacement [mm]", magnitude, "viridis", (0.0, max(largest, 1e-300))),
        ("σ₁ (largest principal stress) [MPa]", principal[..., 0], STRESS_MAP, (-stress, stress)),
        ("σ₃ (smallest principal stress) [MPa]", principal[..., 2], STRESS_MAP, (-stress, stress)),
    ]
    figure, axes = plt.subplots(3, 2, figsize=(9, 10.5), width_ratios=[30, 1])
    for row, (label, values, colours, limits) in zip(axes, panels, strict=True):
        image = render(_deformed(run, values, scale, colours, limits), (1.4, -2.2, 1.1))
        place(row[0], image, label)
        figure.colorbar(ScalarMappable(Normalize(*limits), colours), cax=row[1])
    moment = "" if run.explicit is None else f", t = {1e3 * run.explicit.time:.4g} ms"
    figure.suptitle(
        f"{run.name}{moment}: displacements drawn × {scale:g}", x=0.03, ha="left", fontsize=13
    )
    figure.subplots_adjust(left=0.03, right=0.9, top=0.92, bottom=0.03, hspace=0.25, wspace=0.05)
    save_figure(figure, path)


def _deformed(
    run: BoxRun, values: FloatArray, scale: float, colours: str, limits: tuple[float, float]
) -> Any:
    group = run.box.model.groups[0]
    quads = np.concatenate(list(run.box.block.faces.values()))
    positions = group.reference_positions()

    def add(plotter: Any) -> None:
        for copy in range(group.n_copies):
            moved = polydata(positions[copy] + scale * run.displacements[copy], quads)
            moved.point_data["values"] = values[copy]
            plotter.add_mesh(
                moved,
                scalars="values",
                cmap=colours,
                clim=limits,
                show_edges=True,
                edge_opacity=0.25,
                ambient=0.4,
                show_scalar_bar=False,
            )
            outline = polydata(positions[copy], quads).extract_feature_edges(
                feature_angle=40, boundary_edges=False, non_manifold_edges=False
            )
            plotter.add_mesh(outline, color="#606060", line_width=1.5)

    return add
