"""The command line."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


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
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _repeat_lost_interruption
    try:
        from validation.cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("stopped: nothing was saved", file=sys.stderr)
        raise SystemExit(130) from None
