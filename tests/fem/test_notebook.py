"""The few names of a notebook: one statement, three answers, arrays and meshes."""

from __future__ import annotations

import inspect
import json
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cached_property

import numpy as np
import pytest

import fem
import geometry
import mbd
import validation
from fem import Explicit, Material, Problem, Static, concrete, solve_explicit, solve_static
from fem.answer.answer import answer_of
from fem.problem import ProblemError
from fem.system.system import Sector, System
from geometry import (
    Answer,
    Assembly,
    HexagonBlock,
    beam,
    contact_mesh,
    pillar,
    pipe,
    shaft,
    tube,
    tunnel,
)
from geometry.errors import RefusedError
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import LoadCase, PressureLoad, face_pressure
from geometry.parts.placed import AssemblyError
from mbd import Rigid, analyse
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.coarse_tubes import coarse, pressed
from validation import load_case


@pytest.fixture(scope="module")
def problem() -> Problem:
    return pressed(1, (12, 2, 2))


@pytest.fixture(scope="module")
def static(problem) -> Answer:
    return solve_static(problem, PLAIN)


def test_shapes_are_those_that_are_documented(problem, static) -> None:
    n_points, n_contacts = 4 * 13 * 3 * 3, len(static.contacts["pressure"])
    assert list(static.fields) == ["displacement", "stress", "principal_stress", "mises"]
    shapes = {name: values.shape for name, values in static.fields.items()}
    assert shapes["displacement"] == shapes["principal_stress"] == (n_points, 3)
    assert (shapes["stress"], shapes["mises"]) == ((n_points, 6), (n_points,))
    assert static.points.shape == (n_points, 3)
    assert (np.diff(static.fields["principal_stress"], axis=1) <= 0.0).all()
    assert np.unique(static.block_of_point).tolist() == [4, 5, 6, 7]
    assert np.unique(static.layer_of_point).tolist() == [1]
    assert {len(values) for values in static.contacts.values()} == {n_contacts}
    assert static.contacts["blocks"].shape == static.contacts["side"].shape == (n_contacts, 2)
    assert static.report["residual"] < 1e-8


def _writable(value: object, name: str, seen: set[int]) -> Iterator[str]:
    """Names of the arrays in an object, and in what it computes once, that can be changed.

    All but those of the model that a solver makes of the blocks.
    """
    if id(value) in seen or isinstance(value, Sector | System):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            yield name
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _writable(part, name, seen)
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _writable(part, f"{name}.{key}", seen)
    elif is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        held = [part.name for part in fields(value)]
        held += [key for key in dir(kind) if isinstance(getattr(kind, key), cached_property)]
        for key in held:
            try:
                part = getattr(value, key)
            except RefusedError:
                continue
            yield from _writable(part, f"{kind.__name__}.{key}", seen)


@pytest.mark.parametrize("name", ["blocks", "load", "rigid", "static"])
def test_arrays_of_public_objects_are_read_only(name, problem, static) -> None:
    """Also of what comes back from another process."""
    found = {
        "blocks": lambda: problem.blocks,
        "load": lambda: problem.load_case,
        "rigid": lambda: analyse(problem),
        "static": lambda: static,
    }[name]()
    assert not list(_writable(found, name, set()))
    details = getattr(found, "details", found)
    assert not list(_writable(details, name, set()))
    if name == "rigid":
        copied = pickle.loads(pickle.dumps(replace(details)))
        assert not list(_writable(copied, name, set()))


def test_von_mises_is_that_of_the_stress(static) -> None:
    """√(3/2 s:s) of the deviator s, from the six components: rounding alone."""
    stress = static.fields["stress"]
    deviator = stress[:, :3] - stress[:, :3].mean(axis=1, keepdims=True)
    squares = (deviator**2).sum(axis=1) + 2.0 * (stress[:, 3:] ** 2).sum(axis=1)
    expected = np.sqrt(1.5 * squares)
    assert np.allclose(static.fields["mises"], expected, rtol=1e-9, atol=1e-12)


