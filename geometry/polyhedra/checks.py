"""Refuse assemblies of any blocks that cannot be meant: once, at the door."""

from __future__ import annotations

import numpy as np

from geometry.assembly import AssemblyError
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.overlap import find_overlaps

#: Coordinates may be rounded to this part of the contact tolerance.
_ROUNDING = 0.01


def check_contacts(assembly: PolyhedralAssembly) -> None:
    """Refuse free blocks that touch nothing.

    Raises
    ------
    AssemblyError
        Naming the block and, if there is one, the gap that keeps it apart.
    """
    found = assembly.interfaces
    touching = np.zeros(assembly.n_blocks, dtype=bool)
    touching[found.block_m] = touching[found.block_s] = True
    lonely = np.flatnonzero(~touching & ~assembly.fixed)
    if not lonely.size:
        return
    block = int(lonely[0])
    remedy = "move it, or fix or remove it"
    tolerance = assembly.tolerance
    for _ in range(3):
        tolerance *= 10.0
        wider = assembly.contacts_within(tolerance)
        if block in wider.block_m or block in wider.block_s:
            remedy = (
                f"a facing surface lies within {tolerance:.3g} mm: set detection.tolerance = "
                f"{tolerance:.3g} if that is meant to touch"
            )
            break
    more = f" (and {lonely.size - 1} more)" if lonely.size > 1 else ""
    raise AssemblyError(
        f"{assembly.name}: block {block}{more} touches no other block within "
        f"{assembly.tolerance:.3g} mm; {remedy}"
    )


def check_overlaps(assembly: PolyhedralAssembly) -> None:
    """Refuse blocks that are deeper in each other than twice the contact tolerance.

    Raises
    ------
    AssemblyError
        Naming the deepest pair, how deep and where.
    """
    found = find_overlaps(
        assembly.shapes,
        assembly.shape_of,
        assembly.rotations,
        assembly.translations,
        2 * assembly.tolerance,
    )
    if found:
        worst = found[0]
        raise AssemblyError(
            f"{assembly.name}: blocks {worst.block_a} and {worst.block_b} overlap by "
            f"{worst.depth:.3g} mm near {np.round(worst.point, 2).tolist()} mm "
            f"({len(found)} overlapping pairs); expected blocks that touch within "
            f"{assembly.tolerance:.3g} mm: move them apart or set detection.tolerance"
        )


def check_assembly(assembly: PolyhedralAssembly) -> None:
    """Refuse overlapping blocks and blocks without contact.

    Raises
    ------
    AssemblyError
        One clear message for the first of these found.
    """
    if not (np.isfinite(assembly.tolerance) and assembly.tolerance > 0):
        raise AssemblyError(
            f"detection.tolerance: got {assembly.tolerance}, expected a positive length in mm"
        )
    if assembly.tolerance > 0.1 * assembly.characteristic_length:
        raise AssemblyError(
            f"detection.tolerance: got {assembly.tolerance:g} mm for blocks of "
            f"{assembly.characteristic_length:.3g} mm; expected a small fraction of a block"
        )
    _check_distance(assembly)
    check_overlaps(assembly)
    check_contacts(assembly)


def _check_distance(assembly: PolyhedralAssembly) -> None:
    """Refuse blocks so far from the origin that coordinates are rounded to what counts as a gap."""
    reach = float(np.abs(assembly.translations).max())
    rounding = float(np.spacing(reach))
    if not rounding <= _ROUNDING * assembly.tolerance:
        raise AssemblyError(
            f"{assembly.name}: a block lies {reach:.3g} mm from the origin, where coordinates "
            f"are rounded to {rounding:.1g} mm, and gaps of {assembly.tolerance:.3g} mm are told "
            "apart; move the assembly to the origin"
        )
