"""Accuracies that a scene or a command requests of a static run, in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from fem.accuracy.converge import Progress, is_negligible, relative, why_not_refined
from fem.assembly.statement import Problem
from geometry.answer import ALIASES, TITLES, Measure
from geometry.errors import RefusedError
from validation.build.deformable import fem_section, scene_problem
from validation.errors import InputError
from validation.scene.deformable import FemSection, Method, parse_share
from validation.scene.read import DeformableScene


def parse_targets(texts: list[str]) -> dict[str, float]:
    """Read ``p_max_point=3%`` and the like: relative errors [-] by measure."""
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


def states_its_mesh(fem: FemSection) -> bool:
    """Whether a scene states the elements that it is solved with."""
    return not fem.model_fields_set.isdisjoint(("degree", "element"))


def check_request(
    name: str, scene: DeformableScene, targets: Mapping[str, float] | None = None
) -> None:
    """Reject an accuracy that a scene cannot reach, whatever its effects.

    Effects that ``[effects] auto`` leaves out may change p_max, p_eff and u by its tolerance, which
    no error bar holds: it may not exceed a request.
    """
    if not targets:
        return
    fem, auto = scene.fem, scene.effects.auto
    if fem.method is not Method.STATIC:
        raise InputError(
            f'{name}: --accuracy: got fem.method = "{fem.method}"; explicit runs keep the mesh '
            'of the scene: expected fem.method = "static"'
        )
    if fem.mesh == "scene":
        raise InputError(
            f'{name}: --accuracy: got fem.mesh = "scene", which is one mesh; expected one of '
            "the two"
        )
    least = min(targets, key=lambda target: targets[target])
    if auto is not None and auto.tolerance > targets[least]:
        raise InputError(
            f"{name}: --accuracy: got {least}={100 * targets[least]:g}% where effects may be left "
            f"out that change {100 * auto.tolerance:g} %; expected --auto of at most "
            f"{100 * targets[least]:g}%"
        )


def refined(
    name: str, scene: DeformableScene, targets: Mapping[str, float] | None = None
) -> Problem | None:
    """Problem of a scene that is solved on finer and finer meshes; None: on its own."""
    check_request(name, scene, targets)
    fem = fem_section(scene, name)
    if fem.method is not Method.STATIC or fem.mesh == "scene":
        return None
    if fem.mesh is None and states_its_mesh(fem) and not targets:
        return None
    try:
        problem, why = refinable(name, scene)
    except RefusedError:
        return None  # the run rejects it
    if why is None:
        if not fem.error_estimate:
            raise InputError(
                f'{name}: fem.error_estimate: applies to fem.mesh = "scene" alone; a run that '
                "refines always has error bars: remove the key, or add fem.mesh"
            )
        return problem
    if targets or fem.mesh == "converged":
        raise InputError(
            f'{name}: accuracy: got {why}, whose mesh is not refined; expected fem.mesh = "scene"'
        )
    return None


def refinable(name: str, scene: DeformableScene) -> tuple[Problem | None, str | None]:
    """Problem of a static scene, and what stands against finer meshes; None where nothing does."""
    if scene.is_cell:
        return None, "a periodic cell"
    problem = scene_problem(scene, name)
    return problem, why_not_refined(problem)


def progress_words(now: Progress) -> str:
    """Describe the next mesh, its expected time, and the best values so far."""
    expected = f", about {now.seconds:.2g} CPU s" if now.seconds > 0.0 else ""
    words = f"mesh {now.rung} of at most {now.n_rungs}, {now.unknowns} unknowns a block{expected}"
    if "p_max_point" in now.measures:
        words += f"; pressure at a point {now.measures['p_max_point'].value_words}"
    return words


def reached_rows(measures: Mapping[str, Measure], targets: Mapping[str, float]) -> list[str]:
    """Repeat each request, reached or not, with its error bar."""
    rows = []
    for name, share in targets.items():
        bar = relative(measures[name])
        digits = 1 if bar < 0.1 else 0
        bar_words = f"± {100 * bar:.{digits}f} %" if isfinite(bar) else "no error bar"
        if bar <= share:
            verdict = f"reached, {bar_words}"
        elif is_negligible(measures, name):
            verdict = "not needed, negligible beside the largest stress"
        else:
            verdict = f"not reached, {bar_words}"
        rows.append(f"{name}={100 * share:g}%: {verdict}")
    return rows
