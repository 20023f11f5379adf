"""Opening and slip of contact facets: closed forms of two boxes, in arrays and files."""

from __future__ import annotations

import csv
from dataclasses import replace

import meshio
import numpy as np
import pytest

from fem import (
    CoulombFriction,
    Explicit,
    Frames,
    LinearPenalty,
    Material,
    Problem,
    Static,
    solve_explicit,
    solve_static,
)
from fem.contact.normals import ContactNormals
from geometry import ColumnBox, LoadCase, box_column
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.own_blocks import column
from tests.support.pressed_boxes import AREA, PRESSURE, SHEAR, SIZES, STICK, STIFF, boxes
from tests.support.printed import printed
from validation import plot, write

pytestmark = pytest.mark.quick


def on_upper(answer):
    """Slip of the upper box relative to the lower one, (n, 3) [mm], and the area of its facets."""
    found = answer.contacts
    sign = np.where(found["blocks"][:, 1] == 1, 1.0, -1.0)
    return sign[:, None] * found["slip"], found["area"]


SEARCHES = pytest.mark.parametrize(
    "search", [{}, {"finite_sliding": True, "upper": (3, 2, 2)}], ids=["matched", "searched"]
)


@SEARCHES
def test_slip_with_friction_carries_the_shear(search) -> None:
    """Points that stick carry stick stiffness times slip: its sum is the shear over that, from
    equilibrium alone, to the residual of 1e-8 of the load tenfold. A search follows the box, whose
    joint it finds tilted by 1e-5 or less, as the pressures of 0.5 MPa vary by half of that."""
    friction = CoulombFriction(0.8, stick_stiffness=STICK)
    method = Static(mesh="scene", load_steps=1, error_estimate=False)
    problem = boxes(shear=SHEAR, friction=friction, frames=Frames.DEFORMABLE, **search)
    # Current normals lean by the tilt of the box.
    problem = replace(problem, normals=ContactNormals.REFERENCE)
    answer = solve_static(problem, method)
    slip, area = on_upper(answer)
    force, near = STICK * area @ slip, 1e-3 if search else 1e-6
    assert force[0] == pytest.approx(SHEAR * AREA, rel=near)
    assert abs(force[1]) < near * SHEAR * AREA
    assert np.abs(slip[:, 2]).max() < 1e-3 * SHEAR / STICK  # along the facets, which hardly turn
    # The load tilts the upper box: its front edge presses more than its back edge.
    gap, x = answer.contacts["gap"], answer.contacts["centroid"][:, 0]
    assert gap.max() < 0.0
    assert gap[x > 0].max() < gap[x < 0].min()


@SEARCHES
def test_slip_without_friction_is_that_of_bulging(search) -> None:
    """A box on a rigid plane bulges by ν p / E freely: slip grows from its middle. Where the box
    stands along the plane nothing determines: differences are compared."""
    answer = solve_static(boxes(poisson=0.2, **search), PLAIN)
    slip, area = on_upper(answer)
    where = answer.contacts["centroid"]
    expected = 0.2 * PRESSURE / 33e3 * (where - area @ where / AREA)
    found = slip - area @ slip / AREA
    # Centroids are those of the deformed state in a search: strains of 3e-6.
    np.testing.assert_allclose(found[:, :2], expected[:, :2], rtol=1e-4, atol=1e-9)
    # A search leaves out what hangs over the edge: 1.5e-4 of the 33 mm of a facet, twentyfold.
    assert answer.contacts["gap"] == pytest.approx(-PRESSURE / STIFF, rel=1e-4)


@pytest.mark.parametrize("search", [False, True])
def test_a_clearance_stays_open_by_what_weight_leaves(search) -> None:
    """The upper box hangs, the lower one stands: their faces move down by ρ g h² / 2 E each."""
    found = box_column([ColumnBox(s, (2, 2, 2)) for s in SIZES])
    load = LoadCase(found, "held", (), np.array([True, True]))
    material = Material(density=2.4e-6, young_modulus=33e3, poisson_ratio=0.0)
    problem = Problem(
        found,
        load,
        material,
        law=LinearPenalty(STIFF),
        clearance=1e-3,
        gravity=(0.0, 0.0, -9810.0),
        frames=Frames.DEFORMABLE,
        finite_sliding=search,
        check_units=False,
    )
    answer = solve_static(problem, PLAIN)
    left = 1e-3 + 2.4e-6 * 9810.0 * (50.0**2 - 30.0**2) / (2.0 * 33e3)
    assert len(answer.contacts["gap"]) == 4
    assert answer.contacts["gap"] == pytest.approx(left, rel=1e-9)
    assert answer.contacts["pressure"].max() == 0.0
    joint = answer.report["joints"][0]
    assert joint["smallest_gap"] == pytest.approx(left, rel=1e-9)
    assert joint["largest_gap"] == pytest.approx(left, rel=1e-9)


def test_an_explicit_run_slips_as_the_static_state() -> None:
    """To the residual of 1e-4 at which a damped run stops, tenfold."""
    problem = boxes(
        shear=SHEAR,
        friction=CoulombFriction(0.8, stick_stiffness=STICK),
        frames=Frames.DEFORMABLE,
        finite_sliding=True,
    )
    slip, area = on_upper(solve_explicit(problem, Explicit()))
    assert (area @ slip / AREA)[0] == pytest.approx(SHEAR / STICK, rel=1e-3)


def test_files_and_pictures_have_gap_and_slip(tmp_path) -> None:
    answer = solve_static(boxes(poisson=0.2), PLAIN)
    write(answer, tmp_path)
    there = meshio.read(tmp_path / "contact_pressures.vtu").cell_data
    np.testing.assert_array_equal(there["slip"][0], answer.contacts["slip"])
    np.testing.assert_array_equal(there["gap"][0], answer.contacts["gap"])
    bars = [text.get_text() for text in plot(answer, "slip").texts]
    assert any(words.startswith("slip [") and words.endswith("mm]") for words in bars)


@pytest.mark.usefixtures("undrawn")
def test_joints_have_the_extremes_of_their_facets(tmp_path) -> None:
    run = on_its_mesh(column(0.5), method="static")
    printed(column(0.5), tmp_path, "-o", str(tmp_path))
    with (tmp_path / "joints.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = run.contacts
    for row in rows:
        mine = (np.sort(found["blocks"], axis=1) == [int(row["block_m"]), int(row["block_s"])]).all(
            axis=1
        )
        assert float(row["smallest_gap_mm"]) == found["gap"][mine].min()
        assert float(row["largest_gap_mm"]) >= found["gap"][mine].max()
        assert float(row["largest_slip_mm"]) >= np.linalg.norm(found["slip"][mine], axis=1).max()
