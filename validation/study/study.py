"""Studies: one scene, some of its parameters over lists or ranges, one question asked of each.

A study is a short TOML file::

    scene = "tsb1-pipe"
    quantity = "rigid"
    [parameters]
    "block.amplitude" = [10, 15, 20]
    "block.thickness" = { from = 30, to = 60, step = 10 }
    [settings]
    "mesh.around" = 24

Its designs are numbered; the last parameter varies fastest.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import os
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from geometry.errors import unreadable
from validation.errors import InputError
from validation.scene.builtin import builtin_text
from validation.scene.read import SceneFile, apply_overrides, check_scene, read_text, scene_data
from validation.scene.sections import RigidSection
from validation.scene.usage import recording, uncounted

if TYPE_CHECKING:
    from validation.build.blocks import BuiltScene

Quantity = Literal["rigid", "fem"]
Value = Any
"""A value of a scene: number, string, boolean or a list of them."""

#: Columns of each kind of answer, with their SQLite types.
COLUMNS: dict[Quantity, dict[str, str]] = {
    "rigid": {
        "mechanism": "TEXT",
        "equilibrium": "INTEGER",
        "residual": "REAL",
        "effective_count_percent": "REAL",
        "effective_area_percent": "REAL",
        "p_eff": "REAL",
        "p_eff_pooled": "REAL",
        "p_max": "REAL",
        "n_blocks": "INTEGER",
        "n_contacts": "INTEGER",
        "iterations": "INTEGER",
    },
    "fem": {
        "max_displacement": "REAL",
        "sigma_1_max": "REAL",
        "sigma_3_min": "REAL",
        "p_eff": "REAL",
        "p_eff_pooled": "REAL",
        "p_max": "REAL",
        "residual": "REAL",
        "energy_balance": "REAL",
        "n_elements": "INTEGER",
    },
}

#: Of this version is the canonical text that identifies a study.
_FORMAT = 1
#: Sections that no rigid-block answer depends on, but for what blocks weigh.
_DEFORMABLE = ("material", "contact", "effects", "fem")
#: More values of one parameter than this are a slip of the pen.
_MOST_VALUES = 100_000
#: Values of one parameter that are tried before a study begins.
_MOST_TRIED = 500
#: Most designs of one study, and the CPU time of the quickest ones [s].
_MOST_DESIGNS, _QUICKEST_DESIGN = 10_000_000, 0.05


@dataclass(frozen=True)
class Study:
    """A checked study."""

    name: str
    """Name of the built-in study or stem of the file."""
    quantity: Quantity
    """``rigid`` or ``fem``."""
    scene: Mapping[str, Any]
    """Data of the scene, settings applied."""
    parameters: tuple[tuple[str, tuple[Value, ...]], ...]
    """``section.key`` and its values, in the order of the file."""
    reads: tuple[Path, ...] = ()
    """Files that say what the study is: its own and that of its scene."""

    @property
    def n_designs(self) -> int:
        """Number of designs: the product of the numbers of values."""
        return math.prod(len(values) for _, values in self.parameters)

    def design(self, number: int) -> dict[str, Value]:
        """Parameter values of a design, counted from 0; the last parameter varies fastest."""
        chosen: dict[str, Value] = {}
        for path, values in reversed(self.parameters):
            number, place = divmod(number, len(values))
            chosen[path] = values[place]
        return {path: chosen[path] for path, _ in self.parameters}

    def scene_file(self, number: int) -> SceneFile:
        """Checked scene of a design.

        Raises
        ------
        InputError
            When its values do not go together.
        """
        name = f"{self.name}[{number}]"
        return SceneFile(name=name, scene=check_scene(self._data(self.design(number)), name))

    def _data(self, values: Mapping[str, Value]) -> dict[str, Any]:
        return apply_overrides(self.scene, _assignments(values))

    @cached_property
    def canonical(self) -> str:
        """Text that is the same for equal studies, whatever their files look like."""
        scene = check_scene(self._data(self.design(0)), self.name).model_dump(mode="json")
        if self.quantity == "rigid":
            weight = _weight(scene)
            scene = {key: value for key, value in scene.items() if key not in _DEFORMABLE}
            scene |= weight
        content = {
            "format": _FORMAT,
            "quantity": self.quantity,
            "scene": scene,
            "parameters": [[path, list(values)] for path, values in self.parameters],
        }
        return json.dumps(content, sort_keys=True, allow_nan=False)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of `canonical`."""
        return hashlib.sha256(self.canonical.encode()).hexdigest()


