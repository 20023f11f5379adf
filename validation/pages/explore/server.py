"""Server of the page: one WebSocket a page, one thread that computes, one process that deforms.

Pages send plain data: values of sliders, angles, and the names of buttons. No path and no code of a
page is used. Of messages of one kind the newest counts.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from geometry.answer import Answer
from geometry.errors import RefusedError
from geometry.machine.system import stop_signals
from validation.case import Case
from validation.errors import InputError
from validation.pages.explore.answers import (
    Shown,
    download,
    drawn,
    rigid_shown,
    solve_deformable,
)
from validation.pages.explore.sliders import Controls, changed, controls
from validation.pages.page import page_text

#: Names of this machine in the address of a page; others are answered with 404, so that no page of
#: another site can reach the server under a name of its own.
HERE = r"(localhost|127\.0\.0\.1|\[::1\])"
#: Longest message of a page [bytes].
_LONGEST = 20_000
#: What a page may load: what it holds, and the WebSocket of its server.
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'"
)


class _Page(RequestHandler):
    """The page itself."""

    def initialize(self, text: str) -> None:
        self.text = text

    def set_default_headers(self) -> None:
        self.set_header("Content-Security-Policy", _POLICY)
        self.set_header("Cache-Control", "no-store")

    def get(self) -> None:
        self.finish(self.text)


class _Channel(WebSocketHandler):
    """What one open page and the server tell each other; tornado rejects pages of other sites."""

    def initialize(self, file: Case, known: Controls, pool: ThreadPoolExecutor) -> None:
        self.file, self.known, self.pool = file, known, pool
        self.current = file
        self.run: Answer | None = None
        self.rigid: Shown | None = None
        self.deformable: Shown | None = None
        self.process: Any = None
        self.pending: dict[str, dict[str, Any]] = {}
        self.wake = asyncio.Event()

    def open(self, *_: str, **__: str) -> None:
        self.work = asyncio.ensure_future(self._work())

    def on_message(self, message: str | bytes) -> None:
        """Keep the newest message of each kind."""
        try:
            data = json.loads(message)
            self.pending[str(data["kind"])] = data
        except (ValueError, TypeError, KeyError, RecursionError):
            self.pending["unknown"] = {}
        self.wake.set()

    def on_close(self) -> None:
        self.work.cancel()
        self._stop()

    async def _work(self) -> None:
        """Answer messages, one after the other."""
        loop = asyncio.get_running_loop()
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.pending:
                kind = next(iter(self.pending))
                data = self.pending.pop(kind)
                reply = await loop.run_in_executor(self.pool, self._answer, kind, data)
                if reply is not None:
                    number = data.get("number")
                    asked = {"number": number if isinstance(number, int) else None}
                    await self._send({"kind": kind, **asked, **reply})
                if kind == "deform" and self.process is None:
                    self._start()

    async def _send(self, data: dict[str, Any]) -> None:
        with contextlib.suppress(WebSocketClosedError):
            await self.write_message(json.dumps(data))

    def _answer(self, kind: str, data: dict[str, Any]) -> dict[str, Any] | None:
        """Answer a message; input errors are answers with their line."""
        try:
            answer = {
                "values": self._values,
                "turn": self._turn,
                "deform": self._deform,
                "stop": self._stopped,
                "download": self._download,
            }.get(kind)
            if answer is None:
                raise InputError("message: expected values, turn, deform, stop or download")
            return answer(data)
        except RefusedError as error:
            return {"error": str(error)}
        except RecursionError:
            return {"error": "message: lists in lists, too deep; expected names and values"}
        except MemoryError:
            return {"error": "this needs more memory than there is; take fewer blocks or facets"}

    def _values(self, data: dict[str, Any]) -> dict[str, Any]:
        """Answer new values of sliders by rigid blocks."""
        start = time.thread_time()
        values, view = _mapping(data, "values"), _mapping(data, "view")
        coarse = data.get("fine") is not True
        stated = changed(self.file, self.known, values, coarse=False)
        one = changed(self.file, self.known, values, coarse=True) if coarse else stated
        stopped = stated.source != self.current.source and self.process is not None
        if stated.source != self.current.source:
            self._stop()
            self.deformable = None
        self.current, self.rigid = stated, None
        self.run, self.rigid = rigid_shown(one)
        picture = drawn(self.rigid, view)
        spent = {"milliseconds": 1e3 * (time.thread_time() - start)}
        return {"fine": not coarse, "stopped": stopped, **self.rigid.facts, **picture, **spent}

    def _shown(self, data: dict[str, Any]) -> Shown | None:
        return self.deformable if data.get("blocks") == "deformable" else self.rigid

    def _turn(self, data: dict[str, Any]) -> dict[str, Any]:
        """Draw an answer again, from elsewhere."""
        shown = self._shown(data)
        if shown is None:
            raise InputError("there is no such answer yet")
        return {**shown.facts, **drawn(shown, _mapping(data, "view"))}

    def _download(self, data: dict[str, Any]) -> dict[str, Any]:
        shown = self._shown(data)
        name, content = download(str(data.get("what")), self.current, self.run, shown)
        return {"name": name, "content": base64.b64encode(content).decode()}

    # -----------------------------------------------------------------------------------------
    # Deformable blocks

    def _deform(self, _: dict[str, Any]) -> dict[str, Any]:
        return {"progress": "starts"}

    def _start(self) -> None:
        """Solve the current scene in a process of its own."""
        ours, theirs = multiprocessing.Pipe(duplex=False)
        self.process = multiprocessing.get_context("spawn").Process(
            target=solve_deformable,
            args=(theirs, self.current),
            daemon=True,
        )
        self.process.start()
        theirs.close()
        self.following = asyncio.ensure_future(self._follow(self.process, ours))

    async def _follow(self, process: Any, connection: Any) -> None:
        """Pass on what the process sends, until it ends or is ended."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                word, content = await loop.run_in_executor(None, connection.recv)
            except (EOFError, OSError):
                break
            if self.process is not process:
                break
            if word == "done":
                self.deformable = content
                await self._send({"kind": "deformed"})
            else:
                await self._send({"kind": "deform", word: content})
        if self.process is process:
            self.process = None
        connection.close()

    def _stop(self) -> None:
        """End the process that solves, if there is one."""
        process, self.process = self.process, None
        if process is not None:
            process.terminate()

    def _stopped(self, _: dict[str, Any]) -> dict[str, Any]:
        self._stop()
        return {"progress": ""}


