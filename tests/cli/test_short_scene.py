"""Short scenes: what they leave out has defaults that are named, or is missing with its lines."""

from __future__ import annotations

import json
import os
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from tests.support.coarse_tubes import coarse
from tests.support.commands import set_words
from validation import InputError, load_case
from validation.scene.builtin import stands_for_builtin
from validation.scene.families.sine import TubeScene
from validation.scene.keys.schema import scene_schema
from validation.scene.keys.toml_text import flat
from validation.scene.read import check_scene

README = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
SHORT = re.findall(r"```toml\n(.*?)```", README, flags=re.DOTALL)[0]
#: The smallest tube; its own elements, as finer ones take a minute.
SMALL = coarse(2, 4)
ONE_MESH = ("fem.mesh=scene", "fem.error_estimate=false")


def settings(*values: str) -> list[str]:
    return set_words(values)


def scene(**sections: object) -> TubeScene:
    found = check_scene(tomllib.loads(SHORT) | sections)
    assert isinstance(found, TubeScene)
    return found


def defaults(out: str) -> str:
    """What a command names as defaults: in a row of its table, or in a line."""
    named, title = "", ""
    for line in out.splitlines():
        if line.startswith("defaults "):
            return line.removeprefix("defaults ").strip()
        if line.startswith("│"):
            head, words = (cell.strip() for cell in line.split("│")[1:3])
            title = head or title
            named += f" {words}" * (title == "defaults")
    return named.strip()


@pytest.mark.parametrize(
    ("command", "used"),
    [
        (("mbd", "--json", "a.json"), ("mesh",)),
        (("fem", "--json", "a.json", *settings(*SMALL, *ONE_MESH)), ("material", "contact")),
        (("compare", "--json", "a.json", *settings(*SMALL, *ONE_MESH)), ("material", "contact")),
        (("export", "-o", "a.inp"), ("material", "contact", "fem")),
    ],
)
def test_the_scene_of_the_readme_needs_no_edit(tubelock, command, used) -> None:
    """Defaults are named where the answer depends on them, and nowhere else."""
    Path("mine.toml").write_text(SHORT)
    status, out, err = tubelock(command[0], "mine.toml", *command[1:])
    assert status == 0, err
    named = defaults(out)
    assert bool(named) == bool(used)
    for section in used:
        assert re.search(rf"(^|, ){section} ", named)
    if used and command[0] != "export":
        assert set(used) <= set(json.loads(Path("a.json").read_text())["defaults"])


def test_a_scene_that_states_everything_has_no_defaults_to_name(tubelock) -> None:
    status, out, _ = tubelock("fem", "tsb1-pipe", *settings(*SMALL, *ONE_MESH), "--json", "a.json")
    assert status == 0
    assert "defaults" not in out
    assert "defaults" not in json.loads(Path("a.json").read_text())


def test_a_material_by_name_is_its_constants() -> None:
    constants = {"density": 2.4e-9, "young_modulus": 33000.0, "poisson_ratio": 0.2}
    stated, named, left_out = scene(material=constants), scene(material="concrete"), scene()
    for key, value in constants.items():
        assert [getattr(s.material, key) for s in (stated, named, left_out)] == [value] * 3
    heavier = scene(material={"name": "concrete", "density": 2.5e-9}).material
    assert (heavier.density, heavier.young_modulus) == (2.5e-9, 33000.0)
    # What a name stands for was not set by the scene, and is not named as ignored.
    assert named.material.model_fields_set == {"name"}
    with pytest.raises(InputError, match="expected one of concrete, steel"):
        scene(material="stone")
    with pytest.raises(InputError, match="stands above the first"):
        scene(load={"case": "pipe", "material": "concrete"})


def test_facets_left_out_are_those_of_the_built_in_tube() -> None:
    """As many along a wave for any number of waves."""
    data = {key: value for key, value in tomllib.loads(SHORT).items() if key != "mesh"}
    built_in = load_case("tsb1-pipe").scene
    assert isinstance(built_in, TubeScene)
    found = check_scene(data)
    assert isinstance(found, TubeScene)
    assert found.mesh == built_in.mesh
    more = check_scene(data | {"block": data["block"] | {"frequency": 3.0}})
    assert isinstance(more, TubeScene)
    assert more.mesh.around == 2 * found.mesh.around


@pytest.mark.parametrize("kind", ["sine", "hexagon", "box", "brick", "osteomorphic", "wall"])
def test_all_that_is_missing_comes_with_lines_to_add(kind: str) -> None:
    """Added as printed, they make a scene."""
    with pytest.raises(InputError, match="missing; add, with your values") as refused:
        check_scene({"block": {"type": kind}})
    data: dict[str, dict[str, object]] = {"block": {"type": kind}}
    for line in str(refused.value).partition("your values: ")[2].split("; "):
        section, _, keys = line.strip("[").partition("] ")
        data.setdefault(section, {}).update(tomllib.loads(f"v = {{ {keys} }}")["v"])
    assert check_scene(data).block.type == kind


