"""Compiled functions: made or loaded when the first one is called.

The compiler takes a second to load; a program that calls no compiled function does not wait for it.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

#: When the first kernels were read [s since the epoch]: sources that are newer are not what runs.
_STARTED = time.time()


class Kernel:
    """A function that is compiled when it is called, or when a compiled function calls it."""

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], *, cached: bool
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options, self._cached = function, options, cached

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function; in its place wherever numba meets it."""
        import numba

        from geometry.compilation.compiler import KernelCache, folder_of

        result = numba.njit(**self._options)(self._function)
        # Absent where compilation is disabled.
        if self._cached and hasattr(result, "targetoptions"):
            folder = folder_of(self._function.__module__, _STARTED)
            if folder is not None:
                result._cache = KernelCache(self._function, result.targetoptions, folder)
        return result

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.dispatcher(*arguments)

    def code(self, *arguments: Any) -> Callable[..., Any]:
        """Machine code for arguments of the types of these, which are not asked at every call.

        That takes longer than the work on few nodes, where arguments are tuples of arrays.
        """
        dispatcher = self.dispatcher
        if not hasattr(dispatcher, "typeof_pyval"):  # compilation is disabled
            return self._function
        types = tuple(map(dispatcher.typeof_pyval, arguments))
        code: Callable[..., Any] = dispatcher.compile(types)
        return code

    def bound(self, *arguments: Any) -> Callable[[], Any]:
        """Call with these arguments, arrays that are written in place."""
        return functools.partial(self.code(*arguments), *arguments)

    def __getattr__(self, name: str) -> Any:
        """All else is the dispatcher's, the type that numba asks for too."""
        return getattr(self.dispatcher, name)

    def __reduce__(self) -> str:
        """By name, as functions are."""
        return str(self.__qualname__)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit`; with ``cache=True`` machine code is kept: of a function without a closure."""
    cached = options.pop("cache", False)

    def kernel(function: Callable[..., Any]) -> Kernel:
        # Functions of one factory differ in nothing by which code is kept.
        assert not (cached and function.__closure__)
        return Kernel(function, options, cached=cached)

    return kernel