def test_a_measure_is_a_number_with_error_unit_and_place(static) -> None:
    found = static["p_max_point"]
    assert found is static.measures["p_max_point"]
    assert float(found) == found.value > static["p_max_facet"].value
    assert found.unit == "MPa"
    assert set(found.place) >= {"blocks", "layer", "face", "position", "radius"}
    assert static["u"] is static["max_displacement"]
    pressures = static.contacts["pressure"]
    assert static["p_max_facet"].value == pressures.max()
    largest = np.zeros(12)
    for side in range(2):
        np.maximum.at(largest, static.contacts["blocks"][:, side], pressures)
    # The paper's p_max: the mean over the free blocks of their largest facet pressure.
    assert static["p_max"].value == pytest.approx(largest[4:8].mean(), rel=1e-12)


def test_the_table_is_the_repr(static) -> None:
    assert repr(static).splitlines()[0] == static.title
    assert list(static.rows) == ["verdict", "measures", "evidence", "model", "time"]
    assert static.rows["verdict"][0].words.startswith("equilibrium after ")
    for word in ("largest displacement", "pressure at a point", "von Mises", "MPa", "block"):
        assert word in repr(static)
        assert word in static._repr_html_()


def test_an_answer_goes_to_another_process_and_back(static) -> None:
    again = pickle.loads(pickle.dumps(static))
    assert repr(again) == repr(static)
    assert again.as_dict() == static.as_dict()
    assert again.as_dict() == json.loads(json.dumps(static.as_dict()))
    for name in static.fields:
        assert np.array_equal(again.fields[name], static.fields[name])
    for name in static.contacts:
        assert np.array_equal(again.contacts[name], static.contacts[name])
    assert again.mesh().n_points == static.mesh().n_points
    assert not again.fields["displacement"].flags.writeable


def test_nodes_are_those_of_their_blocks(problem, static) -> None:
    for block in np.unique(static.block_of_point).tolist():
        mine = static.block_of_point == block
        assert np.allclose(static.points[mine], problem.blocks.nodes(block), atol=1e-12)


def test_meshes_carry_the_arrays(problem, static) -> None:
    mesh = static.mesh()
    assert mesh.n_points == len(static.points)
    assert mesh.n_cells == 4 * 12 * 2 * 2
    volume = problem.blocks.volumes[problem.blocks.free_blocks].sum()
    # Hexahedra with curved faces: split into tetrahedra by VTK, into Gauss points by us.
    assert mesh.volume == pytest.approx(volume, rel=1e-2)
    assert set(mesh.point_data.keys()) == {"block", "layer", *static.fields}
    assert np.array_equal(mesh.point_data["displacement"], static.fields["displacement"])
    contacts = static.contact_mesh()
    assert np.array_equal(contacts.cell_data["pressure"], static.contacts["pressure"])
    assert np.allclose(contacts.cell_centers().points, static.contacts["centroid"], atol=1e-3)
    rigid = analyse(problem).details
    joints = contact_mesh(problem.blocks, rigid.contact_index, pressure=rigid.contact_pressures)
    assert joints.n_cells == rigid.n_contacts == len(static.contacts["pressure"])


def test_three_answers_are_those_of_the_scene(problem, static) -> None:
    """The scene states the same problem: the same bits. Explicit comes to a residual of 1e-4, and
    pressures follow forces with a gain of some ten."""
    settings = coarse(2, 2)
    case = load_case("tsb1-pipe", settings)
    run = on_its_mesh(case, method="static")
    pressures = static.contacts["pressure"]
    assert np.array_equal(run.details.contact_state.pressures, pressures)
    assert {name: m.value for name, m in run.measures.items()} == {
        name: m.value for name, m in static.measures.items()
    }
    explicit = solve_explicit(problem, Explicit())
    assert explicit.method == "explicit"
    assert explicit.report["residual"] <= 1e-4
    difference = np.abs(explicit.contacts["pressure"] - pressures)
    assert difference.max() < 1e-2 * pressures.max()
    for name in ("blocks", "layer", "side", "centroid"):
        assert np.array_equal(explicit.contacts[name], static.contacts[name])
    rigid = analyse(problem)
    again = analyse(problem.blocks, load=problem.load_case)
    assert np.array_equal(rigid.contacts["pressure"], again.contacts["pressure"])
    for name in ("blocks", "layer", "side", "centroid", "normal"):
        assert np.array_equal(rigid.contacts[name], static.contacts[name])


