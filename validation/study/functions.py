"""A sweep over problems that a function of parameters makes."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from geometry.errors import RefusedError
from mbd.options import Rigid
from validation.case import Case, Method
from validation.solving import repeatable, solve
from validation.study.study import Quantity, Study

if TYPE_CHECKING:
    from fem.problem import Problem


def sweep_function(
    make: Callable[..., Problem], parameters: Mapping[str, Sequence[Any]], method: Method
) -> tuple[Study, list[dict[str, Any]]]:
    """Answer ``make(**values)`` for every combination of values; the last varies fastest.

    A row has the parameters, the measures with their error bars, ``status`` and ``message``.
    """
    name = getattr(make, "__name__", "function")
    stated = tuple((key, tuple(values)) for key, values in parameters.items())
    quantity: Quantity = "rigid" if isinstance(method, Rigid) else "fem"
    study = Study(name=name, quantity=quantity, scene={}, parameters=stated)
    rows = []
    for number, chosen in enumerate(itertools.product(*(values for _, values in stated))):
        values = dict(zip(parameters, chosen, strict=True))
        start, row = time.process_time(), {"number": number, **values}
        try:
            case = Case(name=f"{name}[{number}]", stated=make(**values), method=method)
            measures = repeatable(solve(case)).measures
        except RefusedError as error:
            row |= {"status": "failed", "message": str(error)}
        else:
            for key, measure in measures.items():
                row |= {key: measure.value, f"{key}_error": measure.error}
            row |= {"status": "ok", "message": ""}
        rows.append(row | {"cpu_seconds": time.process_time() - start})
    return study, rows
