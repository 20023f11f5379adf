"""Rungs of `fem --accuracy` as settings of `tubelock cost`: curved elements from coarse to fine.

What a rung costs is what a user pays for it: all rungs up to it, each from the state of the one
before. Its pressures are compared as those of others are, on facets of its own.
"""

from __future__ import annotations

import time

from validation.cost.settings import CostSetting
from validation.run.curved.accuracy import LADDER
from validation.run.curved.fields import CurvedFields
from validation.run.curved.solve import Solved, curved_run, solve_curved
from validation.scene.read import TubeScene


def solve_rungs(
    where: str, scene: TubeScene, setting: CostSetting
) -> tuple[CurvedFields, dict[str, float], float]:
    """Climb the ladder up to the rung of a setting.

    Returns
    -------
    tuple[CurvedFields, dict[str, float], float]
        The state, its scalars as `validation.cost.measure.SCALARS` names them, and CPU time [s].

    Raises
    ------
    InputError
        A rung without a state.
    """
    start = time.process_time()
    waves = round(2 * scene.block.frequency)
    before: Solved | None = None
    for rung in LADDER.rungs[: setting.level]:
        state = None if before is None else before.state
        before = solve_curved(where, scene, rung.mesh(waves), state)
    assert before is not None
    seconds = time.process_time() - start
    fields = CurvedFields(curved_run(where, scene, (before,), {}, ""))
    found = {name: measure.value for name, measure in before.measures.items()}
    return fields, found, seconds
