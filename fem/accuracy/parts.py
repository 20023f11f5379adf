"""What a deformable answer has beside its measures: `geometry.answer.Answer.parts`.

`accuracy` and `meshes` of a state on finer and finer meshes, with the `facets` of its means.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from fem.accuracy.errors import OnMesh, is_negligible, relative, unmet
from geometry.answer import Measure
from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.parts.rows import Row, grouped


@dataclass(frozen=True)
class Accuracy:
    """Error bars that finer and finer meshes were solved for."""

    requested: Mapping[str, float]
    """Relative error bars [-] by measure."""
    measures: Mapping[str, Measure]
    """Numbers of the last mesh with their error bars."""
    ended_by: str
    """What ended the refinement."""
    stopped_by: str | None = None
    """Which limit did: "work", "clock", "memory" or "interrupt"; None: none."""

    @property
    def not_reached(self) -> list[str]:
        """Measures whose error bars are wider than requested."""
        return unmet(self.measures, self.requested)

    def request_rows(self, names: Sequence[str] | None = None) -> list[str]:
        """Repeat requests, by default all, reached or not, with their error bars."""
        rows = []
        for name in self.requested if names is None else names:
            share, bar = self.requested[name], relative(self.measures[name])
            digits = 1 if bar < 0.1 else 0
            bar_words = f"± {100 * bar:.{digits}f} %" if isfinite(bar) else "no error bar"
            if bar <= share:
                verdict = f"reached, {bar_words}"
            elif is_negligible(self.measures, name):
                verdict = "not needed, negligible beside the largest stress"
            else:
                verdict = f"not reached, {bar_words}"
            rows.append(f"{name}={100 * share:g}%: {verdict}")
        return rows

    @property
    def rows(self) -> list[Row]:
        """Each request with what was reached, and what ended the refinement."""
        rows = [Row("requested error bars", row) for row in self.request_rows()]
        return grouped(evidence=[*rows, Row("refinement ended by", self.ended_by)])

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "requested": dict(self.requested),
            "reached": {name: relative(self.measures[name]) for name in self.requested},
            "not_reached": self.not_reached,
            "ended_by": self.ended_by,
            "stopped_by": self.stopped_by,
        }


@dataclass(frozen=True)
class Meshes:
    """Meshes that were solved, from coarse to fine."""

    meshes: list[OnMesh]

    def qualified(self, title: str) -> str:
        """Title of an answer, with what one mesh leaves open."""
        one = "; one mesh: these numbers are not converged"
        return title if len(self.meshes) > 1 else title + one

    @property
    def rows(self) -> list[Row]:
        """Elements and CPU time of each mesh."""
        rows = []
        for mesh in self.meshes:
            of, seconds = mesh.beside, mesh.beside["cpu_seconds"]
            words = f"{of['elements_per_block']} elements of degree {mesh.rung.degree} per block"
            words += f", {of['unknowns']} unknowns: {seconds:.2f} CPU s"
            rows.append(Row("meshes", words, seconds, "s", "time"))
        return rows

    def as_json(self) -> list[dict[str, Any]]:
        """Return plain data."""
        return [mesh.as_json() for mesh in self.meshes]


class MeshFacets(NamedTuple):
    """Facets of the mesh that was stated, on which a state of a finer one is averaged."""

    assembly: Assembly
    """The mesh."""
    pressures: FloatArray
    """Mean pressure on each of its `interfaces`, (n,) [MPa]."""

    @property
    def size(self) -> float:
        """Square root of the mean area [mm]."""
        return float(np.sqrt(self.assembly.interfaces.areas.mean()))

    @property
    def rows(self) -> list[Row]:
        """Their size."""
        words = f"those of [mesh], {self.size:.3g} mm (square root of the mean area)"
        return [Row("facets of p_eff, p_max", words, self.size, "mm", "model")]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"size": self.size, "n": len(self.pressures)}
