"""What loads blocks: pressures and tractions on named faces, and which blocks are held meanwhile.

A load stays what was stated, a pressure on a face of some blocks; facets, forces, nodal forces and
words of decks are asked of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from geometry.assembly import AnyBlocks, Assembly
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray


class LoadCaseError(RefusedError):
    """A load case that the assembly cannot take."""


@dataclass(frozen=True)
class PressureLoad:
    """Pressure on the same face of some blocks."""

    blocks: IntArray
    """(n,)"""
    face: str
    """Name of the face."""
    pressure: float
    """Positive pushes inward [MPa]."""
    follows_block: bool = False
    """Whether it turns with its block where blocks may turn by any angle; else it is dead."""

    def tractions(self, assembly: Assembly, centroids: FloatArray) -> None:  # noqa: ARG002
        """None: a pressure acts along each facet's own normal."""
        return


@dataclass(frozen=True)
class TractionLoad:
    """Dead traction of one direction on the same face of some blocks."""

    blocks: IntArray
    """(n,)"""
    face: str
    """Name of the face."""
    traction: FloatArray
    """World axes, (3,) [MPa]."""

    def tractions(self, assembly: Assembly, centroids: FloatArray) -> FloatArray:  # noqa: ARG002
        """Traction on each facet, world axes, (n_facets, 3) [MPa]."""
        return np.tile(self.traction, (len(centroids), 1))


@dataclass(frozen=True)
class CircumferentialLoad:
    """Dead traction around the axis of the assembly, towards larger angle."""

    blocks: IntArray
    """(n,)"""
    face: str
    """Name of the face."""
    traction: float
    """[MPa]"""

    def tractions(self, assembly: Assembly, centroids: FloatArray) -> FloatArray:
        """Traction on each facet, world axes, (n_facets, 3) [MPa]."""
        arm = centroids - assembly.origin
        arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
        radial = arm / np.linalg.norm(arm, axis=1, keepdims=True)
        return self.traction * np.cross(assembly.axis, radial)


FaceLoad: TypeAlias = PressureLoad | TractionLoad | CircumferentialLoad


@dataclass(frozen=True)
class LoadedFacets:
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
    """Dead traction on each facet, world axes, (n_facets, 3) [MPa]; None for a pressure."""
    pressure: float
    """Of a pressure, positive pushing inward [MPa]."""

    @property
    def forces(self) -> FloatArray:
        """Force on each facet, (n_facets, 3) [N]."""
        if self.tractions is None:
            return -self.pressure * self.area_vectors
        return self.tractions * np.linalg.norm(self.area_vectors, axis=1)[:, None]


@dataclass(frozen=True)
class HeldFace:
    """A face whose nodes do not move while a load acts."""

    block: int
    """Its block, which deforms."""
    face: str
    """Its name."""


@dataclass(frozen=True)
class LoadCase:
    """Loads on the faces of blocks, and the supports that go with them."""

    assembly: AnyBlocks = field(repr=False)
    """What is loaded."""
    name: str
    """What reports call it, such as ``pipe``."""
    faces: tuple[FaceLoad, ...]
    """What acts on faces."""
    fixed: BoolArray
    """Blocks held while the load acts, (n_blocks,)."""
    held: tuple[HeldFace, ...] = ()
    """Faces held of blocks that are not held as a whole."""
    without_couple: bool = False
    """Whether each block takes only the resultant force, at the mean of its surface nodes."""
    body_wrenches: FloatArray | None = None
    """Force and moment about each block's mass centroid on top of the faces: weight, pushes at
    points; (n_blocks, 6) [N, N mm]."""

    def __post_init__(self) -> None:
        for load in self.faces:
            for number in np.unique(self.assembly.shape_of[load.blocks]):
                shape = self.assembly.shapes[number]
                if load.face not in shape.faces:
                    block = load.blocks[self.assembly.shape_of[load.blocks] == number][0]
                    raise LoadCaseError(
                        f"load: block {block} ({shape.name}) has no face {load.face!r}; "
                        f"expected one of {', '.join(shape.faces)}"
                    )

    @cached_property
    def facets(self) -> tuple[LoadedFacets, ...]:
        """Facets of each load of `faces`."""
        return tuple(_loaded_facets(self.assembly, load) for load in self.faces)  # type: ignore[arg-type]

    def _all(self, name: str) -> FloatArray:
        parts = [getattr(found, name) for found in self.facets]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    @cached_property
    def block(self) -> IntArray:
        """Loaded block of each facet, (n_facets,)."""
        return np.concatenate([f.block for f in self.facets] or [np.zeros(0, dtype=np.int64)])

    @cached_property
    def centroids(self) -> FloatArray:
        """Where the force on each facet acts, world coordinates, (n_facets, 3) [mm].

        At the facet's centroid, or `without_couple` at the mean of its block's surface nodes.
        """
        if self.without_couple:
            return surface_means(self.assembly)[self.block]  # type: ignore[arg-type]
        return self._all("centroids")

    @cached_property
    def area_vectors(self) -> FloatArray:
        """Outward vector areas of the facets, world axes, (n_facets, 3) [mm²]."""
        return self._all("area_vectors")

    @cached_property
    def facet_forces(self) -> FloatArray:
        """Force on each facet in the initial configuration, (n_facets, 3) [N]."""
        return self._all("forces")

    @property
    def largest_traction(self) -> float:
        """Largest component of what acts on a face [MPa]."""
        values = [f.pressure if f.tractions is None else f.tractions for f in self.facets]
        return max((float(np.abs(value).max(initial=0.0)) for value in values), default=0.0)


