"""The five load cases of the paper as tractions on block faces, and which frame is released.

Every case exists twice: as physics says (default) and ``as_printed``, the reading that
reproduces the printed tables. They differ in one case, *shaft*: the full tangential traction,
against its resultant force alone, acting at the mean of each block's surface nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from geometry.assembly import Assembly
from geometry.errors import RefusedError
from geometry.mesh import BoolArray, FloatArray, IntArray


class LoadCaseName(StrEnum):
    """Names of the five load cases."""

    PIPE = "pipe"
    TUNNEL = "tunnel"
    PILLAR = "pillar"
    BEAM = "beam"
    SHAFT = "shaft"


#: Cases that load one layer.
_ONE_LAYER = (LoadCaseName.BEAM, LoadCaseName.SHAFT)


class LoadCaseError(RefusedError):
    """A load case that the assembly cannot take."""


@dataclass(frozen=True)
class LoadCase:
    """Tractions on facets in the initial configuration, and the supports that go with them."""

    name: str
    """``pipe``, ``tunnel``, ``pillar``, ``beam`` or ``shaft``."""
    block: IntArray
    """Loaded block of each facet, (n_facets,)."""
    quads: IntArray
    """Corner nodes of each loaded facet in its block's mesh, (n_facets, 4)."""
    centroids: FloatArray
    """Where the force on each facet acts: at its centroid, or `without_couple` at the mean of its
    block's surface nodes; world coordinates, (n_facets, 3) [mm]."""
    area_vectors: FloatArray
    """Outward vector areas in world coordinates, (n_facets, 3) [mm²]."""
    tractions: FloatArray | None
    """Dead traction on each facet in world axes, (n_facets, 3) [MPa]; None for a pressure."""
    pressure: float
    """Load pressure, positive pushing inward [MPa]; unused where `tractions` is given."""
    fixed: BoolArray
    """Blocks held while the load acts, (n_blocks,)."""
    without_couple: bool = False
    """Whether each block takes only the resultant force, at the mean of its surface nodes."""
    body_wrenches: FloatArray | None = None
    """Force and moment about each block's mass centroid on top of the facets: weight, pushes at
    points; (n_blocks, 6) [N, N mm]."""

    @property
    def facet_forces(self) -> FloatArray:
        """Force on each facet in the initial configuration, (n_facets, 3) [N]."""
        if self.tractions is None:
            return -self.pressure * self.area_vectors
        area = np.linalg.norm(self.area_vectors, axis=1)
        forces: FloatArray = self.tractions * area[:, None]
        return forces


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


def loaded_layer(assembly: Assembly) -> int:
    """Return the layer that beam and shaft load, ⌊L/2⌋ + 1: the seventh of twelve."""
    return assembly.n_layers // 2 + 1


