"""Robustness cases of shape: elements and scenes at the edge of what can be meshed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fem.element.hexahedron import ElementType
from fem.element.kinds import block_stiffness
from fem.element.material import Material
from fem.static.solve import static_state
from fem.system.rows import ForceRows, joined_rows
from geometry.block import box_block
from geometry.errors import RefusedError
from geometry.families.sine_block import TSB1
from geometry.mesh import HexMesh, MeshError, boundary_quads, check_mesh
from validation.case import load_case
from validation.stability.case import CaseVerdict, Number, case, case_verdict, rejected
from validation.stability.problems import (
    BRICK,
    CONCRETE,
    deformable,
    held_nodes,
    one_block,
    pressed,
    relative_difference,
    stack,
    tsb1_tube,
)


def affine_patch(mesh: HexMesh, element: ElementType, material: Material) -> Number:
    """Under an affine displacement no inner node sees a force (patch test)."""
    gradient = np.array([[1.0, 0.4, -0.2], [0.1, -0.7, 0.3], [0.5, 0.2, 0.9]]) * 1e-3
    displacement = mesh.nodes @ gradient.T
    stiffness = block_stiffness(mesh, material, element).tocsr()
    force = (stiffness @ displacement.ravel()).reshape(-1, 3)
    inner = np.setdiff1d(np.arange(mesh.n_nodes), np.unique(boundary_quads(mesh)))
    # Each nodal force sums eight elements whose terms are |K| |u|: round-off is eps times that.
    terms = (abs(stiffness) @ np.abs(displacement.ravel())).reshape(-1, 3)[inner]
    worst = float((np.abs(force[inner]) / terms).max())
    return (f"{element}: inner forces over their terms", worst, 1e-12)


def distorted(size: tuple[float, float, float]) -> HexMesh:
    """Four elements along each edge, inner nodes moved by a tenth of an element."""
    mesh = box_block(size, (4, 4, 4)).mesh
    inner = np.setdiff1d(np.arange(mesh.n_nodes), np.unique(boundary_quads(mesh)))
    nodes = mesh.nodes.copy()
    rng = np.random.default_rng(7)
    nodes[inner] += 0.025 * np.array(size) * rng.uniform(-1.0, 1.0, (len(inner), 3))
    return HexMesh(nodes, mesh.elements)


def _patches(mesh: HexMesh) -> CaseVerdict:
    return case_verdict(*(affine_patch(mesh, kind, CONCRETE) for kind in ElementType))


@case()
def aspect_1_200() -> CaseVerdict:
    """Distorted elements of aspect 1:200: patch test, every element type."""
    return _patches(distorted((200.0, 200.0, 1.0)))


@case()
def angle_2_degrees() -> CaseVerdict:
    """Elements with angles of 2°: patch test, every element type."""
    mesh = box_block((4.0, 4.0, 4.0), (4, 4, 4)).mesh
    nodes = mesh.nodes.copy()
    nodes[:, 0] += nodes[:, 2] / np.tan(np.radians(2.0))
    return _patches(HexMesh(nodes, mesh.elements))


@case()
def inverted_element() -> CaseVerdict:
    """A hexahedron turned inside out: rejected, the element named."""
    mesh = box_block((2.0, 2.0, 2.0), (2, 2, 2)).mesh
    nodes = mesh.nodes.copy()
    nodes[13] = [3.0, 3.0, 3.0]
    return rejected(lambda: check_mesh(HexMesh(nodes, mesh.elements)), MeshError, "inverted")


@case("poisson-0.4999")
def incompressible() -> CaseVerdict:
    """ν = 0.4999, confined compression: p L / (λ + 2μ), every element."""
    rubber = Material(density=1e-9, young_modulus=10.0, poisson_ratio=0.4999)
    block = box_block((10.0, 10.0, 10.0), (2, 2, 2))
    mesh, pressure = block.mesh, 0.01
    every = np.arange(mesh.n_nodes)
    sides, bottom = held_nodes(every, 0, 1), held_nodes(every[mesh.nodes[:, 2] == 0.0], 2)
    top = np.flatnonzero(mesh.nodes[:, 2] == 10.0)
    share = np.zeros((mesh.n_nodes, 3))
    # Equal facets: corners, edges, centre of the face carry 1, 2, 4 sixteenths.
    inside = ((mesh.nodes[top, :2] > 0.0) & (mesh.nodes[top, :2] < 10.0)).sum(axis=1)
    share[top, 2] = -pressure * 100.0 * 2.0**inside / 16.0
    given: Any = {
        "supports": joined_rows([sides, bottom]),
        "forces": (ForceRows(np.zeros_like(every), every, share),),
    }
    expected, checks = pressure * 10.0 / rubber.constrained_modulus, list[Number]()
    for kind in ElementType:
        result = static_state(one_block(block, rubber, element=kind, **given))
        sunk = -result.displacements[0][0, top, 2].mean()
        # Round-off times the ratio of bulk and shear modulus, 5 000.
        checks.append((f"{kind}: sinking", relative_difference(sunk, expected), 1e-9))
    return case_verdict(*checks)


def _deflection(divisions: tuple[int, int, int], element: ElementType, ratio: float) -> float:
    """Tip deflection of a clamped bar over that of Euler's beam, which knows no ν."""
    block = box_block((100.0, 10.0, 10.0), divisions)
    mesh = block.mesh
    held = held_nodes(np.flatnonzero(mesh.nodes[:, 0] == 0.0))
    tip = np.flatnonzero(mesh.nodes[:, 0] == 100.0)
    force = np.zeros((mesh.n_nodes, 3))
    force[tip, 2] = 1.0 / len(tip)
    material = Material(density=1e-9, young_modulus=1000.0, poisson_ratio=ratio)
    nodes = np.arange(mesh.n_nodes)
    forces = (ForceRows(np.zeros_like(nodes), nodes, force),)
    stated = one_block(block, material, element=element, supports=held, forces=forces)
    result = static_state(stated)
    beam = 100.0**3 / (3.0 * 1000.0 * 10.0**4 / 12.0)
    return float(result.displacements[0][0, tip, 2].mean()) / beam