def _loaded_facets(assembly: Assembly, load: FaceLoad) -> LoadedFacets:
    """Facets of one face of several blocks, placed."""
    block, quads, centroids, vectors = [], [], [], []
    for number in np.unique(assembly.shape_of[load.blocks]):
        copies = load.blocks[assembly.shape_of[load.blocks] == number]
        surface = assembly.shapes[number].surface(load.face)
        turn = assembly.rotations[copies]
        block.append(np.repeat(copies, surface.n_facets))
        quads.append(np.tile(surface.quads, (len(copies), 1)))
        placed = np.einsum("bij,fj->bfi", turn, surface.centroids)
        placed += assembly.translations[copies, None, :]
        centroids.append(placed.reshape(-1, 3))
        vectors.append(np.einsum("bij,fj->bfi", turn, surface.area_vectors).reshape(-1, 3))
    middle = np.concatenate(centroids)
    return LoadedFacets(
        block=np.concatenate(block),
        quads=np.concatenate(quads),
        centroids=middle,
        area_vectors=np.concatenate(vectors),
        tractions=load.tractions(assembly, middle),
        pressure=load.pressure if isinstance(load, PressureLoad) else 0.0,
    )


def surface_means(assembly: Assembly) -> FloatArray:
    """Mean of the surface nodes of each block in world coordinates, (n_blocks, 3) [mm]."""
    local = np.array([s.mesh.nodes[s.surface_nodes].mean(axis=0) for s in assembly.shapes])
    turned = np.einsum("bij,bj->bi", assembly.rotations, local[assembly.shape_of])
    return turned + assembly.translations


def with_body_wrenches(load: LoadCase, wrenches: FloatArray) -> LoadCase:
    """Return the load with forces and moments on whole blocks on top.

    Parameters
    ----------
    load
        What acts already.
    wrenches
        About each block's mass centroid, (n_blocks, 6) [N, N mm].
    """
    there = load.body_wrenches
    return replace(load, body_wrenches=wrenches if there is None else there + wrenches)


def face_pressure(assembly: Assembly, blocks: IntArray, face: str, pressure: float) -> LoadCase:
    """Build a pressure on one named face of some blocks; the assembly's fixed blocks are held.

    Parameters
    ----------
    assembly
        Blocks.
    blocks
        Numbers of the loaded blocks, (n,).
    face
        Name of the loaded face.
    pressure
        Positive pushing inward [MPa].

    Raises
    ------
    LoadCaseError
        For a non-finite pressure, or blocks without such a face.
    """
    check_finite(pressure)
    faces = (PressureLoad(blocks, face, pressure),)
    return LoadCase(assembly, "pressure", faces, assembly.fixed.copy())


def check_finite(pressure: float) -> None:
    """Refuse a pressure that is not finite.

    Raises
    ------
    LoadCaseError
        Saying so.
    """
    if not np.isfinite(pressure):
        raise LoadCaseError(f"load.pressure: got {pressure}, expected a finite pressure in MPa")
