"""Commands that list, print and draw scenes, and make pages about them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from validation.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    complete_scenes,
    exit_by,
    method_options,
)

if TYPE_CHECKING:
    from validation.case import Case


def scenes(
    name: Annotated[str | None, typer.Argument(autocompletion=complete_scenes)] = None,
    *,
    studies: bool = False,
    schema: bool = False,
) -> None:
    """List the built-in scenes and studies, or print one as TOML.

    Parameters
    ----------
    name : [NAME]
        Print this scene or study as TOML, as a template.
    studies
        The built-in parameter studies, for `sweep`.
    schema
        Print the JSON schema of scene files, for editors.
    """
    from validation.scene.builtin import builtin_about, builtin_names, builtin_text

    if schema:
        import json

        from validation.scene.keys.schema import scene_schema

        print(json.dumps(scene_schema(), indent=1, ensure_ascii=False))
        return
    kind = "study" if studies else "scene"
    if name is not None:
        print(builtin_text(name, kind), end="")
        return
    names = builtin_names(kind)
    width = max(map(len, names))
    for known in names:
        print(f"{known:{width}} {builtin_about(known, kind)}")


def show(scene: SceneArgument, *, output: Path | None = None, settings: SetOption = None) -> None:
    """Draw a scene: blocks, fixed end rings, load and supports.

    Parameters
    ----------
    output : -o FILE.png
        Picture to write; out/SCENE/assembly.png.
    """
    from validation.case import load_case
    from validation.output.files import require_picture
    from validation.output.outputs import Outputs

    file = load_case(scene, settings or ())
    picture = output or Path("out") / file.name / "assembly.png"
    require_picture(picture)
    with Outputs(files={"-o": picture}, case=file) as outputs:
        _draw_scene(file, picture)
        outputs.say("picture", picture)


def _draw_scene(file: Case, path: Path) -> None:
    """Draw the blocks before any answer, with load and supports where they are of the scene."""
    from validation.output.pictures.gallery import save_figure

    title, problem = f"{file.name}: {file.load_words}", file.with_method("rigid").problem
    weight: Any = problem.gravity
    if problem.is_solid:
        from validation.output.pictures.polyhedra import draw_blocks

        save_figure(draw_blocks(problem.blocks, title=title, weight=weight), path)
        return
    from validation.output.pictures.assemblies import draw_assembly

    blocks: Any = problem.rigid_blocks
    save_figure(draw_assembly(blocks, problem.load_case, title=title, weight=weight), path)


@method_options("fem", "accuracy", "max_work", "max_seconds", "max_memory")
def report(
    scene: SceneArgument,
    *,
    output: Path | None = None,
    settings: SetOption = None,
    json: JsonOption = None,
    quick: bool = False,
    load_cases: bool = False,
) -> None:
    """Write one HTML page to send: verdicts, pictures, tables.

    The page needs no network. Loads side by side are the combinations of the scene, if it has any.

    Parameters
    ----------
    output : -o FILE.html
        Page to write; out/SCENE/report.html.
    quick
        Rigid blocks only: seconds.
    load_cases
        Also solve a tube under the five load cases.
    """
    from validation.case import load_case
    from validation.errors import InputError
    from validation.output.console import solver_progress
    from validation.output.files import PAGES
    from validation.output.outputs import Outputs
    from validation.pages.report import report_scene, write_page

    file = load_case(scene, settings or ())
    page = Path("out") / file.name / "report.html" if output is None else output
    if page.suffix.lower() not in PAGES:
        raise InputError(f"-o {page}: expected a file name that ends in .html")
    with Outputs(json, files={"-o": page}, case=file) as outputs:
        with solver_progress(file.name) as tell:
            result = report_scene(file, deformable=not quick, load_cases=load_cases, tell=tell)
            if result.deformable is not None:
                tell.end(result.deformable)
            data = result.as_dict()  # what it reads of the scene
            tell("pictures")
            write_page(result, page)
        for verdict in result.verdicts:
            outputs.console.print(f"{verdict.question:24} {verdict.words}")
        for reason in result.failed.values():
            outputs.console.print(f"{'no answer':24} {reason}", soft_wrap=True)
        outputs.tell_keys()
        outputs.say("page", page)
        outputs.write_json(data)
    if result.deformable is not None:
        exit_by(result.deformable, file.method)


def explore(
    scene: SceneArgument,
    *,
    settings: SetOption = None,
    host: str = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 0,
) -> None:
    """Serve a page with sliders on this machine; Ctrl-C ends it.

    Rigid blocks follow the sliders; a button solves deformable ones.

    Parameters
    ----------
    host : ADDRESS
        Address to listen to; others may reach it.
    port : N
        Port; 0: a free one.
    """
    from importlib.util import find_spec

    from validation.case import load_case, require_deformable
    from validation.errors import InputError
    from validation.output.console import text_console

    file = load_case(scene, settings or ())
    require_deformable(file, "explore")
    if find_spec("tornado") is None:
        raise InputError(
            "explore: the library tornado is not installed: pip install 'tubelock[explore]'"
        )
    from validation.pages.explore.server import explore_until_stopped

    console = text_console()
    if host not in ("127.0.0.1", "localhost", "::1"):
        console.print(
            f"warning: {host}: everyone who can reach this address can use the page, see the scene "
            "and spend CPU time of this machine; there is no password"
        )
    explore_until_stopped(
        file, host, port, lambda place: console.print(f"{file.name}: {place} (Ctrl-C ends)")
    )
    console.print("stopped")
