"""Linear statics of blocks that do not touch: K u = f with prescribed displacements."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fem.assembly.deformable import DeformableAssembly
from fem.problem.model import BlockGroup, Model, ModelError, rigid_motions
from fem.static.result import StaticResult
from geometry.mesh import FloatArray, IntArray

_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


@dataclass(frozen=True)
class LinearStaticResult:
    """Displacements in equilibrium with the loads at amplitude one."""

    displacements: tuple[FloatArray, ...]
    """Of each group, (n_copies, n_nodes, 3) [mm], world axes."""
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


def _constraints(model: Model, group: int, copy: int) -> tuple[FloatArray, FloatArray]:
    """Rows C and values d of C u = d for one copy, at amplitude one: (n, 3 n_nodes) and (n,)."""
    n_nodes = model.groups[group].n_nodes
    rows, values = [], []
    for support in model.supports:
        if support.group != group:
            continue
        mine = np.flatnonzero(support.copies == copy)
        block = np.zeros((len(mine), n_nodes, 3))
        block[np.arange(len(mine)), support.nodes[mine]] = support.directions[mine]
        rows.append(block.reshape(len(mine), -1))
        values.append(support.displacement[mine])
    if not rows:
        return np.zeros((0, 3 * n_nodes)), np.zeros(0)
    return np.concatenate(rows), np.concatenate(values)


def check_held(name: str, positions: FloatArray, constraints: FloatArray) -> None:
    """Refuse supports that leave a rigid motion.

    Raises
    ------
    ModelError
        Naming the motion that is free.
    """
    modes = rigid_modes(positions)
    held = constraints @ modes
    _, values, right = np.linalg.svd(np.vstack([held, np.zeros((6, 6))]), full_matrices=False)
    if values[-1] > 1e-9 * max(values[0], 1.0):
        return
    motion = _MOTIONS[int(np.argmax(np.abs(right[-1])))]
    raise ModelError(
        f"{name}: the supports leave a rigid motion free (mainly {motion}); expected a static run "
        "to hold all six: fix a face, or solve by explicit dynamics"
    )


def _free_components(constraints: FloatArray) -> IntArray:
    """Components that no support holds; supports must be parallel to an axis."""
    component = np.abs(constraints).argmax(axis=1)
    if len(constraints) and not np.allclose(
        np.abs(constraints[np.arange(len(constraints)), component]), 1.0
    ):
        raise ModelError(
            "static: got supports that are not parallel to an axis; expected x, y or z"
        )
    return np.setdiff1d(np.arange(constraints.shape[1]), component)


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
    displacements = []
    energy = work = defect = scale = 0.0
    for number, group in enumerate(model.groups):
        positions = group.reference_positions()
        found = np.zeros((group.n_copies, group.n_nodes, 3))
        for copy in range(group.n_copies):
            rows, values = _constraints(model, number, copy)
            check_held(f"{group.name}[{copy}]", positions[copy], rows)
            free = _free_components(rows)
            stiffness = _world_stiffness(group, copy)
            free_rows = stiffness[free]
            force = _loads(model, number, copy)
            u = np.zeros(3 * group.n_nodes)
            for row, value in zip(rows, values, strict=True):
                component = int(np.abs(row).argmax())
                u[component] = value * row[component]
            right = force[free] - free_rows @ u
            u[free] = splu(sp.csc_matrix(free_rows.tocsc()[:, free])).solve(right)
            internal = stiffness @ u
            energy += 0.5 * float(u @ internal)
            work += 0.5 * float(force @ u)
            defect += float(np.sum((force - internal)[free] ** 2))
            scale += float(np.sum(force[free] ** 2) + np.sum(right**2))
            found[copy] = u.reshape(-1, 3)
        displacements.append(found)
    return LinearStaticResult(
        displacements=tuple(displacements),
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
    found = solve_linear_static(deformable.model)
    none = np.zeros((0, 4))
    shares = [k / load_steps for k in range(1, load_steps + 1)] if keep_steps else []
    moved = found.displacements
    return StaticResult(
        deformable=deformable,
        displacements=moved,
        overclosures=none,
        pressures=none,
        residual=found.residual,
        converged=True,
        status=f"equilibrium of single bodies, residual {found.residual:.1e}",
        steps=tuple((share, tuple(share * u for u in moved)) for share in shares),
        loose_blocks=np.zeros(0, dtype=np.int64),
        residuals=(found.residual,),
        strain_energy=found.strain_energy,
        contact_energy=0.0,
        external_work=found.external_work,
        frictional_dissipation=0.0,
        symmetry=1,
        representative=np.arange(deformable.assembly.n_blocks),
        n_unknowns=3 * deformable.model.n_nodes,
        cpu_seconds={"total": found.cpu_seconds},
        load_steps=load_steps,
    )
