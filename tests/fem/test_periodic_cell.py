"""The periodic cell is what the middle of a long tube tends to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fem.answer.pressures import contact_measures
from fem.explicit.run import Status
from fem.static.solve import StaticMethod, StaticOptions, static_state
from fem.system.contact_state import corner_displacements
from geometry import Answer
from tests.support.answers import on_its_mesh
from tests.support.fem_problems import pair_resultants
from validation import Case, load_case

COARSE = ["mesh.around=12", "mesh.radial=1", "mesh.axial=2"]
CELL = [*COARSE, "fem.symmetry='periodic cell'"]


def scene_of(*settings: str, case: str = "tsb1-pipe") -> Case:
    return load_case(case, settings)


@pytest.fixture(scope="module")
def cell() -> Answer:
    return on_its_mesh(scene_of(*CELL), method="static")


def unbalanced_forces(run_of: Case, tiles: dict[int, np.ndarray]) -> dict[int, float]:
    """Norm of loads, contact and internal forces of every layer of a tube, displaced by tiles."""
    deformable = run_of.problem.system
    assembly = deformable.assembly
    place = np.zeros(assembly.n_blocks, dtype=np.int64)
    for layer in np.unique(assembly.layer):
        place[assembly.layer == layer] = np.arange((assembly.layer == layer).sum())
    group = deformable.bodies[0]
    u = np.zeros((group.n_copies, group.n_nodes, 3))
    for block in deformable.deformable_blocks:
        tile = tiles[int(assembly.layer[block]) % 2]
        u[deformable.copy_of[block]] = tile[place[block]]
    surfaces, contact = deformable.surfaces, deformable.contact
    moved = corner_displacements(deformable, (u,))
    corners = surfaces.nodal_forces(moved, contact.law.pressure(surfaces.overclosures(moved)))
    total = np.zeros_like(u)
    for half, blocks, quads in (
        (slice(0, 4), surfaces.block_m, surfaces.quads_m),
        (slice(4, 8), surfaces.block_s, surfaces.quads_s),
    ):
        mine = np.flatnonzero(deformable.body_number[blocks] == 0)
        copies = deformable.copy_of[blocks[mine]]
        np.add.at(total, (copies[:, None], quads[mine]), corners[mine, half])
    loads = deformable.computed.expand(deformable.computed.nodal_forces())[0]
    norms = {}
    for block in deformable.deformable_blocks:
        copy, turn = int(deformable.copy_of[block]), assembly.rotations[block]
        inner = (group.stiffness @ (u[copy] @ turn).ravel()).reshape(-1, 3)
        left = total[copy] + loads[copy] - inner @ turn.T
        layer = int(assembly.layer[block])
        norms[layer] = max(norms.get(layer, 0.0), float(np.linalg.norm(left)))
    return norms


def test_cells_on_top_of_each_other_are_an_equilibrium_of_a_tube(cell: Answer) -> None:
    # Displacements of the cell, repeated over six layers, balance in every layer that does not
    # touch the frame: to the residual of the cell, 1e-8 of its loads. In the outer layers, which
    # the cell knows nothing of, they do not.
    u, n = cell.details.displacements[0], 4
    norms = unbalanced_forces(scene_of(*COARSE, "assembly.layers=6"), {1: u[:n], 0: u[n:]})
    size = float(np.linalg.norm(cell.details.whole.computed.nodal_forces()))
    assert max(norms[k] for k in (2, 3, 4, 5)) < 1e-7 * size
    assert min(norms[1], norms[6]) > 0.1 * size


def pressures(scene: str, *settings: str) -> np.ndarray:
    """Pressures of the two middle layers of a tube, or of its cell: p_max and p_eff [MPa]."""
    state = on_its_mesh(load_case(scene, settings), method="static").details
    assembly = state.whole.assembly
    lower = 1 if assembly.image_of is not None else assembly.n_layers // 2
    chosen = np.isin(assembly.layer[assembly.free_blocks], (lower, lower + 1))
    of_blocks = contact_measures(state).per_block
    return np.array([of_blocks.p_max[chosen].mean(), of_blocks.p_eff[chosen].mean()])


def distances(scene: str, layers: Sequence[int], *settings: str) -> list[np.ndarray]:
    """Relative distances of the middle layers of tubes from their cell [-]."""
    limit = pressures(scene, *settings, "fem.symmetry='periodic cell'")
    return [pressures(scene, *settings, f"assembly.layers={n}") / limit - 1.0 for n in layers]


def test_middle_of_longer_tubes_tends_to_the_cell() -> None:
    # The ends act on the middle through the mean axial strain, which frames that do not move
    # share out over all layers: an error c/L. Twice as many layers have half of it, to the next
    # order in 1/L: a tenth at sixteen layers, within a quarter here; and what extrapolation
    # leaves is a fraction of it.
    few, more, many = distances("tsb1-pipe", (4, 16, 32), *COARSE)
    assert (abs(many) < abs(more)).all()
    assert (abs(more) < abs(few)).all()
    np.testing.assert_allclose(many / more, 0.5, rtol=0.25)
    assert (abs(2 * many - more) < 0.25 * abs(more)).all()


def test_cell_is_in_balance(cell: Answer) -> None:
    # Nothing pushes the cell along its axis, so both interfaces carry the same axial force, and
    # the sector gives the digits of the whole ring: to the residuals.
    deformable = cell.details.whole
    exact = StaticOptions(tolerance=1e-11)
    result = static_state(deformable, exact)
    force, _ = pair_resultants(result)
    surfaces, layer = deformable.surfaces, deformable.assembly.layer
    first = surfaces.pair_start[:-1]
    m, s = layer[surfaces.block_m[first]], layer[surfaces.block_s[first]]
    inside, closing = force[(m == 1) & (s == 2)].sum(0), force[(m == 2) & (s == 3)].sum(0)
    assert inside[2] > 1.0
    np.testing.assert_allclose(inside, closing, atol=1e-7 * inside[2])
    ring = static_state(deformable, replace(exact, symmetry=1))
    assert (result.system.orbits.order, ring.system.orbits.order) == (4, 1)
    size = np.abs(ring.displacements[0]).max()
    np.testing.assert_allclose(
        result.displacements[0], ring.displacements[0], rtol=0, atol=1e-6 * size
    )
    # No motion of the cell as a whole creeps in, though nothing resists one.
    mean = ring.displacements[0].mean(axis=(0, 1))
    assert np.abs(mean).max() < 1e-6 * size


def test_explicit_cell_ends_at_the_static_one(cell: Answer) -> None:
    # Residual 1e-6; the tube's stiffness to its softest motion is that of its contacts, so
    # displacements agree to a few times that over the ratio of the two, 1e-4.
    settings = [*CELL, "fem.method='explicit'", "fem.residual=1e-6"]
    run = on_its_mesh(scene_of(*settings), method="explicit")
    size = np.abs(cell.details.displacements[0]).max()
    np.testing.assert_allclose(
        run.details.displacements[0],
        cell.details.displacements[0],
        rtol=0,
        atol=1e-4 * size,
    )
    assert run["p_max"].value == pytest.approx(cell["p_max"].value, rel=1e-4)
    assert run["p_eff"].value == pytest.approx(cell["p_eff"].value, rel=1e-4)


@pytest.mark.parametrize(
    ("case", "mesh", "finite_rotation"),
    [
        ("tsb2-pipe", COARSE, "false"),
        ("thb0-tunnel", ["mesh.edge=4", "mesh.radial=1"], "true"),
    ],
    ids=["tsb2", "thb0"],
)
def test_nothing_turns_an_explicit_cell(case: str, mesh: list[str], finite_rotation: str) -> None:
    # What is left of second order pushes the cell round, and nothing resists: without a
    # constraint the hexagons turn for ever and the Sine Blocks end 8e-3 away. Displacements
    # agree as in the test above.
    settings = [*mesh, "fem.symmetry='periodic cell'"]
    still = on_its_mesh(scene_of(*settings, case=case), method="static")
    turns = f"effects.finite_rotation={finite_rotation}"
    moving = [*settings, "fem.method='explicit'", "fem.residual=1e-6", turns]
    run = on_its_mesh(scene_of(*moving, case=case), method="explicit")
    result = run.details.run
    assert result is not None
    assert result.status is Status.CONVERGED
    # The constraint does no work but on motions of second order.
    assert abs(result.energy_balance) < 1e-3
    for found, expected in zip(run.details.displacements, still.details.displacements, strict=True):
        size = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * size)
    assert run["p_max"].value == pytest.approx(still["p_max"].value, rel=1e-4)


def test_friction_and_clearance_close_the_cell_too() -> None:
    # The same limit, with an error that falls with the number of layers.
    more = ["effects.friction.coefficient=0.05", "contact.clearance=1e-3", "fem.load_steps=2"]
    few, many = distances("tsb1-pipe", (4, 16), *COARSE, *more)
    assert (abs(many) < 0.5 * abs(few)).all()


def test_hexagon_blocks_have_a_cell() -> None:
    # Contact leaves a torque about the axis here that frames would take: without its constraint
    # Newton's method turns the cell for ever. Both methods agree on pressures to the small
    # rotation by which their constraints differ, and the middle of a longer tube is nearer.
    mesh = ["mesh.edge=4", "mesh.radial=1"]
    scene = scene_of(*mesh, "fem.symmetry='periodic cell'", case="thb0-tunnel")
    run = on_its_mesh(scene, method="static")
    assert run.details.evidence.converged
    sparse = static_state(run.details.whole, StaticOptions(method=StaticMethod.SPARSE))
    np.testing.assert_allclose(
        sparse.contact_state.pressures,
        run.details.contact_state.pressures,
        rtol=0,
        atol=1e-4 * run["p_max"].value,
    )
    few, many = distances("thb0-tunnel", (2, 12), *mesh)
    assert abs(many[1]) < 0.8 * abs(few[1])
