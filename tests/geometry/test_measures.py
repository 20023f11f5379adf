"""The paper's measures on fields whose answer is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geometry.answer import title_of
from geometry.parts.measures import Resultants, block_measures, chain, measures, planes
from geometry.polyhedra.facet_contact import PatchContacts
from tests.support.coarse_tubes import keys
from validation import load_case, solve

pytestmark = pytest.mark.quick


def one_block(pressure: list[float], area: list[float] | None = None):
    p = np.array(pressure)
    a = np.ones(len(p)) if area is None else np.array(area)
    mine = np.zeros(len(p), dtype=np.int64)
    return block_measures(np.array([0]), mine, mine + 1, p, a)


def test_uniform_pressure_takes_part_everywhere() -> None:
    found = one_block([0.3] * 7)
    assert found.participation[0] == 7
    assert found.p_eff[0] == pytest.approx(0.3)
    assert found.p_max[0] == 0.3


def test_one_pressed_element_of_many() -> None:
    found = one_block([0.0, 0.0, 5.0, 0.0], [1, 1, 3, 1])
    assert found.participation[0] == 1
    assert found.effective_area[0] == 3.0
    assert found.p_eff[0] == found.p_max[0] == 5.0


def test_participation_ratio_by_hand() -> None:
    # (1 + 2 + 3)² / (1 + 4 + 9) = 36 / 14 = 2.57: the two largest, mean 2.5.
    # Of one it is 3, of three 2.
    found = one_block([1.0, 3.0, 2.0])
    assert found.participation[0] == 2
    assert found.p_eff[0] == pytest.approx(2.5)
    assert found.p_eff_step[0] == pytest.approx(0.5)


def test_unpressed_block_has_no_effective_area() -> None:
    found = one_block([0.0, 0.0])
    assert found.participation[0] == 0
    assert found.p_eff[0] == 0.0


def test_a_small_pressure_is_one_and_round_off_is_none() -> None:
    # Of a solver that balances to 1e-12: 1e-10 of the largest is a pressure, 1e-13 is nothing.
    m, s = np.array([0, 2, 4]), np.array([1, 3, 5])
    found = block_measures(np.arange(6), m, s, np.array([1.0, 1e-10, 1e-13]), np.ones(3))
    np.testing.assert_array_equal(found.p_max, [1.0, 1.0, 1e-10, 1e-10, 0.0, 0.0])


def test_contact_counts_for_both_blocks_and_averages_are_plain_means() -> None:
    # Blocks 0-1 share pressure 1, blocks 1-2 share pressure 3.
    m, s = np.array([0, 1]), np.array([1, 2])
    found = block_measures(np.arange(3), m, s, np.array([1.0, 3.0]), np.array([2.0, 4.0]))
    np.testing.assert_allclose(found.p_max, [1.0, 3.0, 3.0])
    # Block 1: (1 + 3)² / (1 + 9) = 1.6: one element.
    np.testing.assert_array_equal(found.participation, [1, 1, 1])
    overall = measures(found, np.array([2, 2, 4]), np.array([4.0, 8.0, 8.0]))
    assert overall.p_max == pytest.approx(7 / 3)
    assert overall.effective_count_percent == pytest.approx((50 + 50 + 25) / 3)
    assert overall.effective_area_percent == pytest.approx((50 + 50 + 50) / 3)


def test_pooled_mean_weighs_blocks_by_their_effective_elements() -> None:
    """Block 0 alone on four elements of 1, block 1 on one of 6: (4 · 1 + 6) / 5, not (1 + 6) / 2.

    And nothing of a block that no neighbour touches.
    """
    m, s = np.array([0, 0, 0, 0, 1]), np.array([3, 3, 3, 3, 3])
    pressures = np.array([1.0, 1.0, 1.0, 1.0, 6.0])
    found = block_measures(np.arange(3), m, s, pressures, np.ones(5))
    overall = measures(found, np.full(3, 8), np.full(3, 8.0))
    assert overall.p_eff_pooled == pytest.approx(2.0, rel=1e-14)
    assert overall.p_eff == pytest.approx(7 / 3, rel=1e-14)
    # N_eff = 36 / 14 is not rounded down, K = 2 is.
    found = one_block([1.0, 3.0, 2.0])
    overall = measures(found, np.array([4]), np.array([4.0]))
    assert overall.participation_percent == pytest.approx(100 * 36 / 14 / 4, rel=1e-14)
    assert overall.effective_count_percent == 50.0
    idle = measures(one_block([0.0, 0.0]), np.array([4]), np.array([4.0]))
    assert idle.p_eff_pooled == idle.participation_percent == 0.0


@pytest.mark.parametrize("size", [1e-290, 1e290])
def test_measures_grow_with_the_pressure_however_large_or_small(size: float) -> None:
    """Counts are of shares, pressures proportional: also where squares are no numbers."""
    one = one_block([1.0, 0.5, 0.25, 0.0])
    other = one_block([size, 0.5 * size, 0.25 * size, 0.0])
    np.testing.assert_array_equal(other.participation, one.participation)
    # Halves and quarters are exact; the mean of a scaled sum rounds once more.
    np.testing.assert_allclose(other.p_eff / size, one.p_eff, rtol=1e-15)
    np.testing.assert_allclose(other.p_max / size, one.p_max, rtol=1e-15)


def test_the_normal_force_acts_where_it_has_the_moment() -> None:
    """In compression and tension e × N n is the moment in the plane, e lies in the plane, and the
    points of the thrust line are e beside the centroids; without N there is no place."""
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(6, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    forces, moments = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    forces[0] = 3.0 * normals[0]
    forces[1] = -3.0 * normals[1]
    forces[2] = np.cross(normals[2], [1.0, 2.0, 3.0])
    found = Resultants(
        areas=np.ones(6),
        centroids=rng.normal(size=(6, 3)),
        normals=normals,
        forces=forces,
        moments=moments,
    )
    e, normal = found.eccentricity, found.normal_force[:, None] * normals
    in_plane = moments - found.twisting_moment[:, None] * normals
    acts = np.arange(6) != 2
    assert np.cross(e, normal)[acts] == pytest.approx(in_plane[acts], abs=1e-12)
    assert np.einsum("ji,ji->j", e, normals) == pytest.approx(np.zeros(6), abs=1e-12)
    assert (e[2] == 0.0).all()
    assert found.points == pytest.approx(found.centroids + e)
    assert found.shear_force**2 + found.normal_force**2 == pytest.approx((forces**2).sum(axis=1))


def test_joints_are_a_row_where_no_block_has_three() -> None:
    """From the end with the lower number; a way that splits and meets again has two ends too."""
    row, fork = [(2, 3), (0, 1), (1, 2)], [(0, 1), (1, 2), (2, 3), (1, 3), (3, 4)]
    of_row, of_fork = (
        chain(SimpleNamespace(block_m=m, block_s=s)) for m, s in (np.array(row).T, np.array(fork).T)
    )
    assert of_row.tolist() == [1, 2, 0]
    assert of_fork is None


def test_contacts_without_a_patch_add_to_none() -> None:
    contacts = SimpleNamespace(
        patches=SimpleNamespace(areas=np.ones(3)), patch=np.array([0, -1, 2, -2, 0])
    )
    values = np.array([[1.0], [7.0], [2.0], [9.0], [4.0]])
    found = PatchContacts.of_patches(contacts, np.arange(5), values)  # type: ignore[arg-type]
    assert found.ravel().tolist() == [5.0, 0.0, 2.0]


def test_planes_take_normals_of_any_length_and_one_for_all() -> None:
    found = planes([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], [0.0, 3.0, 4.0])
    assert found.normals.tolist() == [[0.0, 0.6, 0.8]] * 2
    assert found.names == ("0", "1")


def test_measures_have_the_units_of_their_table() -> None:
    """Of rigid and of deformable blocks."""
    tube = keys(2, 2)
    answers = [
        solve(load_case("tsb1-pipe", tube | {"fem.mesh": "scene", "fem.error_estimate": False})),
        solve(load_case("tsb1-pipe", tube, method="rigid")),
    ]
    units = {name: m.unit for answer in answers for name, m in answer.measures.items()}
    assert len(units) >= 9
    assert units == {name: title_of(name).unit for name in units}
