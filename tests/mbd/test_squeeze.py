"""Blocks that friction holds between walls only if something presses the walls beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fem import Problem, concrete
from geometry import Assembly
from geometry.block import box_block
from geometry.files.mesh_io import write_hex_mesh
from geometry.mesh import FloatArray
from geometry.polyhedra.assembly import PolyhedralAssembly, polyhedral_assembly
from geometry.polyhedra.polyhedron import convex_polyhedron
from mbd import analyse, contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.loading import Squeeze, squeeze
from mbd.options import FrictionLaw
from validation import load_case, solve

pytestmark = pytest.mark.quick


def prism(profile: Sequence[Sequence[float]]) -> FloatArray:
    """Corners of a profile in x and z, drawn out by 100 mm along y."""
    flat = np.array(profile, dtype=np.float64)
    return np.concatenate([np.insert(flat, 1, y, axis=1) for y in (0.0, 100.0)])


def between_walls(lean: float) -> PolyhedralAssembly:
    """A block between two walls that lean by so many mm on 100: over it (+) or under it (-)."""
    middle = [[-50 - lean / 2, 0], [50 + lean / 2, 0], [50 - lean / 2, 100], [-50 + lean / 2, 100]]
    right = [[50 + lean / 2, 0], [120, 0], [120, 100], [50 - lean / 2, 100]]
    left = [[-x, z] for x, z in right]
    shapes = [convex_polyhedron("prism", prism(p)) for p in (left, right, middle)]
    places = [(shape, np.eye(3), np.zeros(3)) for shape in shapes]
    return polyhedral_assembly("walls", places, np.array([True, True, False]))


def answer(
    assembly: PolyhedralAssembly, force: Sequence[float], mu: float, law: FrictionLaw
) -> tuple[bool, Squeeze | None]:
    contacts = contact_jacobian(assembly, assembly.fixed)
    frictional = frictional_contacts(assembly, contacts, mu, law)
    load = np.array([*force, 0.0, 0.0, 0.0])
    found = frictional_equilibrium(frictional, load)
    if not found.holds:
        return False, None
    return True, squeeze(contacts, frictional, load, found.forces)


@pytest.mark.parametrize("law", [FrictionLaw.CONE, FrictionLaw.PYRAMID])
@pytest.mark.parametrize("mu", [0.3, 0.84])
def test_upright_walls_must_press_with_half_the_weight_over_mu(mu: float, law: FrictionLaw) -> None:
    """Each wall carries half the weight W by friction: 2 μ N >= W."""
    holds, found = answer(between_walls(0.0), (0.0, 0.0, -1000.0), mu, law)
    assert holds
    assert found is not None
    assert found.needed
    assert found.least == pytest.approx(1000.0 / (2.0 * mu), rel=1e-6)
    assert found.blocks in {(0, 2), (1, 2)}
    assert found.reason().startswith("at least")
    assert found.motion is not None
    assert found.motion == pytest.approx([0, 0, -1, 0, 0, 0], abs=1e-6)


def test_walls_that_lean_over_the_block_must_press_harder() -> None:
    """Walls at an angle φ push down, too: 2 N (μ cos φ - sin φ) >= W."""
    phi = np.arctan(0.2)
    holds, found = answer(between_walls(20.0), (0.0, 0.0, -1000.0), 0.84, FrictionLaw.CONE)
    assert holds
    assert found is not None
    assert found.needed
    least = 1000.0 / (2.0 * (0.84 * np.cos(phi) - np.sin(phi)))
    assert found.least == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize(("lean", "force"), [(-20.0, (0.0, 0.0, -1000.0)), (0.0, (1.0, 0.0, 0.0))])
def test_a_load_that_presses_needs_no_squeeze(lean: float, force: tuple[float, ...]) -> None:
    """A wedge is pressed by its weight, a wall by a push towards it."""
    holds, found = answer(between_walls(lean), force, 0.3, FrictionLaw.CONE)
    assert holds
    assert found is not None
    assert found.needed is False
    assert found.reason() == ""


@pytest.mark.parametrize(("slope", "holds"), [(0.25, True), (0.35, False)])
def test_a_block_on_an_incline_presses_it_by_its_weight(slope: float, holds: bool) -> None:
    base = [[0, 0], [400, 0], [400, 400 * slope]]
    along = np.array([1.0, slope]) / np.hypot(1.0, slope)
    normal = np.array([-along[1], along[0]])
    start = 100 * along
    block = [start, start + 100 * along, start + 100 * along + 50 * normal, start + 50 * normal]
    shapes = [convex_polyhedron("prism", prism(p)) for p in (base, [p.tolist() for p in block])]
    places = [(shape, np.eye(3), np.zeros(3)) for shape in shapes]
    assembly = polyhedral_assembly("incline", places, np.array([True, False]))
    held, found = answer(assembly, (0.0, 0.0, -1000.0), 0.3, FrictionLaw.CONE)
    assert held == holds
    if holds:
        assert found is not None
        assert found.needed is False


@pytest.mark.parametrize("interference", [0.0, 0.02])
def test_an_interference_fit_that_rigid_blocks_do_not_count_is_named(
    interference: float, tmp_path: Path
) -> None:
    """A cube of 1e-9 · 1e6 · 9810 N between two that are fixed: each carries half of it."""
    path = tmp_path / "row.toml"
    path.write_text(
        f"""
