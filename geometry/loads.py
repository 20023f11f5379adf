"""What loads blocks: pressures and tractions on named faces, and which blocks are held meanwhile.

A load stays what was stated, a pressure on a face of some blocks; facets, forces, nodal forces and
words of decks are asked of it.

Load cases with names are one record each in `CASES`: what it loads and what it is called.
Every case exists twice: with the full load (default) and ``as_printed``, the load of the paper's
tables. They differ in one case, *shaft*.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import TypeAlias, TypeVar

import numpy as np

from geometry.answer import is_round
from geometry.assembly import Assembly
from geometry.errors import RefusedError, is_number
from geometry.mesh import (
    BoolArray,
    FloatArray,
    IntArray,
    QuadSurface,
    ReadOnlyArrays,
)
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import (
    HeldFace,
    NodeForces,
    Where,
    check_blocks,
    check_region,
    listed,
    local_nodes,
    region_edges,
    region_quads,
)

Values = TypeVar("Values", FloatArray, IntArray)

#: Facets that are placed at once where only their sums over blocks are asked for.
_AT_ONCE = 2**16


class LoadCaseError(RefusedError):
    """A load case that the assembly cannot take."""


@dataclass(frozen=True)
class PressureLoad(ReadOnlyArrays):
    """Pressure on the same face of some blocks."""

    blocks: IntArray
    """(n,)"""
    face: Where
    """Name of the face, or where on the surface."""
    pressure: float
    """Positive pushes inward [MPa]."""
    follows_block: bool = False
    """Whether it turns with its block, in explicit runs with finite rotation; else it is dead."""

    @property
    def words(self) -> str:
        """Its size, and on what it acts."""
        return f"pressure {self.pressure:g} MPa {_on(self)}"

    def tractions(self, assembly: Assembly, points: FloatArray) -> None:  # noqa: ARG002
        """None: a pressure acts along each facet's own normal."""
        return


@dataclass(frozen=True)
class TractionLoad(ReadOnlyArrays):
    """Dead traction of one direction on the same face of some blocks."""

    blocks: IntArray
    """(n,)"""
    face: Where
    """Name of the face, or where on the surface."""
    traction: FloatArray
    """World axes, (3,) [MPa]."""
    force: FloatArray | None = None
    """Where a force was stated: what deformable blocks carry in all on every mesh, (3,) [N]."""

    @property
    def words(self) -> str:
        """Its size, and on what it acts."""
        return f"traction ({', '.join(f'{part:g}' for part in self.traction)}) MPa {_on(self)}"

    def tractions(self, assembly: Assembly, points: FloatArray) -> FloatArray:  # noqa: ARG002
        """Traction at points of the face, world coordinates and axes, (n, 3) [MPa]."""
        return np.tile(self.traction, (len(points), 1))


@dataclass(frozen=True)
class CircumferentialLoad(ReadOnlyArrays):
    """Dead traction around the axis of the assembly, towards larger angle."""

    blocks: IntArray
    """(n,)"""
    face: str
    """Name of the face."""
    traction: float
    """[MPa]"""

    @property
    def words(self) -> str:
        """Its size, and on what it acts."""
        return f"traction {self.traction:g} MPa around the axis {_on(self)}"

    def tractions(self, assembly: Assembly, points: FloatArray) -> FloatArray:
        """Traction at points of the face, world coordinates and axes, (n, 3) [MPa]."""
        arm = points - assembly.origin
        arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
        radial = arm / np.linalg.norm(arm, axis=1, keepdims=True)
        return self.traction * np.cross(assembly.axis, radial)


FaceLoad: TypeAlias = PressureLoad | TractionLoad | CircumferentialLoad


def _on(load: FaceLoad) -> str:
    """Face and number of blocks of a load."""
    face = f"face {load.face}" if isinstance(load.face, str) else "a part of the surface"
    n = len(load.blocks)
    return f"on {face} of {n} block{'s' if n > 1 else ''}"


