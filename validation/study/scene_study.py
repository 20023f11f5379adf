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
import math
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Any

from geometry.answer import TITLES
from geometry.errors import RefusedError
from validation.case import Case
from validation.errors import InputError
from validation.scene.builtin import builtin_text, stands_for_builtin
from validation.scene.deformable import parse_share
from validation.scene.keys.toml_text import flat, is_range
from validation.scene.read import (
    Settings,
    apply_overrides,
    assignments,
    check_scene,
    read_text,
    scene_data,
)
from validation.study.study import (
    COLUMNS,
    NO_COLUMN,
    Quantity,
    Study,
    Value,
    data_digest,
    digests,
    value_text,
)

#: Sections on which no row depends.
_IN_NO_ROW = {"combinations", "pictures", "sections", "stages"}
#: More values of one parameter than this are a slip of the pen.
_MOST_VALUES = 100_000
#: Values of one parameter that are tried before a study begins.
_MOST_TRIED = 500
#: Most designs whose checked scenes are kept.
_MOST_KNOWN = 1_000
#: Most designs of one study, and the CPU time of the quickest ones [s].
MOST_DESIGNS, _QUICKEST_DESIGN = 10_000_000, 0.05


@dataclass(frozen=True)
class SceneStudy(Study):
    """A checked study of one scene, whose parameters are keys ``section.key``."""

    scene: Mapping[str, Any] = field(default_factory=dict)
    """Data of the scene, settings applied."""
    reads: tuple[Path, ...] = ()
    """Files that say what the study is: its own and that of its scene."""

    @property
    def title(self) -> str:
        """Name, method, and the load where no design changes it."""
        if any(path.startswith("load") for path, _ in self.parameters):
            return super().title
        return f"{super().title}: {self.case(0).load_words}"

    def unit_of(self, column: str) -> str:
        """Unit of a measure or of a key; empty where it has none."""
        if "." not in column:
            return super().unit_of(column)
        return self.case(0).unit(column)

    def case(self, number: int) -> Case:
        """Case of a design; its scene is checked once."""
        known = self._known.get(number)
        if known is None:
            data = apply_overrides(self.scene, self.design(number))
            scene, name = check_scene(data, self.name), f"{self.name}[{number}]"
            known = Case(None, scene.method, name, scene)
            if len(self._known) < _MOST_KNOWN:
                self._known[number] = known
        return replace(known)  # what is built for it goes with it

    @cached_property
    def _known(self) -> dict[int, Case]:
        """Cases that were checked already, by the number of the design."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields alone: what is known here is not sent to workers."""
        return {part.name: getattr(self, part.name) for part in fields(self)}

    def results(self, number: int) -> tuple[dict[str, Any], list[str]]:
        """Answer a design; remarks name parameters on which it does not depend."""
        results, remarks = super().results(number)
        idle = [f"{key}: not used by this method" for key in self._idle(self.case(number))]
        return results, [*remarks, *idle]

    def idle_parameters(self) -> list[str]:
        """Parameters on which no answer of its method depends."""
        return self._idle(self.case(0))

    def _idle(self, case: Case) -> list[str]:
        """Those on which the answer of one design does not depend."""
        method = "rigid" if self.quantity == "rigid" else case.method.name
        none = {f"rigid.{name}" for name in NO_COLUMN} if method == "rigid" else set()
        use, paths = case.key_use(method), [path for path, _ in self.parameters]
        none |= {path for path in paths if path.partition(".")[0] in _IN_NO_ROW}
        return [path for path in paths if path in none or use.is_idle(path)]

    def refuse_idle_parameters(self) -> None:
        """Refuse to vary what no row, or no answer of rigid blocks, depends on."""
        never = [path for path in self.varied if path.partition(".")[0] in _IN_NO_ROW]
        if never:
            raise InputError(
                f"{self.name}: {', '.join(never)}: no row of a study depends on it, so rows would "
                "be equal; remove it from [parameters]"
            )
        if self.quantity != "rigid":
            return
        try:
            idle = set(self.varied).intersection(self.idle_parameters())
        except ValueError:
            return  # a design that cannot be computed says nothing; its row will say why
        if idle:
            raise InputError(
                f"{self.name}: {', '.join(sorted(idle))}: no answer of rigid blocks depends on "
                'it, so rows would be equal; remove it from [parameters], or ask quantity = "fem"'
            )

    @cached_property
    def digest(self) -> str:
        """Digest of what its designs share: the same for equal studies, however they are written.

        That is the scene as it is stated, without the parameters, and the files of its blocks.
        """
        keys = self.case(0).keys
        files = digests(Path(part["file"]) for part in self.scene.get("parts", ()))
        paths = [path for path, _ in self.parameters]
        for path in paths:
            *sections, key = path.split(".")
            section = keys
            for name in sections:
                section = section.get(name, {})
            section.pop(key, None)
        return data_digest([self.quantity, keys, sorted(paths), files])

    @cached_property
    def _texts(self) -> list[tuple[str, list[str]]]:
        """Texts of the values of each parameter, the one that varies fastest first."""
        return [(path, list(map(value_text, v))) for path, v in reversed(self.parameters)]

    def question(self, number: int) -> str:
        """Digest of what a design asks, whatever its number is."""
        values = []
        for path, texts in self._texts:
            number, place = divmod(number, len(texts))
            values.append((path, texts[place]))
        return data_digest([self.digest, *sorted(values)])


