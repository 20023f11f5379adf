"""The rigid answer in the type that all solvers share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np

from geometry.answer import Answer, Array, Lazy, Measure, interface_contacts, known, place
from geometry.assembly import AnyBlocks, Assembly
from geometry.errors import RefusedError
from geometry.loads import LoadCase
from geometry.measures import joint_resultants
from geometry.mesh import FloatArray, IntArray
from mbd.analysis import RigidResult, RigidStatement, check_types, rigid_result
from mbd.mechanism import Classification, Mechanism, SelfStress
from mbd.options import Norm, Solver

Option = TypeVar("Option", Norm, Solver)


def analyse(
    assembly: AnyBlocks | RigidStatement,
    load: LoadCase | None = None,
    *,
    norm: Norm | str | None = None,
    solver: Solver | str = Solver.NEWTON,
) -> Answer:
    """Classify rigid blocks without friction and solve for their contact forces (Algorithm 1).

    Parameters
    ----------
    assembly
        Blocks and conforming interfaces; or a whole statement such as `fem.Problem`, which has its
        load.
    load
        Tractions and supports of blocks that come without.
    norm
        What the contact forces minimise: ``pressure`` or ``force``; None: the default of
        `mbd.rigid_result`.
    solver
        ``newton`` (ours) or ``clarabel``.

    Returns
    -------
    Answer
        Its title says the class and whether the load is carried; `details` is the `RigidResult`.
        Where the load is not carried there are no measures and no pressures, for nothing balances
        it; the field ``mechanism`` is then the first-order motion, largest 1 [-].

    Raises
    ------
    RefusedError
        What rigid blocks do not have, such as gaps.
    """
    check_types(assembly, load)
    if load is None:
        statement = cast("RigidStatement", assembly)
        return analyse(statement.blocks, statement.rigid_load, norm=norm, solver=solver)
    blocks = cast("AnyBlocks", assembly)
    chosen = {} if norm is None else {"norm": _named(Norm, "norm", norm)}
    result = rigid_result(blocks, load, solver=_named(Solver, "solver", solver), **chosen)
    return answer_of(blocks, load, result)


class OptionError(RefusedError):
    """An option that the rigid analysis does not have."""


def _named(kind: type[Option], name: str, value: Option | str) -> Option:
    """Option of a name; one that is an option already stays."""
    try:
        return kind(value)
    except ValueError:
        expected = ", ".join(repr(str(option)) for option in kind)
        raise OptionError(f"{name}: got {value!r}; expected {expected}") from None


def answer_of(assembly: AnyBlocks, load: LoadCase, result: RigidResult) -> Answer:
    """Make the answer of a rigid result."""
    points, cells, block = _points(assembly)
    layer = _layers(assembly)
    motion = block_motion(assembly, load, result)
    fields: dict[str, Callable[[], Array]] = {}
    if motion is not None:
        moving = motion
        fields["mechanism"] = lambda: _node_motion(assembly, moving, points, block)
    carried = "carries the load" if result.equilibrium.holds else "does not carry the load"
    return Answer(
        title=f"{assembly.name}: rigid, {result.mechanism}, {carried}",
        method="rigid",
        measures=known(_measures(assembly, result)),
        fields=Lazy(fields),
        points=points,
        cells=cells,
        block_of_point=block,
        layer_of_point=layer[block],
        contacts=Lazy(_contacts(assembly, result) if result.equilibrium.holds else {}),
        reported=lambda: _report(assembly, result),
        details=result,
    )


def _measures(assembly: AnyBlocks, result: RigidResult) -> dict[str, Measure]:
    """Pressures of the paper and the largest one; none where nothing balances the load."""
    if result.measures is None:
        return {}
    worst = int(result.contact_pressures.argmax())
    at, interfaces = int(result.contact_index[worst]), assembly.interfaces
    pair = int(interfaces.block_m[at]), int(interfaces.block_s[at])
    where: dict[str, Any] | None = None
    if isinstance(assembly, Assembly):
        where = place(assembly, pair, interfaces.centroids[at], None)
    else:
        position = interfaces.centroids[at].tolist()
        where = {"blocks": list(pair), "layer": 0, "face": None, "position": position}
    return {
        "p_max_facet": Measure(float(result.contact_pressures[worst]), "MPa", place=where),
        "p_max": Measure(result.measures.p_max, "MPa"),
        "p_eff": Measure(result.measures.p_eff, "MPa"),
    }


def _contacts(assembly: AnyBlocks, result: RigidResult) -> dict[str, Callable[[], Array]]:
    """Contacts in the order of the interfaces, with pressures and normal forces."""
    index, interfaces = result.contact_index, assembly.interfaces
    values: dict[str, Callable[[], Array]] = {
        "pressure": lambda: result.contact_pressures,
        "force": lambda: result.contact_forces,
    }
    if isinstance(assembly, Assembly):
        return values | interface_contacts(assembly, index)
    return values | {
        "area": lambda: interfaces.areas[index],
        "blocks": lambda: np.column_stack([interfaces.block_m[index], interfaces.block_s[index]]),
        "centroid": lambda: interfaces.centroids[index],
        "normal": lambda: interfaces.normals[index],
    }


def _points(assembly: AnyBlocks) -> tuple[FloatArray, IntArray, IntArray]:
    """Nodes of all blocks, their hexahedra or triangles, and the block of each node."""
    points, cells, first = [], [], 0
    for block in range(assembly.n_blocks):
        shape = assembly.shape(block)
        hexahedral = isinstance(assembly, Assembly)
        own = shape.mesh.nodes if hexahedral else shape.points
        points.append(assembly.place(block, own))
        cells.append((shape.mesh.elements if hexahedral else shape.triangles) + first)
        first += len(own)
    owner = np.repeat(np.arange(assembly.n_blocks), [len(p) for p in points])
    return np.concatenate(points), np.concatenate(cells), owner


def _layers(assembly: AnyBlocks) -> IntArray:
    """Layer of each block; zero where blocks have none."""
    if isinstance(assembly, Assembly):
        return assembly.layer
    return np.zeros(assembly.n_blocks, dtype=np.int64)


def block_motion(assembly: AnyBlocks, load: LoadCase, result: RigidResult) -> FloatArray | None:
    """(δt [mm], δθ [rad]) of each block under the mechanism, (n_blocks, 6); None where locked.

    Prefers the mechanism that the load drives; blocks held by the certificate's supports stay.
    """
    driven, certificate = result.equilibrium.mechanism, result.classification.certificate
    if driven is not None:
        return placed_motion(assembly, driven, ~load.fixed)
    if isinstance(certificate, Mechanism):
        return placed_motion(assembly, certificate.virtual_displacement, ~assembly.fixed)
    return None


def placed_motion(assembly: AnyBlocks, motion: FloatArray, free: Array) -> FloatArray:
    """(δt [mm], δθ [rad]) of all blocks, (n_blocks, 6), from rows of a Jacobian of free ones."""
    moving = np.zeros((assembly.n_blocks, 6))
    moving[free] = motion.reshape(-1, 6)
    moving[:, 3:] /= assembly.characteristic_length
    return moving


def _node_motion(
    assembly: AnyBlocks, moving: FloatArray, points: FloatArray, block: IntArray
) -> FloatArray:
    """First-order displacements of nodes, largest 1, (n_points, 3) [-]."""
    arms = points - assembly.centroids[block]
    moved = moving[block, :3] + np.cross(moving[block, 3:], arms)
    return np.asarray(moved / np.linalg.norm(moved, axis=1).max())


def _report(assembly: AnyBlocks, result: RigidResult) -> dict[str, Any]:
    """Evidence and statistics of the analysis, as plain data."""
    equilibrium = result.equilibrium
    forces = result.contact_forces[:, None] * assembly.interfaces.normals[result.contact_index]
    joints = joint_resultants(assembly.interfaces, result.contact_index, forces)
    return {
        "mechanism": str(result.mechanism),
        "mechanism_as_supported": str(result.supported_classification.mechanism),
        "certificate": certificate_report(result.classification),
        "equilibrium": {
            "holds": equilibrium.holds,
            "residual": equilibrium.residual,
            "iterations": equilibrium.iterations,
            "status": equilibrium.status,
        },
        "joints": joints.as_json() if equilibrium.holds else [],
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "cpu_seconds": result.cpu_seconds,
    }


def certificate_report(classification: Classification) -> dict[str, Any] | None:
    """Return the proof of the mechanism class as plain data."""
    certificate = classification.certificate
    if isinstance(certificate, SelfStress):
        return {
            "kind": "self-stress",
            "smallest_force": float(certificate.forces.min()),
            "residual": certificate.residual,
            "smallest_singular_value": certificate.smallest_singular_value,
        }
    if isinstance(certificate, Mechanism):
        return {
            "kind": "mechanism",
            "virtual_displacement": certificate.virtual_displacement.tolist(),
            "smallest_gap_rate": certificate.smallest_gap_rate,
            "work": certificate.work,
        }
    return None
