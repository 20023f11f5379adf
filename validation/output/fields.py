"""Fields of a deformable run for ParaView."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.element.material import von_mises
from fem.stresses.ball_averages import moved_bodies
from fem.stresses.recovery import (
    Recovered,
    block_displacements,
    cells_of,
    equidistant,
    grid_places,
    recover,
    recovered_of,
)
from fem.system.body import Body
from fem.system.system import System
from geometry.files.mesh_io import write_hex_mesh, write_lagrange_cells
from geometry.machine.system import write_whole
from geometry.mesh import FloatArray, HexMesh
from validation.output.files import FRAMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fem.explicit.solve import Frame
    from fem.state import State
    from validation.case import Case


def groups_mesh(groups: Sequence[Body]) -> HexMesh:
    """All copies of all groups as one mesh, undeformed, world axes."""
    nodes, elements, offset = [], [], 0
    for group in groups:
        starts = offset + group.n_nodes * np.arange(group.n_copies)
        elements.append((group.mesh.elements[None] + starts[:, None, None]).reshape(-1, 8))
        nodes.append(group.reference_positions().reshape(-1, 3))
        offset += group.n_nodes * group.n_copies
    return HexMesh(np.concatenate(nodes), np.concatenate(elements))


def stress_fields(principal: Iterable[FloatArray]) -> dict[str, FloatArray]:
    """``sigma_1`` to ``sigma_3`` and ``mises`` of principal stresses in parts (…, 3) [MPa]."""
    every = np.concatenate([part.reshape(-1, 3) for part in principal])
    return {f"sigma_{k + 1}": every[:, k] for k in range(3)} | {"mises": von_mises(every)}


def field_data(
    recovered: Sequence[Recovered], displacements: Sequence[FloatArray]
) -> dict[str, NDArray[Any]]:
    """Nodal fields of all groups: displacement, stress and principal stresses."""
    return {
        "displacement": np.concatenate([u.reshape(-1, 3) for u in displacements]),
        "stress": np.concatenate([result.stress.reshape(-1, 6) for result in recovered]),
        **stress_fields(result.principal for result in recovered),
    }


def write_curved(
    path: Path,
    groups: Sequence[Body],
    displacements: Sequence[FloatArray],
    owners: Mapping[str, NDArray[np.int32]],
    *,
    finite_rotation: bool,
) -> None:
    """`write_fields` of elements of higher degree: Lagrange cells with nodes of their own."""
    positions, moved, principal = [], [], []
    for group, u in zip(groups, displacements, strict=True):
        local, _ = block_displacements(group, u, finite_rotation=finite_rotation)
        cells = cells_of(moved_bodies(group, local))
        world = equidistant(cells.degree).values @ u[:, group.mesh.connectivity]
        turns = group.rotations[:, None, None]
        placed = (turns @ cells.positions[..., None])[..., 0]
        placed = placed + group.translations[:, None, None]
        positions.append(placed.reshape(-1, *placed.shape[2:]))
        moved.append(world.reshape(-1, 3))
        principal.append(cells.principal)
    fields = {"displacement": np.concatenate(moved), **stress_fields(principal)}
    places = grid_places(cells.degree)
    write_lagrange_cells(path, np.concatenate(positions), places, fields, owners)


def write_fields(
    path: Path,
    groups: Sequence[Body],
    displacements: Sequence[FloatArray],
    *,
    finite_rotation: bool,
    recovered: Sequence[Recovered] | None = None,
    owners: Mapping[str, NDArray[np.int32]] | None = None,
) -> None:
    """Write the fields of one state as cells of the degree of its elements.

    Displacements are in world axes, each (n_copies, n_nodes, 3) [mm]; with finite rotation that of
    each block is removed before stresses. Where these are known (``recovered``), those at
    integration points are written, too. ``owners`` are those of `element_owners`.
    """
    if groups[0].element.degree > 1:
        given = {} if owners is None else owners
        write_curved(path, groups, displacements, given, finite_rotation=finite_rotation)
        return
    pairs = zip(groups, displacements, strict=True)
    result = recovered or [recover(g, u, finite_rotation=finite_rotation) for g, u in pairs]
    write_hex_mesh(
        path,
        groups_mesh(groups),
        point_data=field_data(result, displacements),
        cell_data={**(owners or {}), **({} if recovered is None else point_data(groups, result))},
    )


def write_solution(found: State, path: Path) -> None:
    """Write the fields of a solution as cells of the degree of its elements."""
    write_fields(
        path,
        found.whole.bodies,
        found.displacements,
        finite_rotation=found.finite_rotation,
        recovered=recovered_of(found),
        owners=element_owners(found.whole),
    )


def point_data(groups: Sequence[Body], recovered: Sequence[Recovered]) -> dict[str, NDArray[Any]]:
    """Principal stresses at the integration points of each element, (n_elements, n_points)."""
    rows = [
        result.point_principal.reshape(group.n_copies * group.mesh.n_elements, -1, 3)
        for group, result in zip(groups, recovered, strict=True)
    ]
    return {
        "sigma_1_integration_points": np.concatenate([r[:, :, 0] for r in rows]),
        "sigma_3_integration_points": np.concatenate([r[:, :, 2] for r in rows]),
    }


def element_owners(deformable: System) -> dict[str, NDArray[np.int32]]:
    """Block, its layer and its group of each element of `groups_mesh`, (n_elements,)."""
    block: list[NDArray[np.int32]] = []
    body_number: list[NDArray[np.int32]] = []
    for number, group in enumerate(deformable.bodies):
        own = np.flatnonzero(deformable.body_number == number)
        copies = np.full(group.n_copies, -1)
        # Images of a block stand for the copy of their original: the first named is itself.
        copies[deformable.copy_of[own[::-1]]] = own[::-1]
        block.append(np.repeat(copies, group.mesh.n_elements).astype(np.int32))
        body_number.append(np.full(len(block[-1]), number, dtype=np.int32))
    blocks = np.concatenate(block)
    return {
        "block": blocks,
        "layer": deformable.assembly.layer[blocks].astype(np.int32),
        "group": np.concatenate(body_number),
    }


class FrameWriter:
    """Writes frames as ``frame_0000.vtu`` … and a ``frames.pvd`` that names their times.

    Where a run may end early, more frames come than were asked for: while it runs up to twice as
    many are kept, every second one goes when there are more, and at the end those stay that are
    spread best, the last always.
    """

    def __init__(self, folder: Path, case: Case, *, resumed: bool = False) -> None:
        self.folder = folder
        self.case = case
        self.count: int = case.method.frames  # type: ignore[union-attr]
        self.kept: dict[int, float] = self._known() if resumed else {}
        """Time of each frame by its number."""
        numbers = sorted(self.kept)
        self.stride = max(1, numbers[1] - numbers[0]) if len(numbers) > 1 else 1

    def __call__(self, frame: Frame) -> None:
        """Write one frame and bring the collection up to date."""
        if frame.number == 0:  # nothing is left of an earlier run, or of a first try
            for path in self.folder.glob(FRAMES):
                path.unlink()
            self.kept, self.stride = {}, 1
        if frame.number % self.stride and not frame.last:
            return
        path = self.folder / _frame_name(frame.number)
        turning = self.case.problem.finite_rotation
        write_fields(path, frame.bodies, frame.displacements, finite_rotation=turning)
        self.kept[frame.number] = float(frame.time)
        if frame.last:
            self._finish()
        elif len(self.kept) > 2 * self.count:
            self.stride *= 2
            self._drop([number for number in self.kept if number % self.stride])
        self._write_collection()

    def _finish(self) -> None:
        """Keep as many frames as were asked for, numbered one after the other."""
        numbers = sorted(self.kept)
        if len(numbers) > self.count:
            keep = _spread([self.kept[number] for number in numbers], self.count)
            self._drop([number for k, number in enumerate(numbers) if k not in keep])
        times = [self.kept[number] for number in sorted(self.kept)]
        for place, number in enumerate(sorted(self.kept)):
            (self.folder / _frame_name(number)).replace(self.folder / _frame_name(place))
        self.kept = dict(enumerate(times))

    def _drop(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            (self.folder / _frame_name(number)).unlink(missing_ok=True)
            del self.kept[number]

    def _known(self) -> dict[int, float]:
        """Frames that the run wrote before it was interrupted."""
        try:
            text = (self.folder / "frames.pvd").read_text("utf-8")
        except OSError:
            return {}
        result = re.findall(r'timestep="([^"]+)" file="frame_(\d+)\.vtu"', text)
        return {int(number): float(time) for time, number in result}

    def _write_collection(self) -> None:
        lines = [
            f'    <DataSet timestep="{self.kept[number]!r}" file="{_frame_name(number)}"/>'
            for number in sorted(self.kept)
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


def _spread(times: Sequence[float], count: int) -> set[int]:
    """Places of so many times that lie as evenly as can be, the last always among them."""
    chosen = [len(times) - 1]
    for place in range(count - 2, -1, -1):
        wanted = times[-1] * place / (count - 1)
        among = range(place, chosen[-1])  # enough are left for those before
        chosen.append(min(among, key=lambda k: abs(times[k] - wanted)))
    return set(chosen)


def _frame_name(number: int) -> str:
    return f"frame_{number:04d}.vtu"
