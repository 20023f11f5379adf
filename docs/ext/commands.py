"""The page of commands, from the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from validation.cli.app import app, described


def write_commands(path: Path) -> None:
    """Write one section for each command and subcommand, in the order of ``tubelock --help``."""
    group = typer.main.get_command(app)
    lines = [
        "# Commands",
        "",
        "The text of `tubelock --help` and `tubelock COMMAND --help`. Exit status 0: done; 2:",
        "input error, with a one-line diagnostic; 3: a requested accuracy or state was not",
        "reached, or a run was unstable; 130: interrupted, with the files of the last finished",
        "mesh.",
        "",
        "A run that takes longer than two seconds prints on standard error what it is at, of how",
        "many, and the numbers of each finished mesh. The last line of the output is the CPU time",
        "and the peak memory of the whole process, pictures included.",
        "",
        "| command | what it does |",
        "|---|---|",
    ]
    result = list(_commands(group, ()))
    for words, command in result:
        anchor = "-".join(words)
        lines.append(f"| [`{' '.join(words)}`](#command-{anchor}) | {_first(command)} |")
    for words, command in result:
        lines += ["", *_section(words, command)]
    path.write_text("\n".join(lines) + "\n", "utf-8")


def _commands(group: Any, before: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    context = typer.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if command.hidden:
            continue
        yield (*before, name), command
        if hasattr(command, "list_commands"):
            yield from _commands(command, (*before, name))


def _first(command: Any) -> str:
    return (command.help or "").strip().split("\n")[0]


def _section(words: tuple[str, ...], command: Any) -> list[str]:
    context = typer.Context(described(command), info_name=" ".join(("tubelock", *words)))
    usage = command.get_usage(context).removeprefix("Usage: ")
    lines = [
        f"(command-{'-'.join(words)})=",
        f"## {' '.join(words)}",
        "",
        *(line.strip() for line in (command.help or "").strip().split("\n")),
        "",
        "```text",
        usage,
        "```",
    ]
    rows = [row for parameter in command.params if (row := _row(parameter, context))]
    if rows:
        lines += ["", "| argument, option | meaning |", "|---|---|"]
        lines += [f"| `{left.replace('|', chr(92) + '|')}` | {right} |" for left, right in rows]
    return lines


def _row(parameter: Any, context: Any) -> tuple[str, str] | None:
    if parameter.name == "help":
        return None
    record = parameter.get_help_record(context)
    if record is None:
        return None
    return record[0], " ".join(record[1].split()).replace("|", "\\|")
