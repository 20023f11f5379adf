"""The cache of compiled functions: what is read under a name is what was written under it."""

import multiprocessing
from pathlib import Path

from geometry.compilation import LockedCacheFile, njit

FORMS, ROUNDS, PROCESSES = 8, 60, 4


def work(folder: str, seed: int) -> int:
    """Save and load forms of many functions by turns; count what came back under a wrong name."""
    wrong = 0
    for number in range(ROUNDS):
        file = LockedCacheFile(folder, f"function-{number}", "stamp")
        for step in range(FORMS):
            key = (seed + step) % FORMS
            found = file.load(key)
            wrong += found is not None and found != f"code of {key}"
            if found is None:
                file.save(key, f"code of {key}")
                wrong += file.load(key) != f"code of {key}"
    return wrong


def test_processes_that_fill_one_cache_never_read_each_others_code(tmp_path: Path) -> None:
    """Without the lock a quarter of the reads here, 483 of 1 920, gave the code of another form."""
    with multiprocessing.get_context("spawn").Pool(PROCESSES) as pool:
        tasks = [(str(tmp_path), 2 * seed) for seed in range(PROCESSES)]
        assert sum(pool.starmap(work, tasks)) == 0
    for number in range(ROUNDS):
        file = LockedCacheFile(str(tmp_path), f"function-{number}", "stamp")
        assert [file.load(key) for key in range(FORMS)] == [f"code of {k}" for k in range(FORMS)]


def test_compiled_functions_use_the_lock() -> None:
    from fem.explicit.kernels.stiffness import stiffness_product

    assert isinstance(stiffness_product._cache._cache_file, LockedCacheFile)
    assert njit()(lambda x: 2 * x)(3) == 6
