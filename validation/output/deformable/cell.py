"""The error of a periodic cell as a table."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from validation.output.console import listing


def cell_table(name: str, found: dict[str, Any]) -> Table:
    """Cell, middle layers and tube, and the error."""
    seconds = {key: f"{found[f'{key}_seconds']:.2f}" for key in ("cell", "tube")}
    rows = [
        ("periodic cell", "cell", "{:.5g}", 1.0),
        ("two middle layers of the tube", "middle", "{:.5g}", 1.0),
        ("whole tube", "tube", "{:.5g}", 1.0),
        ("error of the middle layers", "error_of_middle_layers", "{:+.2f} %", 100.0),
        ("difference from the whole tube", "difference_from_whole_tube", "{:+.2f} %", 100.0),
    ]
    title = f"{name}: periodic cell and {found['layers']} layers, static, {found['mesh']}"
    table = listing(title, "", "p_max, MPa", "p_eff, MPa", "u, mm", "CPU s")
    for words, key, form, factor in rows:
        numbers = (form.format(factor * value) for value in found[key].values())
        table.add_row(words, *numbers, seconds.get(key, ""))
    return table
