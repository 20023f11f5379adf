"""What `tubelock cost` varies: methods, elements, meshes, ramps, damping, precision.

Mass scaling is that of the elements that allow the shortest steps. That of all elements is not
among them: with a ramp in periods of the tube it changes the unit of time and nothing else (as many
steps, the same answer); with a ramp in seconds it is a longer or shorter ramp, which is measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from fem.element.hexahedron import ElementType
from mbd import Norm
from validation.build.cell import refuse_cell
from validation.build.deformable import fem_section
from validation.errors import InputError
from validation.run.curved.accuracy import LADDER
from validation.run.curved.solve import refused
from validation.scene.deformable import Damping, Method, RayleighSection
from validation.scene.read import TubeScene

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


@dataclass(frozen=True)
class BaseMesh:
    """Elements of one block at level 1; level k has k times as many in each direction."""

    around: int
    radial: int
    axial: int

    def at(self, level: int, radial_grading: float = 1.0) -> dict[str, float]:
        """Values of ``[mesh]`` at a level."""
        return {
            "around": level * self.around,
            "radial": level * self.radial,
            "axial": level * self.axial,
            "radial_grading": radial_grading,
        }


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

    def mesh(self, base: BaseMesh) -> dict[str, float]:
        """Values of ``[mesh]``."""
        level = CURVED_FACETS if self.method == "curved" else self.level
        return base.at(level, self.radial_grading)

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
        return f"{rung.around} × {rung.radial} × {rung.axial} of degree {rung.degree}"


@dataclass(frozen=True)
class CostPlan:
    """All that one call measures."""

    base: BaseMesh
    settings: tuple[CostSetting, ...]
    reference_levels: tuple[int, ...]
    """Levels of the static C3D8I solutions that are extrapolated, or rungs of curved elements."""
    curved: bool = False
    """Whether the finest of some rungs of curved elements is the reference."""

    @property
    def references(self) -> tuple[CostSetting, ...]:
        """Settings of the reference."""
        if self.curved:
            return tuple(curved_setting(k) for k in self.reference_levels)
        return tuple(static_setting(ElementType.INCOMPATIBLE, k) for k in self.reference_levels)

    @property
    def graded_references(self) -> tuple[CostSetting, ...]:
        """Settings of the reference of what sits at the outer edge, on graded meshes."""
        return () if self.curved else tuple(graded(setting) for setting in self.references)


def require_cost_scene(scene: Any, name: str) -> TubeScene:
    """Return the scene if its work and precision can be measured.

    Raises
    ------
    InputError
        Other blocks than Sine Blocks, missing sections, effects without a static reference.
    """
    if not isinstance(scene, TubeScene):
        raise InputError(
            f"{name}: block.type {scene.block.type!r}: the cost of accuracy is measured on nested "
            'meshes of Sine Blocks; expected block.type = "sine", such as tsb1-pipe'
        )
    fem_section(scene, name)
    refuse_cell(scene, name, "cost")
    if scene.effects.friction is not None:
        raise InputError(
            f"{name}: effects.friction: errors are measured against a static solution, which "
            "depends on no history; remove friction"
        )
    if scene.effects.gravity is not None:
        raise InputError(
            f"{name}: effects.gravity: rigid answers are measured too, of the load alone; remove it"
        )
    if scene.effects.elastic_frame:
        raise InputError(
            f"{name}: effects.elastic_frame: expected rigid frame blocks, which rigid and "
            "deformable answers share; remove it"
        )
    return scene


def base_mesh(scene: TubeScene) -> BaseMesh:
    """Coarsest mesh: one element through the wall, at least four a wave.

    The pressure peaks sit on the flanks of the waves, so elements are twice as short round the
    block as across the wall, and two and a half times as long along the axis. The count round a
    block is a multiple of the number of waves, so that all levels conform.
    """
    block = scene.block
    waves = round(2 * block.frequency)
    size = max(block.thickness, block.height / 5)
    arc = 2 * math.pi * (block.inner_radius + block.thickness / 2) / block.blocks_per_layer
    per_wave = max(4, round(2 * arc / size / waves))
    return BaseMesh(waves * per_wave, 1, max(2, round(block.height / (2.5 * size))))


def rigid_setting(norm: Norm, level: int) -> CostSetting:
    """Rigid blocks."""
    return CostSetting(f"rigid, {norm} norm", "rigid", level, (("rigid.norm", str(norm)),))


def static_setting(element: ElementType, level: int) -> CostSetting:
    """Deformable blocks, Newton's method."""
    changes = (("fem.method", "static"), ("fem.element", element.value))
    return CostSetting(f"static {ELEMENT_NAMES[element]}", "static", level, changes)


def curved_setting(rung: int) -> CostSetting:
    """Curved elements as `fem --accuracy` takes them, up to a rung from 1."""
    return CostSetting("static curved", "curved", rung, (("fem.method", "static"),))


def graded(setting: CostSetting) -> CostSetting:
    """Return the same on meshes with short elements at the outer face, where pressures peak."""
    family = f"{setting.family}, graded"
    return replace(setting, family=family, radial_grading=RADIAL_GRADING)


def explicit_setting(element: ElementType, level: int, **changes: str) -> CostSetting:
    """Deformable blocks, explicit dynamics to the static state by adaptive damping."""
    values = {"damping": "static", "precision": "float64", **changes}
    given = {"method": "explicit", "element": element.value, **values}
    pairs = tuple((f"fem.{key}", value) for key, value in given.items())
    return CostSetting(f"explicit {ELEMENT_NAMES[element]}", "explicit", level, pairs)


