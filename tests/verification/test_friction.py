"""Friction, static against explicit.

Tubes of one layer on coarse meshes under four loads, with and without gaps, friction from 0.01 to
0.6. Each is solved by the static solver straight up, by an explicit run that is damped to its
static state, and by the static solver past the load by half and back: the two ends of the set of
answers that slow loading admits. Both methods meet within 2 %, or the explicit answer lies between
the ends, or it lies outside by what is said: where blocks fly through a gap before they press, no
law says where they land.
"""

import time
from dataclasses import replace
from itertools import pairwise

import pytest

from fem import Static, solve_static
from fem.answer.measures import load_step_change
from tests.support.answers import PLAIN, on_its_mesh
from tests.support.coarse_tubes import tube
from tests.verification.error_problems import PRESSED, exact_push, pushed_box

#: Measures that are compared, and what the table calls them.
MEASURES = {"p_max": "p_max", "p_eff": "p_eff", "max_displacement": "u"}
#: Load on the way past, over the load, and load steps there and back.
PAST, STEPS = 1.5, 5
#: Largest difference of two answers that meet [-].
MEETING = 0.02

#: Load, friction, and clearance along every normal before the load acts [mm].
CASES = (
    ("pipe", 0.01, 0.0),
    ("pipe", 0.3, 0.0),
    ("pipe", 0.6, 0.0),
    ("pipe", 0.3, 0.05),
    ("tunnel", 0.1, 0.0),
    ("tunnel", 0.6, 0.0),
    ("tunnel", 0.3, 0.03),
    ("pillar", 0.05, 0.0),
    ("pillar", 0.3, 0.0),
    ("shaft", 0.05, 0.0),
    ("shaft", 0.3, 0.0),
    ("shaft", 0.1, 0.03),
)


def solved(load, friction, gap):
    """Static straight up, explicit, and static past the load and back; CPU seconds of each."""
    law = (f"effects.friction.coefficient={friction}", f"contact.clearance={gap}")
    static, explicit = (
        tube(f"tsb1-{load}", *law, f"fem.method='{method}'") for method in ("static", "explicit")
    )
    past = static.changed({"load.pressure": PAST * static.scene.load.pressure}).problem
    seconds, runs = [time.process_time()], []
    for run in (
        lambda: on_its_mesh(static),
        lambda: on_its_mesh(explicit),
        lambda: solve_static(replace(static.problem, after=past), Static(load_steps=STEPS)),
    ):
        runs.append(run())
        seconds.append(time.process_time())
    return runs, [b - a for a, b in pairwise(seconds)]


def outside(runs, name):
    """Distance of the explicit answer to the nearer end of the set; 0 between them [-].

    What half as many load steps change is no distance.
    """
    direct, explicit, back = (run[name].value for run in runs)
    low, high = sorted((direct, back))
    steps = load_step_change(runs[0].details).get(name, 0.0)
    return max(low - steps - explicit, explicit - high - steps, 0.0) / abs(direct)


def changes(runs, k):
    """Explicit (1), or past and back (2), over static straight up, less one [-]."""
    values = ({name: run[name].value for name in MEASURES} for run in (runs[0], runs[k]))
    direct, other = values
    return {name: other[name] / direct[name] - 1.0 for name in MEASURES}


def verdict(runs):
    """Whether both methods meet, lie in the set, or not."""
    apart = [name for name, change in changes(runs, 1).items() if abs(change) > MEETING]
    if not apart:
        return "meet"
    beyond = max(outside(runs, name) for name in apart)
    return "between the ends" if beyond == 0.0 else f"outside by {100 * beyond:.2g} %"


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (CASES[0], "meet"),
        pytest.param(CASES[8], "between the ends", marks=pytest.mark.thorough),
        pytest.param(CASES[11], "meet", marks=pytest.mark.thorough),
    ],
    ids=lambda value: "-".join(map(str, value)) if isinstance(value, tuple) else value,
)
def test_static_and_explicit_answers_meet_or_lie_in_the_set(case, expected):
    assert verdict(solved(*case)[0]) == expected


def test_a_box_that_is_pushed_sideways_sticks_by_the_closed_form():
    """Uniform pressure and shear, the elastic slip of the joint; any mesh contains the solution.

    The solver leaves 1e-8 of the forces, and pressures follow the joint by its steep law.
    """
    found = solve_static(pushed_box(), PLAIN)
    for name, value in exact_push().items():
        scale = value if name == "max_displacement" else PRESSED
        assert abs(found[name].value - value) < 1e-5 * scale, name


def rows():
    """Static against explicit of every load: MPa, mm, and differences in percent."""
    for load, friction, gap in CASES:
        runs, seconds = solved(load, friction, gap)
        row = {"TSB1, μ, gap [mm]": f"{load} {friction:g}" + (f", {gap:g}" if gap else "")}
        for name, word in MEASURES.items():
            row[f"static {word}"] = runs[0][name].value
            row[f"explicit {word} [%]"] = 100.0 * changes(runs, 1)[name]
            row[f"back {word} [%]"] = 100.0 * changes(runs, 2)[name]
        row["load steps"] = runs[0].details.evidence.load_steps
        yield row | {"CPU s": sum(seconds), "verdict": verdict(runs)}
