"""The explosion of a tube as text."""

from __future__ import annotations

from rich.console import Console

from validation.output.console import two_columns
from validation.run.rigid.explosion import Explosion


def print_explosion(run: Explosion, console: Console) -> None:
    """Print the verdict and its numbers."""
    first, finite = run.first, run.finite
    table = two_columns(f"{run.name}: explosion")
    table.add_row("verdict", "explodes" if run.explodes else "does not explode")
    words = "admissible" if first.admissible else "not admissible"
    table.add_row(
        "first order, frame released",
        f"{words}: smallest gap rate {first.smallest_gap_rate:.4g} mm per mm outward; "
        f"{first.closing_area_percent:.1f} % of the contact area closes, "
        f"{first.opening_area_percent:.1f} % opens",
    )
    last = finite.distances[-1]
    if finite.first_overlap is None:
        words = f"free up to {last:g} mm (one wall thickness), the last distance looked at"
    else:
        words = (
            f"free up to {finite.free_distance:.3g} mm, then blocks are more than "
            f"{finite.tolerance:g} mm in each other; {finite.depths[-1]:.3g} mm deep at {last:g} mm"
        )
    table.add_row("finite motion", words)
    table.add_row("outward push, frame held", f"{run.held}")
    table.add_row(
        "outward push, nothing held",
        "carried by the contacts alone"
        if first.held_together
        else "drives a motion (turning and lengthening of the tube allowed)",
    )
    table.add_row("CPU seconds", f"{run.cpu_seconds:.2f}")
    console.print(table)