# ---------------------------------------------------------------------------------------------
# Reading


def load_study(source: str, overrides: Iterable[str] = ()) -> Study:
    """Read and check a study: a TOML file or a built-in one.

    Overrides are ``section.key=value``, applied to the scene after ``[settings]``.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    """
    path = Path(source)
    builtin = path.suffix != ".toml" and unreadable(path) == "no such file"
    text = builtin_text(source, "study") if builtin else read_text(path, "a study in TOML")
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not TOML: {error}") from None
    folder = None if builtin else path.parent
    study = check_study(data, source if builtin else path.stem, folder, overrides)
    own = () if builtin else (path,)
    return replace(study, reads=(*own, *study.reads))


def check_study(
    data: Mapping[str, Any], name: str, folder: Path | None = None, overrides: Iterable[str] = ()
) -> Study:
    """Check a study's data; a relative scene file lies in the folder, or in the working one.

    Raises
    ------
    InputError
        One line naming the first thing that is wrong.
    """
    known = ["scene", "quantity", "parameters", "settings"]
    for key in data:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.4)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"{name}: unknown key {key}{hint}; expected {', '.join(known)}")
    scene, quantity = data.get("scene"), data.get("quantity", "rigid")
    if not isinstance(scene, str):
        raise InputError(
            f'{name}: scene: got {scene!r}, expected a scene, e.g. scene = "tsb1-pipe"'
        )
    if quantity not in COLUMNS:
        raise InputError(
            f"{name}: quantity: got {quantity!r}, expected one of {', '.join(COLUMNS)}"
        )
    for section in ("parameters", "settings"):
        if not isinstance(data.get(section, {}), dict):
            raise InputError(f"{name}: [{section}]: expected a section of section.key = values")
    parameters = tuple(
        (path, _values(f"{name}: {path}", given))
        for path, given in _flat(data.get("parameters", {}), ())
    )
    if not parameters:
        raise InputError(
            f"{name}: [parameters] is missing or empty: name at least one parameter of the "
            'scene, e.g. "block.amplitude" = [10, 20]'
        )
    settings = dict(_flat(data.get("settings", {}), ()))
    _refuse_twice(name, parameters, settings)
    source = _scene_source(scene, folder)
    _, base = scene_data(source)
    base = apply_overrides(base, [*_assignments(settings), *overrides])
    files = [Path(source), *(Path(part["file"]) for part in base.get("parts", ()))]
    reads = tuple(file for file in files if file.is_file())
    study = Study(name, quantity, base, parameters, reads)
    _check_count(study)
    _check_values(study)
    return study


def _scene_source(scene: str, folder: Path | None) -> str:
    beside = None if folder is None else folder / scene
    return str(beside) if beside is not None and beside.suffix == ".toml" else scene


def _is_range(given: Any) -> bool:
    return isinstance(given, dict) and ("from" in given or "to" in given)


