"""Static runs of Sine Block tubes with curved elements, on one mesh.

Means over facets are those over the facets of ``[mesh]``, whatever the elements. Degree and mesh
are chosen by `validation.run.curved.accuracy`.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fem.assembly.contact_state import CapAction, cap_action
from fem.contact.law import ContactLaw
from fem.element.lagrange import LagrangeElement
from fem.element.lagrange_stress import PointValue, averaged_tension, everywhere
from fem.static.lagrange_block import Lattice, body_force, face_pressure
from fem.static.lagrange_peaks import FacetMeans, Lines, facet_means, largest_point_pressure
from fem.static.lagrange_tube import LayeredJoints, TubeState, solve_layered_tube, transferred
from geometry.families.sine_block import (
    SineBlockDivisions,
    SineBlockParameters,
    sine_block_points,
    waves_of_turn,
)
from geometry.loads import CASES
from geometry.measures import block_measures
from geometry.mesh import FloatArray
from validation.build.deformable import build_material
from validation.errors import named
from validation.run.measures import Measure
from validation.scene.read import TubeScene


@dataclass(frozen=True)
class CurvedMesh:
    """Curved elements of one block."""

    degree: int
    """Of the polynomials."""
    lines: Lines
    """Ends of the elements across the wall, around and along the axis, 0 to 1."""

    @property
    def n_elements(self) -> int:
        """Of a block."""
        return int(np.prod([len(line) - 1 for line in self.lines]))

    @property
    def n_unknowns(self) -> int:
        """Displacement components of a block."""
        return 3 * int(np.prod([self.degree * (len(line) - 1) + 1 for line in self.lines]))


@dataclass(frozen=True)
class Solved:
    """A state on one mesh and its measures, without errors."""

    mesh: CurvedMesh
    state: TubeState
    measures: dict[str, Measure]
    cpu_seconds: float
    """Of this mesh alone [s]."""


@dataclass(frozen=True)
class CurvedRun:
    """A tube of curved blocks and its answers."""

    name: str
    scene: TubeScene
    meshes: tuple[CurvedMesh, ...]
    """Those that were solved, from coarse to fine; the last one gave the answer."""
    seconds: tuple[float, ...]
    """CPU time of each [s]."""
    measures: dict[str, Measure]
    """With their errors."""
    estimate: str
    """What the errors are, in words."""
    state: TubeState
    """On the last mesh."""
    cap: CapAction | None
    """Where the maximum stiffness of the contact law acted in a sector; None for a law without."""

    @property
    def mesh(self) -> CurvedMesh:
        """Of the answer."""
        return self.meshes[-1]

    @property
    def title(self) -> str:
        """Scene, load, method and mesh."""
        layers, mesh = self.scene.assembly.layers, self.mesh
        return (
            f"{self.name}, {layers} layer{'s' if layers > 1 else ''}: {self.scene.load_words}; "
            f"static FEM, {mesh.n_elements} curved elements of degree {mesh.degree} per block"
            f"{self.scene.gap_words}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "scene": self.name,
            "method": "static",
            "degree": self.mesh.degree,
            "n_elements": self.mesh.n_elements,
            "n_unknowns": self.mesh.n_unknowns,
            "measures": {name: measure.as_json() for name, measure in self.measures.items()},
            "contact_cap": None if self.cap is None else asdict(self.cap),
            "newton_iterations": self.state.iterations,
            "residual": self.state.residual,
            "meshes": [
                {
                    "degree": mesh.degree,
                    "lines": [line.tolist() for line in mesh.lines],
                    "cpu_seconds": seconds,
                }
                for mesh, seconds in zip(self.meshes, self.seconds, strict=True)
            ],
            "cpu_seconds": {"total": sum(self.seconds)},
        }


def curved_run(
    name: str, scene: TubeScene, solved: tuple[Solved, ...], errors: dict[str, float], estimate: str
) -> CurvedRun:
    """Answer with the last of the meshes that were solved, and these errors."""
    assert scene.contact is not None
    last = solved[-1]
    state = last.state
    return CurvedRun(
        name=name,
        scene=scene,
        meshes=tuple(s.mesh for s in solved),
        seconds=tuple(s.cpu_seconds for s in solved),
        measures={key: replace(m, error=errors.get(key)) for key, m in last.measures.items()},
        estimate=estimate,
        state=state,
        cap=cap_action(scene.contact.built, state.pressures, state.weights),
    )


def solve_curved(
    name: str, scene: TubeScene, mesh: CurvedMesh, before: TubeState | None = None
) -> Solved:
    """Solve on one mesh, from the state on a coarser one if there is one.

    Raises
    ------
    InputError
        An element that folds, or a state that was not found.
    """
    assert scene.material is not None
    assert scene.contact is not None
    start = time.process_time()
    block = scene.shape
    element = LagrangeElement(mesh.degree, build_material(scene.material))
    lattice = sine_lattice(block, mesh.lines, element)
    law, clearance = scene.contact.built, scene.contact.clearance
    with named(name):
        waves = waves_of_turn(block, scene.assembly.turn)
        layered = _layered(scene, block, waves * (len(mesh.lines[1]) - 1) // block.waves_per_block)
        state = solve_layered_tube(
            lattice,
            layered,
            _force(lattice, scene),
            law,
            clearance=clearance,
            start=None if before is None else transferred(before, lattice),
        )
    angle = waves / block.waves_per_block * block.block_angle
    measures = _measures(state, scene, law, block, angle)
    return Solved(mesh, state, measures, time.process_time() - start)


def climbed(name: str, scene: TubeScene, meshes: Iterable[CurvedMesh]) -> list[Solved]:
    """`solve_curved` on meshes from coarse to fine, each from the state of the one before."""
    solved: list[Solved] = []
    for mesh in meshes:
        solved.append(solve_curved(name, scene, mesh, solved[-1].state if solved else None))
    return solved


def _force(lattice: Lattice, scene: TubeScene) -> FloatArray:
    """Loads on the nodes of a block in its own frame, (n_nodes, 3) [N]: pressure and weight."""
    force = face_pressure(lattice, CASES[scene.load.case].face, scene.load.pressure)
    if scene.effects.gravity is None:
        return force
    return force + body_force(lattice, np.array(scene.effects.gravity))


def _layered(scene: TubeScene, block: SineBlockParameters, turn: int) -> LayeredJoints:
    """How layers meet, with a turn in elements.

    A turn by π about a radius maps the tube onto itself where the wave is odd about the middle of
    a block, and nothing weighs; an even number of layers is then computed by its lower half.
    """
    layers = scene.assembly.layers
    # Odd layers are turned towards larger angles: the one above an odd one is turned back.
    turned = tuple(-turn if layer % 2 else turn for layer in range(1, layers))
    odd = block.shift == round(block.shift)
    weighs = scene.effects.gravity is not None
    return LayeredJoints(layers, turned, layers % 2 == 0 and odd and not weighs)


def facet_lines(scene: TubeScene) -> Lines:
    """Lines of ``[mesh]`` across the wall, around and along the axis, 0 to 1."""
    mesh = scene.mesh
    divisions = SineBlockDivisions(mesh.around, mesh.radial, mesh.axial, mesh.radial_grading)
    around, axial = (np.linspace(0.0, 1.0, n + 1) for n in (mesh.around, mesh.axial))
    return divisions.radial_positions, around, axial


def sine_lattice(
    block: SineBlockParameters,
    lines: tuple[FloatArray, FloatArray, FloatArray],
    element: LagrangeElement,
) -> Lattice:
    """Exact Sine Block with elements between lines across the wall, around and along the axis."""

    def shape(v: FloatArray, u: FloatArray, w: FloatArray) -> FloatArray:
        return sine_block_points(block, block.inner_radius + block.thickness * v, u, w)

    return Lattice(element, lines, shape)


def _measures(
    state: TubeState,
    scene: TubeScene,
    law: ContactLaw,
    block: SineBlockParameters,
    angle: float,
) -> dict[str, Measure]:
    assert scene.contact is not None
    assert scene.material is not None
    clearance, radius = scene.contact.clearance, scene.material.averaging_radius

    def at(found: PointValue, unit: str = "MPa") -> Measure:
        return Measure(found.value, unit, place=_place(found, block, angle))

    stress = everywhere(state.bodies)
    size = np.linalg.norm(state.displacements, axis=2)
    layer, node = divmod(int(size.argmax()), size.shape[1])
    where = state.lattice.positions[node]
    moved = PointValue(float(size[layer, node]), layer + 1, where, None)
    averaged = at(averaged_tension(state.bodies, radius))
    assert averaged.place is not None
    averaged.place["averaging_radius"] = radius
    means = facet_means(state, facet_lines(scene), law, clearance)
    return {
        **_paper_measures(means, scene),
        "p_max_point": at(largest_point_pressure(state, law, clearance)),
        "sigma_1_max": at(stress.extreme(0)),
        "sigma_3_min": at(stress.extreme(2)),
        "sigma_1_averaged": averaged,
        "max_displacement": at(moved, "mm"),
    }


def _paper_measures(means: FacetMeans, scene: TubeScene) -> dict[str, Measure]:
    """The paper's measures of the facets of ``[mesh]``; each layer is one block n times over."""
    layers = np.arange(scene.assembly.layers)
    m, s = means.layers.T
    per_block = block_measures(layers, m, s, means.pressures, means.areas)
    return {
        "p_eff": Measure(float(per_block.p_eff.mean()), "MPa"),
        "p_max": Measure(float(per_block.p_max.mean()), "MPa"),
    }


def _place(found: PointValue, block: SineBlockParameters, angle: float) -> dict[str, Any]:
    """Where a value is, in the first block of its layer."""
    turn = angle if found.layer % 2 else 0.0
    x, y, z = found.position
    around = float(np.arctan2(y, x)) + turn
    r, height = float(np.hypot(x, y)), float(z) + (found.layer - 1) * block.height
    return {
        "blocks": [block.blocks_per_layer * found.layer],
        "layer": found.layer,
        "face": found.face,
        "position": [r * float(np.cos(around)), r * float(np.sin(around)), height],
        "radius": r,
        "angle": float(np.degrees(around)) % 360.0,
        "height": height,
    }
