"""The command line."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

#: What numpy and scipy name as they are loaded and seldom use: a tenth of the start.
_SELDOM = {
    *("numpy.char", "numpy.f2py", "numpy.random", "numpy.testing"),
    *("pydoc", "scipy.spatial.transform"),
}


class _WhenUsed(PathFinder):
    """Finds `_SELDOM`, which are loaded when something of them is used."""

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = super().find_spec(name, path, target) if name in _SELDOM else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


class Interrupted(KeyboardInterrupt):
    """Ctrl-C.

    Python ends a process by the signal where a `KeyboardInterrupt` itself passed through ``exec``,
    which dataclasses call as they are made, though it was caught afterwards.
    """


def _interrupt(_number: int, _frame: FrameType | None) -> NoReturn:
    raise Interrupted


def _repeat_lost_interruption(lost: UnraisableHookArgs) -> None:
    """Interrupt again where Python ignored it: in finalizers and in callbacks of C libraries."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
    elif not sys.is_finalizing():
        from geometry.machine.system import interrupt

        threading.Timer(0.01, interrupt).start()


def main() -> None:
    """Run the command line; Ctrl-C while it is loaded ends it as later."""
    gc.disable()  # loaded modules are never freed: a search among them takes a tenth of the start
    # Its search for plugins opens a file of every installed package.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    if _WhenUsed not in sys.meta_path:
        sys.meta_path.insert(0, _WhenUsed)
    sys.unraisablehook = _repeat_lost_interruption
    try:
        from validation.cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("stopped: nothing was saved", file=sys.stderr)
        raise SystemExit(130) from None
