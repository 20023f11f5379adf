"""From an assembly and a load case to deformable blocks in contact.

Congruent blocks are copies of one body with one stiffness. Frame blocks are rigid supports
(no degrees of freedom) or deformable blocks held at their outer faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fem.contact.law import ContactLaw
from fem.contact.surfaces import (
    MatchedFacets,
    check_initial_overlap,
    contact_surfaces,
)
from fem.element.hexahedron import ElementType
from fem.element.kinds import block_lumped_mass, element_of
from fem.element.lagrange import with_degree
from fem.element.material import Material
from fem.system.body import Body, ModelError, Springs, placed_body, springs_on
from fem.system.rows import (
    ALL_THE_WAY,
    Amplitude,
    ForceRows,
    HeldRows,
    TabularAmplitude,
    edge_forces,
    facet_points,
    held_at,
    joined_rows,
    pressure_forces,
    traction_forces,
    wrench_forces,
)
from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.loads import FaceLoad, LoadCase, PressureLoad, TractionLoad
from geometry.mesh import BoolArray, FloatArray, IntArray
from geometry.parts.regions import HeldFace, region_nodes, region_quads


class DeformableAssemblyError(RefusedError):
    """An assembly that cannot be computed as deformable blocks."""


#: Directions that differ by less are one [-].
_SAME = 1e-9
#: Outer face of a fixed block in the first and in the last layer, the first that exists.
_OUTER_FACES = {"first": ("bottom", "z-"), "last": ("top", "z+")}


def touching_surfaces(
    assembly: Assembly,
    system: BoolArray,
    offsets: FloatArray,
    clearance: float,
    law: ContactLaw,
) -> MatchedFacets:
    """Matched facets of which at least one block deforms, rejected where they overlap too deeply.

    Raises
    ------
    ContactError
        Blocks that overlap at the start by more than the law's range.
    """
    surfaces = contact_surfaces(assembly, offsets, clearance=clearance)
    touching = system[surfaces.block_m] | system[surfaces.block_s]
    surfaces = surfaces.subset(np.flatnonzero(touching))
    check_initial_overlap(surfaces, law, clearance)
    return surfaces


def curved(assembly: Assembly, degree: int) -> Assembly:
    """Give all blocks elements of a degree."""
    shapes = tuple(with_degree(shape, degree) for shape in assembly.shapes)
    return replace(assembly, shapes=shapes)


def check_cell(assembly: Assembly, *, rigid: bool, finite_sliding: bool) -> None:
    """Reject what a periodic cell does not have: ``rigid`` says how its fixed blocks would be."""
    if not rigid:
        raise DeformableAssemblyError(
            f"{assembly.name}: a periodic cell has no frame to deform; expected rigid frames"
        )
    if finite_sliding:
        raise DeformableAssemblyError(
            f"{assembly.name}: blocks of a periodic cell cannot slide on to other images; expected "
            "finite sliding off"
        )


def check_held(assembly: Assembly, load: LoadCase) -> None:
    """Reject blocks that no chain of contacts connects to a fixed block or a support."""
    result, n = assembly.interfaces, assembly.n_blocks
    touch = coo_array((np.ones(result.n_contacts), (result.block_m, result.block_s)), shape=(n, n))
    _, part = connected_components(touch, directed=False)
    holds = load.fixed.copy()
    holds[[face.block for face in load.held]] = True
    loose = np.flatnonzero(~np.isin(part, part[holds]))
    if len(loose):
        names = ", ".join(str(b) for b in loose[:8]) + (", …" if len(loose) > 8 else "")
        raise DeformableAssemblyError(
            f"{assembly.name}: {len(loose)} blocks are unrestrained ({names}); expected every "
            "block to touch a fixed one, directly or through others: add supports or end rings"
        )


def block_groups(
    assembly: Assembly,
    system: BoolArray,
    offsets: FloatArray,
    materials: tuple[Material, ...],
    element: ElementType,
    *,
    held: tuple[HeldFace, ...] = (),
) -> tuple[tuple[Body, ...], IntArray, IntArray]:
    """One body for each shape and material that deforms, copies in the order of the blocks.

    ``materials`` are those of all blocks, (n_blocks,).

    Blocks on springs share a body where their springs are the same.

    Returns
    -------
    tuple[tuple[Body, ...], IntArray, IntArray]
        The bodies; number of the body and copy of each block, -1 for rigid ones, (n_blocks,).
    """
    body_number = np.full(assembly.n_blocks, -1, dtype=np.int64)
    copy_of = np.full(assembly.n_blocks, -1, dtype=np.int64)
    bodies: list[Body] = []
    kinds, springs = _springs(assembly, held)
    alike: dict[tuple[int, int, Material], list[int]] = {}
    for block in np.flatnonzero(system).tolist():
        key = int(assembly.shape_of[block]), int(kinds[block]), materials[block]
        alike.setdefault(key, []).append(block)
    for (number, kind, material), blocks in sorted(alike.items(), key=lambda found: found[0][:2]):
        shape = assembly.shapes[number]
        body_number[blocks] = len(bodies)
        copy_of[blocks] = np.arange(len(blocks))
        bodies.append(
            placed_body(
                shape.mesh,
                material,
                element=element_of(shape.mesh, element),
                rotations=assembly.rotations[blocks],
                translations=assembly.translations[blocks] + offsets[blocks],
                springs=springs[int(kind)],
                name=shape.name,
            )
        )
    return tuple(bodies), body_number, copy_of


def _springs(
    assembly: Assembly, held: tuple[HeldFace, ...]
) -> tuple[IntArray, list[Springs | None]]:
    """Which springs each block has, (n_blocks,), and each kind of them, the first of none."""
    of_block: dict[int, list[HeldFace]] = {}
    for face in held:
        if face.spring is not None:
            of_block.setdefault(face.block, []).append(face)
    kinds, springs = np.zeros(assembly.n_blocks, dtype=np.int64), list[Springs | None]([None])
    known: dict[bytes, int] = {}
    for block, faces in of_block.items():
        turn = assembly.rotations[block]
        beds = [
            (
                face.title,
                region_quads(assembly, block, face.face),
                float(face.spring or 0.0),
                face.axes @ turn,
            )
            for face in faces
        ]
        key = b"".join(
            name.encode() + part.tobytes()
            for name, quads, stiffness, axes in beds
            for part in (quads, np.array(stiffness), np.round(axes.T @ axes, 9) + 0.0)
        )
        if key not in known:
            known[key] = len(springs)
            springs.append(springs_on(assembly.shape(block).mesh, beds))
        kinds[block] = known[key]
    return kinds, springs


def block_load_forces(assembly: Assembly, load: LoadCase, block: int) -> FloatArray | None:
    """Consistent nodal forces of a load case on one block, in the block's own frame.

    A load on the block as a whole is spread like inertia.

    Returns
    -------
    FloatArray | None
        (n_nodes, 3) [N]; None where the block carries no load.
    """
    on_faces = _face_forces(assembly, load, block)
    if load.body_wrenches is None or not load.body_wrenches[block].any():
        return on_faces
    mesh, rotation = assembly.shape(block).mesh, assembly.rotations[block]
    wrench = load.body_wrenches[block]
    arm = load.assembly.centroids[block] - load.assembly.translations[block]
    moment = wrench[3:] + np.cross(arm, wrench[:3])
    share = block_lumped_mass(mesh, 1.0)
    forces = wrench_forces(mesh.nodes, share, wrench[:3] @ rotation, moment @ rotation)
    return forces if on_faces is None else on_faces + forces


def _pressed(load: LoadCase, block: int) -> bytes | None:
    """Facets of a block under pressures: congruent blocks with the same ones are loaded alike.

    None where other loads act.
    """
    dead = load.body_wrenches is not None or load.lines or load.nodes
    if dead or any(f.tractions is not None for f in load.facets):
        return None
    return b"|".join(result.quads[result.on(block)].tobytes() for result in load.facets)


def _face_forces(assembly: Assembly, load: LoadCase, block: int) -> FloatArray | None:
    """Forces of the loaded facets of one block in its own frame; None where it has none."""
    mesh, rotation = assembly.shape(block).mesh, assembly.rotations[block]
    forces: FloatArray | None = None
    for face, result in zip(load.faces, load.facets, strict=True):
        mine = result.on(block)
        if not len(mine):
            continue
        quads = mesh.facet_nodes(result.quads[mine])
        if isinstance(face, PressureLoad):
            part = pressure_forces(mesh.nodes, quads, result.pressure)
        else:
            places = assembly.place(block, facet_points(mesh.nodes, quads).reshape(-1, 3))
            traction = face.tractions(assembly, places) @ rotation
            part = traction_forces(mesh.nodes, quads, traction.reshape(len(quads), -1, 3))
        if isinstance(face, TractionLoad) and face.force is not None:
            share = result.areas[mine].sum() / result.areas.sum()
            part *= share * np.linalg.norm(face.force) / np.linalg.norm(part.sum(axis=0))
        forces = part if forces is None else forces + part
    for edges in load.edges:
        mine = np.flatnonzero(edges.block == block)
        if len(mine):
            local = edges.per_length @ rotation
            part = edge_forces(mesh.nodes, edges.quads[mine], edges.side[mine], mesh, local)
            forces = part if forces is None else forces + part
    for nodal in load.nodes:
        on_nodes = nodal.on_nodes(block, assembly.nodes(block))
        if on_nodes is not None:
            part = on_nodes @ rotation
            forces = part if forces is None else forces + part
    if load.without_couple and forces is not None:
        # Equal shares on all surface nodes: their resultant acts at the mean of these nodes.
        surface = assembly.shape(block).surface_nodes
        resultant = forces.sum(axis=0)
        forces = np.zeros_like(forces)
        forces[surface] = resultant / len(surface)
    return forces


def force_rows(assembly: Assembly, load: LoadCase, deforms: BoolArray) -> tuple[ForceRows, ...]:
    """Loads of the blocks that deform (n_blocks,); pressures that turn with them come last."""
    turning = tuple(face for face in load.faces if _turns(face))
    if not turning:
        return _dead_loads(assembly, load, deforms)
    dead = replace(load, faces=tuple(face for face in load.faces if not _turns(face)))
    alone = replace(load, faces=turning, body_wrenches=None, lines=(), nodes=())
    follow = _dead_loads(assembly, alone, deforms)
    turned = (replace(part, follows_block=True) for part in follow)
    return (*_dead_loads(assembly, dead, deforms), *turned)


def ground_loads(assembly: Assembly, load: LoadCase, body_number: IntArray) -> FloatArray | None:
    """Loads on blocks that do not deform, (n_blocks, 6) [N, N mm]; None where there are none."""
    rigid = body_number < 0
    whole = load.body_wrenches is not None and bool(load.body_wrenches[rigid].any())
    if not (whole or rigid[load.block].any()):
        return None
    return load.on_mesh(assembly).wrenches * rigid[:, None]


def _turns(face: FaceLoad) -> bool:
    """Whether a load turns with its block."""
    return isinstance(face, PressureLoad) and face.follows_block


def _dead_loads(assembly: Assembly, load: LoadCase, deforms: BoolArray) -> tuple[ForceRows, ...]:
    rows = list[tuple[IntArray, IntArray, FloatArray]]()
    known: dict[tuple[int, bytes], FloatArray | None] = {}
    for block in np.flatnonzero(deforms).tolist():
        pressed = _pressed(load, block)
        key = int(assembly.shape_of[block]), pressed or b""
        if pressed is None or key not in known:
            known[key] = block_load_forces(assembly, load, block)
        local = known[key]
        if local is not None:
            nodes = np.flatnonzero(local.any(axis=1))
            rows.append((np.full(len(nodes), block), nodes, local[nodes]))
    if not rows:
        return ()
    of, node, force = map(np.concatenate, zip(*rows, strict=True))
    return (ForceRows(of, node, force),)


def outer_face(assembly: Assembly, block: int) -> str:
    """Face at which a fixed block that deforms is held."""
    ends = {0: "first", int(assembly.layer.max()): "last"}
    end, shape = ends.get(int(assembly.layer[block])), assembly.shape(block)
    if end is None:
        raise DeformableAssemblyError(
            f"{assembly.name}: block {block} is fixed inside the assembly; expected fixed blocks "
            "in the first or last layer, or rigid frames"
        )
    names = [name for name in _OUTER_FACES[end] if name in shape.faces]
    if not names:
        raise DeformableAssemblyError(
            f"{assembly.name}: block {block} ({shape.name}) has no outer face to fix; expected "
            f"one named {' or '.join(_OUTER_FACES[end])}, or rigid frames"
        )
    return names[0]


def support_rows(assembly: Assembly, load: LoadCase, *, rigid: bool) -> HeldRows:
    """Rows of what holds or moves blocks that deform: as stated, and the outer faces of frames.

    ``rigid`` says that fixed blocks do not deform: supports add nothing to them.

    Raises
    ------
    DeformableAssemblyError
        As `outer_face`; a support that moves a block that stays as a whole.
    ModelError
        Two supports that move one node by different lengths along one direction.
    """
    for face in load.held if rigid else ():
        if face.moves and load.fixed[face.block]:
            raise DeformableAssemblyError(
                f"support {face.title}: got a motion of block {assembly.named(face.block)}, which "
                "is fixed as a whole; expected a block that is not, or elastic frames"
            )
    faces = [face for face in load.held if not (rigid and load.fixed[face.block])]
    for block in [] if rigid else np.flatnonzero(load.fixed).tolist():
        faces.append(HeldFace(block, outer_face(assembly, block)))
    of_block: dict[int, list[HeldFace]] = {}
    for held in faces:
        if held.spring is None:
            of_block.setdefault(held.block, []).append(held)
    wholly, single = list[HeldRows](), list[HeldRows]()
    nodes_of: dict[tuple[int, tuple[str, ...]], IntArray] = {}
    for block in sorted(of_block, key=lambda block: int(assembly.layer[block])):
        mine, turn = of_block[block], assembly.rotations[block]
        names = tuple(held.face for held in mine if isinstance(held.face, str))
        whole = all(held.directions is None and held.displacement is None for held in mine)
        if not (whole and len(names) == len(mine) and len({held.title for held in mine}) == 1):
            single += _supports_of(assembly, block, mine)
            continue
        key = int(assembly.shape_of[block]), names
        if key not in nodes_of:
            shape = assembly.shape(block)
            quads = np.concatenate([shape.faces[face] for face in names])
            nodes_of[key] = np.unique(shape.mesh.facet_nodes(quads))
        nodes = nodes_of[key]
        directions = np.tile(turn, (len(nodes), 1))
        wholly.append(held_at(block, np.repeat(nodes, 3), directions, name=mine[0].title))
    return joined_rows((*wholly, *single))


def _supports_of(assembly: Assembly, block: int, faces: list[HeldFace]) -> list[HeldRows]:
    """Components of the nodes of one block that its supports prescribe, each once."""
    none = np.zeros((0, 3))
    taken, moving = dict[int, FloatArray](), dict[int, FloatArray]()
    result = []
    for held in sorted(faces, key=lambda face: not face.moves):  # what moves comes first
        nodes, directions = [], []
        for node in region_nodes(assembly, block, held.face).tolist():
            if np.abs(held.axes @ moving.get(node, none).T).max(initial=0.0) > _SAME:
                raise ModelError(
                    f"support {held.title}: another support moves a node of block "
                    f"{assembly.named(block)} along a direction of this one; expected one of the "
                    "two"
                )
            before = taken.get(node, none)
            new = _beyond(before, held.axes)
            taken[node] = np.concatenate([before, new])
            nodes += [node] * len(new)
            directions.append(new)
            if held.moves:
                moving[node] = np.concatenate([moving.get(node, none), held.axes])
        along = np.concatenate([none, *directions])
        moved = np.zeros(3) if held.displacement is None else held.displacement
        result.append(
            held_at(
                block,
                np.array(nodes, dtype=np.int64),
                along @ assembly.rotations[block],
                along @ moved,
                amplitude=motion_of(held) if held.moves else None,
                name=held.title,
            )
        )
    return result


def _beyond(before: FloatArray, axes: FloatArray) -> FloatArray:
    """Unit directions that some have beyond others that are held already, (n, 3)."""
    if not len(before):
        return axes
    rest = axes - axes @ before.T @ before
    if np.abs(rest - axes).max() <= _SAME:
        return axes
    _, size, right = np.linalg.svd(rest)
    new: FloatArray = right[: int((size > _SAME).sum())]
    return new


def motion_of(held: HeldFace) -> Amplitude:
    """Share of its displacement by which a support moves, as a function of time [s]."""
    if not held.path:
        return ALL_THE_WAY
    times, shares = zip(*held.path, strict=True)
    return TabularAmplitude(times, shares)
