"""Robustness cases of shape: elements and scenes at the edge of what can be meshed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.element.hexahedron import ElementType
from fem.element.kinds import block_stiffness
from fem.element.material import Material
from fem.state import State
from fem.static.solve import solve_static
from fem.system.model import Support, fixed_nodes, nodal_load
from geometry.assembly import AssemblyError
from geometry.block import Block, box_block
from geometry.errors import RefusedError
from geometry.families.sine_block import TSB1
from geometry.mesh import FloatArray, HexMesh, MeshError, boundary_quads, check_mesh
from validation.stability.case import Cases, Check, Finding, refusal
from validation.stability.problems import (
    BRICK,
    CONCRETE,
    deformable,
    one_block,
    relative,
    stack,
    tube,
)

CASES = Cases("geometry")


def affine_patch(mesh: HexMesh, element: ElementType, material: Material) -> Check:
    """Under an affine displacement no inner node sees a force (patch test)."""
    gradient = np.array([[1.0, 0.4, -0.2], [0.1, -0.7, 0.3], [0.5, 0.2, 0.9]]) * 1e-3
    displacement = mesh.nodes @ gradient.T
    stiffness = block_stiffness(mesh, material, element).tocsr()
    force = (stiffness @ displacement.ravel()).reshape(-1, 3)
    inner = np.setdiff1d(np.arange(mesh.n_nodes), np.unique(boundary_quads(mesh)))
    # Each nodal force sums eight elements whose terms are |K| |u|: round-off is eps times that.
    terms = (abs(stiffness) @ np.abs(displacement.ravel())).reshape(-1, 3)[inner]
    worst = float((np.abs(force[inner]) / terms).max())
    return Check(f"{element}: inner forces over their terms", worst, 1e-12)


def distorted(size: tuple[float, float, float]) -> HexMesh:
    """Four elements along each edge, inner nodes moved by a tenth of an element."""
    mesh = box_block(size, (4, 4, 4)).mesh
    inner = np.setdiff1d(np.arange(mesh.n_nodes), np.unique(boundary_quads(mesh)))
    nodes = mesh.nodes.copy()
    rng = np.random.default_rng(7)
    nodes[inner] += 0.025 * np.array(size) * rng.uniform(-1.0, 1.0, (len(inner), 3))
    return HexMesh(nodes, mesh.elements)


def _patches(mesh: HexMesh) -> Finding:
    return Finding(*(affine_patch(mesh, kind, CONCRETE) for kind in ElementType))


@CASES.add("aspect-1-200", "Distorted elements of aspect 1:200: patch test, every element type")
def _aspect() -> Finding:
    return _patches(distorted((200.0, 200.0, 1.0)))


@CASES.add("angle-2-degrees", "Elements with angles of 2°: patch test, every element type")
def _sharp() -> Finding:
    mesh = box_block((4.0, 4.0, 4.0), (4, 4, 4)).mesh
    nodes = mesh.nodes.copy()
    nodes[:, 0] += nodes[:, 2] / np.tan(np.radians(2.0))
    return _patches(HexMesh(nodes, mesh.elements))


@CASES.add("inverted-element", "A hexahedron turned inside out: rejected, the element named")
def _inverted() -> Finding:
    mesh = box_block((2.0, 2.0, 2.0), (2, 2, 2)).mesh
    nodes = mesh.nodes.copy()
    nodes[13] = [3.0, 3.0, 3.0]
    return refusal(lambda: check_mesh(HexMesh(nodes, mesh.elements)), MeshError, "inverted")


@CASES.add("poisson-0.4999", "ν = 0.4999, confined compression: p L / (λ + 2μ), every element")
def _incompressible() -> Finding:
    rubber = Material(density=1e-9, young_modulus=10.0, poisson_ratio=0.4999)
    block = box_block((10.0, 10.0, 10.0), (2, 2, 2))
    mesh = block.mesh
    pressure, checks = 0.01, []
    for kind in ElementType:
        sides = [fixed_nodes(0, np.arange(mesh.n_nodes), components=(0, 1))]
        bottom = fixed_nodes(0, np.flatnonzero(mesh.nodes[:, 2] == 0.0), components=(2,))
        top = np.flatnonzero(mesh.nodes[:, 2] == 10.0)
        share = np.zeros((mesh.n_nodes, 3))
        # Equal facets: corners, edges, centre of the face carry 1, 2, 4 sixteenths.
        inside = ((mesh.nodes[top, :2] > 0.0) & (mesh.nodes[top, :2] < 10.0)).sum(axis=1)
        share[top, 2] = -pressure * 100.0 * 2.0**inside / 16.0
        result = _solved(block, rubber, kind, (*sides, bottom), share)
        sunk = -result.displacements[0][0, top, 2].mean()
        expected = pressure * 10.0 / rubber.constrained_modulus
        # Round-off times the ratio of bulk and shear modulus, 5 000.
        checks.append(Check(f"{kind}: sinking", relative(sunk, expected), 1e-9))
    return Finding(*checks)


def _solved(
    block: Block,
    material: Material,
    element: ElementType,
    supports: tuple[Support, ...],
    force: FloatArray,
) -> State:
    """Static state of one block with supports and forces on its nodes."""
    forces = (nodal_load(0, force),)
    return solve_static(
        one_block(block, material, element=element, supports=supports, forces=forces)
    )


def _deflection(divisions: tuple[int, int, int], element: ElementType, ratio: float) -> float:
    """Tip deflection of a clamped bar over that of Euler's beam, which knows no ν."""
    block = box_block((100.0, 10.0, 10.0), divisions)
    mesh = block.mesh
    held = fixed_nodes(0, np.flatnonzero(mesh.nodes[:, 0] == 0.0))
    tip = np.flatnonzero(mesh.nodes[:, 0] == 100.0)
    force = np.zeros((mesh.n_nodes, 3))
    force[tip, 2] = 1.0 / len(tip)
    material = Material(density=1e-9, young_modulus=1000.0, poisson_ratio=ratio)
    result = _solved(block, material, element, (held,), force)
    beam = 100.0**3 / (3.0 * 1000.0 * 10.0**4 / 12.0)
    return float(result.displacements[0][0, tip, 2].mean()) / beam


