"""Linear statics of blocks that do not touch: K u = f with prescribed displacements."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fem.assembly.deformable import DeformableAssembly
from fem.assembly.local_system import NOTHING_HELD, HeldNodes, by_node, constraint_transform
from fem.problem.model import BlockGroup, Model, ModelError, rigid_motions
from fem.problem.springs import Springs
from fem.static.result import StaticResult
from geometry.mesh import FloatArray

_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


@dataclass(frozen=True)
class LinearStaticResult:
    """Displacements in equilibrium with the loads at amplitude one."""

    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm], world axes."""
    support_forces: tuple[FloatArray, ...]
    """Of the supports on the nodes of each group, alike [N]."""
    strain_energy: float
    """½ uᵀKu [N mm]."""
    external_work: float
    """½ fᵀu of the loads [N mm]; equals the strain energy where supports do not move."""
    residual: float
    """‖f - K u‖ on the free components, relative to ‖f‖."""
    cpu_seconds: float
    """CPU time of the solution [s]."""


def rigid_modes(positions: FloatArray) -> FloatArray:
    """Six rigid motions of points (n, 3) about their mean, unit length scale: (3 n, 6)."""
    arm = positions - positions.mean(axis=0)
    arm = arm / max(float(np.abs(arm).max()), 1e-300)
    return rigid_motions(arm).reshape(-1, 6)


def _held(model: Model, group: int, copy: int) -> HeldNodes:
    """Nodes of one copy that are held or moved, in world axes, at amplitude one."""
    nodes, directions, values = [], [], []
    for support in model.supports:
        mine = support.copies == copy
        if support.group == group and mine.any():
            nodes.append(support.nodes[mine])
            directions.append(support.directions[mine])
            values.append(support.displacement[mine][:, None])
    if not nodes:
        return NOTHING_HELD
    result, _ = by_node(np.concatenate(nodes), np.concatenate(directions), np.concatenate(values))
    return result


def check_held(name: str, positions: FloatArray, held: HeldNodes, springs: Springs | None) -> None:
    """Refuse supports and springs that leave a rigid motion.

    Raises
    ------
    ModelError
        Naming the motion that is free.
    """
    modes = rigid_modes(positions)
    at_nodes = modes.reshape(-1, 3, 6)[held.nodes]
    felt = np.einsum("nik,nim->nkm", held.axes, at_nodes) * held.held[:, :, None]
    rows = [felt.reshape(-1, 6), np.zeros((6, 6))]
    if springs is not None:
        resisted = springs.stiffness @ modes
        rows.append(resisted / np.abs(springs.matrices).max())
    _, values, right = np.linalg.svd(np.vstack(rows), full_matrices=False)
    if values[-1] > 1e-9 * max(values[0], 1.0):
        return
    motion = _MOTIONS[int(np.argmax(np.abs(right[-1])))]
    raise ModelError(
        f"{name}: the supports leave a rigid motion free (mainly {motion}); expected a static run "
        "to hold all six: fix a face, or solve by explicit dynamics"
    )


def _loads(model: Model, group: int, copy: int) -> FloatArray:
    """Nodal forces of one copy at amplitude one, gravity included, (3 n_nodes,) [N]."""
    target = model.groups[group]
    force = np.zeros((target.n_nodes, 3))
    for load in model.loads:
        if load.group == group:
            mine = load.copies == copy
            np.add.at(force, load.nodes[mine], load.forces[mine])
    if model.effects.gravity is not None:
        force += target.lumped_mass[:, None] * model.effects.gravity
    return force.ravel()


def _world_stiffness(group: BlockGroup, copy: int) -> sp.csr_array:
    turn = sp.kron(sp.eye_array(group.n_nodes), group.rotations[copy], format="csr")
    return sp.csr_array(turn @ sp.csr_array(group.stiffness) @ turn.T)


def solve_linear_static(model: Model) -> LinearStaticResult:
    """Solve K u = f for every block by itself.

    Parameters
    ----------
    model
        Blocks without interactions; loads and prescribed displacements at amplitude one.

    Raises
    ------
    ModelError
        Supports that leave a rigid motion, or blocks that interact.
    """
    if model.interactions:
        raise ModelError("static: got blocks in contact; expected the contact solver for them")
    started = time.process_time()
    displacements, supported = [], []
    energy = work = defect = scale = 0.0
    for number, group in enumerate(model.groups):
        positions = group.reference_positions()
        result, reactions = np.zeros((2, group.n_copies, group.n_nodes, 3))
        for copy in range(group.n_copies):
            held = _held(model, number, copy)
            check_held(f"{group.name}[{copy}]", positions[copy], held, group.springs)
            transform, free, given = constraint_transform(held, group.n_nodes)
            stiffness = _world_stiffness(group, copy)
            turned = sp.csr_array(transform.T @ stiffness @ transform)
            free_rows = turned[free]
            force = _loads(model, number, copy)
            right = (transform.T @ force)[free] - free_rows @ given
            given[free] = splu(sp.csc_matrix(free_rows.tocsc()[:, free])).solve(right)
            u = transform @ given
            internal = stiffness @ u
            energy += 0.5 * float(u @ internal)
            work += 0.5 * float(force @ u)
            left = transform.T @ (force - internal)
            defect += float(np.sum(left[free] ** 2))
            scale += float(np.sum((transform.T @ force)[free] ** 2) + np.sum(right**2))
            left[free] = 0.0
            reactions[copy] = -(transform @ left).reshape(-1, 3)
            result[copy] = u.reshape(-1, 3)
        displacements.append(result)
        supported.append(reactions)
    return LinearStaticResult(
        displacements=tuple(displacements),
        support_forces=tuple(supported),
        strain_energy=energy,
        external_work=work,
        residual=float(np.sqrt(defect / scale)) if scale > 0 else 0.0,
        cpu_seconds=time.process_time() - started,
    )


def solve_apart(
    deformable: DeformableAssembly, *, load_steps: int = 1, keep_steps: bool = False
) -> StaticResult:
    """Find the static state of blocks that meet none: a linear problem for each.

    Parameters
    ----------
    deformable
        Blocks, loads and supports.
    load_steps, keep_steps
        Whether the result holds so many equal parts of the load, and the displacements of each.

    Raises
    ------
    ModelError
        As `solve_linear_static`.
    """
    result = solve_linear_static(deformable.model)
    none = np.zeros((0, 4))
    shares = [k / load_steps for k in range(1, load_steps + 1)] if keep_steps else []
    moved = result.displacements
    return StaticResult(
        deformable=deformable,
        displacements=moved,
        support_forces=result.support_forces,
        overclosures=none,
        pressures=none,
        residual=result.residual,
        converged=True,
        status=f"equilibrium of single bodies, residual {result.residual:.1e}",
        steps=tuple((share, tuple(share * u for u in moved)) for share in shares),
        loose_blocks=np.zeros(0, dtype=np.int64),
        residuals=(result.residual,),
        strain_energy=result.strain_energy,
        contact_energy=0.0,
        external_work=result.external_work,
        frictional_dissipation=0.0,
        symmetry=1,
        representative=np.arange(deformable.assembly.n_blocks),
        n_unknowns=3 * deformable.model.n_nodes,
        cpu_seconds={"total": result.cpu_seconds},
        load_steps=load_steps,
    )
