"""Friction, static against explicit: ``python -m validation.compare.friction``.

Tubes of one layer on coarse meshes under four loads, with and without gaps, and a plate on a slope,
friction from 0.01 to 0.6. Each is solved by the static solver straight up, by an explicit run
that is damped to its static state, and by the static solver past the load by half and back: the
two ends of the set of answers that slow loading admits. Both methods meet within 2 %, or the
explicit answer lies between the ends, or it lies outside by what is said: where blocks fly through
a gap before they press, no law says where they land.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from validation.errors import run_command
from validation.run.friction_set import PAST_AND_BACK
from validation.run.solve import run_explicit, run_static
from validation.scene.read import DeformableScene, load_scene

#: Measures that are compared, and what the table calls them.
MEASURES = {"p_max": "p_max", "p_eff": "p_eff", "max_displacement": "u"}
#: Largest difference of two answers that meet [-].
MEETING = 0.02

_COARSE = ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=4")


@dataclass(frozen=True)
class Case:
    """A scene with friction."""

    scene: str
    """Built-in scene."""
    friction: float
    """μ"""
    gap: float = 0.0
    """Clearance along every normal before the load acts [mm]."""

    def stated(self, method: str) -> DeformableScene:
        """The scene for one of the methods."""
        settings = (
            f"effects.friction.coefficient={self.friction}",
            f"contact.clearance={self.gap}",
            f"fem.method='{method}'",
            "fem.damping='static'",
        )
        scene = load_scene(self.scene, [*_COARSE, *settings]).scene
        assert isinstance(scene, DeformableScene)
        return scene


#: Of each load the friction from little to much, with gaps and without.
CASES = (
    Case("tsb1-pipe", 0.01),
    Case("tsb1-pipe", 0.3),
    Case("tsb1-pipe", 0.6),
    Case("tsb1-pipe", 0.3, 0.05),
    Case("tsb1-tunnel", 0.1),
    Case("tsb1-tunnel", 0.6),
    Case("tsb1-tunnel", 0.3, 0.03),
    Case("tsb1-pillar", 0.05),
    Case("tsb1-pillar", 0.3),
    Case("tsb1-shaft", 0.05),
    Case("tsb1-shaft", 0.3),
    Case("tsb1-shaft", 0.1, 0.03),
)


@dataclass(frozen=True)
class Ends:
    """One measure of one scene."""

    direct: float
    """Static, straight up, in its unit."""
    explicit: float
    """Explicit."""
    back: float
    """Static, past the load by half and back."""
    load_steps: float
    """What half as many load steps change."""

    @property
    def difference(self) -> float:
        """Explicit over static, less one [-]."""
        return self.explicit / self.direct - 1.0

    @property
    def width(self) -> float:
        """Past and back over straight up, less one [-]."""
        return self.back / self.direct - 1.0

    @property
    def outside(self) -> float:
        """Distance of the explicit answer to the nearer end; 0 between them [-]."""
        low, high = sorted((self.direct, self.back))
        beyond = max(low - self.load_steps - self.explicit, self.explicit - high - self.load_steps)
        return max(beyond, 0.0) / abs(self.direct)


@dataclass(frozen=True)
class Row:
    """A scene and what its answers are."""

    case: Case
    ends: dict[str, Ends]
    """Of each of `MEASURES`."""
    load_steps: int
    """Of the static run."""
    seconds: tuple[float, float, float]
    """CPU time of the three runs."""

    @property
    def largest_difference(self) -> float:
        """Of all measures [-]."""
        return max(abs(end.difference) for end in self.ends.values())

    @property
    def verdict(self) -> str:
        """Whether both methods meet, lie in the set, or not."""
        if self.largest_difference <= MEETING:
            return "meet"
        outside = max(end.outside for end in self.ends.values() if abs(end.difference) > MEETING)
        return "between the ends" if outside == 0.0 else f"outside by {100 * outside:.2g} %"


def compared(case: Case) -> Row:
    """Solve a scene three times."""
    seconds = [time.process_time()]
    static = run_static(case.scene, case.stated("static"))
    seconds.append(time.process_time())
    explicit = run_explicit(case.scene, case.stated("explicit"))
    seconds.append(time.process_time())
    back = run_static(case.scene, case.stated("static"), load_path=PAST_AND_BACK)
    seconds.append(time.process_time())
    change = static.load_step_change
    assert static.static is not None
    first, second, third = (b - a for a, b in pairwise(seconds))
    return Row(
        case,
        {
            name: Ends(
                static.measures[name].value,
                explicit.measures[name].value,
                back.measures[name].value,
                change.get(name, 0.0),
            )
            for name in MEASURES
        },
        static.static.load_steps,
        (first, second, third),
    )


def table(rows: Sequence[Row]) -> Table:
    """All scenes."""
    found = Table(title="Friction: static against explicit")
    found.add_column("scene, μ, gap [mm]")
    for name in MEASURES.values():
        found.add_column(f"static {name}", justify="right")
        found.add_column("explicit", justify="right")
        found.add_column("past, back", justify="right")
    for name in ("load steps", "CPU s", "verdict"):
        found.add_column(name)
    for row in rows:
        case = row.case
        cells = [f"{case.scene} {case.friction:g}" + (f", {case.gap:g}" if case.gap else "")]
        for name in MEASURES:
            end = row.ends[name]
            cells += [
                f"{end.direct:.4g}",
                f"{100 * end.difference:+.2f} %",
                f"{100 * end.width:+.1f} %",
            ]
        cells += [f"{row.load_steps}", ", ".join(f"{s:.1f}" for s in row.seconds), row.verdict]
        found.add_row(*cells)
    return found


def main(
    *,
    only: Annotated[str, typer.Option(help="Scenes whose name contains this.")] = "",
) -> None:
    """Print static against explicit answers with friction."""
    console, rows = Console(width=200), []
    for case in CASES:
        if only in case.scene:
            rows.append(compared(case))
            console.print(f"{case.scene} {case.friction:g}, gap {case.gap:g}: {rows[-1].verdict}")
    console.print(table(rows))
    met = sum(row.largest_difference <= MEETING for row in rows)
    console.print(f"{met} of {len(rows)} scenes meet within {100 * MEETING:g} %")


if __name__ == "__main__":
    run_command(lambda: typer.run(main))