def test_the_rigid_answer_has_the_same_type(problem) -> None:
    rigid = analyse(problem)
    assert (rigid.method, rigid.report["mechanism"]) == ("rigid", "locked")
    assert rigid["p_max"].value == rigid.details.measures.p_max
    assert rigid["p_max_facet"].value == rigid.contacts["pressure"].max()
    assert rigid.contact_mesh().n_cells == len(rigid.contacts["pressure"])
    blocks = problem.blocks
    n_elements = sum(blocks.shape(b).mesh.n_elements for b in range(blocks.n_blocks))
    assert rigid.mesh().n_cells == n_elements
    again = pickle.loads(pickle.dumps(rigid))
    assert again.as_dict() == rigid.as_dict()
    assert again.details is None
    assert again.title.endswith("rigid blocks, locked")


def test_options_of_the_rigid_analysis_are_words(problem) -> None:
    assert analyse(problem, Rigid(norm="pressure"))["p_eff"] == analyse(problem)["p_eff"]
    assert analyse(problem, Rigid(norm="force"))["p_eff"] != analyse(problem)["p_eff"]


def test_rigid_blocks_that_move_show_how(problem) -> None:
    """Two boxes pulled apart: nothing balances the load, and the upper one goes up by one."""
    boxes = box_column([ColumnBox((40.0, 40.0, 60.0), (2, 2, 2))] * 2)
    load = face_pressure(boxes, np.array([1]), "z+", -1e-3)
    answer = analyse(boxes, load=replace(load, fixed=np.array([True, False])))
    assert answer.title.endswith("not carried without friction; block 1 moves most: +z 1")
    assert not answer.measures
    assert not answer.contacts
    motion = answer.fields["mechanism"]
    assert np.allclose(motion[answer.block_of_point == 1], [0.0, 0.0, 1.0], atol=1e-9)
    assert not motion[answer.block_of_point == 0].any()


def test_measures_over_the_facets_of_another_mesh(problem, static) -> None:
    """What a refined solution says of the facets of the scene's mesh: given the solution's own
    pressures on its own mesh nothing changes but the areas, a facet's quadrature against its
    corners (1e-3 of a facet of this curvature)."""
    found = problem.blocks.interfaces
    given = np.zeros(found.n_contacts)
    given[static.details.contact_state.interface] = static.contacts["pressure"]
    answer = answer_of(static.details, {"p_eff": 0.5}, facets=(problem.blocks, given))
    for name in ("p_eff", "p_max", "p_max_facet"):
        assert answer[name].value == pytest.approx(static[name].value, rel=1e-3)
    assert answer["p_eff"].error == 0.5
    assert answer["p_max"].error is None
    assert np.array_equal(answer.contacts["pressure"], static.contacts["pressure"])
    assert np.array_equal(answer.contacts["side"], static.contacts["side"])


@pytest.mark.parametrize("load", [pipe, tunnel, pillar, beam, shaft])
def test_every_load_has_a_name(load) -> None:
    blocks = tube(HexagonBlock(4, 120.0, 40.0), layers=1, mesh=(4, 2))
    problem = Problem(blocks, load(0.01), concrete)
    assert problem.load_case.name == load.__name__
    (face,) = problem.load_case.faces
    assert 0.01 in (getattr(face, "pressure", None), getattr(face, "traction", None))


def test_constants_are_named() -> None:
    with pytest.raises(TypeError):
        Material(33e3, 0.2, 2.4e-9)  # type: ignore[misc]