@dataclass(frozen=True)
class LoadedFacets(ReadOnlyArrays):
    """Facets that one load acts on, in the initial configuration."""

    block: IntArray
    """Loaded block of each facet, (n_facets,)."""
    quads: IntArray
    """Corner nodes of each facet in its block's mesh, (n_facets, 4)."""
    centroids: FloatArray
    """World coordinates, (n_facets, 3) [mm]."""
    area_vectors: FloatArray
    """Outward, world axes, (n_facets, 3) [mm²]."""
    tractions: FloatArray | None
    """Dead traction at each centroid, world axes, (n_facets, 3) [MPa]; None for a pressure."""
    pressure: float
    """Of a pressure, positive pushing inward [MPa]."""

    @cached_property
    def areas(self) -> FloatArray:
        """Size of each vector area, (n_facets,) [mm²]."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def _sorted(self) -> tuple[IntArray, IntArray]:
        """Facets in the order of their blocks, and these blocks."""
        order = np.argsort(self.block, kind="stable")
        return order, self.block[order]

    def on(self, block: int) -> IntArray:
        """Facets of one block, (n,)."""
        order, blocks = self._sorted
        first, last = np.searchsorted(blocks, [block, block + 1])
        return order[first:last]

    @property
    def forces(self) -> FloatArray:
        """Force on each facet, (n_facets, 3) [N]."""
        if self.tractions is None:
            return -self.pressure * self.area_vectors
        return self.tractions * self.areas[:, None]


@dataclass(frozen=True)
class LineLoad(ReadOnlyArrays):
    """Dead force per length along straight edges of some blocks."""

    blocks: IntArray
    """(n,)"""
    start: FloatArray
    """End of the line that the edges lie on, world coordinates, (3,) [mm]."""
    end: FloatArray
    """The other end, (3,) [mm]."""
    force: FloatArray
    """World axes, (3,) [N/mm]."""

    @property
    def words(self) -> str:
        """Its size, and on what it acts."""
        force = ", ".join(f"{part:g}" for part in self.force)
        return f"line load ({force}) N/mm on edges of {len(self.blocks)} blocks"


@dataclass(frozen=True)
class LoadedEdges(ReadOnlyArrays):
    """Edges that one line load acts on, in the initial configuration."""

    block: IntArray
    """Loaded block of each edge, (n_edges,)."""
    quads: IntArray
    """Corner nodes of a facet that has the edge, (n_edges, 4)."""
    side: IntArray
    """Corner of that facet at which the edge begins; it ends at the next one, (n_edges,)."""
    centroids: FloatArray
    """World coordinates of the middle, (n_edges, 3) [mm]."""
    forces: FloatArray
    """Force on each edge, (n_edges, 3) [N]."""
    per_length: FloatArray
    """(3,) [N/mm]"""

    @property
    def area_vectors(self) -> FloatArray:
        """An edge has none, (n_edges, 3)."""
        return np.zeros_like(self.forces)


@dataclass(frozen=True)
class LoadCase(ReadOnlyArrays):
    """Loads on the faces of blocks, and the supports that go with them."""

    assembly: AnyBlocks = field(repr=False)
    """The loaded assembly."""
    name: str
    """Name in reports, such as ``pipe``."""
    faces: tuple[FaceLoad, ...]
    """Loads on faces."""
    fixed: BoolArray
    """Blocks held while the load acts, (n_blocks,)."""
    held: tuple[HeldFace, ...] = ()
    """Faces held, moved or on springs of blocks that are not held as a whole."""
    lines: tuple[LineLoad, ...] = ()
    """Loads along edges."""
    nodes: tuple[NodeForces, ...] = ()
    """Forces on nodes."""
    without_couple: bool = False
    """Whether each block takes only the resultant force, at the mean of its surface nodes."""
    body_wrenches: FloatArray | None = None
    """Force and moment about each block's mass centroid on top of the faces: weight, pushes at
    points; (n_blocks, 6) [N, N mm]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        fixed, n = np.asarray(self.fixed), self.assembly.n_blocks
        if fixed.dtype != np.bool_ or fixed.shape != (n,):
            raise LoadCaseError(
                f"fixed: got {fixed.dtype} of shape {fixed.shape}; expected True or False for each "
                f"of {n} blocks, ({n},)"
            )
        for load in self.faces:
            check_region(self.assembly, load.blocks, load.face, "load", LoadCaseError)
        for held in self.held:
            held.check(self.assembly)
        for line in self.lines:
            check_blocks(self.assembly, line.blocks, "load", LoadCaseError)
            if not np.isfinite([line.start, line.end, line.force]).all():
                raise LoadCaseError("load: got a line load that is not finite; expected mm, N/mm")

    @cached_property
    def facets(self) -> tuple[LoadedFacets, ...]:
        """Facets of each load of `faces`."""
        return tuple(_loaded_facets(self.assembly, load) for load in self.faces)  # type: ignore[arg-type]

    @cached_property
    def edges(self) -> tuple[LoadedEdges, ...]:
        """Edges of each load of `lines`."""
        return tuple(_loaded_edges(self.assembly, line) for line in self.lines)  # type: ignore[arg-type]

    def _all(self, name: str, none: Values) -> Values:
        parts = [getattr(result, name) for result in (*self.facets, *self.edges, *self.nodes)]
        return np.concatenate(parts) if parts else none

    @cached_property
    def block(self) -> IntArray:
        """Loaded block of each facet, then of each edge, then of each node, (n_facets,)."""
        return self._all("block", np.zeros(0, dtype=np.int64))

    @cached_property
    def centroids(self) -> FloatArray:
        """Where the force on each facet acts, world coordinates, (n_facets, 3) [mm].

        At the facet's centroid, or `without_couple` at the mean of its block's surface nodes.
        """
        if self.without_couple:
            return surface_means(self.assembly)[self.block]  # type: ignore[arg-type]
        return self._all("centroids", np.zeros((0, 3)))

    @cached_property
    def area_vectors(self) -> FloatArray:
        """Outward vector areas of the facets, world axes, (n_facets, 3) [mm²]."""
        return self._all("area_vectors", np.zeros((0, 3)))

    @cached_property
    def facet_forces(self) -> FloatArray:
        """Force on each facet in the initial configuration, (n_facets, 3) [N]."""
        return self._all("forces", np.zeros((0, 3)))

    @cached_property
    def _on_blocks(self) -> FloatArray:
        """Force, moment about the mass centroid, and sizes of forces, summed over facets; (n, 7).

        Of many facets a part at a time, none of which is kept.
        """
        n, means = self.assembly.n_blocks, None
        if self.without_couple:
            means = surface_means(self.assembly)  # type: ignore[arg-type]
        total = np.zeros((n, 7))
        parts: Iterator[LoadedFacets | LoadedEdges | NodeForces]
        parts = chain(self._face_parts(), self.edges, self.nodes)
        for part in parts:
            force = part.forces
            arm = part.centroids if means is None else means[part.block]
            moment = np.cross(arm - self.assembly.centroids[part.block], force)
            size = np.linalg.norm(force, axis=1)
            # Column by column: several times faster than `np.add.at`.
            for k, column in enumerate((*force.T, *moment.T, size)):
                total[:, k] += np.bincount(part.block, column, n)
        return total

    def _face_parts(self) -> Iterator[LoadedFacets]:
        for load in self.faces:
            yield from _placed_facets(self.assembly, load)  # type: ignore[arg-type]

    @property
    def wrenches(self) -> FloatArray:
        """Force and moment about each block's mass centroid, (n_blocks, 6) [N, N mm].

        Facet forces act at `centroids`, as in Algorithm 1 of the paper.
        """
        wrench = self._on_blocks[:, :6]
        return wrench if self.body_wrenches is None else self.body_wrenches + wrench

    @property
    def acting(self) -> FloatArray:
        """Sizes of the forces on each block, summed over facets, (n_blocks,) [N].

        Forces that balance each other count.
        """
        sizes = self._on_blocks[:, 6]
        if self.body_wrenches is None:
            return sizes
        return sizes + np.linalg.norm(self.body_wrenches[:, :3], axis=1)

    def with_wrenches(self, wrenches: FloatArray | None) -> LoadCase:
        """Return the load with forces and moments on whole blocks on top; None: itself.

        About each block's mass centroid, (n_blocks, 6) [N, N mm].
        """
        if wrenches is None:
            return self
        there = self.body_wrenches
        return replace(self, body_wrenches=wrenches if there is None else there + wrenches)

    def on_mesh(self, assembly: Assembly) -> LoadCase:
        """Return the same load on another mesh of its blocks, whose centroids differ a little."""
        wrenches = self.body_wrenches
        if wrenches is not None:
            arm = self.assembly.centroids - assembly.centroids
            moments = wrenches[:, 3:] + np.cross(arm, wrenches[:, :3])
            wrenches = np.hstack([wrenches[:, :3], moments])
        return replace(self, assembly=assembly, body_wrenches=wrenches)

    @property
    def on_regions(self) -> bool:
        """Whether loads or supports lie on planes, in boxes or on lines.

        Other meshes need not have facets that end there.
        """
        regions = [part.face for part in (*self.faces, *self.held)]
        return bool(self.lines or self.nodes) or any(
            not isinstance(where, str) for where in regions
        )

    @property
    def largest_traction(self) -> float:
        """Largest component of what acts on a face [MPa]."""
        values = (
            load.pressure if isinstance(load, PressureLoad) else load.traction
            for load in self.faces
        )
        return max((float(np.abs(value).max()) for value in values), default=0.0)


