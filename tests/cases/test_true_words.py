"""Words about motions are true: which joint slides or tips, and what large motions lack."""

import json
import re

import numpy as np
import pytest

from geometry import RefusedError
from mbd import analyse
from tests.support.commands import command
from validation import load_case, read_answer

pytestmark = pytest.mark.quick


def printed_of(path, text, *settings):
    path.write_text(text, "utf-8")
    words = [part for one in settings for part in ("--set", one)]
    data = path.with_suffix(".json")
    status, out, err = command("fem", str(path), *words, "--json", str(data))
    return status, out + err, json.loads(data.read_text("utf-8")) if status == 0 else {}


#: A cube of 50 mm pressed by N = 100 N onto a plate and pushed by a force F at a height.
PUSHED = """
loads = [{{blocks = [1], force = [{force}, 0.0, 0.0], point = [0.0, 0.0, {height}]}}]
[block]
type = "boxes"
boxes = [
    {{size = [50, 50, 10], divisions = [2, 2, 1]}}, {{size = [50, 50, 50], divisions = [2, 2, 2]}}
]
[load]
pressure = 0.04
[effects.friction]
coefficient = 0.3
"""


@pytest.mark.parametrize(
    ("force", "above", "slides", "tips"),
    [
        (40.0, 0.0, True, False),
        (40.0, 25.0, True, False),
        (40.0, 50.0, True, False),
        (28.0, 100.0, False, True),
        (70.0, 50.0, True, True),
    ],
)
def test_a_block_slides_beyond_its_friction_and_tips_beyond_its_moment(
    tmp_path, force, above, slides, tips
):
    assert slides is (force > 0.3 * 100.0)
    assert tips is (force * above > 100.0 * 25.0)
    text = PUSHED.format(force=force, height=10.0 + above)
    status, printed, _ = printed_of(tmp_path / "pushed.toml", text)
    assert status == 2
    assert ("slides" in printed, "tips" in printed) == (slides, tips)


#: A block that its support moves along, by a fifth of its size, on another one.
CARRIED = """
supports = [{{face = "z+", blocks = [1], move = [{way}, 0.0, 0.0]}}]
[block]
type = "boxes"
boxes = [
    {{size = [100, 100, 20], divisions = [4, 4, 1]}},
    {{size = [50, 50, 50], divisions = [2, 2, 2]}},
]
[contact]
clearance = -0.001
[fem]
mesh = "scene"
error_estimate = false
"""


@pytest.mark.parametrize("sliding", [False, True])
def test_a_translation_asks_for_no_finite_rotation(tmp_path, sliding):
    text = CARRIED.format(way=10.0)
    setting = f"effects.finite_sliding={str(sliding).lower()}"
    status, printed, answer = printed_of(tmp_path / "carried.toml", text, setting)
    assert status == 0, printed
    assert "finite_rotation" not in printed
    assert ("large_motion" in answer) is not sliding


@pytest.mark.slow
def test_a_picture_of_pressures_counts_the_facets_that_press(tmp_path):
    """Its words follow from the pressures and areas that are written beside it."""
    small = ("assembly.layers=1", "mesh.around=12", "mesh.radial=1", "mesh.axial=4")
    sets = [part for one in (*small, "pictures.format=svg") for part in ("--set", one)]
    status, printed, error = command("mbd", "tsb1-pipe", *sets, "--fields", "-o", str(tmp_path))
    assert status == 0, error
    text = (tmp_path / "contact_pressures.svg").read_text("utf-8")
    contacts = read_answer(tmp_path).contacts
    pressure, force = contacts["pressure"], contacts["pressure"] * contacts["area"]
    pressing = 100.0 * np.mean(pressure > 1e-9 * pressure.max())
    most = re.search(r"([\d.]+) % of the contact facets press, ([\d.]+) % carry 90 %", text)
    assert most is not None
    assert float(most[1]) == pytest.approx(pressing, abs=0.05)
    # So many carry nine tenths, and one fewer does not.
    count = round(float(most[2]) / 100.0 * len(force))
    carried = np.cumsum(np.sort(force)[::-1]) / force.sum()
    assert carried[count - 2] < 0.9 <= carried[count - 1]
    # The paper's means over facets come after what acts at one place.
    assert printed.index("p_eff") > printed.index("the paper's measures")


@pytest.mark.parametrize("scene", ["cubes", "octahedra"])
def test_an_assembly_without_a_load_has_a_class_and_no_rows_of_zeros(tmp_path, scene):
    path = tmp_path / "answer.json"
    status, printed, _ = command("mbd", scene, "--json", str(path))
    assert status == 0
    assert "pressure" not in printed
    answer = analyse(load_case(scene).problem)
    assert "locked" in answer.title
    assert dict(answer.measures) == json.loads(path.read_text("utf-8"))["measures"] == {}


@pytest.mark.parametrize("scene", ["cantilever", "spinning-block", "beam-on-springs"])
def test_rigid_analysis_of_single_bodies_is_one_refusal(scene):
    with pytest.raises(RefusedError, match=r"expected|remove it"):
        analyse(load_case(scene).problem)
