"""The command line. Invalid input gives one line on standard error and exit status 2."""

from __future__ import annotations

import difflib
import gc
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import typer
import typer.core
import typer.main
from typer.core import TyperCommand, TyperGroup, TyperOption

from validation.cli import analysis, decks, paper, scenes, study, verification
from validation.cli.options import command
from validation.errors import InputError, place_of, run_command


class Command(TyperCommand):
    """A command, whose options are no keys of scenes."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, for which docstrings are read now."""
        described(self)
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments, or name the key that was meant."""
        known = {option for p in self.get_params(ctx) for option in (*p.opts, *p.secondary_opts)}
        for word in args[: args.index("--") if "--" in args else None]:
            option, _, value = word.partition("=")
            if option.startswith("--") and option not in known:
                _refuse_key(option, value)
        return super().parse_args(ctx, args)


def described(command: Any) -> Any:
    """Return a command with the help of its options that set fields of a method."""
    place = getattr(command.callback, "help_of", None)
    if place is not None:
        from validation.scene.keys.quantities import words_of_fields

        words = words_of_fields(*place)
        for option in command.params:
            if isinstance(option, TyperOption) and not option.help and option.name in words:
                option.help = words[option.name]
    return command


def _refuse_key(option: str, value: str) -> None:
    """Reject an option that is a key of scenes, in the words of ``--set``."""
    from validation.scene.read import SCENE_TYPES

    key = option.removeprefix("--").replace("-", "_")
    for model in SCENE_TYPES.values():
        place = place_of(key, model)
        if place is not None:
            raise InputError(
                f"{option}: no such option; keys of a scene are set by --set {place}="
                f"{value or 'VALUE'}"
            )


_HELP = (
    "Structural analysis of topological interlocking assemblies: kinematics, contact pressures, "
    "stresses. SCENE is a built-in scene or your TOML file: tubelock mbd arch"
)
_EPILOG = (
    "Exit status: 0 done; 1 a robustness case failed (`stability`) or a file has faults (`check`); "
    "2 input error, with a one-line diagnostic; 3 a requested accuracy or state not reached, or "
    "a run unstable; 130 interrupted, with the files of the last finished mesh. "
    "NO_COLOR=1 in the environment switches colours off."
)


class _Group(TyperGroup):
    """Commands, listed by subject in the help."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command, or name the nearest one."""
        if args and args[0] not in self.commands:
            near = difflib.get_close_matches(args[0], self.commands, n=1)
            hint = f"did you mean {near[0]}?" if near else f"expected {', '.join(self.commands)}"
            raise InputError(f"{args[0]}: no such command; {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each subject, in the order of the commands."""
        width = max(map(len, self.commands))
        sections: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            one = self.commands[name]
            row = (name.ljust(width), one.get_short_help_str(formatter.width - 6 - width))
            sections.setdefault(str(getattr(one, "rich_help_panel", "")), []).append(row)
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


app = typer.Typer(
    name="tubelock",
    cls=_Group,
    help=_HELP,
    epilog=_EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
reproduce = typer.Typer(cls=_Group)

#: Commands by subject, in the order of ``tubelock --help``.
_COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "Analyse": {
        "scenes": scenes.scenes,
        "check": decks.check,
        "show": scenes.show,
        "mbd": analysis.mbd,
        "fem": analysis.fem,
        "compare": analysis.compare,
        "report": scenes.report,
        "explore": scenes.explore,
        "sweep": study.sweep,
        "sensitivity": study.sensitivity,
        "optimise": study.optimise,
        "export": decks.export,
        "deck": decks.deck,
    },
    "Verification": {
        "effects": verification.effects,
        "cost": verification.cost,
        "stability": verification.stability,
    },
}
_PARTS: tuple[Callable[..., None], ...] = (
    paper.tables,
    paper.figures,
    paper.claims,
    paper.deformable,
    paper.errata,
    paper.report,
)
for _subject, _commands in _COMMANDS.items():
    for _name, _function in _commands.items():
        app.command(_name, rich_help_panel=_subject, cls=Command)(command(_function))
for _function in _PARTS:
    reproduce.command(rich_help_panel="Parts", cls=Command)(command(_function))
reproduce.callback(
    invoke_without_command=True,
    help="Reproduce the paper: the full report, or one of its parts.",
)(command(paper.report, more=False))
app.add_typer(reproduce, name="reproduce", rich_help_panel="Verification")


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"tubelock {version('tubelock')}")
        raise typer.Exit


@app.callback()
def _habits(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Structural analysis of topological interlocking assemblies."""


@cache
def _program() -> Any:
    """All commands, built once in a process that runs several."""
    return typer.main.get_command(app)


def main() -> None:
    """Run the command line."""
    gc.freeze()
    gc.enable()
    # Commands load more modules: a search among what they keep is a tenth of a short one.
    gc.set_threshold(200_000)
    try:
        run_command(_program())
    finally:
        gc.freeze()  # nor at the end


if __name__ == "__main__":
    main()
