"""Supports and loads on parts of surfaces: closed forms, patch tests, and what is rejected."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem import LinearPenalty, Material, Problem, solve_static
from fem.answer.forces import push_curves_of
from fem.system.body import ModelError
from geometry import (
    Assembly,
    Block,
    Box,
    HeldFace,
    LineLoad,
    LoadCase,
    Plane,
    PressureLoad,
    RefusedError,
    TractionLoad,
    box_block,
)
from tests.support.answers import PLAIN
from tests.support.drawn_blocks import cuboid, write_obj
from validation import load_case

SIZE = np.array([100.0, 50.0, 40.0])
E, NU = 1000.0, 0.3
STUFF = Material(density=1e-9, young_modulus=E, poisson_ratio=NU)
X, Y, Z = np.eye(3)
ALL = np.array([0])


def placed(*blocks: Block, turn: np.ndarray | None = None) -> Assembly:
    """Blocks one on the other, all turned about the origin."""
    turn, n = np.eye(3) if turn is None else turn, len(blocks)
    up = SIZE[2] * np.outer(np.arange(n), Z) @ turn.T
    return Assembly(
        name="blocks",
        shapes=blocks,
        shape_of=np.arange(n),
        rotations=np.tile(turn, (n, 1, 1)),
        translations=up,
        layer=np.arange(n),
        fixed=np.zeros(n, dtype=np.bool_),
        unmatched_allowed=True,
    )


def solved(blocks: Assembly, held, *, faces=(), lines=(), degree=1, law=None):
    load = LoadCase(
        blocks, "test", tuple(faces), blocks.fixed, held=tuple(held), lines=tuple(lines)
    )
    stated = {} if law is None else {"law": law}
    problem = Problem(blocks, load, STUFF, degree=degree, check_units=False, **stated)
    return solve_static(problem, PLAIN)


def oblique() -> np.ndarray:
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(0.7) * cross + (1.0 - np.cos(0.7)) * cross @ cross


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("turn", [np.eye(3), oblique()], ids=["upright", "oblique"])
def test_rollers_on_three_faces_leave_a_bar_free_to_contract(turn: np.ndarray, degree: int) -> None:
    """Uniaxial tension, exact in the elements: u = σ/E (x, -ν y, -ν z), whatever the axes.

    Faces are chosen by name, by a plane and by a box; the support at the end takes the force.
    """
    blocks = placed(box_block(tuple(SIZE), (3, 2, 2)), turn=turn)
    x, y, z = turn.T
    floor = Box(np.array([0.0, 0.0, 0.0]), np.array([100.0, 50.0, 0.0]))
    below = floor if turn is np.eye(3) or np.allclose(turn, np.eye(3)) else "z-"
    held = [
        HeldFace(0, "x-", x[None], name="end"),
        HeldFace(0, Plane(np.zeros(3), y), y[None]),
        HeldFace(0, below, z[None]),
    ]
    answer = solved(blocks, held, faces=[TractionLoad(ALL, "x+", 2.0 * x)], degree=degree)
    local = answer.points @ turn
    expected = (local * np.array([2.0, -2.0 * NU, -2.0 * NU]) / E) @ turn.T
    np.testing.assert_allclose(answer.fields["displacement"], expected, atol=1e-12)
    force = answer.report["reactions"]["end"]["force"]
    np.testing.assert_allclose(force, -2.0 * 50.0 * 40.0 * x, atol=1e-7)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_block_sinks_evenly_into_a_bed_of_springs(degree: int) -> None:
    """Under a pressure p on a bed of k per area by p / k, and the springs carry all of it."""
    blocks = placed(box_block(tuple(SIZE), (3, 2, 2)))
    held = [
        HeldFace(0, "z-", Z[None], spring=5.0, name="bed"),
        HeldFace(0, "x-", X[None]),
        HeldFace(0, "y-", Y[None]),
    ]
    answer = solved(blocks, held, faces=[PressureLoad(ALL, "z+", 1.0)], degree=degree)
    below = answer.points[:, 2] == 0.0
    sunk = answer.fields["displacement"][below, 2]
    np.testing.assert_allclose(sunk, -1.0 / 5.0, rtol=1e-11)
    springs = answer.report["reactions"]["bed"]["force"]
    np.testing.assert_allclose(springs, [0.0, 0.0, 5000.0], atol=1e-7)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_line_load_is_carried_by_the_support_with_its_moment(degree: int) -> None:
    """Of 3 N/mm down along a top edge of 100 mm: 300 N, and the moment about the origin."""
    blocks = placed(box_block(tuple(SIZE), (3, 2, 2)))
    line = LineLoad(ALL, np.array([0.0, 50.0, 40.0]), np.array([100.0, 50.0, 40.0]), -3.0 * Z)
    answer = solved(blocks, [HeldFace(0, "z-", name="base")], lines=[line], degree=degree)
    found = answer.report["reactions"]["base"]
    np.testing.assert_allclose(found["force"], [0.0, 0.0, 300.0], atol=1e-7)
    np.testing.assert_allclose(found["moment"], [300.0 * 50.0, -300.0 * 50.0, 0.0], atol=1e-5)


def test_a_press_meets_blocks_joint_and_bed_in_series() -> None:
    """Two blocks, a joint of stiffness k_c per area and a bed k, free to contract: the force on
    the moving support is that of springs in series, linear in its way, and so is its work."""
    low = box_block(tuple(SIZE), (3, 2, 2), contact_faces=("z+",))
    high = box_block(tuple(SIZE), (3, 2, 2), contact_faces=("z-",))
    blocks, way = placed(low, high), 0.5
    sides = [HeldFace(b, face, axis[None]) for b in (0, 1) for face, axis in (("x-", X), ("y-", Y))]
    held = [
        *sides,
        HeldFace(0, "z-", Z[None], spring=5.0),
        HeldFace(1, "z+", Z[None], displacement=-way * Z, name="press"),
    ]
    answer = solved(blocks, held, law=LinearPenalty(100.0))
    stiffness = 5000.0 / (1.0 / 5.0 + 80.0 / E + 1.0 / 100.0)
    measures = answer.measures
    assert measures["push_peak"].value == pytest.approx(stiffness * way, rel=1e-9)
    assert measures["push_stiffness"].value == pytest.approx(stiffness, rel=1e-9)
    assert measures["push_work"].value == pytest.approx(0.5 * stiffness * way**2, rel=1e-9)
    (curve,) = push_curves_of(answer.details)
    np.testing.assert_allclose(curve.displacements, np.linspace(0.0, way, 21), atol=1e-12)
    np.testing.assert_allclose(curve.forces, stiffness * curve.displacements, rtol=1e-9)


def test_a_table_of_motion_is_followed_back_and_forth() -> None:
    """Elastic blocks give back what they took: the force is that of the way, not of the history."""
    low = box_block(tuple(SIZE), (1, 1, 1), contact_faces=("z+",))
    high = box_block(tuple(SIZE), (1, 1, 1), contact_faces=("z-",))
    held = [HeldFace(b, face, axis[None]) for b in (0, 1) for face, axis in (("x-", X), ("y-", Y))]
    held += [HeldFace(0, "z-", Z[None])]
    table = ((0.0, 0.0), (1.0, 1.0), (3.0, 0.25))
    held += [HeldFace(1, "z+", Z[None], displacement=-0.5 * Z, path=table)]
    answer = solved(placed(low, high), held, law=LinearPenalty(100.0))
    (curve,) = push_curves_of(answer.details)
    way, stiffness = curve.displacements, 5000.0 / (80.0 / E + 1.0 / 100.0)
    assert way.max() == pytest.approx(0.5)
    assert way[-1] == pytest.approx(0.125)
    np.testing.assert_allclose(curve.forces, stiffness * way, atol=1e-6)


def test_supports_that_contradict_each_other_are_rejected_by_name() -> None:
    blocks = placed(box_block(tuple(SIZE), (1, 1, 1)))
    held = [
        HeldFace(0, "z-", name="base"),
        HeldFace(0, "x+", Z[None], displacement=-Z, name="press"),
    ]
    with pytest.raises(ModelError, match="base: another support moves a node of block 0"):
        solved(blocks, held)


BOX = {
    "block": {"type": "box", "size": [100.0, 50.0, 40.0]},
    "mesh": {"divisions": [2, 1, 1]},
    "fem": {"mesh": "scene", "error_estimate": False},
}


def test_a_name_of_several_blocks_is_all_of_them_or_none(tmp_path: Path) -> None:
    """Supports and loads on faces act on every block of a name; a force needs one."""
    for name in ("a", "b"):
        write_obj(tmp_path / f"{name}.obj", {name: cuboid((0, 0, 0), (100, 50, 40))})
    (tmp_path / "own.toml").write_text(
        '[block]\ntype = "mesh"\n[[parts]]\nfile = "a.obj"\n'
        "places = [{at = [0, 0, 0]}, {at = [0, 0, 80]}]\n"
        '[[parts]]\nfile = "b.obj"\nfixed = true\nplaces = [{at = [0, 0, 40]}]\n'
        "[effects]\ngravity = [0, 0, -9810]\n"
    )
    data = load_case(tmp_path / "own.toml").keys
    held = {"supports": [{"plane": {"x": 0.0}, "blocks": ["a"]}]}
    found = load_case(data | held, method="rigid").problem.load_case.held
    assert [support.block for support in found] == [0, 1]
    loaded = {"loads": [{"force": [0, 0, 1], "blocks": ["a"]}]}
    with pytest.raises(RefusedError, match="the name of 2 blocks"):
        _ = load_case(data | loaded, method="rigid").problem


def test_a_scene_states_the_same_as_python() -> None:
    """Rollers and a total force: mean stress F / A, carried by the roller at the end."""
    case = load_case(
        BOX
        | {
            "supports": [
                {"face": "x-", "hold": "normal", "name": "end"},
                {"plane": {"y": 0.0}, "hold": ["y"]},
                {"box": [[0, 0, 0], [100, 50, 0]], "hold": ["z"]},
            ],
            "loads": [{"face": "x+", "force": [4000.0, 0.0, 0.0]}],
        }
    )
    answer = solve_static(case.problem, PLAIN)
    assert answer.measures["sigma_1_max"].value == pytest.approx(2.0, rel=1e-9)
    force = answer.report["reactions"]["end"]["force"]
    np.testing.assert_allclose(force, [-4000.0, 0.0, 0.0], atol=1e-6)


def test_a_support_may_hold_a_face_of_no_load() -> None:
    """Nothing is lost where the pressure on the face is zero."""
    held = [{"face": "z+", "hold": ["z"]}]
    case = load_case(BOX | {"supports": held, "load": {"z+": {"pressure": 0.0}}})
    assert len(case.problem.load_case.held) == 1


def test_a_support_of_a_fixed_block_adds_nothing_and_one_that_moves_is_rejected() -> None:
    """Nodes of the block on it are not held in its place: it settles as without, to the bit."""
    low = box_block(tuple(SIZE), (1, 1, 1), contact_faces=("z+",))
    high = box_block(tuple(SIZE), (1, 1, 1), contact_faces=("z-",))
    blocks = replace(placed(low, high), fixed=np.array([True, False]))
    load = PressureLoad(np.array([1]), "z+", 0.1)
    alone, beside = (solved(blocks, held, faces=[load]) for held in ((), [HeldFace(0, "x-")]))
    assert alone.fields["displacement"].min() < 0.0
    np.testing.assert_array_equal(beside.fields["displacement"], alone.fields["displacement"])
    with pytest.raises(RefusedError, match=r"motion of block .*, which is fixed as a whole"):
        solved(blocks, [HeldFace(0, "x-", displacement=0.1 * X)], faces=[load])