contact = {{clearance = {-interference}}}
[block]
type = "mesh"
[[parts]]
file = "cube.inp"
places = [{{at = [0, 0, 0]}}, {{at = [100, 0, 0]}}, {{at = [200, 0, 0]}}]
[assembly]
fixed = [0, 2]
[material]
density = 1e-9
young_modulus = 33000.0
poisson_ratio = 0.2
[effects]
gravity = [0.0, 0.0, -9810.0]
[effects.friction]
coefficient = 0.5
"""
    )
    write_hex_mesh(tmp_path / "cube.inp", box_block((100.0, 100.0, 100.0), (1, 1, 1)).mesh)
    file = load_case(str(path), ())
    answer = solve(file.with_method("rigid"))
    words = answer.details.words
    assert "carried if pressed beforehand (a hint, not proved): at least 9.81 N between 0" in words
    assert ("interference" in answer.parts) == (interference > 0.0)
    if interference:
        assert "0.02 mm: not counted by rigid blocks" in answer.parts["interference"].rows[0].words


def toppling_blocks() -> tuple[list[FloatArray], list[bool]]:
    """Corners of Goodman and Bray's 16 blocks of 10 m on stairs of 1 m, 1 m thick, and what is
    fixed: a stair below each, whose side the block before it touches [mm]."""
    heights = [4.0 * n for n in range(1, 11)]
    heights += [heights[-1] - 6.2 * k for k in range(1, 7)]
    boxes, fixed = [], []
    for n, height in enumerate(heights):
        for low, high, stays in ((-8.0, n, True), (n, n + height, False)):
            sides = (10.0 * n, 10.0 * (n + 1)), (0.0, 1.0), (low, high)
            boxes.append(
                1e3 * np.array([[x, y, z] for x in sides[0] for y in sides[1] for z in sides[2]])
            )
            fixed.append(stays)
    return boxes, fixed


@pytest.mark.parametrize(("share", "stands"), [(0.99, False), (1.01, True)])
def test_toppling_blocks_stand_from_the_published_friction_on(share: float, stands: bool) -> None:
    """Goodman and Bray, "Toppling of rock slopes" (1976): limit equilibrium at tan φ = 0.7855.
    Forces within the friction cones exist below it, too, where sliding would have to dilate."""
    boxes, fixed = toppling_blocks()
    blocks = [convex_polyhedron("block", corners) for corners in boxes]
    slope = Assembly.from_blocks(blocks, fixed=np.flatnonzero(fixed).tolist())
    down = -9810.0 * np.array([0.5, 0.0, np.sqrt(0.75)])
    problem = Problem(slope, None, concrete, friction=0.7855 * share, gravity=tuple(down))
    answer = analyse(problem)
    assert answer.as_dict()["carried"]
    assert ("if pressed beforehand (a hint, not proved)" in answer.title) is not stands
    assert answer["total_reaction"].value == pytest.approx(
        np.linalg.norm(problem.rigid_weight[:, :3][~slope.fixed].sum(axis=0)), rel=1e-6
    )
