"""What `tubelock cost` varies: methods, elements, meshes, ramps, damping."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from fem.accuracy.ladder import LADDER
from fem.element.hexahedron import ElementType
from mbd.options import Norm
from validation.errors import InputError
from validation.scene.family import AssemblyScene

#: Abaqus' names, as the field knows the elements.
ELEMENT_NAMES = {
    ElementType.INCOMPATIBLE: "C3D8I",
    ElementType.FULL: "full",
    ElementType.B_BAR: "C3D8",
    ElementType.REDUCED: "C3D8R",
}


#: Elements at the inner over those at the outer face of graded meshes.
RADIAL_GRADING = 8.0
#: Level of the facets over which pressures of curved elements are means.
CURVED_FACETS = 8
#: Elements of the coarsest mesh along a wave or an edge, through the wall and in the direction that
#: is left: pressures peak on the flanks of waves, so elements are shortest along these.
_COARSEST = (4, 1, 2)


@dataclass(frozen=True)
class BaseMesh:
    """Elements of one block at level 1; level k has k times as many in each direction."""

    counts: tuple[tuple[str, int | tuple[int, ...]], ...]
    """Values of ``[mesh]`` that count elements."""
    grades: bool = False
    """Whether ``[mesh]`` knows a grading across the wall."""

    def at(self, level: int, radial_grading: float = 1.0) -> dict[str, Any]:
        """Values of ``[mesh]`` at a level."""
        result: dict[str, Any] = {
            key: level * n if isinstance(n, int) else tuple(level * k for k in n)
            for key, n in self.counts
        }
        return result | ({"radial_grading": radial_grading} if self.grades else {})

    @property
    def words(self) -> str:
        """Such as ``12 × 1 × 2 (around, radial, axial)``."""
        names = ", ".join(key if isinstance(n, int) else "x, y, z" for key, n in self.counts)
        sizes = [size for _, n in self.counts for size in ([n] if isinstance(n, int) else n)]
        return f"{' × '.join(map(str, sizes))} ({names})"


def base_mesh(scene: AssemblyScene, name: str) -> BaseMesh:
    """Coarsest mesh, whose multiples conform: one element through the wall, four a wave."""
    counts = scene.element_counts | scene.coarse_mesh(*_COARSEST)
    if not counts:
        raise InputError(
            f"{name}: block.type {scene.block.type!r}: the cost of accuracy is measured on nested "
            "meshes, and this scene gives a mesh of its own to every block; expected a family with "
            "[mesh], such as tsb1-pipe, thb0-tunnel or planar-sine"
        )
    given = getattr(scene, "mesh", None)
    return BaseMesh(tuple(counts.items()), hasattr(given, "radial_grading"))


@dataclass(frozen=True)
class CostSetting:
    """One way to answer a scene."""

    family: str
    """What it is apart from the mesh; settings of one family are meshes of one method."""
    method: str
    """``rigid``, ``static``, ``curved`` or ``explicit``."""
    level: int
    """Refinement of the base mesh; of curved elements the rung, from 1."""
    changes: tuple[tuple[str, str], ...] = ()
    """Values of the scene that differ, as ``section.key`` and text."""
    ramp_factor: float = 1.0
    """Ramp over the recommended one, of an explicit run [-]."""
    hold_periods: float | None = None
    """Periods of the lowest excited mode under full load, where no residual stops the run."""
    damping_ratio: float | None = None
    """Constant mass damping in place of an adaptive one, over critical of that mode [-]."""
    radial_grading: float = 1.0
    """Elements at the inner over those at the outer face of the wall [-]."""

    def mesh(self, base: BaseMesh) -> dict[str, Any]:
        """Values of ``[mesh]``."""
        return base.at(self.facet_level, self.radial_grading)

    @property
    def facet_level(self) -> int:
        """Level of the facets that pressures are means over."""
        return CURVED_FACETS if self.method == "curved" else self.level

    @property
    def curve(self) -> str:
        """Method, elements of higher degree apart from trilinear ones."""
        return "curved" if self.family.startswith("static degree") else self.method

    @property
    def name(self) -> str:
        """Family and mesh."""
        return f"{self.family}, {self.mesh_words}"

    @property
    def mesh_words(self) -> str:
        """Level, or the elements of a rung."""
        if self.method != "curved":
            return f"mesh ×{self.level}"
        rung = LADDER[self.level - 1]
        return f"{rung.along} × {rung.across} × {rung.upward} of degree {rung.degree}"


def rigid_setting(norm: Norm, level: int) -> CostSetting:
    """Rigid blocks."""
    return CostSetting(f"rigid, {norm} norm", "rigid", level, (("rigid.norm", str(norm)),))


def static_setting(element: ElementType, level: int) -> CostSetting:
    """Deformable blocks, Newton's method."""
    changes = (("fem.method", "static"), ("fem.element", element.value))
    return CostSetting(f"static {ELEMENT_NAMES[element]}", "static", level, changes)


