"""Section forces as rows of a table and as CSV."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from geometry.measures import SectionForces
from validation.output.files import write_csv
from validation.output.joints import components
from validation.output.outputs import Outputs

#: File of the section forces.
SECTION_FILES = ("section_forces.csv",)
#: Units of the columns; others are directions.
_UNITS = {
    "plane_point": "mm",
    "area": "mm2",
    "centroid": "mm",
    "force": "N",
    "moment": "Nmm",
    "normal_force": "N",
    "shear_forces": "N",
    "bending_moments": "Nmm",
    "twisting_moment": "Nmm",
    "point": "mm",
}


def add_sections(table: Table, found: SectionForces | None) -> None:
    """Add a line for each section."""
    for k, name in enumerate(() if found is None else found.planes.names):
        assert found is not None
        table.add_row(f"section {name}", found.words(k))


def write_sections(found: SectionForces | None, outputs: Outputs) -> None:
    """Write one row for each section; nothing without a folder or without sections."""
    if found is not None:
        outputs.write("sections", SECTION_FILES[0], lambda path: _write(found, path))


def _write(found: SectionForces, path: Path) -> None:
    columns = {"name": list(found.planes.names)}
    for key, values in found.columns().items():
        unit = _UNITS.get(key, "")
        if values.ndim == 1:
            columns[f"{key}_{unit}"] = values.tolist()
            continue
        axes = ("x", "y", "z") if values.shape[1] == 3 else ("1", "2")
        parts = components(key, values, unit, axes)
        columns |= {name: part.tolist() for name, part in parts.items()}
    write_csv(path, columns, zip(*columns.values(), strict=True))