def test_numbers_of_numpy_are_numbers(problem) -> None:
    """Friction of single precision is that coefficient to its digits."""
    single, double = (replace(problem, friction=mu).coulomb for mu in (np.float32(0.25), 0.25))
    assert single == double
    assert Static(load_steps=np.int64(2)) == Static(load_steps=2)


@pytest.mark.parametrize("package", [fem, geometry, mbd, validation])
def test_packages_list_their_public_names(package) -> None:
    """<TAB>, dir and help show every public name, and each is said in a line."""
    assert set(dir(package)) == set(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert f"`{name}`" in package.__doc__, name


def test_a_problem_is_shown_without_arrays(problem) -> None:
    shown = repr(replace(problem, friction=0.3, degree=2))
    assert shown == (
        "Problem(<sine-tube: 12 blocks, 4 of them free with 192 elements>, load 'pipe', degree=2, "
        "friction=0.3)"
    )


def test_help_explains_every_keyword_of_a_problem() -> None:
    text = inspect.getdoc(Problem)
    parameters = text.split("Parameters")[1].split("Raises")[0]
    for found in fields(Problem):
        assert f"\n{found.name}\n" in parameters, found.name
        if any(found.default is value for value in (0.0, 1, True, False, None)):
            words = parameters.split(f"\n{found.name}\n")[1]
            assert f"Default {found.default}".removesuffix(".0") in words.split("\n\n")[0]


def _boxes(*, sunk: float = 0.0, fine: int = 1) -> Assembly:
    """Three boxes on each other, the last one lowered."""
    column = box_column([ColumnBox((100.0, 80.0, 60.0), (fine, fine, fine))] * 3)
    places = column.translations.copy()
    places[2, 2] -= sunk
    return replace(column, translations=places)


def test_problems_reject_blocks_that_overlap_and_name_both_and_the_depth() -> None:
    with pytest.raises(AssemblyError, match=r"blocks 1 and 2 overlap by 7 mm; .* move them apart"):
        Problem(_boxes(sunk=7.0), _pressed(_boxes()), concrete)
    # Two blocks at one place have no corner in each other; one must move by its width.
    with pytest.raises(AssemblyError, match="blocks 1 and 2 overlap by 60 mm"):
        Problem(_boxes(sunk=60.0), _pressed(_boxes()), concrete)


@pytest.mark.parametrize("fine", [1, 2])
def test_problems_reject_what_no_solver_can_solve_when_they_are_made(fine: int) -> None:
    boxes = _boxes(fine=fine)
    load = _pressed(boxes)
    assert Problem(boxes, load, concrete).blocks is boxes
    everything = replace(load, fixed=np.ones(3, dtype=bool))
    with pytest.raises(RefusedError, match="every block is fixed"):
        Problem(boxes, everything, concrete)
    with pytest.raises(RefusedError, match="2 blocks are unrestrained"):
        Problem(_boxes(sunk=-5.0, fine=fine), replace(load, fixed=np.arange(3) == 2), concrete)
    with pytest.raises(RefusedError, match=r"deepest 0.1 mm between blocks 0 and 1"):
        Problem(boxes, load, concrete, clearance=-0.1)
    brick = boxes.shapes[0]
    turned = replace(brick.mesh, elements=np.roll(brick.mesh.elements, 4, axis=1))
    inside_out = replace(brick, mesh=turned, charts=None)
    with pytest.raises(RefusedError, match="inverted"):
        Problem(replace(boxes, shapes=(inside_out,)), load, concrete)
    with pytest.raises(ProblemError, match="got one of 3 blocks for 2 blocks"):
        Problem(box_column([ColumnBox((100.0, 80.0, 60.0), (1, 1, 1))] * 2), load, concrete)


def _pressed(boxes: Assembly) -> LoadCase:
    """The last box pressed downwards, the first one fixed."""
    load = PressureLoad(blocks=np.array([2]), face="z+", pressure=0.1)
    return LoadCase(assembly=boxes, name="pressed", faces=(load,), fixed=np.arange(3) == 0)
