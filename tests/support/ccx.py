"""CalculiX as an oracle: the one file of tests that knows where the program is run."""

from __future__ import annotations

from validation.study.comparison.calculix import (
    CalculixError,
    CalculixResult,
    calculix_available,
    run_calculix,
)

__all__ = ["CalculixError", "CalculixResult", "calculix_available", "run_calculix"]
