"""Load cases with names: one record each, which says what it loads and what it is called.

Nothing else lists load cases: a new one is one record here, found by its name.

Every case exists twice: as physics says (default) and ``as_printed``, the reading that reproduces
the paper's tables. They differ in one case, *shaft*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.assembly import Assembly
from geometry.loads.case import (
    CircumferentialLoad,
    FaceLoad,
    LoadCase,
    LoadCaseError,
    PressureLoad,
    check_finite,
)
from geometry.mesh import IntArray


@dataclass(frozen=True, kw_only=True)
class NamedLoad:
    """A load case that any tube can take."""

    name: str
    """What scenes call it."""
    words: str
    """What titles call it."""
    face: str
    """Face that is loaded."""
    blocks: Callable[[Assembly, int], IntArray]
    """Blocks that are loaded, of the assembly and the loaded layer, (n,)."""
    acts: Callable[[IntArray, str, float], FaceLoad] = PressureLoad
    """What acts, of the blocks, the face and the load pressure [MPa]."""
    one_layer: bool = False
    """Whether it loads a single layer."""
    every_layer: bool = False
    """Whether it loads every free layer alike, so that a periodic cell can carry it."""
    releases: bool = False
    """Whether the blocks it loads belong to the frame and are released."""
    force_as_printed: bool = False
    """Whether the paper's tables have its resultant forces alone, at the mean of each block's
    surface nodes."""

    def on(
        self,
        assembly: Assembly,
        pressure: float,
        *,
        as_printed: bool = False,
        layer: int | None = None,
    ) -> LoadCase:
        """Put the load on an assembly.

        Parameters
        ----------
        assembly
            A tube whose blocks have the loaded faces.
        pressure
            Load pressure [MPa].
        as_printed
            The reading that reproduces the paper's tables (see the module's text).
        layer
            Loaded layer of a case that loads one; by default ⌊L/2⌋ + 1.

        Raises
        ------
        LoadCaseError
            For a non-finite pressure, a layer that does not exist, blocks without the face.
        """
        check_finite(pressure)
        chosen = loaded_layer(assembly) if layer is None else layer
        if not 1 <= chosen <= assembly.n_layers:
            raise LoadCaseError(
                f"load.layer: got {chosen}, expected a free layer from 1 to {assembly.n_layers}"
            )
        load = self.acts(self.blocks(assembly, chosen), self.face, pressure)
        fixed = assembly.fixed.copy()
        if self.releases:
            fixed[load.blocks] = False
        without_couple = as_printed and self.force_as_printed
        return LoadCase(assembly, self.name, (load,), fixed, without_couple=without_couple)


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
    """The reading that reproduces the paper's tables."""

    def on(self, assembly: Assembly) -> LoadCase:
        """Tractions on the facets of an assembly, and what it is held by.

        Raises
        ------
        LoadCaseError
            As `NamedLoad.on`.
        """
        return self.case.on(assembly, self.pressure, as_printed=self.as_printed, layer=self.layer)


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


def named_load(name: str) -> NamedLoad:
    """Find a load case.

    Raises
    ------
    LoadCaseError
        For an unknown name.
    """
    if name not in CASES:
        raise LoadCaseError(f"load.case: got {name!r}, expected one of {', '.join(CASES)}")
    return CASES[name]


def load_case(
    assembly: Assembly,
    name: str,
    pressure: float,
    *,
    as_printed: bool = False,
    layer: int | None = None,
) -> LoadCase:
    """Put a load case on an assembly by its name: see `NamedLoad.on`.

    Raises
    ------
    LoadCaseError
        For an unknown case, a layer of a case that loads all, and as `NamedLoad.on`.
    """
    case = named_load(name)
    if layer is not None and not case.one_layer:
        known = " or ".join(other.name for other in CASES.values() if other.one_layer)
        raise LoadCaseError(
            f"load.layer: got {layer}, but {case.name} loads no single layer; remove it, or choose "
            f"load.case = {known}"
        )
    return case.on(assembly, pressure, as_printed=as_printed, layer=layer)
