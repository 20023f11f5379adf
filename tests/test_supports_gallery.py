"""Built-in scenes of supports, loads and motions against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fem import solve_static
from validation.build.deformable import scene_problem
from validation.scene.read import check_scene, scene_data


def solved(name: str) -> Any:
    scene = check_scene(scene_data(name)[1], name)
    return solve_static(scene_problem(scene, name), mesh="scene", error_bars=False)


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
    assert reactions["springs"]["force"][2] == pytest.approx(0.5 * force, rel=1e-9)


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
