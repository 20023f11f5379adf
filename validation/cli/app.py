"""The command line. Bad input gives one line on standard error and exit status 2."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Annotated

import typer

from validation.cli import compare, cost, decks, demo, fem, look, paper, rigid, study, trust
from validation.cli.options import command
from validation.errors import run_command

_EPILOG = (
    "Exit status: 0 done; 1 done, and a hard case is red (`stability`); 2 refused, with one line "
    "that says what was got, what is expected and what to do; 130 interrupted. "
    "NO_COLOR=1 in the environment: no colours."
)

app = typer.Typer(
    name="tubelock",
    help="Topological interlocking assemblies: locked or not, contact pressures, stresses.",
    epilog=_EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
reproduce = typer.Typer()

#: In the order of ``tubelock --help``: from looking to doubting.
_COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo.demo,
    "scenes": look.scenes,
    "schema": look.schema,
    "show": look.show,
    "mbd": rigid.mbd,
    "explode": rigid.explode,
    "fem": fem.fem,
    "compare": compare.compare,
    "clearance": compare.clearance,
    "studies": study.studies,
    "sweep": study.sweep,
    "rescue": study.rescue,
    "export": decks.export,
    "import": decks.import_,
    "cost": cost.cost,
    "effects": trust.effects,
    "cell": trust.cell,
    "stability": trust.stability,
    "convergence": compare.convergence,
    "peaks": cost.peaks,
}
_PARTS: tuple[Callable[..., None], ...] = (
    paper.tables,
    paper.figures,
    paper.claims,
    paper.errata,
    paper.report,
)
for _name, _function in _COMMANDS.items():
    app.command(_name)(command(_function))
for _function in _PARTS:
    reproduce.command()(command(_function))
reproduce.callback(
    invoke_without_command=True,
    help="Reproduce the paper: alone, this writes the whole report; the commands write parts.",
)(paper.report)
app.add_typer(reproduce, name="reproduce")


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
        typer.Option("--version", callback=_print_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    """Topological interlocking assemblies: locked or not, contact pressures, stresses."""


def main() -> None:
    """Run the command line."""
    # What is loaded stays: looking for what of it is garbage takes a twentieth of a short command.
    gc.set_threshold(50_000)
    run_command(app)


if __name__ == "__main__":
    main()