def _parts(assembly: Assembly, load: FaceLoad) -> Iterator[tuple[IntArray, QuadSurface]]:
    """Blocks that are loaded on the same facets of their shape, and these."""
    if isinstance(load.face, str):
        for number in np.unique(assembly.shape_of[load.blocks]):
            copies = load.blocks[assembly.shape_of[load.blocks] == number]
            yield copies, assembly.shapes[number].surface(load.face)
        return
    for block in load.blocks.tolist():
        nodes = local_nodes(assembly, block)
        yield np.array([block]), QuadSurface(nodes, region_quads(assembly, block, load.face))


def _placed_facets(assembly: Assembly, load: FaceLoad) -> Iterator[LoadedFacets]:
    """Facets of one face of several blocks, placed, some blocks at a time."""
    for blocks, surface in _parts(assembly, load):
        n = surface.n_facets
        for copies in np.array_split(blocks, -(-len(blocks) * n // _AT_ONCE) or 1):
            turn = assembly.rotations[copies]
            middle = np.einsum("bij,fj->bfi", turn, surface.centroids)
            middle = (middle + assembly.translations[copies, None, :]).reshape(-1, 3)
            yield LoadedFacets(
                block=np.repeat(copies, n),
                quads=np.tile(surface.quads, (len(copies), 1)),
                centroids=middle,
                area_vectors=np.einsum("bij,fj->bfi", turn, surface.area_vectors).reshape(-1, 3),
                tractions=load.tractions(assembly, middle),
                pressure=load.pressure if isinstance(load, PressureLoad) else 0.0,
            )


def _loaded_facets(assembly: Assembly, load: FaceLoad) -> LoadedFacets:
    """Facets of one face of several blocks, placed."""
    parts = list(_placed_facets(assembly, load))
    tractions = [part.tractions for part in parts if part.tractions is not None]
    return replace(
        parts[0],
        block=np.concatenate([part.block for part in parts]),
        quads=np.concatenate([part.quads for part in parts]),
        centroids=np.concatenate([part.centroids for part in parts]),
        area_vectors=np.concatenate([part.area_vectors for part in parts]),
        tractions=np.concatenate(tractions) if tractions else None,
    )


def _loaded_edges(assembly: Assembly, load: LineLoad) -> LoadedEdges:
    """Edges of the surfaces of blocks that lie on a line."""
    block, quads, side = [], [], []
    for number in load.blocks.tolist():
        result, first = region_edges(assembly, number, load.start, load.end)
        block.append(np.full(len(result), number))
        quads.append(result)
        side.append(first)
    of, corners, begin = (np.concatenate(parts) for parts in (block, quads, side))
    if not len(of):
        raise LoadCaseError(
            f"load: no edge of the blocks {listed(load.blocks)} lies on the line from "
            f"{load.start.tolist()} to {load.end.tolist()}; expected an edge of the mesh"
        )
    sides = corners.shape[1]
    local = np.stack([corners[np.arange(len(of)), (begin + k) % sides] for k in range(2)], axis=1)
    ends = np.stack(
        [
            assembly.place(b, local_nodes(assembly, b)[pair])
            for b, pair in zip(of.tolist(), local, strict=True)
        ]
    )
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return LoadedEdges(
        of, corners, begin, ends.mean(axis=1), np.outer(lengths, load.force), load.force
    )


def surface_means(assembly: Assembly) -> FloatArray:
    """Mean of the surface nodes of each block in world coordinates, (n_blocks, 3) [mm]."""
    means = [shape.mesh.nodes[shape.surface_nodes].mean(axis=0) for shape in assembly.shapes]
    return assembly.place_each(np.array(means))


def face_pressure(assembly: Assembly, blocks: IntArray, face: str, pressure: float) -> LoadCase:
    """Build a pressure [MPa] on a named face of some blocks; the assembly's fixed ones are held.

    Raises
    ------
    LoadCaseError
        For a non-finite pressure, or blocks without such a face.
    """
    check_finite(pressure)
    faces = (PressureLoad(blocks, face, pressure),)
    return LoadCase(assembly, "pressure", faces, assembly.fixed.copy())


def check_finite(pressure: object) -> None:
    """Reject a pressure that is not finite."""
    if not is_number(pressure):
        raise LoadCaseError(f"pressure: got {pressure!r}, expected a finite number of MPa")


@dataclass(frozen=True, kw_only=True)
class NamedLoad:
    """A load case that any tube can take."""

    name: str
    """Name in scenes."""
    words: str
    """Name in titles."""
    face: str
    """Face that is loaded."""
    blocks: Callable[[Assembly, int], IntArray]
    """Blocks that are loaded, of the assembly and the loaded layer, (n,)."""
    acts: Callable[[IntArray, str, float], FaceLoad] = PressureLoad
    """The loads, from the blocks, the face and the load pressure [MPa]."""
    one_layer: bool = False
    """Whether it loads a single layer."""
    every_layer: bool = False
    """Whether it loads every free layer alike, so that a periodic cell can carry it."""
    releases: bool = False
    """Whether the blocks it loads belong to the frame and are released."""
    force_as_printed: bool = False
    """Whether the paper's tables have its resultant forces alone, at the mean of each block's
    surface nodes."""


def layer_blocks(assembly: Assembly, layer: int) -> IntArray:
    """Free blocks of a layer, (n,)."""
    return np.flatnonzero((assembly.layer == layer) & ~assembly.fixed)


def loaded_layer(assembly: Assembly) -> int:
    """Return the layer that cases of one layer load, ⌊L/2⌋ + 1: the seventh of twelve."""
    return assembly.n_layers // 2 + 1


@dataclass(frozen=True, kw_only=True)
class Load:
    """A load case with its pressure, not yet on an assembly."""

    case: NamedLoad
    """Which."""
    pressure: float
    """[MPa]"""
    layer: int | None = None
    """Loaded layer of a case that loads one; None: ⌊L/2⌋ + 1."""
    as_printed: bool = False
    """The reading that reproduces the paper's tables (see the module's text)."""

    def __post_init__(self) -> None:
        check_finite(self.pressure)
        if self.layer is not None and not self.case.one_layer:
            names = " or ".join(other.name for other in CASES.values() if other.one_layer)
            raise LoadCaseError(
                f"layer: got {self.layer}, but {self.case.name} loads no single layer; remove "
                f"it, or choose `case` = {names}"
            )

    def on(self, assembly: Assembly) -> LoadCase:
        """Tractions on the facets of an assembly, and what it is held by.

        Raises
        ------
        LoadCaseError
            Blocks without the loaded face, a layer that is not there, or a traction round the axis
            of blocks that stand in no ring.
        """
        case = self.case
        layer = loaded_layer(assembly) if self.layer is None else self.layer
        if not 1 <= layer <= assembly.n_layers:
            raise LoadCaseError(
                f"layer: got {layer}, expected a free layer from 1 to {assembly.n_layers}"
            )
        if case.acts is CircumferentialLoad and not is_round(assembly):
            others = ", ".join(
                other.name for other in CASES.values() if other.acts is not case.acts
            )
            raise LoadCaseError(
                f"case: got {case.name}, a traction round the axis of a tube, and "
                f"{assembly.name} has none: its blocks stand in no ring; expected one of {others}"
            )
        load = case.acts(case.blocks(assembly, layer), case.face, self.pressure)
        fixed = assembly.fixed.copy()
        if case.releases:
            fixed[load.blocks] = False
        without_couple = self.as_printed and case.force_as_printed
        return LoadCase(assembly, case.name, (load,), fixed, without_couple=without_couple)


#: Load cases by their names.
CASES: dict[str, NamedLoad] = {
    case.name: case
    for case in (
        NamedLoad(
            name="beam",
            words="pressure on one block",
            face="outer",
            blocks=lambda assembly, layer: layer_blocks(assembly, layer)[:1],
            one_layer=True,
        ),
        NamedLoad(
            name="pillar",
            words="axial pressure",
            face="top",
            blocks=lambda assembly, _: np.flatnonzero(assembly.layer == assembly.n_layers + 1),
            releases=True,
        ),
        NamedLoad(
            name="pipe",
            words="internal pressure",
            face="inner",
            blocks=lambda assembly, _: assembly.free_blocks,
            every_layer=True,
        ),
        NamedLoad(
            name="shaft",
            words="tangential traction",
            face="outer",
            blocks=layer_blocks,
            acts=CircumferentialLoad,
            one_layer=True,
            force_as_printed=True,
        ),
        NamedLoad(
            name="tunnel",
            words="external pressure",
            face="outer",
            blocks=lambda assembly, _: assembly.free_blocks,
            every_layer=True,
        ),
    )
}


def beam(pressure: float, layer: int | None = None) -> Load:
    """Pressure on the outer face of one block of a layer, by default of the middle one [MPa]."""
    return Load(case=CASES["beam"], pressure=pressure, layer=layer)


def pillar(pressure: float) -> Load:
    """Pressure on the flat top of the top frame, which is released [MPa]."""
    return Load(case=CASES["pillar"], pressure=pressure)


def pipe(pressure: float) -> Load:
    """Pressure on the inner faces of all free blocks [MPa]."""
    return Load(case=CASES["pipe"], pressure=pressure)


def shaft(pressure: float, layer: int | None = None) -> Load:
    """Tangential traction on the outer faces of a layer, by default of the middle one [MPa].

    Towards larger θ. The paper's tables have its resultant force alone, at the mean of each block's
    surface nodes.
    """
    return Load(case=CASES["shaft"], pressure=pressure, layer=layer)


def tunnel(pressure: float) -> Load:
    """Pressure on the outer faces of all free blocks [MPa]."""
    return Load(case=CASES["tunnel"], pressure=pressure)


def named_load(
    name: str, pressure: float, *, as_printed: bool = False, layer: int | None = None
) -> Load:
    """Load case by its name; other arguments as the fields of `Load`."""
    if name not in CASES:
        raise LoadCaseError(f"case: got {name!r}, expected one of {', '.join(CASES)}")
    return Load(case=CASES[name], pressure=pressure, layer=layer, as_printed=as_printed)