@CASES.add("poisson-0.4999-bending", "ν = 0.4999, clamped bar: B-bar bends, finer is better")
def _bending() -> Finding:
    coarse = _deflection((20, 2, 2), ElementType.B_BAR, 0.4999)
    fine = _deflection((40, 4, 4), ElementType.B_BAR, 0.4999)
    full = _deflection((20, 2, 2), ElementType.FULL, 0.4999)
    # Two elements in the depth: shear and the clamped end take 1/n² of the order of 5 %.
    return Finding(
        Check("2 elements over Euler's beam", coarse, 1.02, 0.94),
        Check("distance of 4 elements over that of 2", (1 - fine) / (1 - coarse), 0.75),
        Check("full integration, which locks", full, 0.5),
    )


@CASES.add("units-metre-scene", "A scene written in metres: rejected, the factor named")
def _metre_scene() -> Finding:
    from validation.build.problem import build_assembly
    from validation.case import load_case

    def build() -> None:
        values = ("height=0.2", "amplitude=0.02", "inner_radius=0.12", "thickness=0.04")
        file = load_case("tsb1-pipe", [f"block.{value}" for value in values])
        build_assembly(file.scene)  # type: ignore[arg-type]

    return refusal(build, RefusedError, "multiply by 1000")


@CASES.add("amplitude-too-large", "Waves that cut through the frame: rejected, the limit named")
def _too_large() -> Finding:
    return refusal(lambda: tube(amplitude=TSB1.height), ValueError, "expected less than half")


@CASES.add("contacts-lost", "Blocks a hair apart: the brick that touches nothing is rejected")
def _apart() -> Finding:
    from validation.stability.problems import pressed

    assembly = stack(2)
    places = assembly.translations.copy()
    places[-1, 2] += 1e-3 * BRICK[2]
    apart = replace(assembly, translations=places)
    return refusal(
        lambda: deformable(apart, pressed(apart, 0.01)), (AssemblyError, ValueError), "expected"
    )


@CASES.add("scaled-mesh", "Coordinates of 1e-6 and 1e6 mm: the patch test does not notice")
def _scales() -> Finding:
    checks = []
    for factor in (1e-6, 1e6):
        mesh = distorted((10.0, 10.0, 10.0))
        mesh = HexMesh(factor * mesh.nodes, mesh.elements)
        checks.append(affine_patch(mesh, ElementType.INCOMPATIBLE, CONCRETE))
    return Finding(*checks)
