"""Whether more friction ever carries less: assemblies and pairs of friction drawn by chance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.support.rubbing import KINDS, balances, drawn, less_with_more

PAIRS, SEED = 200, 20_261_201


def rows() -> Iterator[dict[str, Any]]:
    """A row for each kind: pairs, verdicts by faces, and where more friction carries less."""
    draws = [(KINDS[k % len(KINDS)], SEED + k) for k in range(PAIRS)]
    for kind in KINDS:
        seeds = [seed for of, seed in draws if of == kind]
        carried, undecided, wrong = 0, 0, list[str]()
        for seed in seeds:
            rng = np.random.default_rng(seed)
            problem, pair = drawn(kind, rng), sorted(10.0 ** rng.uniform(-2.0, 0.1, 2))
            verdicts = [balances(problem, friction) for friction in (0.0, *pair)]
            carried += sum(v[0] is True for v in verdicts)
            undecided += sum(held is None for v in verdicts for held in v)
            wrong += [f"seed {seed}: {line}" for line in less_with_more(verdicts, (0.0, *pair))]
        yield {
            "kind": kind,
            "pairs": len(seeds),
            "carried by faces": f"{carried} of {3 * len(seeds)}",
            "undecided": undecided,
            "less with more friction": "; ".join(wrong) or "never",
        }
