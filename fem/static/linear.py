"""Linear statics of blocks that do not touch: K u = f with prescribed displacements."""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sp

from fem.static.linear_step.linearisation import factorize
from fem.static.result import StaticResult
from fem.system.build import DeformableAssembly
from fem.system.model import ModelError, rigid_motions
from fem.system.sector import no_symmetry
from fem.system.system import System, system_of

_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


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
        Supports that leave a rigid motion of a block.
    """
    started = time.process_time()
    system = system_of(deformable, no_symmetry(deformable))
    for slot in range(system.n_slots):
        _check_held(system, slot)
    transform, free = system.held.transform(system.n_nodes)
    given = system.held.variables(system.n_nodes)
    force, stiffness = system.external_force.ravel(), system.stiffness
    rows = sp.csr_array(transform.T @ stiffness @ transform)[free]
    right = (transform.T @ force)[free] - rows @ given
    given[free] = factorize(sp.csr_array(rows.tocsc()[:, free]))(right)
    u = transform @ given
    internal = stiffness @ u
    left = transform.T @ (force - internal)
    scale = float(np.hypot(np.linalg.norm((transform.T @ force)[free]), np.linalg.norm(right)))
    residual = float(np.linalg.norm(left[free])) / scale if scale > 0.0 else 0.0
    left[free] = 0.0
    moved = tuple(system.expand(u.reshape(-1, 3)))
    none = np.zeros(deformable.surfaces.weights.shape)
    shares = [k / load_steps for k in range(1, load_steps + 1)] if keep_steps else []
    return StaticResult(
        deformable=deformable,
        displacements=moved,
        support_forces=tuple(system.expand(-(transform @ left).reshape(-1, 3))),
        overclosures=none,
        pressures=none,
        residual=residual,
        converged=True,
        status=f"equilibrium of single bodies, residual {residual:.1e}",
        steps=tuple((share, tuple(share * u for u in moved)) for share in shares),
        loose_blocks=np.zeros(0, dtype=np.int64),
        residuals=(residual,),
        strain_energy=0.5 * float(u @ internal),
        contact_energy=0.0,
        external_work=0.5 * float(force @ u),
        frictional_dissipation=0.0,
        symmetry=1,
        representative=np.arange(deformable.assembly.n_blocks),
        n_unknowns=3 * deformable.model.n_nodes,
        cpu_seconds={"total": time.process_time() - started},
        load_steps=load_steps,
    )


def _check_held(system: System, slot: int) -> None:
    """Refuse supports and springs that leave a rigid motion of a block, and name it."""
    group, copy = system.group(slot), int(system.deformable.copy_of[system.blocks[slot]])
    positions, nodes = group.reference_positions()[copy], system.nodes_of(slot)
    arm = positions - positions.mean(axis=0)
    # Motions about world axes, in those of the block.
    modes = rigid_motions(arm / max(float(np.abs(arm).max()), 1e-300))
    modes = np.einsum("ij,nik->njk", group.rotations[copy], modes)
    held = system.held
    mine = (held.nodes >= nodes.start) & (held.nodes < nodes.stop)
    at_nodes = modes[held.nodes[mine] - nodes.start]
    felt = np.einsum("nik,nim->nkm", held.axes[mine], at_nodes) * held.held[mine][:, :, None]
    rows = [felt.reshape(-1, 6), np.zeros((6, 6))]
    if group.springs is not None:
        resisted = group.springs.stiffness @ modes.reshape(-1, 6)
        rows.append(resisted / np.abs(group.springs.matrices).max())
    _, values, right = np.linalg.svd(np.vstack(rows), full_matrices=False)
    if values[-1] <= 1e-9 * max(values[0], 1.0):
        motion = _MOTIONS[int(np.argmax(np.abs(right[-1])))]
        raise ModelError(
            f"{group.name}[{copy}]: the supports leave a rigid motion free (mainly {motion}); "
            "expected a static run to hold all six: fix a face, or solve by explicit dynamics"
        )