def degree_setting(degree: int, level: int) -> CostSetting:
    """Elements of a degree on the exact shape, Newton's method."""
    changes = (("fem.method", "static"), ("fem.degree", str(degree)))
    return CostSetting(f"static degree {degree}", "static", level, changes)


def curved_setting(rung: int) -> CostSetting:
    """Curved elements as `fem --accuracy` takes them, up to a rung from 1."""
    return CostSetting("static curved", "curved", rung, (("fem.method", "static"),))


def graded(setting: CostSetting) -> CostSetting:
    """Return the same on meshes with short elements at the outer face, where pressures peak."""
    family = f"{setting.family}, graded"
    return replace(setting, family=family, radial_grading=RADIAL_GRADING)


def explicit_setting(element: ElementType, level: int, **changes: str) -> CostSetting:
    """Deformable blocks, explicit dynamics to the static state by adaptive damping."""
    values = {"damping": "static", **changes}
    given = {"method": "explicit", "element": element.value, **values}
    pairs = tuple((f"fem.{key}", value) for key, value in given.items())
    return CostSetting(f"explicit {ELEMENT_NAMES[element]}", "explicit", level, pairs)


def variants(level: int) -> list[CostSetting]:
    """Explicit C3D8I with one thing changed."""
    result: dict[str, tuple[dict[str, str], dict[str, float]]] = {
        "residual 1e-2": ({"residual": "1e-2"}, {}),
        "residual 1e-6": ({"residual": "1e-6"}, {}),
        "ramp × 0.1": ({}, {"ramp_factor": 0.1}),
        "ramp × 10": ({}, {"ramp_factor": 10.0}),
        "constant damping": ({}, {"hold_periods": 4.0, "damping_ratio": 1.0}),
        "α = 2 /s": ({"damping": "paper"}, {"ramp_factor": 0.1, "hold_periods": 10.0}),
    }
    settings = []
    for words, (changes, times) in result.items():
        setting = explicit_setting(ElementType.INCOMPATIBLE, level, **changes)
        given: dict[str, Any] = {"family": f"{setting.family}, {words}", **times}
        settings.append(replace(setting, **given))
    return settings


def with_setting(scene: AssemblyScene, base: BaseMesh, setting: CostSetting) -> AssemblyScene:
    """Scene that a setting solves; times that depend on its frequency are left to the run."""
    changes: dict[str, Any] = dict(setting.changes)
    changes["mesh"] = setting.mesh(base)
    if any(key.startswith("fem.") for key in changes):
        # What the plan varies and a setting does not name is as by default.
        usual: dict[str, Any] = {"degree": 1}
        if changes.get("fem.method") == "explicit":
            usual = dict.fromkeys(("ramp_time", "end_time")) | {"residual": 1.0e-4}
        changes = {f"fem.{key}": value for key, value in usual.items()} | changes
    return scene.changed(changes)