@case("poisson-0.4999-bending")
def bending() -> CaseVerdict:
    """ν = 0.4999, clamped bar: B-bar bends, finer is better."""
    coarse = _deflection((20, 2, 2), ElementType.B_BAR, 0.4999)
    fine = _deflection((40, 4, 4), ElementType.B_BAR, 0.4999)
    full = _deflection((20, 2, 2), ElementType.FULL, 0.4999)
    # Two elements in the depth: shear and the clamped end take 1/n² of the order of 5 %.
    return case_verdict(
        ("2 elements over Euler's beam, off 0.98", abs(coarse - 0.98), 0.04),
        ("distance of 4 elements over that of 2", (1 - fine) / (1 - coarse), 0.75),
        ("full integration, which locks", full, 0.5),
    )


@case()
def units_metre_scene() -> CaseVerdict:
    """A scene written in metres: rejected, the factor named."""
    metres = {"height": 0.2, "amplitude": 0.02, "inner_radius": 0.12, "thickness": 0.04}
    settings = {f"block.{key}": value for key, value in metres.items()}
    words = "multiply by 1000"
    return rejected(lambda: load_case("tsb1-pipe", settings).problem, RefusedError, words)


@case()
def amplitude_too_large() -> CaseVerdict:
    """Waves that cut through the frame: rejected, the limit named."""
    return rejected(lambda: tsb1_tube(amplitude=TSB1.height), ValueError, "expected less than half")


@case()
def contacts_lost() -> CaseVerdict:
    """Blocks a hair apart: the brick that touches nothing is rejected."""
    assembly = stack(2)
    places = assembly.translations.copy()
    places[-1, 2] += 1e-3 * BRICK[2]
    apart = replace(assembly, translations=places)
    return rejected(lambda: deformable(apart, pressed(apart, 0.01)), RefusedError, "expected")


@case()
def scaled_mesh() -> CaseVerdict:
    """Coordinates of 1e-6 and 1e6 mm: the patch test does not notice."""
    mesh = distorted((10.0, 10.0, 10.0))
    scaled = (HexMesh(factor * mesh.nodes, mesh.elements) for factor in (1e-6, 1e6))
    return case_verdict(*(affine_patch(m, ElementType.INCOMPATIBLE, CONCRETE) for m in scaled))
