"""Words about the keys of sections: docstrings below the fields of a class, or descriptions."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from functools import cache


@cache
def field_docstrings(section: type) -> dict[str, str]:
    """Literals below the fields of a class and of its bases, in one line each."""
    result: dict[str, str] = {}
    for base in reversed(section.__mro__):
        result |= _own_docstrings(base)
    for name, field in getattr(section, "model_fields", {}).items():
        if field.description is not None:
            result.setdefault(name, field.description)
    return result


@cache
def _own_docstrings(base: type) -> dict[str, str]:
    """Literals below the fields of a class itself."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
    except (OSError, TypeError):
        return {}
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    return {
        field.target.id: " ".join(str(text.value.value).split())
        for field, text in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }
