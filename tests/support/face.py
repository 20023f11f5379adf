"""The only door of tests of scenes, studies, commands and pages to the inside of the packages.

`case`, `solved`, `rejected` and `command` are what a test of a scene needs. Names of the table
below are what these four do not cover yet: when a file of the packages moves, this file follows,
and no test.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

if TYPE_CHECKING:
    from geometry import Answer
    from validation import Case

#: Settings as a mapping of keys to values, or as words of ``--set``.
Settings = Mapping[str, Any] | Sequence[str]


def case(source: str | Path, settings: Settings = ()) -> Case:
    """A built-in scene or one in a file, with settings that replace its own."""
    from validation import load_case

    return load_case(source, settings)


def solved(
    stated: str | Path | Case, settings: Settings = (), *, method: str | None = None
) -> Answer:
    """Answer of a case by "rigid", "static" or "explicit"; None: deformable, as it states."""
    from validation import solve

    asked = case(stated, settings) if isinstance(stated, str | Path) else stated
    return solve(asked if method is None else asked.with_method(method))


def on_its_mesh(
    stated: Any,
    name: str = "scene",
    method: str | None = None,
    *,
    error_estimate: bool = False,
    **follow: Any,
) -> Answer:
    """Answer of a case, or of a scene by its name, on its mesh, without what else takes time."""
    from validation import solve
    from validation.case import scene_case

    case = scene_case(stated, name) if hasattr(stated, "fem") else stated
    if method is not None:
        case = case.with_method(method)
    fast: dict[str, Any] = {"error_estimate": error_estimate}
    fast |= {"mesh": "scene"} if case.scene.fem.method == "static" else {"static_reference": False}
    return solve(case.stating(case.scene.changed({"fem": fast})), **follow)


def compared_runs(name: str, stated: Any) -> tuple[list[Answer], list[Answer]]:
    """Rigid answers in both norms and static ones to a case, or a scene."""
    from validation.study.comparison.scene import compared_runs as compared

    return compared(name, getattr(stated, "scene", stated))


def by_options(problem: Any, options: Any) -> Answer:
    """Static answer on the mesh of a problem, by options of the solver that no scene has."""
    from fem.accuracy.one_mesh import static_solution
    from fem.answer import answer_of

    turning = problem.finite_rotation
    solution = static_solution(problem.deformable, options, finite_rotation=turning)
    return answer_of(solution, problem=problem)


def rejected(stated: str | Path, settings: Settings = (), *, method: str | None = None) -> str:
    """The one line that rejects a case, when it is read or when it is solved."""
    from geometry.errors import RefusedError

    try:
        solved(stated, settings, method=method)
    except RefusedError as error:
        line = str(error)
        assert line.count("\n") == 0 < len(line), f"expected one line, got {line!r}"
        return line
    raise AssertionError(f"{stated}, {settings}: expected to be rejected, got an answer")


def command(*words: str) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of ``tubelock WORDS``, in this process."""
    from validation.cli.app import main

    out, err = _stream(), _stream()
    with (
        mock.patch.object(sys, "argv", ["tubelock", *words]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
            status = 0
        except SystemExit as stop:
            status = int(stop.code or 0)
    return status, _text(out), _text(err)


def _stream() -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="", write_through=True)


def _text(stream: io.TextIOWrapper) -> str:
    stream.flush()
    return stream.buffer.getvalue().decode("utf-8")  # type: ignore[attr-defined]


# ---------------------------------------------------------------------------------------------
# Inner names that tests still use: module -> names; "alias=name" where two modules have the same
# name, "name=*" for the module itself, whose names a test replaces. Imported when asked for.

_INNER = {
    "fem.accuracy.converge": "LEAST_MESHES climbed converge",
    "fem.accuracy.errors": "SAFETY error_bar",
    "fem.accuracy.facets": "pressures_on_facets",
    "fem.accuracy.ladder": (
        "DEGREES LADDER Ladder PRESSURES Rung coarser fineness graded_to_both_ends "
        "graded_to_one_end on_degree=on_mesh split"
    ),
    "fem.accuracy.one_mesh": "accuracy_one_mesh_module=* static_solution",
    "fem.accuracy.parts": "FrictionSet relative unmet",
    "fem.accuracy.statics": "accuracy_statics_module=* static_options",
    "fem.accuracy.strength": "_BoundError _scaled_until",
    "fem.accuracy.transfer": "interpolation node_places transferred",
    "fem.assembly.contact_state": "corner_displacements facing_points",
    "fem.assembly.deformable": "DeformableAssembly",
    "fem.assembly.reactions": "PushCurve push_curves",
    "fem.assembly.statement": "Motion ProblemError",
    "fem.assembly.symmetry": "largest_cyclic_orbits local_forces with_half_turn",
    "fem.contact.cuts": "closest_on_facets",
    "fem.contact.facet_peaks": "LARGEST_FACTOR facet_peaks",
    "fem.contact.surfaces": "ContactNormals corner_forces point_kinematics",
    "fem.dynamics": "ramp_change stated_run",
    "fem.decks.keywords": "DeckError",
    "fem.decks.laws": "law_table",
    "fem.decks.problem": "element_time_step problem_deck",
    "fem.decks.read.cards": "read_cards",
    "fem.decks.read.deck": "deck_of_lines",
    "fem.decks.statement": "Flavour NodalForceLoad Procedure",
    "fem.decks.write": "deck_lines",
    "fem.element.lagrange_mesh": "LagrangeMesh lagrange_lumped_mass=block_lumped_mass with_degree",
    "fem.explicit.setup.assembly": "explicit_assembly",
    "fem.explicit.setup.quasi_static": "block_frequencies recommended_times",
    "fem.explicit.solve": "Frame Status StopCriterion initial_state prepare",
    "fem.measures": "bracketed",
    "fem.problem.effects": "AdaptiveMassDamping EffectError Effects",
    "fem.problem.loads": "SmoothStepAmplitude wrench_forces",
    "fem.problem.model": "Model ModelError block_group",
    "fem.problem.time_step": "critical_time_step",
    "fem.solution": "Solution",
    "fem.static.contact_forces": "grid_blocks",
    "fem.static.linear_step.grid_block": "PointFlexibility",
    "fem.static.newton": "static_newton_module=*",
    "fem.static.result": "StaticError StaticResult",
    "fem.static.solve": (
        "StaticMethod StaticOptions solve_deformable_static=solve_static static_solve_module=*"
    ),
    "geometry.answer": "Contacts WIDEST measure_rows",
    "geometry.assembly": "AssemblyError PlacedBlocks",
    "geometry.block": "mapped_block",
    "geometry.families.hexagon_block": "HexagonBlockDivisions hexagon_block",
    "geometry.families.masonry": "box",
    "geometry.families.platonic_layers": "tetrahedron",
    "geometry.families.sine_block": "SineBlockDivisions",
    "geometry.families.tube": "HexagonTube SineTube",
    "geometry.files.block_files": "diagnosed_blocks step_hexahedra",
    "geometry.files.hexahedral_solids": (
        "connected_solids file_blocks hexahedral_block six_sided_hexahedra split_tetrahedra"
    ),
    "geometry.files.mesh_io": "write_hex_mesh",
    "geometry.files.named_surfaces": "Y_UP",
    "geometry.files.quadratic": "NATURAL",
    "geometry.files.write_solids": "flat_faces write_solids",
    "geometry.loads": (
        "CASES CircumferentialLoad LoadCaseError NamedLoad face_pressure with_body_wrenches"
    ),
    "geometry.measures": "SectionError first_largest",
    "geometry.mesh": "CORNERS MeshError QuadSurface grid_points",
    "geometry.meshing.charts": "unit_lines",
    "geometry.meshing.refinement": "charts_of with_lines",
    "geometry.parts.supports": "SupportError",
    "geometry.polyhedra.assembly": "as_polyhedral",
    "geometry.polyhedra.explosion": "follow_explosion outward_directions",
    "geometry.polyhedra.polyhedron": "polyhedron_from_quads",
    "mbd.force_range": "force_ranges",
    "mbd.friction": "frictional_contacts frictional_equilibrium",
    "mbd.margin": "first_order_explosion",
    "mbd.options": "FrictionLaw",
    "mbd.push": "at_rest",
    "validation.build.deck": "build_deck",
    "validation.build.problem": "build_assembly scene_problem",
    "validation.build.polyhedra": "build_polyhedra motion",
    "validation.build.supports": "stated_load",
    "validation.case": "require_deformable scene_case with_auto",
    "validation.cli.app": "app main",
    "validation.cli.completion": "_keys",
    "validation.cli.options": "parse_targets",
    "validation.output.answer_files": "FILES",
    "validation.output.console": "output_console_module=*",
    "validation.output.decks": "export_deck solve_deck",
    "validation.output.deformable.answers": "RUN_FILES=FILES print_run",
    "validation.output.deformable.fields": "FrameWriter",
    "validation.output.forces": "JOINT_FILES write_joints",
    "validation.output.outputs": "Outputs",
    "validation.output.pictures.canvas": "rgb",
    "validation.output.pictures.scales": "VERMILION",
    "validation.output.pictures.sections": "picture_section=section",
    "validation.output.pictures.tubes": "run_facets section_heights",
    "validation.output.rigid": "print_rigid",
    "validation.output.solids": "check_file write_repaired",
    "validation.pages.verdicts": "verdicts",
    "validation.paper.evidence": "Evidence StudyTable",
    "validation.paper.reference": "reference",
    "validation.run.held_by_faces": "faces_words require_held_by_faces",
    "validation.run.held_by_friction": "inside_words require_held_by_friction",
    "validation.run.rigid.changed": "class_with_layers frame_warning layers_to_unlock",
    "validation.run.rigid.explosion": "explosion_json rigid_explosion_module=* run_explosion",
    "validation.scene.combinations": "combined",
    "validation.scene.deformable": "EffectName",
    "validation.scene.family": "AssemblyScene RoundScene round_types",
    "validation.scene.polyhedra": "MeshScene PlaceSection PolyhedralScene",
    "validation.scene.read": "DeformableScene SCENE_TYPES TubeScene check_scene scene_data",
    "validation.study.combinations": "combination_answers envelope",
    "validation.study.comparison.agreement": "agreement effective_region",
    "validation.study.comparison.calculix": "CalculixError calculix_available run_calculix",
    "validation.study.comparison.report": "Comparison",
    "validation.study.costs.peaks": "cap_comparison order",
    "validation.study.costs.references": "references",
    "validation.study.design": "Row run_design",
    "validation.study.effects.auto": "without_effect require_wider",
    "validation.run.cell": "middle_answer",
    "validation.study.study": "Study",
}

#: Where each of these names comes from.
INNER_NAMES = {
    entry.partition("=")[0]: (module, entry.partition("=")[2] or entry)
    for module, names in _INNER.items()
    for entry in names.split()
}


def __getattr__(name: str) -> Any:
    if name not in INNER_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, inner = INNER_NAMES[name]
    place = import_module(module)
    return place if inner == "*" else getattr(place, inner)
