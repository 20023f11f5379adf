"""Built-in scenes of supports, loads and motions against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fem import CoulombFriction, LinearPenalty, Material, Problem, solve_static
from geometry import Assembly, Block, HeldFace, LoadCase, RefusedError
from geometry.block import mapped_block
from tests.support.answers import PLAIN, on_its_mesh
from validation import load_case, solve


def solved(name: str) -> Any:
    return solve_static(load_case(name).problem, PLAIN)


def test_a_beam_on_springs_is_that_of_winkler() -> None:
    """Deflection w0 and moment M0 under the load of an infinite beam.

    Winkler (Hetényi 1946): w0 = P λ / 2 k b, M0 = P / 4 λ with λ = (k b / 4 E I)^¼. A solid beam
    deforms in shear, too: with Timoshenko's beam on the same bed, of which the deflection is a
    Fourier integral in closed form, it sinks by 0.93 % more. What is left are the indentation
    below the load and the decay of the shear there, of order (h λ)³ of w0 [Timoshenko and Goodier,
    art. 40: 0.84 P h³ / 48 E I of the beam on two supports], and the end at x = 1200 mm, less than
    4 exp(-2 λ L) of w0. The mesh, of degree 2 with h / 2 by 25 mm, adds less.
    """
    answer = solved("beam-on-springs")
    width = height = 40.0
    modulus, bed, force = 210000.0, 1.0 * width, 2.0 * 50.0 * width
    bending, shear = modulus * width * height**3 / 12.0, modulus / 2.6 * width * height / 1.2
    wave = (bed / (4.0 * bending)) ** 0.25
    winkler = force * wave / (2.0 * bed)
    square, half = 2.0 * wave**2, bed / (2.0 * shear)
    root = np.sqrt(2.0 * (square + half))
    timoshenko = force / (2.0 * bending) * (1.0 / square + bending / shear) / root
    moment = 0.5 * force / root
    tolerance = (height * wave) ** 3 + 4.0 * np.exp(-2.0 * wave * 1200.0)
    assert tolerance < 0.5 * (timoshenko / winkler - 1.0)  # shear is seen

    middle = (answer.points[:, 0] == 0.0) & (answer.points[:, 2] == 0.0)
    (start, axis, end) = answer.fields["displacement"][middle, 2]
    across = (start + 4.0 * axis + end) / 6.0  # mean over the width: anticlastic bending
    assert -across == pytest.approx(timoshenko, rel=tolerance)
    assert -across == pytest.approx(winkler, rel=tolerance + timoshenko / winkler - 1.0)
    reactions = answer.as_dict()["reactions"]
    assert reactions["middle"]["moment"][1] == pytest.approx(moment, rel=tolerance)
    assert reactions["bed"]["force"][2] == pytest.approx(0.5 * force, rel=1e-9)


def test_a_roller_takes_what_presses_the_top_row_of_a_wall() -> None:
    """Joints have no friction: no row but the top one has a force along the wall.

    Rigid blocks to round-off. Normals of the joints between rows lean by strains of the bricks,
    p / E = 2e-5, under weights that add up to half of the force.
    """
    force = 0.1 * 115.0 * 71.0
    file = load_case("wall-with-roller")
    rigid = solve(file.with_method("rigid")).as_dict()["reactions"]["roller"]
    assert rigid["force"] == pytest.approx([-force, 0.0, 0.0], abs=1e-9 * force)
    assert rigid["moment"][1] == pytest.approx(-force * 248.5, rel=1e-9)
    run = on_its_mesh(file, method="static")
    assert run.report["reactions"]["roller"]["force"] == pytest.approx(
        [-force, 0.0, 0.0], abs=2e-5 * force
    )


def test_shifted_boxes_slide_at_the_coulomb_limit() -> None:
    """The force rises to μ N and stays; before, boxes and joint are springs in series.

    Without transverse strain all slip is along x, so that the limit is μ N along the joint,
    whatever the distribution of pressure. The joint turns by at most the shear of the boxes,
    μ p / G: the force along x differs by N μ p / G, a share p / G of μ N. Series:
    A / (H / G + 1 / k_t) with all facets at one shear. The free ends carry none: they take at most
    H / L of the stiffness of the boxes. Bending of the boxes as a cantilever adds 4 H³ / E L² to
    H / G + 1 / k_t.
    """
    answer = solved("shifted-boxes")
    area, height, length, modulus = 200.0 * 100.0, 40.0, 200.0, 33000.0
    limit, boxes, stick = 0.5 * 1.0 * area, height / (0.5 * modulus), 1.0 / 50.0
    (curve,) = answer.as_dict()["motions"]
    force, turned = np.array(curve["force"]), 1.0 / (0.5 * modulus)
    assert force.max() <= limit * (1.0 + turned)
    np.testing.assert_allclose(force[-2:], limit, rtol=turned)
    assert (np.diff(force) > -turned * limit).all()
    series = area / (boxes + stick)
    bending = 4.0 * height**3 / (modulus * length**2)
    less = (boxes * height / length + bending) / (boxes + stick)
    stiffness = answer.measures["push_stiffness"].value
    assert series * (1.0 - less) <= stiffness <= series


A, B, C, LENGTH = 10.0, 20.0, 30.0, 4.0
STEEL = Material(density=7.85e-9, young_modulus=210000.0, poisson_ratio=0.3)
INTERFERENCE, JOINT, MU = 0.0025, 1e5, 0.1
X, Y, Z = np.eye(3)


def quarter_ring(inner: float, outer: float, around: int, contact: str) -> Block:
    lines = (
        np.linspace(inner, outer, around // 3 + 2),
        np.linspace(0.0, np.pi / 2.0, around + 1),
        np.array([0.0, LENGTH]),
    )

    def shape(at: np.ndarray) -> np.ndarray:
        radius, angle, height = at.T
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])

    faces = {"u-": "inner", "u+": "outer", "v-": "start", "v+": "end", "w-": "bottom", "w+": "top"}
    directions = ("radial", "around", "axial")
    return mapped_block("ring", lines, shape, faces, (contact,), directions=directions)


def press_fit(around: int, *, pressed_by: float | None = None) -> Any:
    """Quarters of two rings, too large for each other, the inner one pressed out downwards."""
    rings = (quarter_ring(A, B, around, "outer"), quarter_ring(B, C, around, "inner"))
    blocks = Assembly(
        name="rings",
        shapes=rings,
        shape_of=np.arange(2),
        rotations=np.tile(np.eye(3), (2, 1, 1)),
        translations=np.zeros((2, 3)),
        layer=np.arange(2),
        fixed=np.zeros(2, dtype=np.bool_),
        unmatched_allowed=True,
    )
    held = [
        HeldFace(b, face, axis[None]) for b in (0, 1) for face, axis in (("start", Y), ("end", X))
    ]
    held.append(HeldFace(1, "bottom", Z[None]))
    stated: dict[str, Any] = {}
    if pressed_by is None:
        held.append(HeldFace(0, "bottom", Z[None]))
    else:
        held.append(HeldFace(0, "top", Z[None], displacement=-pressed_by * Z, name="punch"))
        stated["friction"] = CoulombFriction(MU, 1e4)
    load = LoadCase(blocks, "press fit", (), blocks.fixed, held=tuple(held))
    law = LinearPenalty(JOINT)
    problem = Problem(blocks, load, STEEL, law=law, clearance=-INTERFERENCE, **stated)
    return solve_static(problem, PLAIN)


def fit_pressure() -> float:
    """Two thick rings under plane stress (Lamé), Ø 20 / 40.005 in Ø 40 / 60 mm, and the joint."""
    inner, outer = (B**2 + A**2) / (B**2 - A**2), (C**2 + B**2) / (C**2 - B**2)
    return INTERFERENCE / (B * (inner + outer) / STEEL.young_modulus + 1.0 / JOINT)


def test_a_press_fit_has_the_pressure_of_lame() -> None:
    """Error of the second order in the angle of a facet, which two meshes measure.

    The interference is deeper than the contact law allows unless it is stated.
    """
    coarse, fine = (press_fit(n).measures["p_eff"].value for n in (6, 12))
    error = (coarse - fine) / 3.0
    assert abs(error) < 0.005 * fine
    assert fine - error == pytest.approx(fit_pressure(), abs=abs(error))


def test_a_press_fit_is_pressed_out_by_the_friction_of_its_pressure() -> None:
    """π d l p μ, of which a quarter; to the error of p, and the stress along the axis.

    The mean axial stress of the inner ring, F / A, widens it by ν F / A E: a share
    ν (F / A) / (p (inner + outer)) of the interference.
    """
    hand = fit_pressure()
    force = MU * hand * 0.5 * np.pi * B * LENGTH
    coarse = press_fit(6)
    (curve,) = press_fit(6, pressed_by=0.01).as_dict()["motions"]
    wider = 0.3 * force / (np.pi / 4.0 * (B**2 - A**2)) / (hand * (5.0 / 3.0 + 2.6))
    tolerance = abs(coarse.measures["p_eff"].value / hand - 1.0) + wider
    assert tolerance < 0.02
    np.testing.assert_allclose(curve["force"][5:], force, rtol=tolerance)


def test_checks_of_rigid_blocks_in_place_leave_out_supports_that_move() -> None:
    """Whether faces and friction carry the load is a question of rigid blocks in their place."""
    assert on_its_mesh("shifted-boxes", method="static").details.evidence.converged
    data = load_case("tetrahedra").keys
    data["assembly"] = {"columns": 1, "rows": 1}
    del data["effects"], data["rigid"]
    data["mesh"] = {"size": 100.0}
    blocks = load_case(data, method="rigid").problem.blocks
    free = int(np.flatnonzero(~blocks.fixed)[0])
    pushed = load_case(data | {"load": {"push": {"block": free, "distance": 0.1}}})
    assert on_its_mesh(pushed, method="static").details.evidence.converged


def pressed_boxes(*, held: str, load: str) -> Any:
    """Boxes without friction, pressed from above; a support and a load on the upper one."""
    data = load_case("shifted-boxes").keys
    del data["effects"]
    data["supports"] = [{"blocks": [1], "face": held, "hold": "normal", "name": "roller"}]
    data["loads"] = [{"blocks": [1], "face": load, "traction": [0.0, 0.1, 0.0]}]
    return load_case(data)


def test_a_mechanism_that_supports_leave_is_named() -> None:
    scene = pressed_boxes(held="x+", load="x-")
    words = (
        r"supports do not carry the load: block 1 slides on block 0 along \(0.00, 1.00, 0.00\); `tu"
    )
    with pytest.raises(RefusedError, match=words) as error:
        on_its_mesh(scene, method="static")
    assert "\n" not in str(error.value)


def test_a_load_that_a_support_takes_is_rejected() -> None:
    scene = pressed_boxes(held="y+", load="y+")
    with pytest.raises(
        RefusedError, match="roller holds the face of block 1 that is loaded, in the"
    ):
        _ = scene.problem
    assert pressed_boxes(held="y+", load="y-").problem.load_case.held