def _world_surface(
    assembly: Assembly, blocks: IntArray, face: str
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Loaded blocks, facets, centroids and vector areas of one face of several blocks."""
    block_number, quads, centroids, vectors = [], [], [], []
    for number in np.unique(assembly.shape_of[blocks]):
        copies = blocks[assembly.shape_of[blocks] == number]
        shape = assembly.shapes[number]
        if face not in shape.faces:
            raise LoadCaseError(
                f"load: block {copies[0]} ({shape.name}) has no face {face!r}; "
                f"expected one of {', '.join(shape.faces)}"
            )
        surface = shape.surface(face)
        turn = assembly.rotations[copies]
        block_number.append(np.repeat(copies, surface.n_facets))
        quads.append(np.tile(surface.quads, (len(copies), 1)))
        placed = np.einsum("bij,fj->bfi", turn, surface.centroids)
        placed += assembly.translations[copies, None, :]
        centroids.append(placed.reshape(-1, 3))
        vectors.append(np.einsum("bij,fj->bfi", turn, surface.area_vectors).reshape(-1, 3))
    return (
        np.concatenate(block_number),
        np.concatenate(quads),
        np.concatenate(centroids),
        np.concatenate(vectors),
    )


def _radial(assembly: Assembly, points: FloatArray) -> FloatArray:
    """Unit vectors from the tube axis to points, (n, 3)."""
    arm = points - assembly.origin
    arm = arm - np.outer(arm @ assembly.axis, assembly.axis)
    radial: FloatArray = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    return radial


def surface_means(assembly: Assembly) -> FloatArray:
    """Mean of the surface nodes of each block in world coordinates, (n_blocks, 3) [mm]."""
    local = np.array([s.mesh.nodes[s.surface_nodes].mean(axis=0) for s in assembly.shapes])
    turned = np.einsum("bij,bj->bi", assembly.rotations, local[assembly.shape_of])
    means: FloatArray = turned + assembly.translations
    return means


def load_case(
    assembly: Assembly,
    name: str | LoadCaseName,
    pressure: float,
    *,
    as_printed: bool = False,
    layer: int | None = None,
) -> LoadCase:
    """Build one of the five load cases of the paper.

    Parameters
    ----------
    assembly
        A tube whose blocks have faces ``inner``, ``outer`` and, in the top frame, ``top``.
    name
        pipe: pressure on the inner faces of all free blocks; tunnel: on the outer faces;
        pillar: on the flat top of the top frame, which is released; beam: on the outer face
        of one block of `layer`; shaft: tangential traction (towards larger θ) on the outer
        faces of all blocks of `layer`.
    pressure
        Load pressure [MPa].
    as_printed
        The reading that reproduces the paper's tables (see the module's text).
    layer
        Loaded layer of beam and shaft; by default ⌊L/2⌋ + 1.

    Raises
    ------
    LoadCaseError
        For a non-finite pressure, an unknown case, a layer that does not exist or of a case that
        loads no single one.
    """
    try:
        case = LoadCaseName(name)
    except ValueError:
        known = ", ".join(LoadCaseName)
        raise LoadCaseError(f"load.case: got {name!r}, expected one of {known}") from None
    if not np.isfinite(pressure):
        raise LoadCaseError(f"load.pressure: got {pressure}, expected a finite pressure in MPa")
    if layer is not None and case not in _ONE_LAYER:
        raise LoadCaseError(
            f"load.layer: got {layer}, but {case} loads no single layer; remove it, or choose "
            f"load.case = {' or '.join(_ONE_LAYER)}"
        )
    chosen = loaded_layer(assembly) if layer is None else layer
    if not 1 <= chosen <= assembly.n_layers:
        raise LoadCaseError(
            f"load.layer: got {chosen}, expected a free layer from 1 to {assembly.n_layers}"
        )
    free = assembly.free_blocks
    in_layer = np.flatnonzero((assembly.layer == chosen) & ~assembly.fixed)
    top = np.flatnonzero(assembly.layer == assembly.n_layers + 1)
    blocks, face = {
        LoadCaseName.PIPE: (free, "inner"),
        LoadCaseName.TUNNEL: (free, "outer"),
        LoadCaseName.PILLAR: (top, "top"),
        LoadCaseName.BEAM: (in_layer[:1], "outer"),
        LoadCaseName.SHAFT: (in_layer, "outer"),
    }[case]
    block, quads, centroids, vectors = _world_surface(assembly, blocks, face)
    tractions: FloatArray | None = None
    shaft = case is LoadCaseName.SHAFT
    if shaft:
        tractions = pressure * np.cross(assembly.axis, _radial(assembly, centroids))
    fixed = assembly.fixed.copy()
    if case is LoadCaseName.PILLAR:
        fixed[top] = False
    without_couple = as_printed and shaft
    return LoadCase(
        name=str(case),
        block=block,
        quads=quads,
        centroids=surface_means(assembly)[block] if without_couple else centroids,
        area_vectors=vectors,
        tractions=tractions,
        pressure=pressure,
        fixed=fixed,
        without_couple=without_couple,
    )


@dataclass(frozen=True, kw_only=True)
class Load:
    """One of the five load cases, not yet on an assembly."""

    case: LoadCaseName
    """Which."""
    pressure: float
    """[MPa]"""
    layer: int | None = None
    """Loaded layer of beam and shaft; None: ⌊L/2⌋ + 1."""
    as_printed: bool = False
    """The reading that reproduces the paper's tables (see the module's text)."""

    def on(self, assembly: Assembly) -> LoadCase:
        """Tractions on the facets of an assembly, and what it is held by.

        Raises
        ------
        LoadCaseError
            As `load_case`.
        """
        return load_case(
            assembly, self.case, self.pressure, as_printed=self.as_printed, layer=self.layer
        )


def pipe(pressure: float) -> Load:
    """Pressure on the inner faces of all free blocks [MPa]."""
    return Load(case=LoadCaseName.PIPE, pressure=pressure)


def tunnel(pressure: float) -> Load:
    """Pressure on the outer faces of all free blocks [MPa]."""
    return Load(case=LoadCaseName.TUNNEL, pressure=pressure)


def pillar(pressure: float) -> Load:
    """Pressure on the flat top of the top frame, which is released [MPa]."""
    return Load(case=LoadCaseName.PILLAR, pressure=pressure)


def beam(pressure: float, layer: int | None = None) -> Load:
    """Pressure on the outer face of one block of a layer, by default of the middle one [MPa]."""
    return Load(case=LoadCaseName.BEAM, pressure=pressure, layer=layer)


def shaft(pressure: float, layer: int | None = None) -> Load:
    """Tangential traction on the outer faces of a layer, by default of the middle one [MPa]."""
    return Load(case=LoadCaseName.SHAFT, pressure=pressure, layer=layer)


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
    if not np.isfinite(pressure):
        raise LoadCaseError(f"load.pressure: got {pressure}, expected a finite pressure in MPa")
    block, quads, centroids, vectors = _world_surface(assembly, blocks, face)
    return LoadCase(
        name="pressure",
        block=block,
        quads=quads,
        centroids=centroids,
        area_vectors=vectors,
        tractions=None,
        pressure=pressure,
        fixed=assembly.fixed.copy(),
    )
