"""Commands load what they use: a test of names, for times depend on the machine."""

from __future__ import annotations

import subprocess
import sys

import pytest

#: Runs a command and prints the modules that it has loaded.
PROGRAM = """
import io, sys
from contextlib import redirect_stderr, redirect_stdout, suppress
before = set(sys.modules)
with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), suppress(SystemExit):
    from validation.cli import main
    main()
print("\\n".join(set(sys.modules) - before))
"""
#: Packages that read the command line and print.
TERMINAL = {"typer", "annotated_doc", "shellingham", "typing_extensions"}
#: Packages that check scenes.
SCENES = {"pydantic", "pydantic_core", "annotated_types", "typing_inspection", "rich"}
#: Packages that compute.
NUMBERS = {"numpy", "scipy", "threadpoolctl"}
#: What the statement of a problem is made of; nothing that solves, meshes or searches.
STATEMENT = {
    *("fem", "fem.problem", "fem.method"),
    *("fem.contact", "fem.contact.law", "fem.contact.own_law", "fem.contact.pair_laws"),
    *("fem.contact.friction", "fem.contact.normals"),
    *("fem.element", "fem.element.hexahedron", "fem.element.functions", "fem.element.material"),
    *("fem.system", "fem.system.effects"),
}
#: Parts of scipy that a rigid tube does without.
UNUSED_SCIPY = {"spatial", "special", "optimize", "interpolate", "stats", "integrate", "fft"}
#: Own packages that solve nothing for rigid tubes.
UNUSED = (
    *(
        "geometry.polyhedra.polyhedron",
        "geometry.polyhedra.facet_contact",
        "geometry.files.readers",
    ),
    *("mbd.programs", "mbd.contacts.friction", "mbd.limits"),
    *("validation.output.pictures.canvas", "validation.output.pictures.gallery"),
    *("validation.study", "validation.pages", "validation.paper", "validation.stability"),
    *("mbd.held", "validation.build.polyhedra", "validation.build.supports"),
    "validation.scene.families.box",
)


def loaded(*words: str) -> set[str]:
    """Modules that a command loads, those of Python's own library apart."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=True
    )
    names = set(done.stdout.split())
    return {name for name in names if name.partition(".")[0] not in sys.stdlib_module_names}


def foreign(modules: set[str]) -> set[str]:
    """Packages among modules that are not our own; compiled parts of one have its name."""
    packages = {name.partition(".")[0] for name in modules}
    return {name for name in packages if not name.startswith("_")} - {
        *("geometry", "mbd", "fem", "validation"),
        *("cython_runtime",),  # each compiled module adds it
    }


@pytest.mark.parametrize("words", [("--help",), ("scenes",), ("mbd", "--help")])
def test_lists_and_help_load_no_numbers(words: tuple[str, ...]) -> None:
    modules = loaded(*words)
    assert "validation.cli.app" in modules
    assert foreign(modules) <= TERMINAL | SCENES
    assert not {name for name in modules if name.startswith(("fem", "mbd"))}


def test_a_rigid_tube_loads_its_statement_and_its_solver() -> None:
    modules = loaded("mbd", "tsb1-pipe", "--json", "-")
    assert "mbd.equilibrium" in modules
    assert foreign(modules) <= TERMINAL | SCENES | NUMBERS
    assert {name for name in modules if name.startswith("fem")} <= STATEMENT
    parts = {name.split(".")[1] for name in modules if name.startswith("scipy.")}
    assert not parts & UNUSED_SCIPY
    assert not {name for name in modules if name.startswith(("numpy.f2py.", "numpy.testing."))}
    assert not {name for name in modules if name.startswith(UNUSED)}


def test_a_deformable_tube_loads_no_optimiser_and_nothing_that_draws() -> None:
    coarse = ("--set", "assembly.layers=1", "--set", "fem.max_meshes=1")
    modules = loaded("fem", "tsb1-pipe", *coarse, "--json", "-")
    assert "fem.static.newton" in modules
    assert foreign(modules) <= TERMINAL | SCENES | NUMBERS
    parts = {name.split(".")[1] for name in modules if name.startswith("scipy.")}
    assert not parts & UNUSED_SCIPY - {"spatial", "special"}
    assert not {name for name in modules if name.startswith(("fem.explicit", "fem.decks"))}
    # The options of rigid blocks are keys of its scene; nothing that solves them, or solids.
    assert {name for name in modules if name.startswith("mbd")} == {"mbd", "mbd.options"}
    assert not {name for name in modules if name.startswith("geometry.polyhedra.facet_contact")}
    seldom = ("numpy.random.", "scipy.spatial.transform.", "scipy.constants")
    assert not {name for name in modules if name.startswith(seldom)}
