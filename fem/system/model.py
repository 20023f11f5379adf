"""The statement of a problem: deformable blocks, what holds them, what loads them.

Everything here is constant; what evolves is `fem.explicit.state.State`. World axes, mm, N, t, s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.sparse import bsr_array

from fem.element.kinds import (
    Element,
    block_hourglass_stiffness,
    block_internal_force,
    block_lumped_mass,
    block_stiffness,
    element_of,
    nodal_stress,
    point_stress,
)
from fem.element.material import Material
from fem.system.effects import Effects
from fem.system.springs import Springs
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, HexMesh, IntArray, ReadOnlyArrays

Amplitude = Callable[[float], float]
"""Factor of a load or a displacement as a function of time [s]."""


class ModelError(RefusedError):
    """A model no solver can use: the message says what was got, what was expected."""


@dataclass(frozen=True)
class ReferenceBlock:
    """Stiffness of a block, assembled at first use."""

    mesh: HexMesh
    """[mm]."""
    material: Material
    element: Element
    springs: Springs | None = None
    """Between its surface and the ground; None: none."""

    def of_elements(self, some: IntArray) -> FloatArray:
        """Stiffness matrices of some elements, springs included, (m, 3 n, 3 n) [N/mm]."""
        coordinates = self.mesh.nodes[self.mesh.connectivity[some]]
        result = self.element.stiffness(coordinates, self.material)
        return result if self.springs is None else self.springs.added(some, result)

    @cached_property
    def stiffness(self) -> bsr_array:
        """Springs included, (3 n_nodes, 3 n_nodes) [N/mm]."""
        result = block_stiffness(self.mesh, self.material, self.element)
        if self.springs is None:
            return result
        return bsr_array((result + self.springs.stiffness).tocsr(), blocksize=(3, 3))

    def internal_force(self, displacement: FloatArray) -> FloatArray:
        """K u of copies, springs included, (n_copies, n_nodes, 3) [mm] to the same [N]."""
        flat = displacement.reshape(len(displacement), -1).T
        if self.element.degree == 1:
            return np.asarray((self.stiffness @ flat).T.reshape(displacement.shape))
        force = block_internal_force(self.mesh, self.material, displacement)
        if self.springs is not None:
            force += (self.springs.stiffness @ flat).T.reshape(displacement.shape)
        return force

    @cached_property
    def hourglass_stiffness(self) -> bsr_array | None:
        """The part of `stiffness` that controls hourglass modes; None where there are none."""
        return block_hourglass_stiffness(self.mesh, self.material, self.element)


@dataclass(frozen=True)
class BlockGroup(ReadOnlyArrays):
    """Congruent copies of one meshed block: x = rotation @ X + translation."""

    name: str
    """Name in messages; a copy is ``name[k]``."""
    mesh: HexMesh
    """Reference block [mm]."""
    material: Material
    """Elastic constants and density."""
    element: Element
    rotations: FloatArray
    """Rigid placement of each copy, (n_copies, 3, 3)."""
    translations: FloatArray
    """(n_copies, 3) [mm]."""
    reference: ReferenceBlock
    """Stiffness of one copy in its reference position."""
    lumped_mass: FloatArray
    """(n_nodes,) [t]."""
    added_mass: float = 0.0
    """Part of the lumped mass of one copy that mass scaling added [t]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_group(self)

    @property
    def stiffness(self) -> bsr_array:
        """Of the reference block, (3 n_nodes, 3 n_nodes) [N/mm]."""
        return self.reference.stiffness

    @property
    def springs(self) -> Springs | None:
        """Between the surface of each copy and the ground; None: none."""
        return self.reference.springs

    @property
    def hourglass_stiffness(self) -> bsr_array | None:
        """The part of `stiffness` that controls hourglass modes, for their energy."""
        return self.reference.hourglass_stiffness

    @property
    def n_copies(self) -> int:
        """Number of copies."""
        return len(self.rotations)

    @property
    def n_nodes(self) -> int:
        """Nodes of one copy."""
        return self.mesh.n_nodes

    def point_stress(self, local: FloatArray) -> FloatArray:
        """Stress at the points of the elements, (n_copies, n_points, 6) [MPa].

        From displacements in the axes of the reference block, (n_copies, n_nodes, 3) [mm].
        """
        return point_stress(self.mesh, self.material, self.element, local)

    def nodal_stress(self, local: FloatArray) -> FloatArray:
        """The same at the nodes, (n_copies, n_nodes, 6) [MPa]."""
        return nodal_stress(self.mesh, self.material, self.element, local)

    def reference_positions(self) -> FloatArray:
        """Undeformed nodes of all copies in world axes, (n_copies, n_nodes, 3) [mm]."""
        turned = np.einsum("cij,nj->cni", self.rotations, self.mesh.nodes)
        return turned + self.translations[:, None]


