"""Static runs that friction does not hold end in one line with the motion, before any iteration."""

from __future__ import annotations

import numpy as np
import pytest

from fem.accuracy import one_mesh
from tests.support.answers import PLAIN, on_its_mesh
from validation import Case, InputError, load_case, solve


def _pile(slope: float, friction: float | None, height: float = 10.0) -> Case:
    """Two plates on a held one, gravity leaning by a slope towards +x."""
    way = np.array([slope, 0.0, -1.0]) * 9810.0
    effects: dict[str, object] = {"gravity": way.tolist()}
    if friction is not None:
        effects["friction"] = {"coefficient": friction}
    boxes = [{"size": [50.0, 50.0, h], "divisions": [2, 2, 1]} for h in (10.0, 10.0, height)]
    return load_case(
        {
            "block": {"type": "boxes", "boxes": boxes},
            "load": {"pressure": 1e-3},
            "material": {"density": 2.4e-9, "young_modulus": 33e3, "poisson_ratio": 0.2},
            "contact": {"clearance_at_zero_pressure": 1e-3, "pressure_at_zero_clearance": 1e-4},
            "fem": {"method": "static"},
            "effects": effects,
        }
    )


class _Started(Exception):  # noqa: N818
    """The solver was called."""


def _solver_called(*_: object, **__: object) -> None:
    raise _Started


def test_plates_slide_just_beyond_the_friction_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    # Weight 2·10·50²·ρg = 1.177 N above the lower joint, 1e-3 · 50² = 2.5 N of pressure: joints
    # slide where slope · W > μ (W + P), first the lower one, which has more weight on it.
    weight = 2 * 10.0 * 50.0**2 * 2.4e-9 * 9810.0
    limit = 0.3 * (weight + 2.5) / weight
    monkeypatch.setattr(one_mesh, "static_state", _solver_called)
    with pytest.raises(InputError) as refused:
        on_its_mesh(_pile(1.01 * limit, 0.3), method="static")
    words = str(refused.value)
    assert "block 1 slides on block 0 along (1.00, 0.00, 0.00)" in words
    assert "0.3" in words
    assert "\n" not in words
    with pytest.raises(_Started):
        on_its_mesh(_pile(0.99 * limit, 0.3), method="static")


def test_without_friction_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_mesh, "static_state", _solver_called)
    with pytest.raises(_Started):
        on_its_mesh(_pile(1.0, None), method="static")


def test_a_tall_plate_tips_before_it_slides(monkeypatch: pytest.MonkeyPatch) -> None:
    # 200 high on 10, 50 wide: both turn over the lower edge where slope (W · 110 + W/20 · 5) =
    # 25 (W + W/20 + P), before the upper one alone (slope W · 100 = 25 (W + P)) and at a slope
    # that a friction of 2 does not let slide.
    weight = 200.0 * 50.0**2 * 2.4e-9 * 9810.0
    limit = 25.0 * (1.05 * weight + 2.5) / (110.25 * weight)
    assert limit < 0.25 * (weight + 2.5) / weight
    monkeypatch.setattr(one_mesh, "static_state", _solver_called)
    with pytest.raises(InputError, match="block 1 tips on block 0"):
        on_its_mesh(_pile(1.02 * limit, 2.0, 200.0), method="static")
    with pytest.raises(_Started):
        on_its_mesh(_pile(0.98 * limit, 2.0, 200.0), method="static")


def test_points_inside_the_edges_are_named_where_they_decide() -> None:
    # The same plate: its facets of 25 mm press at points 25 (1 - 1/√3) / 2 inside their edges.
    weight = 200.0 * 50.0**2 * 2.4e-9 * 9810.0
    half = 25.0 - 12.5 * (1.0 - 1.0 / np.sqrt(3.0))
    limit = half * (1.05 * weight + 2.5) / (110.25 * weight)
    for share, moves in ((0.98, False), (1.02, True)):
        case = _pile(share * limit, 2.0, 200.0).changed({"fem.load_steps": 1})
        if not moves:
            assert on_its_mesh(case).details.evidence.converged
            continue
        with pytest.raises(InputError, match="block 1 tips on block 0") as refused:
            on_its_mesh(case)
        assert "finer mesh" in str(refused.value)


def test_a_problem_made_in_python_is_refused_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = _pile(3.0, 0.3).problem
    monkeypatch.setattr(one_mesh, "static_state", _solver_called)
    with pytest.raises(InputError, match=r"^mine: no static state: block 1 slides on block 0"):
        solve(Case(problem, PLAIN, "mine"))
