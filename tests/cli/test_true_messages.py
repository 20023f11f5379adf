"""Slips of a new user: one line, in the user's own words, with what was meant."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fem import Explicit, Problem, Static, concrete, solve_explicit, solve_static
from geometry import RefusedError, SineBlock, pipe, read_blocks, tube
from mbd import analyse
from tests.support.answers import on_its_mesh
from validation import builtin_text, load_case
from validation.cli.options import parse_targets


def refusal(path: Path, text: str) -> str:
    path.write_text(text, "utf-8")
    with pytest.raises(RefusedError) as error:
        load_case(str(path))
    return str(error.value)


def test_misspelt_keys_and_sections_are_named_before_what_is_missing(tmp_path: Path) -> None:
    text, path = builtin_text("tsb1-pipe"), tmp_path / "mytube.toml"
    assert "did you mean 'amplitude'" in refusal(path, text.replace("amplitude =", "amplitud ="))
    assert "unknown section [blok]: did you mean [block]" in refusal(
        path, text.replace("[block]", "[blok]")
    )
    short = re.sub(r"^young_modulus", "young", text, flags=re.MULTILINE)
    told = refusal(path, short)
    assert "material.young: did you mean 'young_modulus'" in told
    # What was meant by the misspelt key is neither wrong nor missing; another one is.
    assert "also" not in told
    told = refusal(path, re.sub(r"^density.*$", "", short, flags=re.MULTILINE))
    assert told.endswith("'young_modulus'?; also missing: material.density")
    comma = re.sub(r"^amplitude = \S+", "amplitude = 10,5", text, flags=re.MULTILINE)
    assert "10,5: numbers have a point" in refusal(path, comma)
    path.write_text(text, "utf-8")
    with pytest.raises(RefusedError, match=r"did you mean .*mytube\.toml"):
        load_case(str(tmp_path / "mytube"))


def test_a_file_in_the_place_of_a_folder_is_named(
    tubelock,  # type: ignore[no-untyped-def]
    tmp_path: Path,
) -> None:
    (tmp_path / "out.txt").touch()
    for place in ("out.txt", "out.txt/below"):
        status, _, told = tubelock("mbd", "tsb1-pipe", "-o", place)
        assert status == 2
        assert "out.txt: is a file; expected a folder" in told


def test_accuracies_and_their_times(tmp_path: Path) -> None:
    assert parse_targets(["p_max=5%"]) == {"p_max": 0.05}


def test_elements_that_a_reader_does_not_know_are_named(tmp_path: Path) -> None:
    path = tmp_path / "brick.inp"
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes = "".join(f"{n}, {x}., {y}., {z}.\n" for n, (x, y, z) in enumerate(corners, start=1))
    text = f"*NODE\n{nodes}*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
    path.write_text(text, "utf-8")
    assert len(read_blocks(path)) == 1
    path.write_text(text.replace("C3D8", "C3D27"), "utf-8")
    with pytest.raises(RefusedError, match="element type C3D27; expected C3D8 or C3D20"):
        read_blocks(path)


def test_gravity_in_metres_is_refused_in_python() -> None:
    shape = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )
    blocks, load = tube(shape, layers=1, mesh=(12, 1, 2)), pipe(0.01)
    with pytest.raises(RefusedError, match=r"did you mean m/s²\?"):
        Problem(blocks, load, concrete, gravity=(0.0, 0.0, -9.81))
    for meant in ({"check_units": False}, {}):
        size = 9.81 if meant else 9810.0
        problem = Problem(blocks, load, concrete, gravity=(0.0, 0.0, -size), **meant)
        np.testing.assert_array_equal(problem.acceleration, [0.0, 0.0, -size])


def test_another_method_than_that_of_a_call_is_named() -> None:
    shape = SineBlock(
        height=200, amplitude=20, frequency=1.5, blocks_per_layer=4, inner_radius=120, thickness=40
    )
    problem = Problem(tube(shape, layers=1, mesh=(12, 1, 2)), pipe(0.01), concrete)
    for call, other, own in (
        (solve_static, Explicit(), "Static"),
        (solve_static, "scene", "Static"),
        (solve_explicit, Static(), "Explicit"),
        (analyse, Static(), "Rigid"),
    ):
        with pytest.raises(RefusedError, match=rf"^{call.__name__}: got a .*expected.* {own}\("):
            call(problem, other)


@pytest.mark.parametrize(("amplitude", "degrees"), [(40.0, None), (90.0, 82)])
def test_waves_that_are_almost_upright_are_named(
    tubelock,  # type: ignore[no-untyped-def]
    amplitude: float,
    degrees: int | None,
) -> None:
    """The slope by the mesh itself: of the block's upper face at the outer radius, where it is
    largest, and by hand atan(2f n a / r_o) = atan(3 · 4 · 90 / 160) = 81.6°."""
    sets = [f"block.amplitude={amplitude}", "assembly.layers=1", "mesh.around=96"]
    sets += ["mesh.radial=1", "mesh.axial=1"]
    words = [word for setting in sets for word in ("--set", setting)]
    status, out, _ = tubelock("export", "tsb1-pipe", *words, "-o", "a.inp")
    assert status == 0
    assert ("as steep as" in out) is (degrees is not None)
    file = load_case("tsb1-pipe", sets)
    shape = file.scene.stated.block  # type: ignore[union-attr]
    block = file.scene.build().shapes[0]  # type: ignore[union-attr]
    quads = block.mesh.nodes[block.faces["top"]]
    outer = np.hypot(quads[..., 0], quads[..., 1]) > shape.outer_radius - 1e-6
    pair = quads[outer].reshape(-1, 2, 3)
    rise = np.abs(np.diff(pair[..., 2], axis=1)).ravel()
    run = np.linalg.norm(np.diff(pair[..., :2], axis=1), axis=2).ravel()
    # 32 elements a wave: a chord beside the zero is at most (π/32)²/6 flatter.
    assert (rise / run).max() == pytest.approx(shape.steepest_slope, rel=(np.pi / 32) ** 2)
    if degrees is not None:
        assert f"as steep as {degrees}°" in out


@pytest.mark.parametrize(("ratio", "degree"), [(0.4999, 1), (0.4999, 2), (0.3, 1)])
def test_oscillating_mean_stresses_are_named(ratio: float, degree: int) -> None:
    """Of a nearly incompressible cantilever; not where every element has one mean stress."""
    settings = ["fem.method=static", "mesh.divisions=[6,1,1]", f"material.poisson_ratio={ratio}"]
    found = {}
    for element in ("incompatible", "b-bar") if degree == 1 else (None,):
        kind = [f"fem.degree={degree}"] if element is None else [f"fem.element={element}"]
        answer = on_its_mesh("cantilever", settings + kind, method="static")
        found[element] = answer.report.get("notes", {})
    assert ("nearly incompressible" in found[None if degree > 1 else "incompatible"]) is (
        ratio > 0.4
    )
    assert "nearly incompressible" not in found.get("b-bar", {})
