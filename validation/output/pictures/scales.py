"""Colours of quantities: what they mean, where they end, and the bars that say so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from geometry.mesh import FloatArray, IntArray
from validation.output.pictures.canvas import Pixels, rgb

if TYPE_CHECKING:
    from fem.state import State

#: Okabe–Ito colours: told apart by colour-blind readers.
BLUE, SKY, ORANGE, VERMILION, GREEN, GREY = (
    "#0072B2",
    "#56B4E9",
    "#E69F00",
    "#D55E00",
    "#009E73",
    "#8C8C8C",
)
#: Places where nothing is: joints that are open, blocks without stresses.
PALE = "#E4E4E4"
#: Lines of one plot, one after the other.
OF_LINES = (BLUE, ORANGE, GREEN, VERMILION)
#: One map for each quantity. Pale is low, dark is high: pressures.
PRESSURE_MAP = "YlGnBu"
#: Less green, more brown: pressures against those of another answer.
DIFFERENCE_MAP = "BrBG_r"
#: Compression blue, tension red.
STRESS_MAP = "RdBu_r"
#: Stresses without a sign.
MISES_MAP = "YlOrRd"
#: Part of the largest value below which there is none.
_ZERO = 1e-9
#: Part of the largest pressure below which colours of linear scales look alike; powers of ten of
#: logarithmic ones.
_FAINT, _DECADES = 0.1, 3.0
#: Sizes of displacements, and displacements outward (orange) and inward (purple).
MOTION_MAP, OUTWARD_MAP = "viridis", "PuOr_r"


@dataclass(frozen=True)
class Scale:
    """Colours of a quantity, and what it reaches."""

    label: str
    """Quantity and unit."""
    colours: str
    """Name of a matplotlib map."""
    low: float
    high: float
    reached: tuple[float, float]
    """Least and largest value there is; beyond the colours, the bar has an arrow."""
    note: str = ""
    """Where the largest value lies, in words."""
    diverging: bool = False
    """Whether the middle of the map is zero; the bar shows the part of it between its ends."""
    nothing: str = ""
    """What a value of zero means: those places are grey, and the bar says so."""

    decades: float = 0.0
    """Powers of ten between both ends of a logarithmic scale; zero: it is linear."""

    def position(self, values: FloatArray) -> FloatArray:
        """Where values lie on the bar, from 0 to 1, (n,)."""
        if self.decades:
            shares = np.log10(np.maximum(values, self.low) / self.low) / self.decades
        else:
            shares = (values - self.low) / max(self.high - self.low, 1e-300)
        return np.clip(shares, 0.0, 1.0)

    def of(self, values: FloatArray) -> Pixels:
        """Colours of values, (n, 3)."""
        from matplotlib import colormaps

        reach = max(abs(self.low), abs(self.high), 1e-300)
        shares = self.position(values)
        if self.diverging:
            shares = (np.clip(values, self.low, self.high) + reach) / (2.0 * reach)
        shades = np.asarray(255 * colormaps[self.colours](shares)[:, :3] + 0.5, dtype=np.uint8)
        if self.nothing:
            shades[values <= _ZERO * reach] = rgb(PALE)
        return shades

    def gradient(self, count: int) -> Pixels:
        """So many colours from the lower to the upper end, (count, 3)."""
        between = np.geomspace if self.decades else np.linspace
        return self.of(between(self.low, self.high, count))

    def ticks(self, count: int) -> list[float]:
        """Both ends, and round numbers that have room between them."""
        from matplotlib.ticker import MaxNLocator

        if self.decades:
            first = int(np.ceil(np.log10(self.low)))
            inside = 10.0 ** np.arange(first, first + np.ceil(self.decades))
        else:
            inside = np.array(MaxNLocator(count).tick_values(self.low, self.high))
        room = 0.7 / count
        places = self.position(inside)
        between = inside[(places > room) & (places < 1.0 - room)]
        return [self.low, *between.tolist(), self.high]

    def number(self, value: float) -> str:
        """A value as it stands at the bar, without the power of ten in the label."""
        return f"{value / 10.0**self.power:.3g}".replace("-", "−")

    @property
    def beyond(self) -> str:
        """At which ends values lie beyond the colours by a digit, as matplotlib names it."""
        below, above = (
            sign * (reached - end) > 0.0 and self.number(reached) != self.number(end)
            for sign, reached, end in zip(
                (-1.0, 1.0), self.reached, (self.low, self.high), strict=True
            )
        )
        return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]

    @property
    def words(self) -> str:
        """Label, and where the colours stop below what there is, how far it goes."""
        least, most = map(self.number, self.reached)
        beyond = {
            "neither": "",
            "min": f"min. {least}",
            "max": f"max. {most}",
            "both": f"min. {least}, max. {most}",
        }[self.beyond]
        if self.decades:
            beyond = "logarithmic"
        return ", ".join(part for part in (self._label, beyond) if part)

    @property
    def power(self) -> int:
        """Power of ten that the numbers at the bar leave out, where they would be too long."""
        largest = max(abs(self.low), abs(self.high))
        power = int(np.floor(np.log10(largest))) if largest > 1e-299 else 0
        return power if not -2 <= power < 4 else 0

    @property
    def _label(self) -> str:
        """Label, its unit with the power of ten."""
        if not self.power:
            return self.label
        raised = str(self.power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        what, bracket, unit = self.label.rpartition("[")
        return f"{what}{bracket}10{raised} {unit}"

    @property
    def lines(self) -> list[str]:
        """All that is written below a bar."""
        nothing = f"grey: {self.nothing}" if self.nothing else ""
        return [line for line in (self.words, nothing, self.note) if line]


def scale_from_zero(
    label: str, colours: str, values: Sequence[FloatArray], *, nothing: str = ""
) -> Scale:
    """Colours from zero to the largest of some values, never empty."""
    most = max((float(v.max(initial=0.0)) for v in values), default=0.0)
    least = min((float(v.min(initial=0.0)) for v in values), default=0.0)
    return Scale(label, colours, 0.0, most or 1e-300, (least, most), nothing=nothing)


def pressure_scale(label: str, pressures: FloatArray, joints: IntArray) -> Scale:
    """Colours of pressures from zero to the largest; grey is an open joint.

    Logarithmic where half of the closed joints carry less than a tenth of it at most. ``joints``
    has the number of the joint of each pressure, (n,).
    """
    scale = scale_from_zero(label, PRESSURE_MAP, [pressures], nothing="open joint")
    names, joint = np.unique(joints, return_inverse=True)
    largest = np.zeros(len(names))
    np.maximum.at(largest, joint, pressures)
    closed = largest[largest > _ZERO * scale.high]
    if not len(closed) or np.median(closed) > _FAINT * scale.high:
        return scale
    return replace(scale, low=10.0**-_DECADES * scale.high, decades=_DECADES)


def symmetric_scale(label: str, colours: str, values: Sequence[FloatArray]) -> Scale:
    """Colours about zero that reach the 0.1 and 99.9 % quantiles, and zero.

    A few singular nodes must not drown the picture.
    """
    every = np.concatenate([np.zeros(1), *(v.ravel() for v in values)])
    low, high = (float(q) for q in np.quantile(every, (0.001, 0.999)))
    low, high = min(low, 0.0), max(high, 0.0)
    # Round-off beside stresses of the other sign is none.
    low, high = low if -low > _ZERO * high else 0.0, high if high > -_ZERO * low else 0.0
    if high == low:
        low, high = -1e-300, 1e-300
    reached = (float(every.min()), float(every.max()))
    return Scale(label, colours, low, high, reached, diverging=True)


def drawing_scale(solution: State) -> float:
    """Power of ten that makes displacements visible in a picture; at least one."""
    largest = solution.largest_displacement
    size = solution.whole.assembly.characteristic_length
    if largest == 0.0:
        return 1.0
    return float(max(10.0 ** np.floor(np.log10(0.15 * size / largest)), 1.0))