def _mapping(data: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a part of a message that is a mapping."""
    value = data.get(name, {})
    if not isinstance(value, dict):
        raise InputError(f"{name}: got {str(value)[:40]!r}; expected names and values")
    return value


# ---------------------------------------------------------------------------------------------
# The server


def application(file: Case, pool: ThreadPoolExecutor, *, host: str = HERE) -> Application:
    """Return the pages of a scene, under the names of a host (a pattern)."""
    known = controls(file)
    text = page_text(
        "explore.html",
        file=file,
        controls=known.as_json(),
        round=file.is_tube,
    )
    stated = {"file": file, "known": known, "pool": pool}
    app = Application(websocket_max_message_size=_LONGEST)
    app.add_handlers(host, [("/", _Page, {"text": text}), ("/channel", _Channel, stated)])
    return app


async def serve(file: Case, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Serve the page of a scene until it is interrupted; ``tell`` is called with the address.

    Raises
    ------
    InputError
        A host or a port that cannot be listened to.
    """
    here = host in ("127.0.0.1", "localhost", "::1")
    try:
        sockets = bind_sockets(port, host)
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(
            f"--host {host} --port {port}: cannot be listened to ({why}); expected an address of "
            "this machine, and a free port, or none"
        ) from None
    pool = ThreadPoolExecutor(1, "answers")
    server = HTTPServer(application(file, pool, host=HERE if here else r".*"))
    server.add_sockets(sockets)
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    name = f"[{host}]" if ":" in host else host
    try:
        with stop_signals(lambda *_: loop.call_soon_threadsafe(stop.set)):
            tell(f"http://{name}:{sockets[0].getsockname()[1]}/")
            await stop.wait()
    finally:
        server.stop()
        await server.close_all_connections()
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()


def explore_until_stopped(file: Case, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Serve the page of a scene; Ctrl-C ends it."""
    asyncio.run(serve(file, host, port, tell))
