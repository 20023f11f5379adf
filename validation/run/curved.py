"""Static runs of Sine Block tubes with curved elements of degree two or three.

Each measure has the change from one degree less as the estimate of its error.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from typing import Any, NoReturn

import numpy as np

from fem.assembly.measures import CapAction, cap_action_at
from fem.contact.law import ContactLaw
from fem.element.lagrange import LagrangeElement, lobatto_points
from fem.static.lagrange_block import Lattice, face_pressure, seen_block
from fem.static.lagrange_tube import (
    LayeredJoints,
    PointValue,
    TubeState,
    largest_point_pressure,
    sampled_stress,
    solve_layered_tube,
)
from fem.static.solve import StaticError
from geometry.families.sine_block import (
    BlockParameterError,
    SineBlockDivisions,
    SineBlockParameters,
    sine_block_points,
    waves_of_turn,
)
from geometry.loads import CASES
from geometry.mesh import FloatArray, MeshError
from validation.build.blocks import block_parameters
from validation.build.deformable import build_material, contact_law
from validation.errors import InputError
from validation.run.measures import Measure
from validation.scene.deformable import Method
from validation.scene.read import DeformableScene, TubeScene

#: Contact points of one sector at most: the contact problem is dense.
_MOST_POINTS = 7000


@dataclass(frozen=True)
class CurvedRun:
    """A tube of curved blocks and its answers."""

    name: str
    scene: TubeScene
    degree: int
    measures: dict[str, Measure]
    """With the change from one degree less as error."""
    n_elements: int
    """Of one block."""
    n_unknowns: int
    """Displacement components of one block."""
    iterations: int
    residual: float
    """Contact forces that the law does not have, over all [-]."""
    cap: CapAction | None
    """Where the maximum stiffness of the contact law acted in a sector; None for a law without."""
    cpu_seconds: float
    """Of both degrees [s]."""

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "scene": self.name,
            "method": "static",
            "degree": self.degree,
            "n_elements": self.n_elements,
            "n_unknowns": self.n_unknowns,
            "measures": {name: measure.as_json() for name, measure in self.measures.items()},
            "contact_cap": None if self.cap is None else asdict(self.cap),
            "newton_iterations": self.iterations,
            "residual": self.residual,
            "cpu_seconds": {"total": self.cpu_seconds},
        }


def run_curved(name: str, scene: DeformableScene) -> CurvedRun:
    """Solve a tube for its static state with curved elements.

    Raises
    ------
    InputError
        What curved elements cannot do yet, by name, or a state that was not found.
    """
    tube = _checked(name, scene)
    assert tube.fem is not None
    assert tube.contact is not None
    start = time.process_time()
    try:
        state, found = _solved(tube, tube.fem.degree)
        _, less = _solved(tube, tube.fem.degree - 1)
    except (StaticError, MeshError, BlockParameterError) as error:
        raise InputError(f"{name}: {error}") from None
    lattice = state.block.lattice
    return CurvedRun(
        name=name,
        scene=tube,
        degree=tube.fem.degree,
        measures={
            key: replace(measure, error=abs(measure.value - less[key].value))
            for key, measure in found.items()
        },
        n_elements=len(lattice.elements),
        n_unknowns=3 * len(lattice.positions),
        iterations=state.iterations,
        residual=state.residual,
        cap=cap_action_at(contact_law(tube.contact), state.pressures, state.weights),
        cpu_seconds=time.process_time() - start,
    )


def _checked(name: str, scene: DeformableScene) -> TubeScene:
    """Refuse by name what curved elements do not do."""

    def refuse(what: str, expected: str) -> NoReturn:
        raise InputError(
            f"{name}: fem.degree = {degree} with {what}: curved elements do not do that; expected "
            f"{expected}, or fem.degree = 1"
        )

    assert scene.fem is not None
    degree = scene.fem.degree
    if not isinstance(scene, TubeScene):
        refuse("blocks of this family", "a tube of Sine Blocks")
    if scene.material is None or scene.contact is None:
        raise InputError(f"{name}: [material] and [contact] are needed by deformable blocks")
    if scene.fem.method is not Method.STATIC:
        refuse(f'fem.method = "{scene.fem.method}"', 'fem.method = "static"')
    if scene.fem.symmetry not in ("auto", "sector"):
        refuse(f'fem.symmetry = "{scene.fem.symmetry}"', '"auto" or "sector"')
    if scene.fem.frames:
        refuse("fem.frames", "none")
    if not CASES[scene.load.case].every_layer:
        refuse(f"load case {scene.load.case}", "pipe or tunnel")
    if scene.contact.spacing:
        refuse("contact.spacing", "contact.clearance")
    named = [key for key in type(scene.effects).model_fields if getattr(scene.effects, key)]
    if named:
        refuse(f"effects.{named[0]}", "no effects")
    waves = round(2 * scene.block.frequency)
    if scene.mesh.around % waves:
        raise InputError(
            f"{name}: mesh.around: got {scene.mesh.around}; expected a multiple of {waves}, the "
            "waves of a block, so that layers meet"
        )
    points = (degree + 2) ** 2 * _facets(scene)
    if points > _MOST_POINTS:
        raise InputError(
            f"{name}: fem.degree = {degree}: got a mesh with {points} contact points in a sector; "
            f"expected at most {_MOST_POINTS}: curved elements need few, try mesh.around = "
            f"{4 * waves}, mesh.radial = 2, mesh.axial = 4"
        )
    return scene


def _facets(scene: TubeScene) -> int:
    """Facets of all joints of one sector."""
    mesh, layers = scene.mesh, scene.assembly.layers
    return mesh.radial * ((layers + 1) * mesh.around + layers * mesh.axial)


def _solved(scene: TubeScene, degree: int) -> tuple[TubeState, dict[str, Measure]]:
    assert scene.material is not None
    assert scene.contact is not None
    block = block_parameters(scene)
    lattice = _lattice(scene, block, degree)
    seen = seen_block(lattice, ("bottom", "top", "left", "right"))
    turn = waves_of_turn(block, scene.assembly.turn) * scene.mesh.around // block.waves_per_block
    layers = scene.assembly.layers
    # Odd layers are turned towards larger angles: the one above an odd one is turned back.
    turned = tuple(-turn if layer % 2 else turn for layer in range(1, layers))
    law, clearance = contact_law(scene.contact), scene.contact.clearance
    force = face_pressure(lattice, CASES[scene.load.case].face, scene.load.pressure)
    state = solve_layered_tube(seen, LayeredJoints(layers, turned), force, law, clearance=clearance)
    angle = turn / scene.mesh.around * block.block_angle
    return state, _measures(state, scene, law, block, angle)


def _lattice(scene: TubeScene, block: SineBlockParameters, degree: int) -> Lattice:
    """Nodes of the exact curved block, equal elements but for the grading across the wall."""
    assert scene.material is not None
    mesh = scene.mesh
    divisions = SineBlockDivisions(mesh.around, mesh.radial, mesh.axial, mesh.radial_grading)
    across = block.inner_radius + block.thickness * divisions.radial_positions
    lines = (
        across,
        np.linspace(0.0, 1.0, mesh.around + 1),
        np.linspace(0.0, 1.0, mesh.axial + 1),
    )
    r, u, w = np.meshgrid(*(_with_nodes(line, degree) for line in lines), indexing="ij")
    element = LagrangeElement(degree, build_material(scene.material))
    return Lattice(element, sine_block_points(block, r, u, w))


def _with_nodes(ends: FloatArray, degree: int) -> FloatArray:
    """Gauss-Lobatto points between the ends of elements, each end once."""
    inside = 0.5 * (lobatto_points(degree)[1:] + 1.0)
    between = ends[:-1, None] + np.diff(ends)[:, None] * inside
    nodes: FloatArray = np.concatenate([ends[:1], between.ravel()])
    return nodes


def _measures(
    state: TubeState,
    scene: TubeScene,
    law: ContactLaw,
    block: SineBlockParameters,
    angle: float,
) -> dict[str, Measure]:
    assert scene.contact is not None

    def at(found: PointValue, unit: str = "MPa") -> Measure:
        return Measure(found.value, unit, place=_place(found, block, angle))

    stress = sampled_stress(state)
    size = np.linalg.norm(state.displacements, axis=2)
    layer, node = divmod(int(size.argmax()), size.shape[1])
    where = state.block.lattice.positions[node]
    moved = PointValue(float(size[layer, node]), layer + 1, where, None)
    pressure = largest_point_pressure(state, law, scene.contact.clearance)
    return {
        "p_max_point": at(pressure),
        "sigma_1_max": at(stress.extreme(0)),
        "sigma_3_min": at(stress.extreme(2)),
        "max_displacement": at(moved, "mm"),
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
