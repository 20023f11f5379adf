"""Options that several or all commands share, and how shells complete their values."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.errors import NOT_REACHED, InputError, key_places
from validation.scene.builtin import builtin_names

if TYPE_CHECKING:
    from rich.console import Console

    from geometry.answer import Answer
    from validation.case import Case, Method
    from validation.output.outputs import Outputs


# ---------------------------------------------------------------------------------------------
# Completion: the shell runs this at every TAB, so imports are deferred until they are needed


def complete_scenes(incomplete: str) -> list[str]:
    """Names of built-in scenes; the shell offers files by itself where none fits."""
    return [name for name in builtin_names() if name.startswith(incomplete)]


def complete_studies(incomplete: str) -> list[str]:
    """Names of built-in studies."""
    return [name for name in builtin_names("study") if name.startswith(incomplete)]


def complete_effects(incomplete: str) -> list[str]:
    """Names of effects that can be decided."""
    from validation.scene.deformable import EffectName

    return [name for name in EffectName if name.startswith(incomplete)]


def complete_flavours(incomplete: str) -> list[str]:
    """Flavours of decks."""
    return [word for word in ("general", "standard", "calculix") if word.startswith(incomplete)]


def complete_settings(ctx: Any, incomplete: str) -> list[str]:
    """Keys that the scene on the command line may have, as ``section.key=``."""
    keys = _keys_of(ctx.params.get("scene"))
    return [f"{key}=" for key in keys if key.startswith(incomplete)]


def _keys_of(scene: str | None) -> list[str]:
    """All keys of one kind of scene; of every kind where the scene is not known."""
    from validation.scene.read import SCENE_TYPES, scene_data

    kinds = list(SCENE_TYPES.values())
    if scene is not None:
        with suppress(InputError, KeyError, TypeError):
            kinds = [SCENE_TYPES[scene_data(scene)[1]["block"]["type"]]]
    return sorted({key for kind in kinds for key in key_places(kind)})


# ---------------------------------------------------------------------------------------------
# Options

SceneArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Built-in scene (see `scenes`) or TOML file.",
        autocompletion=complete_scenes,
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.KEY=VALUE",
        help="Set a value of the scene; repeatable.",
        autocompletion=complete_settings,
    ),
]
AutoOption = Annotated[
    str | None,
    typer.Option(
        "--auto",
        metavar="1%",
        help="Disable effects whose influence on p_max, p_eff and displacement is below this "
        "tolerance.",
    ),
]
KeepOption = Annotated[
    list[str] | None,
    typer.Option(
        "--keep",
        metavar="EFFECT",
        help="Effect that --auto must not change; repeatable.",
        autocompletion=complete_effects,
    ),
]
CombinationsOption = Annotated[
    bool,
    typer.Option(
        "--combinations",
        help="Solve the load combinations of the scene, [combinations.NAME], with their envelope.",
    ),
]
JsonOption = Annotated[
    str | None,
    typer.Option(
        "--json", metavar="FILE|-", help="Write the result as JSON; - writes to standard output."
    ),
]


WorkersOption = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", help="Number of processes; by default one per core."),
]
SchedulerOption = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Run on this Dask cluster.")
]


def scene_outputs(
    file: Case,
    json: str | None,
    output: Path | None,
    names: tuple[str, ...],
    *,
    ending: str = "",
    **more: Any,
) -> Outputs:
    """Outputs in the folder that is stated; in ``out/SCENE`` where neither that nor JSON is."""
    from validation.output.outputs import Outputs

    default = Path("out") / f"{file.name}{ending}"
    folder = default if output is None and json is None else output
    if more.get("fields") and folder is None:
        raise InputError("--fields: got no folder for them; name one with -o DIR")
    return Outputs(json, folder, names, case=file, **more)


def with_auto(case: Case, tolerance: str | None, keep: Iterable[str] = ()) -> Case:
    """Case whose effects are decided before a run, as ``effects.auto`` would state.

    A tolerance is such as ``1%``, None that of the scene; names of effects to keep are checked.
    """
    from validation.scene.deformable import EffectName, stated_share

    names = tuple(keep)
    if tolerance is None and not names:
        return case
    if not case.meets:
        raise InputError(
            f"{case.name}: --auto compares contact pressures of deformable blocks; expected a "
            "scene with contact, such as tsb1-pipe"
        )
    if tolerance is None and case.auto is None:
        raise InputError("--keep: nothing is decided without --auto; expected --auto 1% beside it")
    unknown = [name for name in names if name not in set(EffectName)]
    if unknown:
        raise InputError(f"--keep {unknown[0]}: expected one of {', '.join(EffectName)}")
    if tolerance is None:
        return case
    return case.changed({"effects.auto": stated_share("--auto", tolerance)})


def decided(
    case: Case, console: Console, keep: Sequence[str] | None
) -> tuple[Case, dict[str, Any]]:
    """The case with its effects decided where it leaves that to the program, and the decision."""
    if case.auto is None:
        return case, {}
    from validation.output.console import following
    from validation.study.effects.auto import decide_effects

    with following(f"{case.name}: which effects matter") as follow:
        case, decision = decide_effects(case, keep or (), told=follow)
    console.print(decision.words)
    return case, {"effects_decision": decision.as_json()}


def solve_combinations(
    case: Case, json: str | None, output: Path | None, others: Mapping[str, Any]
) -> None:
    """Solve and print the combinations of a scene; ``others`` is what has no part in it.

    Factors of named loads are those of weight, load and [[loads]].
    """
    from validation.output.console import following
    from validation.study import combinations as study
    from validation.study.rowfile import store_or_none

    apart = {"--take-out ([rigid] take_out)": "take_out", "--stages ([stages])": "stages"}
    asked = {option: getattr(case.method, key, None) for option, key in apart.items()}
    for name, given in {**others, **asked}.items():
        if given:
            raise InputError(f"--combinations and {name}: choose one of the two")
    names = ("combinations.csv", "combinations.jsonl")
    with scene_outputs(case, json, output, names, ending="-combinations") as outputs:
        rows = None if outputs.folder is None else outputs.path(names[1])
        with following(case.name) as tell, store_or_none(rows) as path:
            answers = study.combination_answers(case, study.combination_cases(case), path, tell)
        study.print_combinations(case, answers, outputs.console)
        outputs.tell_keys()
        outputs.write("table", names[0], lambda path: study.write_combinations(answers, path))
        outputs.write_json({"scene": case.name, **study.combinations_json(answers)})


FieldsOption = Annotated[
    bool,
    typer.Option(
        "--fields", help="Also write fields for ParaView (.vtu) and arrays (answer.npz) into DIR."
    ),
]

QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


#: Options that set a field of a method.
_FIELDS: Mapping[str, Any] = {
    "accuracy": Annotated[list[str] | None, typer.Option("--accuracy", metavar="QUANTITY=3%")],
    "max_work": Annotated[float | None, typer.Option("--max-work", metavar="S")],
    "max_seconds": Annotated[float | None, typer.Option("--max-seconds", metavar="S")],
    "max_memory": Annotated[float | None, typer.Option("--max-memory", metavar="GB")],
    "take_out": Annotated[bool | None, typer.Option("--take-out")],
    "mesh": Annotated[str | None, typer.Option("--mesh", metavar="scene|converged")],
}
#: File and class of the method of each section.
METHODS = {"fem": ("fem/method.py", "Static"), "rigid": ("mbd/options.py", "Rigid")}


def method_options(section: str, *names: str, of_scene: bool = True) -> Callable[..., Any]:
    """Give a command options that set fields of a method; their docstrings are the help.

    They are settings of a scene: ``--max-work 5`` is ``--set fem.max_work=5``. A command without a
    scene takes them by name, as ``asked``.
    """

    def mark(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(*arguments: Any, **options: Any) -> None:
            asked = {name: options.pop(name) for name in names}
            asked = {name: value for name, value in asked.items() if value not in (None, [])}
            if "accuracy" in asked:
                asked["accuracy"] = parse_targets(asked["accuracy"])
            if not of_scene:
                options["asked"] = asked
            elif asked:
                from validation.scene.keys.toml_text import flat, toml_value

                words = [f"{section}.{key}={toml_value(value)}" for key, value in flat(asked)]
                options["settings"] = [*(options.get("settings") or ()), *words]
            function(*arguments, **options)

        stated = inspect.signature(function, eval_str=True)
        own = [part for part in stated.parameters.values() if part.name != "asked"]
        keyword = inspect.Parameter.KEYWORD_ONLY
        own += [inspect.Parameter(n, keyword, default=None, annotation=_FIELDS[n]) for n in names]
        run.__signature__ = stated.replace(parameters=own)  # type: ignore[attr-defined]
        run.__annotations__ = {part.name: part.annotation for part in own}
        run.help_of = METHODS[section]  # type: ignore[attr-defined]
        return run

    return mark


def command(function: Callable[..., None], *, more: bool = True) -> Callable[..., None]:
    """Return a command whose options are described below ``Parameters`` of its docstring.

    Those without an annotation of typer are named there, ``name : -o METAVAR``, and explained:
    keyword-only ones are options. ``more``: it takes ``--quiet`` as well.
    """

    @functools.wraps(function)
    def run(*arguments: Any, quiet: bool = False, **options: Any) -> None:
        from validation.output import console

        console.quiet.set(quiet)
        function(*arguments, **options)

    run.__doc__, described = parameters(inspect.getdoc(function) or "")
    stated = inspect.signature(function, eval_str=True)
    parts = [
        part.replace(annotation=_described(part, *described[part.name]))
        if part.name in described
        else part
        for part in stated.parameters.values()
    ]
    kind = inspect.Parameter.KEYWORD_ONLY
    if more:
        parts.append(inspect.Parameter("quiet", kind, default=False, annotation=QuietOption))
    # typer asks both what a command takes.
    run.__signature__ = stated.replace(parameters=parts)  # type: ignore[attr-defined]
    run.__annotations__ = {part.name: part.annotation for part in parts}
    return run


def parameters(text: str) -> tuple[str, dict[str, tuple[str, str]]]:
    """Split a docstring: the text, and by parameter what follows its colon, and its meaning."""
    text, _, rest = text.partition("\n\nParameters\n----------\n")
    result, name = dict[str, tuple[str, str]](), ""
    for line in rest.splitlines():
        if not line.startswith(" "):
            name, _, how = line.partition(" : ")
            result[name] = how, ""
        else:
            how, words = result[name]
            result[name] = how, f"{words} {line.strip()}".strip()
    return text, result


def _described(part: inspect.Parameter, how: str, words: str) -> Any:
    """Annotation of a parameter with its options, its metavar and its help."""
    names = [word for word in how.split(" ") if word.startswith("-")]
    metavar = " ".join(word for word in how.split(" ") if word not in names) or None
    plain = f"--{part.name.rstrip('_').replace('_', '-')}"
    if not any(name.startswith("--") for name in names):
        names.append(plain)
    known: Any = getattr(part.annotation, "__metadata__", [None])[0]
    if part.kind is not inspect.Parameter.KEYWORD_ONLY:
        made = typer.Argument(metavar=metavar, help=words)
    else:
        made = typer.Option(*names, metavar=metavar, help=words)
    for name in ("autocompletion", "min", "max"):
        setattr(made, name, getattr(known, name, None))
    kind = part.annotation if known is None else part.annotation.__origin__
    return Annotated[kind, made]


def exit_by(answer: Answer, method: Method) -> None:
    """End a command by the exit status of its deformable answer.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C ended its run.
    typer.Exit
        A requested accuracy, the arrival of supports or the end of the run was not reached.
    """
    from fem.answer.measures import reached
    from fem.method import Static

    run = answer.details.run
    stopped_by = answer.report.get("work", {}).get("stopped_by")
    if stopped_by == "interrupt" or (run is not None and run.status == "interrupted"):
        raise KeyboardInterrupt("the files have what was computed until then")
    missed = isinstance(method, Static) and method.accuracy and not_reached(answer)
    if missed or not reached(answer.details) or (run is not None and run.status == "stopped"):
        raise typer.Exit(NOT_REACHED)


def not_reached(answer: Answer) -> list[str]:
    """Measures whose error bars are wider than sought."""
    missed: list[str] = answer.report.get("accuracy", {}).get("not_reached", [])
    return missed


def parse_targets(texts: list[str]) -> dict[str, float]:
    """Read ``p_max_point=3%`` and the like: relative errors [-] by measure."""
    from geometry.answer import ALIASES, TITLES
    from validation.scene.deformable import parse_share

    result: dict[str, float] = {}
    names = ", ".join(("u", *TITLES))
    for text in texts:
        given, _, number = (part.strip() for part in text.rpartition("="))
        name, share = ALIASES.get(given, given), parse_share(number)
        if name not in TITLES:
            raise InputError(f"--accuracy {text}: expected QUANTITY=SHARE with one of {names}")
        if share is None:
            percent = "" if "%" in number else ": is a % missing?"
            raise InputError(
                f"--accuracy {text}: got {number}, expected a share between 0 and 100 %, such as "
                f"{given}=3%{percent}"
            )
        if name in result:
            raise InputError(f"--accuracy {text}: {name} is requested twice; expected it once")
        result[name] = share
    return result
