#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2024.10"]
# ///
"""Tasks for those who prefer nox to make; `nox --list` names them, `make help` names the same."""

from pathlib import Path

import nox

nox.needs_version = ">=2024.10"
nox.options.default_venv_backend = "uv|virtualenv"

#: One layer on a coarse mesh: a deformable answer in seconds.
SMALL = tuple(
    word
    for setting in ("assembly.layers=1", "mesh.around=12", "mesh.radial=2", "mesh.axial=4")
    for word in ("--set", setting)
)


@nox.session
def lint(session: nox.Session) -> None:
    """Style, types, floors and spelling."""
    session.install("--editable", ".", "--group", "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")
    session.run("lint-imports")
    session.run("codespell")


@nox.session
def tests(session: nox.Session) -> None:
    """Every test; arguments go to pytest."""
    session.install("--editable", ".", "--group", "test")
    session.run("pytest", *(session.posargs or ("-n", "2", "--dist", "worksteal")))


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the site into docs/_build/html."""
    session.install("--editable", ".", "--group", "docs")
    session.run("sphinx-build", "--fail-on-warning", "docs", "docs/_build/html")


@nox.session(default=False)
def wheel(session: nox.Session) -> None:
    """Build the wheel, install it into an empty environment and run it outside the checkout."""
    session.install("build")
    session.run("python", "-m", "build", "--wheel")
    newest = max(Path("dist").glob("*.whl"), key=lambda path: path.stat().st_mtime)
    session.install(str(newest))
    elsewhere = Path(session.create_tmp()).resolve()
    with session.chdir(elsewhere):
        session.run("tubelock", "mbd", "tsb1-pipe", "--json", "rigid.json")
        session.run("tubelock", "fem", "tsb1-pipe", *SMALL, "--json", "deformable.json")


if __name__ == "__main__":
    nox.main()
