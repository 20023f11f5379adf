"""The few names of a notebook: one statement, three answers, arrays and meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem import Answer, Frames, Problem, concrete, solve_explicit, solve_static
from fem.assembly.statement import ProblemError
from fem.element.material import Material
from fem.problem.effects import BulkViscosity, Effects, RayleighDamping
from geometry import HexagonBlock, SineBlock, beam, contact_mesh, pillar, pipe, shaft, tube, tunnel
from geometry.assembly import AssemblyError
from geometry.families.sine_block import BlockParameterError
from mbd import analyse
from validation.run.solve import run_static
from validation.scene.read import load_scene

SHAPE = {
    "height": 200,
    "amplitude": 20,
    "frequency": 1.5,
    "blocks_per_layer": 4,
    "inner_radius": 120,
    "thickness": 40,
}


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem(tube(SineBlock(**SHAPE), layers=1, mesh=(12, 2, 2)), pipe(0.01), concrete)


@pytest.fixture(scope="module")
def static(problem) -> Answer:
    return solve_static(problem)


def test_shapes_are_those_that_are_documented(problem, static) -> None:
    n_nodes, n_contacts = 4 * 13 * 3 * 3, len(static.contact_pressures)
    assert static.displacements.shape == static.positions.shape == (n_nodes, 3)
    assert static.principal_stresses.shape == (n_nodes, 3)
    assert static.stresses.shape == (n_nodes, 6)
    assert (np.diff(static.principal_stresses, axis=1) <= 0.0).all()
    assert np.unique(static.block_of_node).tolist() == [4, 5, 6, 7]
    assert static.contact_areas.shape == (n_contacts,)
    assert static.contact_blocks.shape == (n_contacts, 2)
    assert static.residual < 1e-8


def test_nodes_are_those_of_their_blocks(static) -> None:
    whole = static.deformable
    for block in np.unique(static.block_of_node).tolist():
        mine = static.block_of_node == block
        assert np.allclose(static.positions[mine], whole.assembly.nodes(block), atol=1e-12)


def test_meshes_carry_the_arrays(problem, static) -> None:
    mesh = static.mesh()
    assert mesh.n_points == len(static.displacements)
    assert mesh.n_cells == 4 * 12 * 2 * 2
    volume = problem.blocks.volumes[problem.blocks.free_blocks].sum()
    # Hexahedra with curved faces: split into tetrahedra by VTK, into Gauss points by us.
    assert mesh.volume == pytest.approx(volume, rel=1e-2)
    assert np.array_equal(mesh.point_data["displacement [mm]"], static.displacements)
    contacts = static.contacts()
    assert np.array_equal(contacts.cell_data["contact pressure [MPa]"], static.contact_pressures)
    rigid = analyse(problem)
    joints = contact_mesh(problem.blocks, rigid.contact_index, pressure=rigid.contact_pressures)
    assert joints.n_cells == rigid.n_contacts


def test_three_answers_are_those_of_the_scene(problem, static) -> None:
    """The scene states the same problem: the same bits. Explicit comes to a residual of 1e-4, and
    pressures follow forces with a gain of some ten."""
    settings = ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=2")
    scene = load_scene("tsb1-pipe", settings).scene
    run = run_static("scene", scene)  # type: ignore[arg-type]
    assert np.array_equal(run.facet_pressures, static.contact_pressures)
    explicit = solve_explicit(problem)
    assert explicit.residual is not None
    assert explicit.residual <= 1e-4
    largest = static.contact_pressures.max()
    assert np.abs(explicit.contact_pressures - static.contact_pressures).max() < 1e-2 * largest
    rigid = analyse(problem)
    again = analyse(problem.blocks, problem.load_case)
    assert np.array_equal(rigid.contact_pressures, again.contact_pressures)


def test_all_three_carry_the_weight(problem) -> None:
    """Gravity stated once moves all answers; the rigid one by the weight of the free blocks."""
    heavy = replace(problem, gravity=(0.0, 0.0, -9.81e5))
    weight = heavy.rigid_load.body_wrenches
    mass = concrete.density * problem.blocks.volumes
    assert np.allclose(weight[:, 2], -9.81e5 * mass, rtol=1e-14)
    for solve in (solve_static, solve_explicit):
        light, loaded = solve(problem), solve(heavy)
        assert loaded.displacements[:, 2].mean() < light.displacements[:, 2].mean() - 1e-4


def test_damping_is_a_matter_of_the_run(problem) -> None:
    paper = Effects(rayleigh=RayleighDamping(2.0, 1e-8), bulk_viscosity=BulkViscosity())
    short = solve_explicit(problem, damping=paper, end_time=1e-5, ramp_time=0.0)
    free = solve_explicit(problem, damping=None, end_time=1e-5, ramp_time=0.0)
    assert not np.array_equal(short.displacements, free.displacements)


@pytest.mark.parametrize("load", [pipe, tunnel, pillar, beam, shaft])
def test_every_load_has_a_name(load) -> None:
    blocks = tube(HexagonBlock(4, 120.0, 40.0), layers=1, mesh=(4, 2))
    problem = Problem(blocks, load(0.01), concrete)
    assert problem.load_case.name == load.__name__
    (face,) = problem.load_case.faces
    assert 0.01 in (getattr(face, "pressure", None), getattr(face, "traction", None))


def test_what_an_answer_does_not_have_is_refused(problem) -> None:
    with pytest.raises(ProblemError, match=r"friction: got 0\.3; rigid blocks"):
        analyse(replace(problem, friction=0.3))
    with pytest.raises(ProblemError, match="clearance"):
        analyse(replace(problem, clearance=0.1))
    for name in ("finite_sliding", "finite_rotation"):
        with pytest.raises(ProblemError, match=f"{name}: got True"):
            analyse(replace(problem, **{name: True}))
    with pytest.raises(ProblemError, match="three finite"):
        replace(problem, gravity=(0.0, -9810.0))
    assert replace(problem, friction=0.3).deformable.contact.friction.coefficient == 0.3
    assert replace(problem, frames=Frames.DEFORMABLE).deformable.deformable_blocks.size == 12


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"load": concrete}, "load: got a Material"),
        ({"material": pipe(0.01)}, "material: got a Load"),
        ({"load": pipe(1e5)}, "more than material.young_modulus"),
        ({"material": replace(concrete, young_modulus=33.0)}, "young_modulus in GPa"),
        ({"material": replace(concrete, density=2400.0)}, "density in kg/m³"),
    ],
)
def test_absurd_statements_are_refused(problem, changes, words: str) -> None:
    with pytest.raises(ProblemError, match=words):
        replace(problem, **changes)


def test_constants_are_named() -> None:
    with pytest.raises(TypeError):
        Material(33e3, 0.2, 2.4e-9)  # type: ignore[misc]


def test_absurd_blocks_are_refused() -> None:
    with pytest.raises(BlockParameterError, match=r"block\.thickness: got -40"):
        SineBlock(**(SHAPE | {"thickness": -40}))
    with pytest.raises(TypeError):
        SineBlock(200, 20, 1.5, 0, 4, 120, 40)  # type: ignore[misc]
    metres = {key: value / 1e3 for key, value in SHAPE.items()}
    metres |= {"frequency": 1.5, "blocks_per_layer": 4}
    with pytest.raises(AssemblyError, match="millimetres"):
        tube(SineBlock(**metres), layers=1, mesh=(12, 2, 2))
    with pytest.raises(AssemblyError, match="3 numbers of elements"):
        tube(SineBlock(**SHAPE), layers=1, mesh=(12, 2))
