"""Fields of a deformable run for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fem.assembly.deformable import DeformableAssembly
from fem.explicit.solve import Frame
from fem.problem.model import BlockGroup
from fem.problem.recovery import recover
from geometry.assembly import Assembly
from geometry.files.mesh_io import write_hex_mesh
from geometry.mesh import FloatArray, HexMesh, IntArray
from validation.output.files import write_whole

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


def element_owners(deformable: DeformableAssembly) -> dict[str, NDArray[np.int32]]:
    """Block, its layer and its group of each element of `groups_mesh`, (n_elements,)."""
    block: list[NDArray[np.int32]] = []
    group_of: list[NDArray[np.int32]] = []
    for number, group in enumerate(deformable.model.groups):
        own = np.flatnonzero(deformable.group_of == number)
        copies = np.full(group.n_copies, -1)
        # Images of a block stand for the copy of their original: the first named is itself.
        copies[deformable.copy_of[own[::-1]]] = own[::-1]
        block.append(np.repeat(copies, group.mesh.n_elements).astype(np.int32))
        group_of.append(np.full(len(block[-1]), number, dtype=np.int32))
    blocks = np.concatenate(block)
    return {
        "block": blocks,
        "layer": deformable.assembly.layer[blocks].astype(np.int32),
        "group": np.concatenate(group_of),
    }


def facet_owners(
    assembly: Assembly, block_m: IntArray, block_s: IntArray
) -> dict[str, NDArray[np.int32]]:
    """Blocks and layers on both sides of each contact facet, (n_facets,)."""
    return {
        "block_m": block_m.astype(np.int32),
        "block_s": block_s.astype(np.int32),
        "layer_m": assembly.layer[block_m].astype(np.int32),
        "layer_s": assembly.layer[block_s].astype(np.int32),
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
