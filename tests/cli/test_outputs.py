"""Outputs of one call: none is an input of it, none another of its outputs, all announced."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from tests.support.coarse_tubes import SMALL
from validation import InputError, builtin_text
from validation.cli.app import app, described
from validation.output.outputs import Outputs


def test_every_command_says_which_files_it_writes(tubelock) -> None:
    """Outputs.path asserts it for every file; here, that folders hold those files and no others."""
    with (
        pytest.raises(AssertionError, match=r"other\.png"),
        Outputs(folder=Path("a"), names=("one.png",)) as outputs,
    ):
        outputs.write("picture", "other.png", lambda path: path.write_text("x"))
    assert not Path("a").exists()


def test_folders_of_a_refused_call_are_taken_away(tubelock) -> None:
    with (
        pytest.raises(InputError),
        Outputs("b/c/x.json", Path("d/e"), files={"-o": Path("f/g.png")}),
    ):
        raise InputError("refused")
    assert not list(Path().iterdir())


# ---------------------------------------------------------------------------------------------
# Names with markup


@pytest.mark.parametrize("name", ["$x^{2$", "[bold]x", ":smile:", "a_{b"])
def test_names_with_markup_are_only_names(tubelock, name) -> None:
    Path(f"{name}.toml").write_text(builtin_text("tsb1-pipe"))
    short = ["--set", "mesh.around=24", "--set", "mesh.radial=1", "--set", "assembly.layers=1"]
    status, out, err = tubelock(
        "mbd", f"{name}.toml", *short, "--set", "mesh.axial=4", "-o", "[/x]"
    )
    assert (status, err) == (0, "")
    assert out.splitlines()[0].startswith(f"{name}: ")
    assert "picture   [/x]/contact_pressures.png" in out
    status, out, err = tubelock("mbd", name)
    assert status == 2
    assert name in err


# ---------------------------------------------------------------------------------------------
# Shell habits


def test_quiet_says_nothing_but_errors(tubelock) -> None:
    assert tubelock("mbd", "tsb1-pipe", *SMALL, "-q", "--json", "x.json") == (0, "", "")
    assert Path("x.json").stat().st_size > 500
    status, out, err = tubelock("mbd", "tsb1-pip", "--quiet")
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    # It is the habit of one call.
    assert "rigid blocks" in tubelock("mbd", "tsb1-pipe", *SMALL, "--json", "x.json")[1]


def test_version_and_documented_exit_status(tubelock) -> None:
    assert re.fullmatch(r"tubelock \d+\.\d+\.\d+.*\n", tubelock("--version")[1])
    said = " ".join(tubelock("--help")[1].split())
    for words in ("Exit status: 0 done", "2 input error", "130 interrupted", "NO_COLOR"):
        assert words in said
    assert "Parts:" in tubelock("reproduce", "--help")[1]


def test_every_option_of_every_command_is_explained() -> None:
    commands = dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
    commands |= commands.pop("reproduce").commands
    silent = {
        f"{name} {option.name}"
        for name, command in commands.items()
        for option in described(command).params
        if not option.help
    }
    assert silent == set()


def _offered(shell: str, line: str) -> list[str]:
    """What the program offers a shell after the words typed so far."""
    words = line.split(" ")
    environment = {
        "_TUBELOCK_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "_TYPER_COMPLETE_ARGS": line,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    program = "from validation.cli.app import app; app(prog_name='tubelock')"
    found = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return re.findall(r"[\w.=-]+", found.stdout)


@pytest.mark.parametrize(
    "shell",
    ["bash", *(pytest.param(shell, marks=pytest.mark.thorough) for shell in ("zsh", "fish"))],
)
def test_shells_complete_commands_scenes_and_keys(shell) -> None:
    assert {"mbd", "fem", "cost"} <= set(_offered(shell, "tubelock "))
    assert {"tsb1-pipe", "tsb1-pillar"} <= set(_offered(shell, "tubelock mbd tsb1-pi"))
    keys = _offered(shell, "tubelock mbd tsb1-pipe --set load.")
    assert {"load.case=", "load.pressure="} <= set(keys)
    assert not [key for key in keys if key.startswith("block.")]
    assert "paper-480" in _offered(shell, "tubelock sweep pap")