def block_group(
    mesh: HexMesh,
    material: Material,
    *,
    element: Element | None = None,
    rotations: FloatArray | None = None,
    translations: FloatArray | None = None,
    springs: Springs | None = None,
    name: str = "block",
) -> BlockGroup:
    """Assemble the reference block and place its copies.

    ``element`` is that of the mesh; None: `fem.element.kinds.element_of`. Copies are placed by
    rotations (n_copies, 3, 3) and translations (n_copies, 3) [mm]; by default one copy is in its
    reference position.

    Raises
    ------
    MeshError, ModelError
        An unusable mesh or placement.
    """
    if rotations is None:
        count = 1 if translations is None else len(translations)
        rotations = np.tile(np.eye(3), (count, 1, 1))
    if translations is None:
        translations = np.zeros((len(rotations), 3))
    chosen = element_of(mesh) if element is None else element
    return BlockGroup(
        name=name,
        mesh=mesh,
        material=material,
        element=chosen,
        rotations=rotations,
        translations=translations,
        reference=ReferenceBlock(mesh, material, chosen, springs),
        lumped_mass=block_lumped_mass(mesh, material.density),
    )


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of nodes of one group, in world axes.

    Entry k prescribes n_k · u = amplitude(t) · displacement_k at node ``nodes[k]`` of copy
    ``copies[k]``; the directions n_k of one node are orthonormal.
    """

    group: int
    """Number of the group in the model."""
    copies: IntArray
    """(n,)"""
    nodes: IntArray
    """(n,)"""
    directions: FloatArray
    """Unit vectors in world axes, (n, 3)."""
    displacement: FloatArray
    """(n,) [mm] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time."""
    name: str = "support"
    """In tables of reactions; entries of one name are one support."""


def fixed_nodes(
    group: int,
    nodes: IntArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    components: tuple[int, ...] = (0, 1, 2),
    displacement: FloatArray | None = None,
    amplitude: Amplitude | None = None,
    name: str = "support",
) -> Support:
    """Hold, or move along a world vector, the same nodes in every one of ``copies``.

    Parameters
    ----------
    group
        Number of the group.
    nodes
        Node numbers in the reference mesh, (n,).
    copies
        Copies that are held.
    components
        World components that are prescribed; the others are free.
    displacement
        (3,) [mm]; None holds the nodes where they are.
    amplitude
        Factor of the displacement in time.
    name
        In tables of reactions.
    """
    where = [
        a.ravel()
        for a in np.meshgrid(np.asarray(copies), np.asarray(nodes), components, indexing="ij")
    ]
    value = np.zeros(3) if displacement is None else np.asarray(displacement, dtype=np.float64)
    return Support(
        group=group,
        copies=where[0].astype(np.int64),
        nodes=where[1].astype(np.int64),
        directions=np.eye(3)[where[2]],
        displacement=value[where[2]],
        amplitude=amplitude,
        name=name,
    )


@dataclass(frozen=True)
class NodalLoad:
    """Forces on nodes of one group, amplitude(t) · forces, in world axes."""

    group: int
    """Number of the group in the model."""
    copies: IntArray
    """(n,)"""
    nodes: IntArray
    """(n,)"""
    forces: FloatArray
    """(n, 3) [N] at amplitude one."""
    amplitude: Amplitude | None = None
    """None: constant in time from the first step on."""
    follows_block: bool = False
    """Whether the forces turn with the frame of their block (needs finite rotation)."""


def nodal_load(
    group: int,
    forces: FloatArray,
    *,
    copies: Sequence[int] | IntArray = (0,),
    amplitude: Amplitude | None = None,
    follows_block: bool = False,
) -> NodalLoad:
    """Load the same nodes of every one of ``copies`` by dense nodal forces; see `NodalLoad`.

    Forces are (n_nodes, 3) on each copy, or (n_copies, n_nodes, 3), world axes [N]; zero rows are
    dropped.
    """
    copies = np.asarray(copies, dtype=np.int64)
    dense = np.broadcast_to(forces, (len(copies), *np.shape(forces)[-2:]))
    k, node = np.nonzero(np.any(dense != 0.0, axis=2))
    return NodalLoad(
        group, copies[k], node.astype(np.int64), dense[k, node], amplitude, follows_block
    )


class InteractionModel(Protocol):
    """Statement of forces between blocks, such as contact; frozen."""

    def touched_nodes(self, group: int) -> IntArray:
        """Nodes of the group's mesh on which forces may act, (n,)."""

    def nodal_stiffness(self, group: int) -> FloatArray | None:
        """Stiffness to count on each node for the critical time step, (n_nodes,) [N/mm]."""

    def bind(self, bodies: Any) -> Any:
        """Prepare the force for the loop: a `fem.explicit.step.Interaction` of its bodies."""


