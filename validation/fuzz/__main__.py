"""Try thousands of random lines of the command: each is answered, or refused in one line in time.

``python -m validation.fuzz --count 2000 --seed 1`` counts what became of them and shows
every line that was neither. Each runs in a forked process with ten CPU seconds and 2 GB of memory
of its own; ``--apart N`` starts every N-th as a program of its own, as people do.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
from collections import Counter

from validation.fuzz.fate import FINE, Fate, try_lines


def main() -> None:
    """Count the fates of random lines; exit status 1 where one is a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--count", type=int, default=500, help="lines to try; Ctrl-C counts what was tried"
    )
    parser.add_argument("--seed", type=int, default=0, help="decides the lines")
    parser.add_argument("--first", type=int, default=0, help="number of the first line")
    parser.add_argument("--apart", type=int, default=50, help="every N-th as its own program")
    parser.add_argument("--show", action="store_true", help="show every line")
    asked = parser.parse_args()
    os.environ.setdefault("MPLBACKEND", "Agg")
    numbers = range(asked.first, asked.first + asked.count)
    counts: Counter[Fate] = Counter()
    with contextlib.suppress(KeyboardInterrupt):
        for number, tried in zip(
            numbers, try_lines(numbers, asked.seed, apart=asked.apart), strict=True
        ):
            counts[tried.fate] += 1
            if asked.show or tried.fate not in FINE:
                words = shlex.join(tried.words)
                print(f"{number} {tried.fate} {tried.seconds:.1f} s: tubelock {words}")
                print("    " + tried.said.replace("\n", "\n    "), flush=True)
    print(f"{counts.total()} lines of seed {asked.seed} tried: ", end="")
    print(", ".join(f"{counts[fate]} {fate}" for fate in Fate))
    raise SystemExit(any(counts[fate] for fate in Fate if fate not in FINE))


main()
