"""`tubelock fem` on boxes: closed forms, JSON, files, interruption, and bad input at the door."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.support.answers import on_its_mesh
from tests.support.commands import ANSWER_FILES
from validation import Case, load_case, read_answer


def box(scene: str, *settings: str) -> Case:
    return load_case(scene, settings)


def test_cantilever_tip_against_timoshenko_beam() -> None:
    scene = box("cantilever", "fem.method=static")
    data = on_its_mesh(scene).as_dict()
    width, height, length, young = 40.0, 60.0, 400.0, 33000.0
    force, inertia = 0.05 * width * height, width * height**3 / 12
    shear = young / 2.4
    beam = force * length**3 / (3 * young * inertia) + force * length / (
        5 / 6 * shear * width * height
    )
    # The clamped end restrains Poisson's contraction over about one height of the length: the
    # beam theory's own error, (h/L)² / 2 ≈ 1 %.
    assert -data["faces"]["x+"]["mean_displacement"][2] == pytest.approx(beam, rel=0.012)


def test_json_has_the_promised_keys(tubelock) -> None:
    status, out, _ = tubelock(
        "fem",
        "cantilever",
        "--set",
        "mesh.divisions=[6,2,2]",
        "--set",
        "fem.end_time=1e-4",
        "--json",
        "-",
    )
    assert status == 0
    data = json.loads(out)
    promised = {
        "n_elements",
        "n_nodes",
        "n_steps",
        "time_step",
        "critical_time_step",
        "faces",
        "max_displacement",
        "principal_stress",
        "energies",
        "energy_balance",
        "cpu_seconds",
        "element_updates_per_cpu_second",
        "peak_memory_mb",
    }
    assert promised <= set(data)
    assert data["n_elements"] == 24
    assert set(data["faces"]) == {"x-", "x+", "y-", "y+", "z-", "z+"}
    assert len(data["faces"]["x+"]["mean_displacement"]) == 3
    assert set(data["principal_stress"]) == {"max", "min"}
    assert data["time_step"] == pytest.approx(0.9 * data["critical_time_step"])


def test_files_of_a_run(tubelock) -> None:
    import meshio

    status, _, _ = tubelock(
        "fem",
        "spinning-block",
        "--set",
        "mesh.divisions=[4,2,2]",
        "--set",
        "fem.end_time=1e-3",
        "--set",
        "fem.frames=3",
        "-o",
        "run",
        "--fields",
    )
    assert status == 0
    found = {p.name for p in Path("run").iterdir()}
    assert found == {
        *ANSWER_FILES[:3],
        "stresses.png",
        "history.csv",
        "energies.png",
        "frames.pvd",
        "frame_0000.vtu",
        "frame_0001.vtu",
        "frame_0002.vtu",
    }
    assert Path("run/frames.pvd").read_text().count("DataSet") == 3
    mesh = meshio.read("run/fields.vtu")
    assert set(read_answer("run").fields) < set(mesh.point_data) | {"principal_stress"}
    # Four by two by two elements with eight integration points each.
    assert mesh.cell_data["sigma_1_integration_points"][0].shape == (16, 8)
    assert set(mesh.point_data) == {
        *("displacement", "stress", "mises", "sigma_1", "sigma_2", "sigma_3")
    }
    header, *rows = Path("run/history.csv").read_text().splitlines()
    assert header.startswith("time,step,kinetic_energy")
    assert len(rows) > 5


def test_copies_move_as_one_block_does() -> None:
    settings = ("mesh.divisions=[4,2,2]", "fem.end_time=2e-4", "fem.frames=0")
    one = on_its_mesh("cantilever", settings)
    three = on_its_mesh("cantilever", (*settings, "assembly.copies=3"))
    for copy in range(3):
        # The lanes run through the same sums in the same order.
        np.testing.assert_allclose(
            three.details.displacements[0][copy],
            one.details.displacements[0][0],
            rtol=0,
            atol=1e-15,
        )


@pytest.mark.usefixtures("undrawn")
def test_interrupted_and_continued_run_ends_in_the_same_bits(tubelock, monkeypatch) -> None:
    """Ctrl-C in the loop: status 130, a checkpoint, the remedy; then the same bits."""
    arguments = ["fem", "cantilever", "--set", "mesh.divisions=[8,2,2]", "--fields"]
    arguments += ["--set", "fem.frames=0"]
    arguments += ["--set", "fem.end_time=2e-3"]
    assert tubelock(*arguments, "-o", "whole")[0] == 0

    def impatient(_):
        def show(sample) -> None:
            if sample.step > 300:
                signal.raise_signal(signal.SIGINT)

        return show

    with monkeypatch.context() as patch:
        patch.setattr("validation.output.console.explicit_progress", impatient)
        status, _, said = tubelock(*arguments, "-o", "cut")
    assert status == 130
    assert "continue with --resume cut/checkpoint.npz" in said
    assert [p.name for p in Path("cut").iterdir()] == ["checkpoint.npz"]
    assert tubelock(*arguments, "-o", "cut", "--resume", "cut/checkpoint.npz")[0] == 0
    for name in ("history.csv", "fields.vtu"):
        assert Path("whole", name).read_bytes() == Path("cut", name).read_bytes()
    assert not Path("cut/checkpoint.npz").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_run_at_its_limit_of_time_is_continued_to_the_same_bits(tubelock) -> None:
    """A limit that the first sample exceeds: status 3, the answer so far and a checkpoint."""
    arguments = ["fem", "cantilever", "--set", "mesh.divisions=[8,2,2]", "--fields"]
    arguments += ["--set", "fem.frames=0"]
    arguments += ["--set", "fem.end_time=1e-3"]
    assert tubelock(*arguments, "-o", "whole")[0] == 0
    status, said, _ = tubelock(*arguments, "--max-seconds", "1e-9", "-o", "cut")
    assert status == 3
    assert "continue with --resume cut/checkpoint.npz" in said
    assert json.loads(Path("cut/answer.json").read_text("utf-8"))["status"] == "stopped"
    assert tubelock(*arguments, "-o", "cut", "--resume", "cut/checkpoint.npz")[0] == 0
    for name in ("history.csv", "fields.vtu"):
        assert Path("whole", name).read_bytes() == Path("cut", name).read_bytes()


def test_missing_end_time_and_wrong_checkpoint(tubelock) -> None:
    text = load_text("cantilever").replace("end_time = 0.02", "# end_time")
    Path("a.toml").write_text(text)
    assert "fem.end_time is missing" in tubelock("fem", "a.toml")[2]
    Path("b.npz").write_bytes(b"no checkpoint")
    status, _, err = tubelock("fem", "cantilever", "--resume", "b.npz", "-o", "out")
    assert status == 2
    assert "b.npz" in err


def load_text(name: str) -> str:
    from validation import builtin_text

    return builtin_text(name)
