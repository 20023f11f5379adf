"""Names that a person tries first on the command line: one line, with the one that was meant."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

from validation.errors import InputError, places_of

#: What people call commands that have another name here.
_COMMANDS = {
    "rigid": "mbd",
    "static": "fem",
    "explicit": "fem",
    "run": "fem",
    "solve": "fem",
    "plot": "show",
    "list": "scenes",
    "deck": "export",
    "abaqus": "export",
}


class Group(TyperGroup):
    """Commands, some of which have a name that a person tries first."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command, or name the one that was meant."""
        if args and args[0] in _COMMANDS and args[0] not in self.commands:
            raise InputError(
                f"tubelock {args[0]}: no such command; did you mean tubelock {_COMMANDS[args[0]]}?"
            )
        return super().resolve_command(ctx, args)


class Command(TyperCommand):
    """A command, whose options are no keys of scenes."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments, or name the key that was meant."""
        known = {option for p in self.get_params(ctx) for option in (*p.opts, *p.secondary_opts)}
        for word in args[: args.index("--") if "--" in args else None]:
            option, _, value = word.partition("=")
            if option.startswith("--") and option not in known:
                _refuse_key(option, value)
        return super().parse_args(ctx, args)


def _refuse_key(option: str, value: str) -> None:
    """Reject an option that is a key of scenes, in the words of ``--set``."""
    from validation.scene.read import SCENE_TYPES

    key = option.removeprefix("--").replace("-", "_")
    for model in SCENE_TYPES.values():
        place = next(places_of(key, model), None)
        if place is not None:
            raise InputError(
                f"{option}: no such option; keys of a scene are set by --set {place}="
                f"{value or 'VALUE'}"
            )