def test_keys_that_tables_of_a_list_lack_come_with_lines_to_add() -> None:
    box = {"size": [100.0, 80.0, 60.0]}
    with pytest.raises(InputError, match=r"boxes\.0\.divisions and .*1\.divisions are") as refused:
        check_scene({"block": {"type": "boxes", "boxes": [box, box]}})
    lines = str(refused.value).partition("[block.boxes] ")[2]
    whole = box | tomllib.loads(lines)
    assert check_scene({"block": {"type": "boxes", "boxes": [whole, whole]}}).block.type == "boxes"


def test_a_box_needs_no_mesh(tubelock) -> None:
    """Its elements are named among the defaults, and no contact: it touches none."""
    Path("box.toml").write_text(
        '[block]\ntype = "box"\nsize = [90.0, 30.0, 30.0]\n[[supports]]\nface = "x-"\n'
        '[load."x+"]\npressure = 1.0\n'
    )
    status, out, err = tubelock("fem", "box.toml", *settings(*ONE_MESH), "--json", "a.json")
    assert status == 0, err
    named = defaults(out)
    assert "mesh 8 × 4 × 4" in named
    assert "material concrete" in named
    assert "contact" not in named


def test_a_density_that_is_left_out_is_named_where_blocks_weigh(tubelock) -> None:
    wall = (
        '[block]\ntype = "wall"\nsize = [240.0, 115.0, 71.0]\n[assembly]\ncolumns = 2\nrows = 2\n'
    )
    Path("heavy.toml").write_text(f"{wall}[effects]\ngravity = [0.0, 0.0, -9810.0]\n")
    Path("light.toml").write_text(f"{wall}[[loads]]\nblocks = [3]\nforce = [0.0, 0.0, -1.0]\n")
    heavy = tubelock("mbd", "heavy.toml", "--json", "a.json")[1]
    assert re.search("material concrete .*2.4e-09 t/mm³", defaults(heavy))
    assert "density" not in tubelock("mbd", "light.toml", "--json", "a.json")[1]
    Path("tube.toml").write_text(SHORT)
    heavy = settings(*SMALL, "effects.gravity=[0,0,-9810]")
    out = tubelock("mbd", "tube.toml", *heavy, "--json", "a.json")[1]
    assert re.search("material concrete .*2.4e-09 t/mm³", defaults(out))


def test_editors_accept_short_scenes() -> None:
    judge = jsonschema.Draft7Validator(scene_schema())
    data = tomllib.loads(SHORT)
    for short in (data, data | {"material": "concrete"}, data | {"material": {"name": "steel"}}):
        assert not list(judge.iter_errors(short))
    for wrong in ("stone", {"density": 2.4e-9}, {"name": "stone"}):
        assert list(judge.iter_errors(data | {"material": wrong}))


@pytest.mark.parametrize("scene", ["wall", "tsb1-shaft"])
def test_settings_of_friction_replace_it_in_both_spellings(scene: str) -> None:
    """Whether the scene states it or not, and in which spelling."""
    names = ("effects.friction", "effects.friction.coefficient")
    for before in ((), *((f"{name}=0.4",) for name in names)):
        for name in names:
            case = load_case(scene, [*before, f"{name}=0.5"])
            assert case.scene.effects.friction.coefficient == 0.5
            assert case.changed({name: 0.7}).scene.effects.friction.coefficient == 0.7
    case = load_case(scene, ["effects.friction=0.4", "effects.friction.stick_stiffness=50.0"])
    assert case.scene.effects.friction.coefficient == 0.4


@pytest.mark.parametrize(
    "words", ["material=steel", "mesh.around=12", "effects.gravity=[0, 0, -9810]"]
)
def test_settings_state_what_a_changed_case_states(words: str) -> None:
    """By words and by keys, when a scene is read and afterwards; None leaves the key out again."""
    plain, key = load_case("tsb1-pipe"), words.partition("=")[0]
    read = load_case("tsb1-pipe", [words])
    value = dict(flat(read.keys)).get(key, "steel")
    assert plain.changed({key: value}) == plain.changed([words]) == read != plain
    bare = load_case("cubes")  # without [material] and [effects]
    assert bare.changed({"material.tensile_strength": None, key: None}) == bare
    if key == "effects.gravity":
        assert read.changed({key: None}).values == plain.values


@pytest.mark.quick
def test_a_folder_of_results_does_not_hide_a_built_in_scene_or_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tubelock mbd arch -o arch` runs twice."""
    monkeypatch.chdir(tmp_path)
    for name in ("arch", "paper-480"):
        (tmp_path / name).mkdir()
    assert load_case("arch").name == "arch"
    assert stands_for_builtin(Path("paper-480"), "study")
    assert not stands_for_builtin(Path("arch"), "study")


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="no /dev/stdin here")
def test_a_redirected_scene_names_files_of_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.toml").write_text('[block]\ntype = "mesh"\n[[parts]]\nfile = "cubes.obj"\n')
    before = os.dup(0)
    try:
        with Path("s.toml").open() as scene:
            os.dup2(scene.fileno(), 0)
        (part,) = load_case("/dev/stdin").reads[1:]
    finally:
        os.dup2(before, 0)
        os.close(before)
    assert part.absolute() == tmp_path / "cubes.obj"
