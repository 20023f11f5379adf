"""Units of scenes: texts with units, and numbers in another unit than the scene's."""

import tomllib

import jsonschema
import pytest

from geometry import RefusedError
from validation import InputError, builtin_text, load_case
from validation.scene.keys.quantities import parse_unit
from validation.scene.keys.schema import scene_schema
from validation.scene.read import apply_overrides, check_scene

pytestmark = pytest.mark.quick


def number(scene: str, key: str, text: str) -> float:
    method = ["fem.method=explicit"] if key.startswith("fem.") else []
    found = load_case(scene, [*method, f"{key}={text}"]).scene
    for name in key.split("."):
        found = getattr(found, name)
    return found


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("material.density", "2400 kg/m3", 2.4e-9),
        ("material.density", "2.4 g/cm^3", 2.4e-9),
        ("material.density", "2.4 t/m³", 2.4e-9),
        ("material.young_modulus", "33 GPa", 33000.0),
        ("material.young_modulus", "33e3 N/mm**2", 33000.0),
        ("load.pressure", "10 kPa", 0.01),
        ("load.pressure", "-0.1 bar", -0.01),
        ("block.height", "20 cm", 200.0),
        ("block.height", "8 inch", 203.2),
        ("fem.end_time", "20 ms", 0.02),
        ("effects.rayleigh.mass_proportional", "2 s^-1", 2.0),
        ("contact.maximum_stiffness", "1e12 Pa/m", 1e3),
    ],
)
def test_a_text_with_a_unit_is_the_number_of_the_scene(
    key: str, text: str, expected: float
) -> None:
    """Exactly: the same bits as the number written in the unit of the key."""
    assert number("tsb1-pipe", key, text) == expected


def test_vectors_may_have_units() -> None:
    gravity = number("tsb1-pipe", "effects.gravity", '[0, "0 m/s2", "-9.81 m/s²"]')
    assert gravity == (0.0, 0.0, -9810.0)


def test_units_multiply_and_divide() -> None:
    newton_millimetre, joule = parse_unit("N mm"), parse_unit("N·m")
    assert newton_millimetre is not None
    assert joule is not None
    assert joule.dimension == newton_millimetre.dimension == parse_unit("t*mm^2/s2").dimension
    assert joule.size == 1000 * newton_millimetre.size
    for text in ("", "mm//s", "mm/s/s", "furlong", "mm^9", "2 mm", "m^-"):
        assert parse_unit(text) is None


# ---------------------------------------------------------------------------------------------
# Slips


@pytest.mark.parametrize(
    ("scene", "change", "words"),
    [
        ("tsb1-pipe", "material.density=2400", r"kg/m³\? write 2.4e-09"),
        ("tsb1-pipe", "material.density=2.4", r"g/cm³ or t/m³\? write 2.4e-09"),
        ("tsb1-pipe", "material.density=2.4e-6", r"kg/mm³\? write 2.4e-09"),
        ("tsb1-pipe", "material.young_modulus=33", r"117 m/s.*GPa\? write 33000"),
        ("tsb1-pipe", "material.young_modulus=33e9", r"Pa\? write 33000"),
        ("tsb1-pipe", "effects.gravity=[0, 0, -9.81]", r"m/s²\? write 9810"),
        ("tsb1-pipe", "contact.clearance_at_zero_pressure=1e-6", r"m\? write 0.001"),
        ("tsb1-pipe", "effects.friction=30", r"an angle in degrees\? write 0.577"),
        ("tsb1-pipe", "load.pressure=1e4", r"Pa\? write 0.01"),
        ("brick-stack", "block.size=[0.25, 0.12, 0.06]", r"m\? write 250"),
        ("arch", "effects.gravity=[0, 0, -9.81]", r"m/s²\? write 9810"),
        ("wall", "material.density=2400", r"kg/m³\? write 2.4e-09"),
        ("cantilever", "block.size=[0.4, 0.04, 0.06]", r"m\? write 400"),
    ],
)
def test_slips_of_units_are_named_and_can_be_meant(scene: str, change: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        load_case(scene, [change])
    message = str(refused.value)
    assert "\n" not in message
    key, _, text = change.partition("=")
    with pytest.raises(InputError) as varied:  # as studies vary it
        load_case(scene).changed({key: tomllib.loads(f"value = {text}")["value"]})
    assert str(varied.value) == message
    # What the message says makes the scene pass: for all that looks wrong, one after the other.
    accepted: list[str] = []
    for _ in range(4):
        if not message:
            break
        accepted.append(message.split('accept = ["')[1].split('"', maxsplit=1)[0])
        message = ""
        try:
            load_case(scene, [change, f"plausibility.accept={accepted}"])
        except InputError as error:
            message = str(error)
    assert not message


@pytest.mark.slow
def test_editors_know_texts_with_units() -> None:
    judge = jsonschema.Draft7Validator(scene_schema())
    data = tomllib.loads(builtin_text("tsb1-pipe"))
    for change, good in (
        ('material.density="2400 kg/m3"', True),
        ('effects.gravity=[0, 0, "-9.81 m/s2"]', True),
        ("material.density=-1.0", False),
        ('mesh.around="84 mm"', False),
    ):
        changed = apply_overrides(data, [change])
        assert judge.is_valid(changed) is good
        if good:
            check_scene(changed)


def test_a_size_that_no_block_has_can_be_meant_as_well() -> None:
    """The same key as for slips of units: a dust of blocks, and what the message names lets it."""
    small = ["block.edge=0.4", "assembly.rings=0"]
    case = load_case("octahedra", small, method="rigid")
    with pytest.raises(RefusedError, match=r"a block measures 0\.3.*accept = \[\"block\.size\"\]"):
        _ = case.problem
    meant = case.changed(["plausibility.accept=['block.size']"])
    assert meant.problem.blocks.n_blocks == 7