def _variants(level: int) -> list[CostSetting]:
    """Explicit C3D8I with one thing changed."""
    plain = explicit_setting(ElementType.INCOMPATIBLE, level)
    single = explicit_setting(ElementType.INCOMPATIBLE, level, precision="float32")
    loose = explicit_setting(ElementType.INCOMPATIBLE, level, residual="1e-2")
    tight = explicit_setting(ElementType.INCOMPATIBLE, level, residual="1e-6")
    constant = explicit_setting(ElementType.INCOMPATIBLE, level)
    heavy = explicit_setting(ElementType.INCOMPATIBLE, level, mass_scaling="2")
    paper = explicit_setting(ElementType.INCOMPATIBLE, level, damping="paper")
    name = plain.family
    return [
        # Its round-off keeps the residual above any useful bound: time has to stop it.
        replace(single, family=f"{name}, float32", hold_periods=4.0),
        replace(loose, family=f"{name}, residual 1e-2"),
        replace(tight, family=f"{name}, residual 1e-6"),
        replace(heavy, family=f"{name}, mass scaling 2"),
        replace(plain, family=f"{name}, ramp × 0.1", ramp_factor=0.1),
        replace(plain, family=f"{name}, ramp × 10", ramp_factor=10.0),
        replace(
            constant,
            family=f"{name}, constant damping",
            hold_periods=4.0,
            damping_ratio=1.0,
        ),
        replace(paper, family=f"{name}, α = 2 /s", ramp_factor=0.1, hold_periods=10.0),
    ]


def full_plan(scene: TubeScene) -> CostPlan:
    """Everything, to decide by."""
    found = [rigid_setting(norm, k) for norm in Norm for k in (1, 2, 4, 6)]
    best = ElementType.INCOMPATIBLE
    for element in ELEMENT_NAMES:
        found += [
            static_setting(element, k) for k in (1, 2, 3, 4, 6)[: 5 if element is best else 4]
        ]
    for element in ELEMENT_NAMES:
        found += [explicit_setting(element, k) for k in (1, 2, 4, 6)[: 4 if element is best else 3]]
    found += [graded(static_setting(best, k)) for k in (2, 3, 4, 6)]
    found += [graded(explicit_setting(best, k)) for k in (2, 4)]
    found += _variants(2)
    # Without strong damping a run takes far longer: its price shows on the coarser mesh.
    found += [s for s in _variants(4) if s.hold_periods is None or s.hold_periods < 10.0]
    if refused(scene) is not None:
        return CostPlan(base_mesh(scene), tuple(found), (4, 6, 7, 8))
    # The finest rung judges the others and all that is not curved.
    found += [curved_setting(k) for k in (1, 2, 3)]
    return CostPlan(base_mesh(scene), tuple(found), (2, 3, 4), curved=True)


def quick_plan(scene: TubeScene) -> CostPlan:
    """Coarse meshes: shows how it works, in seconds."""
    found = [rigid_setting(norm, k) for norm in Norm for k in (1, 2)]
    found += [
        static_setting(element, k)
        for element in (ElementType.INCOMPATIBLE, ElementType.REDUCED)
        for k in (1, 2)
    ]
    found += [explicit_setting(ElementType.INCOMPATIBLE, 1)]
    found += [_variants(1)[0]]
    return CostPlan(base_mesh(scene), tuple(found), (2, 3, 4))


def with_setting(scene: TubeScene, base: BaseMesh, setting: CostSetting) -> TubeScene:
    """Scene that a setting solves; times that depend on its frequency are left to the run."""
    assert scene.fem is not None
    rigid = dict(p for p in setting.changes if p[0].startswith("rigid."))
    fem = dict(p for p in setting.changes if p[0].startswith("fem."))
    changed: dict[str, Any] = {"mesh": scene.mesh.model_validate(setting.mesh(base))}
    if rigid:
        update = {key.partition(".")[2]: value for key, value in rigid.items()}
        changed["rigid"] = scene.rigid.model_copy(update={"norm": Norm(update["norm"])})
    if fem:
        changed["fem"] = scene.fem.model_copy(update=_fem_values(fem))
    return scene.model_copy(update=changed)


def _fem_values(changes: dict[str, str]) -> dict[str, Any]:
    """Checked values; what the plan varies and a setting does not name is as by default."""
    kinds: dict[str, Any] = {
        "method": Method,
        "element": ElementType,
        "damping": Damping,
        "residual": float,
        "precision": str,
        "mass_scaling": float,
    }
    values: dict[str, Any] = {"ramp_time": None, "end_time": None, "residual": 1.0e-4}
    values["mass_scaling"] = None
    for key, text in changes.items():
        short = key.partition(".")[2]
        values[short] = kinds[short](text)
    return values


def damped_constantly(scene: TubeScene, coefficient: float) -> TubeScene:
    """Scene with constant mass damping [1/s] in place of an adaptive one."""
    assert scene.fem is not None
    given = scene.effects.rayleigh or RayleighSection()
    rayleigh = given.model_copy(update={"mass_proportional": coefficient})
    return scene.model_copy(
        update={
            "effects": scene.effects.model_copy(update={"rayleigh": rayleigh}),
            "fem": scene.fem.model_copy(update={"damping": None}),
        }
    )