# ---------------------------------------------------------------------------------------------
# Reading


def load_study(source: str, overrides: Settings = ()) -> SceneStudy:
    """Read and check a study: a TOML file or a built-in one.

    Overrides are ``section.key=value``, applied to the scene after ``[settings]``.
    """
    path = Path(source)
    builtin = stands_for_builtin(path, "study")
    text = builtin_text(source, "study") if builtin else read_text(path, "a study in TOML")
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: TOML syntax error: {error}") from None
    if builtin:
        return check_study(data, source, None, overrides)
    return check_study(data, path.stem, path.parent, overrides, own=(path,))


def check_study(
    data: Mapping[str, Any],
    name: str,
    folder: Path | None = None,
    overrides: Settings = (),
    *,
    own: tuple[Path, ...] = (),
) -> SceneStudy:
    """Check a study's data; a relative scene file lies in the folder, or in the working one.

    ``own`` is the file that it was read from.
    """
    check_keys(name, data, ("scene", "quantity", "accuracy", "parameters", "settings"))
    scene, quantity = data.get("scene"), data.get("quantity", "rigid")
    if not isinstance(scene, str | Mapping):
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
        (path, parameter_values(f"{name}: {path}", given))
        for path, given in flat(data.get("parameters", {}))
    )
    if not parameters:
        raise InputError(
            f"{name}: [parameters] is missing or empty: name at least one parameter of the "
            'scene, e.g. "block.amplitude" = [10, 20]'
        )
    settings = dict(flat(data.get("settings", {})))
    given = (place for place, _ in assignments(overrides))
    _refuse_twice(name, parameters, {*settings, *given})
    files = []
    if isinstance(scene, str):
        source = _scene_source(scene, folder)
        files, (_, scene) = [Path(source)], scene_data(source)
    base = apply_overrides(apply_overrides(scene, settings), overrides)
    files += (Path(part["file"]) for part in base.get("parts", ()))
    if "accuracy" in data:
        asked = _accuracy(name, data["accuracy"], quantity)
        base = apply_overrides(base, {"fem.accuracy": asked})
    reads = (*own, *(file for file in files if file.is_file()))
    study = SceneStudy(name, quantity, parameters, base, reads)
    _check_count(study)
    _check_values(study)
    return study


def check_keys(place: str, data: Mapping[str, Any], known: Sequence[str]) -> None:
    """Reject a key that is not known, with the one that was meant."""
    for key in data:
        if key not in known:
            raise InputError(
                f"{place}: unknown key {key}{did_you_mean(key, known, 0.4)}; expected "
                f"{', '.join(known)}"
            )