def _flat(data: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """``section.key`` and value, from quoted keys and from nested tables alike."""
    for key, value in data.items():
        place = (*above, key)
        if isinstance(value, dict) and not _is_range(value):
            yield from _flat(value, place)
        else:
            yield ".".join(place), value


def _values(place: str, given: Any) -> tuple[Value, ...]:
    """Values of a parameter, from a list or a range."""
    if _is_range(given):
        return _range(place, given)
    if not isinstance(given, list):
        raise InputError(
            f"{place}: got {given!r}, expected a list such as [10, 15] or a range such as "
            "{ from = 10, to = 25, step = 5 }; a single value belongs in [settings]"
        )
    if not given:
        raise InputError(f"{place}: the list is empty; give at least one value")
    texts = [json.dumps(value, default=str) for value in given]
    for text in texts:
        if texts.count(text) > 1:
            raise InputError(f"{place}: {text} is given twice; every design is computed once")
    return tuple(given)


def _range(place: str, given: Mapping[str, Any]) -> tuple[Value, ...]:
    """Values from, from + step, … up to and including to; exact in decimals."""
    if set(given) != {"from", "to", "step"}:
        raise InputError(
            f"{place}: got a range with {', '.join(given)}; expected from, to and step, all three"
        )
    numbers = []
    for key in ("from", "to", "step"):
        value = given[key]
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise InputError(f"{place}: range {key}: got {value!r}, expected a finite number")
        numbers.append(Decimal(repr(value)))
    start, stop, step = numbers
    count = 0 if step == 0 else int((stop - start) / step) + 1 if (stop - start) * step >= 0 else 0
    if count < 1:
        raise InputError(
            f"{place}: the range from {start} to {stop} with step {step} is empty; "
            "expected a step that leads from the first value to the last"
        )
    if count > _MOST_VALUES:
        raise InputError(f"{place}: the range has {count} values, more than {_MOST_VALUES}")
    whole = all(isinstance(given[key], int) for key in given)
    return tuple((int if whole else float)(start + k * step) for k in range(count))


def _weight(scene: Mapping[str, Any]) -> dict[str, Any]:
    """What rigid blocks weigh by: nothing where the scene names no gravity."""
    gravity = (scene.get("effects") or {}).get("gravity")
    if gravity is None:
        return {}
    return {"weight": {"gravity": gravity, "density": (scene.get("material") or {}).get("density")}}


def _refuse_twice(
    name: str, parameters: tuple[tuple[str, tuple[Value, ...]], ...], settings: Mapping[str, Any]
) -> None:
    paths = [path for path, _ in parameters]
    for path in paths:
        if path in settings or paths.count(path) > 1:
            raise InputError(f"{name}: {path} is given twice, in [parameters] and [settings]")


def _assignments(values: Mapping[str, Value]) -> list[str]:
    """Values as ``section.key=value`` (JSON scalars and lists are TOML as well)."""
    return [f"{path}={json.dumps(value, default=str)}" for path, value in values.items()]


def _check_count(study: Study) -> None:
    """Refuse a study that nobody lives to see the end of."""
    if study.n_designs <= _MOST_DESIGNS:
        return
    counts = " × ".join(str(len(values)) for _, values in study.parameters)
    years = study.n_designs * _QUICKEST_DESIGN / (365.0 * 86400.0)
    raise InputError(
        f"{study.name}: got {counts} = {study.n_designs:.2g} designs, some {years:.2g} CPU years "
        f"at {_QUICKEST_DESIGN:g} CPU s each; expected at most {_MOST_DESIGNS:.0e}: take fewer "
        "values ([parameters]), or larger steps"
    )


def _check_values(study: Study) -> None:
    """Refuse unknown parameters and values that no scene takes; combinations are tried later.

    Of very many values those at the ends and some between them are tried: a scene is read for each.
    """
    first = study.design(0)
    check_scene(study._data(first), study.name)
    for path, values in study.parameters:
        count = min(len(values), _MOST_TRIED)
        for place in (k * (len(values) - 1) // max(count - 1, 1) for k in range(count)):
            try:
                check_scene(study._data(first | {path: values[place]}), study.name)
            except InputError as error:
                if path in str(error):
                    raise


# ---------------------------------------------------------------------------------------------
# One design


@dataclass(frozen=True)
class Row:
    """One design of a study and what came out."""

    number: int
    status: Literal["ok", "failed"]
    """``failed``: nothing could be computed, `message` says why. A tube that carries no load is
    ``ok``: that is an answer."""
    message: str
    """Why it failed; of an answer, the parameters on which it does not depend."""
    parameters: dict[str, Value]
    results: dict[str, Any]
    """By the names in `COLUMNS`; empty if failed."""
    cpu_seconds: float
    """CPU time of the design [s]."""
    worker: tuple[int, float] = (0, 0.0)
    """Process that computed it and the CPU time it had used by then [s]."""
    unused: tuple[str, ...] = ()
    """Keys of its scene on which its results do not depend; empty if failed."""


def run_design(study: Study, number: int) -> Row:
    """Compute one design, counted from 0; whatever goes wrong with it becomes its message."""
    rigid = study.quantity == "rigid"
    # Other threads of the process may be at work on other designs; fem may use several itself.
    clock = time.thread_time if rigid else time.process_time
    start = clock()
    failure, results = "", {}
    unused: tuple[str, ...] = ()
    try:
        file = study.scene_file(number)
        with recording(file.scene) as use:
            results = _rigid_results(file) if rigid else _fem_results(file)
        unused = use.unused
    except Exception as error:
        words = " ".join(str(error).split()) or "no message"
        failure = words if isinstance(error, ValueError) else f"{type(error).__name__}: {words}"
    idle = [path for path, _ in study.parameters if path in unused]
    return Row(
        number=number,
        status="failed" if failure else "ok",
        message=failure or "; ".join(f"{path}: no part of this answer" for path in idle),
        parameters=study.design(number),
        results=results,
        cpu_seconds=clock() - start,
        worker=(os.getpid(), time.process_time()),
        unused=unused,
    )


def refuse_idle_parameters(study: Study) -> None:
    """Refuse a rigid study that varies what no rigid answer depends on: its rows would be equal.

    The first and the last design say it. Answers of deformable blocks take long: there each row
    says it (`Row.message`).
    """
    if study.quantity != "rigid":
        return
    idle = {path for path, values in study.parameters if len(values) > 1}
    for number in (0, study.n_designs - 1):
        try:
            file = study.scene_file(number)
            with recording(file.scene) as use:
                _rigid_results(file)
        except ValueError:
            return  # a design that cannot be computed says nothing; its row will say why
        idle &= set(use.unused)
    if idle:
        raise InputError(
            f"{study.name}: {', '.join(sorted(idle))}: no answer of rigid blocks depends on it, so "
            'rows would be equal; remove it from [parameters], or ask quantity = "fem"'
        )


def failed_row(study: Study, number: int, message: str) -> Row:
    """Row of a design whose process did not live to report it."""
    return Row(number, "failed", message, study.design(number), {}, 0.0)


#: What ``[rigid]`` can ask and no column shows.
_NO_COLUMN = ("collapse", "sliding", "ranges", "margin")


def _of_the_columns(built: BuiltScene) -> BuiltScene:
    """Return a scene that asks for nothing that no column of a study shows."""
    return replace(built, scene=built.scene.changed({"rigid": dict.fromkeys(_NO_COLUMN, False)}))


def _rigid_results(file: SceneFile) -> dict[str, Any]:
    from validation.build.blocks import build_scene
    from validation.run.rigid.answer import analyse_rigid

    built = build_scene(file, command="sweep")
    with uncounted(*((RigidSection, key) for key in _NO_COLUMN)):
        run = analyse_rigid(_of_the_columns(built))
    result = run.result
    # With friction asked, the forces and the verdict are those with it.
    friction = None if run.further is None else run.further.friction
    found: dict[str, Any] = {
        "mechanism": str(result.mechanism),
        "equilibrium": int(run.carried.holds),
        "residual": result.equilibrium.residual if friction is None else friction.residual,
        "n_blocks": result.n_blocks,
        "n_contacts": result.n_contacts,
        "iterations": result.equilibrium.iterations,
    }
    measures = run.measures
    names = ("effective_count_percent", "effective_area_percent", "p_eff", "p_eff_pooled", "p_max")
    for name in names:
        found[name] = None if measures is None else getattr(measures, name)
    return found


def _fem_results(file: SceneFile) -> dict[str, Any]:
    from validation.run.solve import run_scene
    from validation.scene.read import DeformableScene

    if not isinstance(file.scene, DeformableScene):
        raise InputError(f"block.type {file.scene.block.type!r} is not built for `fem` yet")
    run = run_scene(file.name, file.scene)
    principal = [run.principal(b) for b in run.deformable.deformable_blocks.tolist()]
    contact = run.contact if run.meets else None
    return {
        "max_displacement": run.largest_displacement,
        "sigma_1_max": max(float(p[:, 0].max()) for p in principal),
        "sigma_3_min": min(float(p[:, 2].min()) for p in principal),
        "p_eff": None if contact is None else contact.p_eff,
        "p_eff_pooled": None if contact is None else contact.p_eff_pooled,
        "p_max": None if contact is None else contact.p_max_face,
        "residual": run.answer.residual,
        "energy_balance": run.energy_balance,
        "n_elements": run.deformable.model.n_elements,
    }
