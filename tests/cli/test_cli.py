"""The command line as a person uses it: results, JSON, files, and one clear line for bad input."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest

from tests.support.coarse_tubes import SMALL
from tests.support.commands import answered, set_words
from validation import builtin_names, load_case, read_answer
from validation.output.answer_files import NUMBERS
from validation.output.files import write_json

pytestmark = pytest.mark.quick


@pytest.mark.usefixtures("tubelock")
def test_json_of_mbd_has_the_promised_keys_in_full_precision() -> None:
    data, _ = answered("mbd", "tsb1-pipe", *SMALL)
    assert data["scene"] == "tsb1-pipe"
    assert data["mechanism"] == "locked"
    assert data["equilibrium"]["holds"] is True
    assert 0 <= data["equilibrium"]["residual"] < 1e-9
    assert set(data["measures"]) == {
        "p_max_facet",
        "least_joint_force",
        "largest_joint_force",
        "total_reaction",
        "p_eff",
        "p_max",
    }
    assert set(data["contact"]) == {
        "effective_count_percent",
        "participation_percent",
        "effective_area_percent",
        "p_eff",
        "p_eff_pooled",
        "p_max",
    }
    assert data["n_blocks"] == 4
    assert data["n_contacts"] > 0
    assert data["cpu_seconds"]["total"] >= data["cpu_seconds"]["equilibrium"] > 0
    assert len(repr(data["measures"]["p_max"]["value"])) > 12
    assert not Path("out").exists()


def test_mbd_writes_pressures_and_picture(tubelock) -> None:
    import meshio

    status, out, _ = tubelock("mbd", "tsb2-tunnel", *SMALL, "-o", "here", "--fields")
    assert status == 0
    assert "locked" in out
    mesh = meshio.read("here/contact_pressures.vtu")
    pressures = mesh.cell_data["contact_pressure"][0]
    again = read_answer("here")
    assert again["p_max_facet"].value == pressures.max() > 0
    assert np.array_equal(again.contacts["pressure"], pressures)
    assert Path("here/contact_pressures.png").stat().st_size > 20_000
    assert {p.name for p in Path("here").iterdir()} == {
        *NUMBERS,
        "contact_pressures.png",
        "joints.csv",
        "joints.vtu",
    }


def test_infeasible_scene_shows_its_mechanism(tubelock) -> None:
    data, _ = answered("mbd", "brick-stack", "-o", "wall", "--fields")
    assert data["mechanism"] == "activated"
    assert data["equilibrium"]["holds"] is False
    assert data["measures"] == {}
    assert data["certificate"]["work"] > 0
    assert {p.name for p in Path("wall").iterdir()} == {*NUMBERS[:3], "mechanism.png"}


def test_show_draws_a_picture(tubelock) -> None:
    status, _, _ = tubelock("show", "tsb1-shaft", *SMALL, "-o", "tube.png")
    assert status == 0
    assert Path("tube.png").stat().st_size > 20_000


def test_scenes_are_listed_printed_and_all_valid(tubelock) -> None:
    _, out, _ = tubelock("scenes")
    for block in ("tsb1", "tsb2"):
        for case in ("pipe", "tunnel", "pillar", "beam", "shaft"):
            assert f"{block}-{case}" in out
    _, text, _ = tubelock("scenes", "tsb1-pipe")
    Path("mine.toml").write_text(text)
    assert load_case("mine.toml").scene == load_case("tsb1-pipe").scene
    for name in builtin_names():
        load_case(name)


# ---------------------------------------------------------------------------------------------
# Bad input


def test_more_blocks_than_any_memory_holds_are_refused(tubelock) -> None:
    status, out, err = tubelock("mbd", "tsb1-pipe", "--set", "assembly.layers=1000000000")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "fewer blocks" in err
    assert not list(Path().iterdir())


def test_broken_toml_and_missing_keys(tubelock) -> None:
    Path("a.toml").write_text("[block\n")
    assert "TOML syntax error" in tubelock("mbd", "a.toml")[2]
    Path("b.toml").write_text('[block]\ntype = "sine"\n')
    status, _, err = tubelock("mbd", "b.toml")
    assert status == 2
    assert "are missing" in err
    assert "block.height, block.amplitude" in err
    Path("c.toml").write_bytes(b"\xff\xfe\x00")
    assert "no UTF-8 text" in tubelock("mbd", "c.toml")[2]


def test_an_earlier_result_survives_a_failing_run(tubelock) -> None:
    tubelock("mbd", "tsb1-pipe", *SMALL, "--json", "keep.json")
    before = Path("keep.json").read_text()
    status, _, _ = tubelock("mbd", "tsb1-pipe", "--set", "mesh.around=85", "--json", "keep.json")
    assert status == 2
    assert Path("keep.json").read_text() == before


def test_a_full_disk_is_one_line(tubelock, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("validation.output.outputs.write_json", full)
    status, _, err = tubelock("mbd", "tsb1-pipe", *SMALL, "--json", "x.json")
    assert status == 2
    assert "error: No space left on device" in err
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_printed_times_count_error_bars_and_what_was_loaded(tubelock) -> None:
    """The stages add up to the total; the process, named in the last line, spent at least that."""
    settings = ("assembly.layers=1", "mesh.around=12", 'fem.mesh="scene"')
    few = set_words(settings)
    before = time.process_time()
    status, out, _ = tubelock("fem", "tsb1-pipe", *few, *SMALL, "-o", "o")
    after = time.process_time()
    assert status == 0
    (whole,) = re.findall(r"^process +([\d.]+) CPU s", out, re.MULTILINE)
    # Wherever the row is broken into lines.
    words = re.sub(r"[\s│]+", " ", out.split("CPU seconds")[1])
    total = float(re.findall(r"[\d.]+", words)[0])
    spent = re.findall(r"([a-z][a-z ]*?) (\d+\.\d{2})[,\s]", words.partition("└")[0])
    stages = {key.strip(): float(value) for key, value in spent}
    assert {"build", "solve", "error bars"} <= set(stages)
    # Each is rounded to a hundredth; stages of less than half of one are left out.
    assert sum(stages.values()) == pytest.approx(total, abs=4e-2)
    assert stages["error bars"] > 0.0
    # Rounded to a hundredth.
    assert before + total <= float(whole) + 1e-2 <= after + 2e-2


def test_json_has_null_where_a_number_is_not_finite(tmp_path: Path) -> None:
    """JSON knows no infinity: a ratio over nothing was a traceback after the work."""
    path = tmp_path / "a.json"
    write_json(str(path), {"ratio": float("inf"), "rows": [(1.5, float("nan"))], "n": 3})
    assert json.loads(path.read_text("utf-8")) == {"ratio": None, "rows": [[1.5, None]], "n": 3}
