"""Load cases, one file each: found here by their names, listed nowhere."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from geometry.loads.case import LoadCase, LoadCaseError
from geometry.loads.named import NamedLoad

if TYPE_CHECKING:
    from geometry.assembly import Assembly

_MODULES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]

#: Load cases by their names.
CASES: dict[str, NamedLoad] = {m.CASE.name: m.CASE for m in _MODULES if hasattr(m, "CASE")}


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
