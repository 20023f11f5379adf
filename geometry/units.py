"""Refuse lengths that cannot be millimetres."""

from __future__ import annotations

from geometry.assembly import AssemblyError
from geometry.contact_assembly import ContactAssembly

#: Blocks smaller or larger than this (∛V) are drawn in other units than millimetres [mm].
SMALLEST_BLOCK, LARGEST_BLOCK = 1.0, 1e5


def check_size(assembly: ContactAssembly) -> None:
    """Refuse sizes that say that the lengths are not in millimetres.

    Raises
    ------
    AssemblyError
        For blocks outside 1 mm … 100 m.
    """
    length = assembly.characteristic_length
    if not SMALLEST_BLOCK <= length <= LARGEST_BLOCK:
        raise AssemblyError(
            f"{assembly.name}: a block measures {length:.3g} mm (∛ volume); expected lengths in "
            f"millimetres, blocks from {SMALLEST_BLOCK:g} to {LARGEST_BLOCK:g} mm: if yours are in "
            'metres, multiply by 1000 (own meshes: block.units = "m")'
        )