def did_you_mean(given: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return a question for the known name nearest to a given one; nothing where none is near."""
    near = difflib.get_close_matches(given, list(known), n=1, cutoff=cutoff)
    return f"; did you mean {near[0]!r}?" if near else ""


def _scene_source(scene: str, folder: Path | None) -> str:
    beside = None if folder is None else folder / scene
    return str(beside) if beside is not None and beside.suffix == ".toml" else scene


def parameter_values(place: str, given: Any) -> tuple[Value, ...]:
    """Values of a parameter, from a list or a range."""
    if is_range(given):
        return _range(place, given)
    if not isinstance(given, list):
        raise InputError(
            f"{place}: got {given!r}, expected a list such as [10, 15] or a range such as "
            "{ from = 10, to = 25, step = 5 }; a single value belongs in [settings]"
        )
    if not given:
        raise InputError(f"{place}: the list is empty; give at least one value")
    text, times = Counter(map(value_text, given)).most_common(1)[0]
    if times > 1:
        raise InputError(f"{place}: {text} is given twice; every design is computed once")
    return tuple(given)


def _accuracy(name: str, given: Any, quantity: Quantity) -> dict[str, float]:
    """Read the error bars that a study requests of its deformable designs, by measure."""
    from fem.accuracy.converge import TARGETS, checked_targets

    if quantity != "fem":
        raise InputError(
            f"{name}: accuracy: rigid designs have no error bars; remove the key, or write "
            'quantity = "fem"'
        )
    by_measure = given if isinstance(given, Mapping) else dict.fromkeys(TARGETS, given)
    try:
        shares = {key: parse_share(share) for key, share in by_measure.items()}
        result = checked_targets(shares)  # type: ignore[arg-type]
    except RefusedError:
        result = {}
    if not 0 < len(result) == len(by_measure):
        raise InputError(
            f'{name}: accuracy: got {given!r}, expected a share between 0 and 1, e.g. "10%", or '
            f'such shares by measure, e.g. {{ p_eff = "10%" }}: {", ".join(("u", *TITLES))}'
        )
    return result


def _range(place: str, given: Mapping[str, Any]) -> tuple[Value, ...]:
    """Values from, from + step, … up to and including to; exact in decimals."""
    if set(given) != {"from", "to", "step"}:
        raise InputError(
            f"{place}: got a range with {', '.join(given)}; expected from, to and step, all three"
        )
    start, stop, step = (
        _decimal(f"{place}: range {key}", given[key]) for key in ("from", "to", "step")
    )
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


def _decimal(place: str, value: Any) -> Decimal:
    """Exact value of a number as it is written."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and math.isfinite(value)):
        raise InputError(f"{place}: got {value!r}, expected a finite number")
    return Decimal(repr(value))


def _refuse_twice(
    name: str, parameters: tuple[tuple[str, tuple[Value, ...]], ...], settings: set[str]
) -> None:
    paths = [path for path, _ in parameters]
    for path in paths:
        if path in settings or paths.count(path) > 1:
            raise InputError(f"{name}: {path} is given twice, in [parameters] and [settings]")


def _check_count(study: Study) -> None:
    """Refuse a study that nobody lives to see the end of."""
    if study.n_designs <= MOST_DESIGNS:
        return
    counts = " × ".join(str(len(values)) for _, values in study.parameters)
    years = study.n_designs * _QUICKEST_DESIGN / (365.0 * 86400.0)
    raise InputError(
        f"{study.name}: got {counts} = {study.n_designs:.2g} designs, some {years:.2g} CPU years "
        f"at {_QUICKEST_DESIGN:g} CPU s each; expected at most {MOST_DESIGNS:.0e}: take fewer "
        "values ([parameters]), or larger steps"
    )


def _check_values(study: SceneStudy) -> None:
    """Refuse unknown parameters and values that no scene takes; combinations are tried later.

    Of very many values those at the ends and some between them are tried: a scene is read for each.
    """
    first, _ = study.design(0), study.case(0)
    for path, values in study.parameters:
        count = min(len(values), _MOST_TRIED)
        for place in (k * (len(values) - 1) // max(count - 1, 1) for k in range(count)):
            try:
                study.case(study.number(first | {path: values[place]}))
            except InputError as error:
                if path in str(error):
                    raise