@dataclass(frozen=True)
class Model:
    """Deformable blocks with supports, loads and effects."""

    groups: tuple[BlockGroup, ...]
    """Distinct block shapes with their copies."""
    supports: tuple[Support, ...] = ()
    """Prescribed displacements."""
    loads: tuple[NodalLoad, ...] = ()
    """Nodal forces."""
    effects: Effects = field(default_factory=Effects)
    """Damping, viscosity, rotation, gravity."""
    interactions: tuple[InteractionModel, ...] = ()
    """Contact; empty when blocks do not meet."""

    def __post_init__(self) -> None:
        if not self.groups:
            raise ModelError("model: got no blocks; expected at least one group")
        for k, support in enumerate(self.supports):
            _check_entries(self, f"support {k}", support.group, support.copies, support.nodes)
            _check_support(k, support)
        for k, load in enumerate(self.loads):
            _check_entries(self, f"load {k}", load.group, load.copies, load.nodes)
            _check_load(k, load, self.effects)
        if self.effects.finite_rotation:
            refuse_turning_springs(self.groups)

    @property
    def n_elements(self) -> int:
        """Hexahedra of all copies."""
        return sum(g.mesh.n_elements * g.n_copies for g in self.groups)

    @property
    def n_nodes(self) -> int:
        """Nodes of all copies."""
        return sum(g.n_nodes * g.n_copies for g in self.groups)


def refuse_turning_springs(groups: Sequence[BlockGroup]) -> None:
    """Reject springs of blocks that may turn by any angle."""
    if any(group.springs is not None for group in groups):
        raise ModelError(
            "springs: got blocks that may turn by any angle, which springs to the ground do not "
            "follow; expected small rotations (finite_rotation off, pressures that do not turn "
            "with their block)"
        )


def _check_group(group: BlockGroup) -> None:
    n = group.n_nodes
    copies = len(group.rotations)
    if copies == 0 or group.rotations.shape != (copies, 3, 3):
        raise ModelError(
            f"{group.name}: got rotations of shape {group.rotations.shape}, "
            "expected (n_copies, 3, 3) with at least one copy"
        )
    if group.translations.shape != (copies, 3) or not np.isfinite(group.translations).all():
        raise ModelError(
            f"{group.name}: got translations of shape {group.translations.shape}, "
            f"expected {(copies, 3)} finite numbers"
        )
    product = np.einsum("cij,ckj->cik", group.rotations, group.rotations)
    proper = np.abs(product - np.eye(3)).max(axis=(1, 2)) < 1e-9
    proper &= np.linalg.det(group.rotations) > 0.0
    if not proper.all():
        bad = int(np.flatnonzero(~proper)[0])
        raise ModelError(f"{group.name}[{bad}]: placement is not a rotation (R Rᵀ = 1, det R = 1)")
    if group.lumped_mass.shape != (n,):
        raise ModelError(f"{group.name}: got mass {group.lumped_mass.shape} for {n} nodes")
    if not (group.lumped_mass > 0.0).all():
        bad = int(np.flatnonzero(~(group.lumped_mass > 0.0))[0])
        raise ModelError(
            f"{group.name}: node {bad} has mass {group.lumped_mass[bad]} t; expected positive "
            "masses (every node belongs to an element, and elements are less distorted)"
        )


def _check_entries(model: Model, what: str, group: int, copies: IntArray, nodes: IntArray) -> None:
    if not 0 <= group < len(model.groups):
        raise ModelError(f"{what}: got group {group}, expected 0 to {len(model.groups) - 1}")
    target = model.groups[group]
    for name, entries, end in (("copy", copies, target.n_copies), ("node", nodes, target.n_nodes)):
        if len(entries) and not (entries.min() >= 0 and entries.max() < end):
            raise ModelError(
                f"{what}: got {name} {int(entries.min())} to {int(entries.max())}, expected "
                f"0 to {end - 1} of {target.name}"
            )


def _check_support(k: int, support: Support) -> None:
    if not (np.isfinite(support.displacement).all() and np.isfinite(support.directions).all()):
        raise ModelError(f"support {k}: got a displacement or direction that is not finite")
    start = 0.0 if support.amplitude is None else support.amplitude(0.0)
    if support.displacement.any() and (support.amplitude is None or abs(start) > 1e-12):
        raise ModelError(
            f"support {k}: the prescribed displacement jumps at time 0; expected an amplitude "
            "that starts from zero, such as a smooth step"
        )


def _check_load(k: int, load: NodalLoad, effects: Effects) -> None:
    if not np.isfinite(load.forces).all():
        raise ModelError(f"load {k}: got a force that is not finite")
    if load.follows_block and not effects.finite_rotation:
        raise ModelError(
            f"load {k}: follows_block needs finite rotation; set effects.finite_rotation"
        )


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Unit translations and turns of points about an origin, (n, 3, 6).

    ``arms`` are the points from the origin, (n, 3), over a length that makes all six of order one.
    """
    motions = np.zeros((len(arms), 3, 6))
    for axis in range(3):
        motions[:, axis, axis] = 1.0
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return motions
