"""The page of `tubelock explore`: numbers are those of the commands, bad messages are answered."""

from __future__ import annotations

import asyncio
import base64
import json
import pickle
import signal
import subprocess
import sys
import tomllib
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from geometry import Answer
from tests.support.chromium import BROWSER, Page
from tests.support.commands import command
from tests.support.pixels import open_pixels
from validation import load_case, solve
from validation.output.pictures.canvas import Polygons, View
from validation.pages.explore.sliders import COARSE, changed, controls

#: Lists in lists, as no page sends them.
DEEP = 2000 * "[" + 2000 * "]"
SETTINGS = ("assembly.layers=2", "mesh.around=24", "mesh.radial=2", "mesh.axial=4")


def tube(*settings: str):
    return load_case("tsb1-pipe", [*SETTINGS, *settings])


def printed_rows(answer: Answer) -> list[dict[str, Any]]:
    """Rows of the table that an answer prints, but CPU times."""
    return timeless(answer.table.as_json())


def timeless(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [row for row in rows if row["group"] != "time"]


# ---------------------------------------------------------------------------------------------
# Sliders


@pytest.mark.quick
def test_every_number_of_a_tube_has_a_slider_around_its_value() -> None:
    file = tube("limits.least_wall=30.0", "effects.friction=0.3")
    found = controls(file)
    keys = {slider.key for slider in found.sliders}
    block = {
        "height",
        "amplitude",
        "frequency",
        "shift",
        "blocks_per_layer",
        "inner_radius",
        "thickness",
    }
    assert {f"block.{key}" for key in block} | {
        "assembly.layers",
        "load.pressure",
        "limits.least_wall",
        "effects.friction.coefficient",
    } == keys
    assert found.case == "pipe"
    for slider in (*found.sliders, *controls(load_case("wall")).sliders):
        assert slider.low <= slider.value <= slider.high
        # The value of the scene is one that the slider can stand at.
        steps = (slider.value - slider.low) / slider.step
        assert steps == pytest.approx(round(steps))
    assert {s.unit for s in found.sliders if s.key in ("block.height", "load.pressure")} == {
        "mm",
        "MPa",
    }


@pytest.mark.quick
def test_values_of_the_page_make_the_scene_that_set_makes() -> None:
    values = {"block.amplitude": 12.0, "assembly.layers": 3, "load.case": "tunnel"}
    one = changed(tube(), controls(tube()), values, coarse=False).scene
    assert one == tube("block.amplitude=12.0", "assembly.layers=3", "load.case=tunnel").scene
    coarse = changed(tube(), controls(tube()), values, coarse=True).scene
    assert coarse.mesh.radial <= COARSE[1]
    # Another frequency has other waves: the facets along each of them stay, layers still meet.
    more = changed(tube(), controls(tube()), {"block.frequency": 2.5}, coarse=False).scene
    assert more.mesh.around == 5 * tube().scene.mesh.around // 3
    parts = changed(
        load_case("wall"), controls(load_case("wall")), {"block.size.1": 120}, coarse=True
    )
    assert parts.scene.block.size == (240.0, 120.0, 71.0)
    pushed = load_case("wall", ["loads=[{blocks = [3], force = [0.0, 0.0, -200.0]}]"])
    more = changed(pushed, controls(pushed), {"loads.0.force.2": -350.0}, coarse=True)
    assert more.scene.loads[0].force == (0.0, 0.0, -350.0)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("values", "line"),
    [
        (
            {"block.amplitude": 1e9},
            "block.amplitude: got 1000000000.0; expected a number from 0 to",
        ),
        ({"block.amplitude": "20"}, "block.amplitude: got '20'; expected a number"),
        ({"block.amplitude": True}, "block.amplitude: got True; expected a number"),
        ({"block.amplitude": float("nan")}, "block.amplitude: got nan; expected a number"),
        ({"assembly.layers": 2.5}, "assembly.layers: got 2.5; expected a whole number"),
        ({"fem.method": 1}, "fem.method: got a key without a slider; expected block.height"),
        ({"load.case": "../x"}, "load.case: got a key without a slider"),
        ({"block.frequency": 1.75}, "block.frequency: "),
    ],
)
def test_bad_values_are_lines(values: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        solve(changed(tube(), controls(tube()), values, coarse=True).with_method("rigid"))


# ---------------------------------------------------------------------------------------------
# The server


@asynccontextmanager
async def served(file) -> AsyncIterator[str]:
    """Address of a server of a scene."""
    pytest.importorskip("tornado")
    from tornado.httpserver import HTTPServer
    from tornado.netutil import bind_sockets

    from validation.pages.explore.server import application

    pool = ThreadPoolExecutor(1)
    server = HTTPServer(application(file, pool))
    sockets = bind_sockets(0, "127.0.0.1")
    server.add_sockets(sockets)
    try:
        yield f"127.0.0.1:{sockets[0].getsockname()[1]}"
    finally:
        server.stop()
        await server.close_all_connections()
        pool.shutdown()


async def told(channel, *messages: Any) -> list[dict[str, Any]]:
    """Answers until that of the last message."""
    for number, message in enumerate(messages):
        text = message if isinstance(message, str) else json.dumps({**message, "number": number})
        await channel.write_message(text)
    answers = [json.loads(await channel.read_message())]
    while answers[-1].get("number") not in (None, len(messages) - 1):
        answers.append(json.loads(await channel.read_message()))
    return answers


def test_of_values_that_come_quickly_the_last_wins() -> None:
    async def visit() -> list[dict[str, Any]]:
        from tornado.websocket import websocket_connect

        async with served(tube()) as address:
            channel = await websocket_connect(f"ws://{address}/channel")
            amplitudes = range(10, 20)
            messages = [
                {"kind": "values", "fine": True, "values": {"block.amplitude": float(a)}}
                for a in amplitudes
            ]
            answers = await told(channel, *messages)
            await channel.write_message(json.dumps({"kind": "download", "what": "scene"}))
            answers.append(json.loads(await channel.read_message()))
            channel.close()
            return answers

    *answers, file = asyncio.run(visit())
    # All ten are sent before the first is answered: it, and the last one, have an answer.
    assert len(answers) < 10
    own = solve(tube("block.amplitude=19.0").with_method("rigid"))
    assert timeless(answers[-1]["rows"]) == printed_rows(own)
    assert answers[-1]["picture"] != answers[0]["picture"]
    # The scene to download is the one that is shown.
    data = tomllib.loads(base64.b64decode(file["content"]).decode())
    assert file["name"] == "tsb1-pipe.toml"
    assert data["block"]["amplitude"] == 19.0


def test_a_page_sends_no_paths_and_no_code() -> None:
    async def visit() -> list[dict[str, Any]]:
        from tornado.websocket import websocket_connect

        async with served(tube()) as address:
            channel = await websocket_connect(f"ws://{address}/channel")
            messages: list[Any] = [
                "no JSON",
                {"kind": "__class__"},
                {"kind": "values", "values": {"parts.0.file": "/etc/passwd"}},
                {"kind": "values", "values": [1]},
                {"kind": "values", "values": {}, "view": {"width": "1e9"}},
                {"kind": "turn", "blocks": "deformable"},
                {"kind": "download", "what": "../../etc/passwd"},
                DEEP,
                f'{{"kind": "values", "values": {{"block.height": {DEEP}}}}}',
                f'{{"kind": "values", "number": {DEEP}, "values": [1]}}',
            ]
            answers = []
            for message in messages:
                answers += await told(channel, message)
            answers += await told(channel, {"kind": "values", "values": {}, "view": {"width": 1e9}})
            channel.close()
            return answers

    *bad, good = asyncio.run(visit())
    for answer in bad:
        assert "expected" in answer["error"] or answer["error"] == "there is no such answer yet"
    # The server goes on, and no picture is larger than a screen.
    assert "picture" in good


def test_other_sites_do_not_reach_the_server() -> None:
    async def visit() -> list[int]:
        from tornado.httpclient import AsyncHTTPClient, HTTPRequest
        from tornado.websocket import websocket_connect

        client, codes = AsyncHTTPClient(), []
        async with served(tube()) as address:
            for host in (address, "evil.example"):
                request = HTTPRequest(f"http://{address}/", headers={"Host": host})
                codes.append((await client.fetch(request, raise_error=False)).code)
            request = HTTPRequest(
                f"ws://{address}/channel", headers={"Origin": "http://evil.example"}
            )
            with pytest.raises(Exception, match="403"):
                await websocket_connect(request)
            return codes

    assert asyncio.run(visit()) == [200, 404]


def test_the_deformable_answer_comes_from_another_process(monkeypatch) -> None:
    from validation.pages.explore.answers import drawn, solve_deformable

    monkeypatch.setattr(signal, "signal", lambda *_: None)
    file = tube("assembly.layers=1", 'fem.mesh="scene"', "fem.error_estimate=false")
    sent: list[Any] = []
    connection = type("Connection", (), {"send": lambda _, data: sent.append(pickle.dumps(data))})()
    solve_deformable(connection, file)
    *progress, (word, shown) = map(pickle.loads, sent)
    assert all(kind == "progress" for kind, _ in progress)
    assert word == "done"
    own = solve(file)
    assert timeless(shown.facts["rows"]) == printed_rows(own)
    assert drawn(shown, {})["picture"] != drawn(shown, {"azimuth": 90.0})["picture"]
    solve_deformable(connection, tube("material.poisson_ratio=0.1", "fem.max_work=1e-9"))
    assert pickle.loads(sent[-1])[0] == "failed"


def test_ctrl_c_ends_the_server_without_a_word_of_python() -> None:
    pytest.importorskip("tornado")
    process = subprocess.Popen(
        [sys.executable, "-m", "validation.cli", "explore", "tsb1-pipe"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert "http://127.0.0.1:" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    words, errors = process.communicate()
    assert (process.returncode, words, errors) == (0, "stopped\n", "")


@pytest.mark.quick
def test_a_missing_extra_is_one_line(monkeypatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    status, _, told = command("explore", "tsb1-pipe")
    assert status == 2
    assert "pip install 'tubelock[explore]'" in told
    assert told.count("\n") == 1


@pytest.mark.quick
def test_every_thread_draws_the_same_picture() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    square = Polygons(corners, np.array([[0, 1, 2, 3]]), "#0072B2", lit=False)
    view = View([square], (0.0, 0.0, 1.0))
    here = view.render(60, 40)
    for _ in range(2):
        with ThreadPoolExecutor(1) as pool:
            assert np.array_equal(pool.submit(view.render, 60, 40).result(), here)
    assert np.array_equal(view.render(60, 40), here)


# ---------------------------------------------------------------------------------------------
# The page in a browser


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
def test_a_slider_moves_the_number_and_the_picture(tmp_path) -> None:
    focus = "document.querySelector('input[data-key=\"block.amplitude\"]').focus()"
    measure = "document.getElementById('rows').rows[2].cells.item(1).textContent"
    corners = "(r => [r.left, r.top, r.right, r.bottom])"
    place = f"{corners}(document.getElementById('stage').getBoundingClientRect())"

    async def stage(page: Page) -> np.ndarray:
        left, top, right, bottom = (int(v) for v in await page.evaluate(place))
        return open_pixels(await page.screenshot())[top + 2 : bottom - 2, left + 2 : right - 2]

    async def rest(page: Page, after: str) -> None:
        """Wait until the facets are those of the scene, after another answer than one."""
        await page.wait(
            f"document.body.dataset.number > {after} && document.body.dataset.fine === 'true'"
        )
        await page.evaluate("document.getElementById('picture').decode()")

    async def visit() -> None:
        async with served(tube()) as address, Page(tmp_path / "browser", 1400, 900) as page:
            await page.open(f"http://{address}/")
            await rest(page, "0")
            before, picture = await page.evaluate(measure), await stage(page)
            number = await page.evaluate("document.body.dataset.number")
            await page.evaluate(focus)
            for kind in ("keyDown", "keyUp"):
                await page.call(
                    "Input.dispatchKeyEvent",
                    type=kind,
                    key="ArrowLeft",
                    code="ArrowLeft",
                    windowsVirtualKeyCode=37,
                )
            await rest(page, number)
            after, moved = await page.evaluate(measure), await stage(page)
            own = [solve(tube(f"block.amplitude={a}").with_method("rigid")) for a in (20.0, 19.0)]
            words = [printed_rows(answer)[2]["words"] for answer in own]
            assert [before, after] == words
            # The tube is drawn, and its pressures are others.
            assert 0.02 < (picture < 0.95).any(axis=2).mean() < 0.9
            assert (np.abs(moved - picture) > 0.1).any(axis=2).mean() > 0.001
            # What cannot be built is said, and the page goes on.
            await page.evaluate(
                "for (const [k, v] of [['block.height', 50], ['block.amplitude', 40]]) {"
                'const s = document.querySelector(`input[data-key="${k}"]`); s.value = v;'
                "s.dispatchEvent(new Event('input')); }"
            )
            await page.wait(
                "document.getElementById('error').textContent.includes('block.amplitude: got 40')"
            )
            await page.evaluate("document.getElementById('reset').click()")
            await page.wait("document.getElementById('error').textContent === ''")
            assert page.errors == []
            outside = [
                u
                for u in page.requests
                if not u.startswith((f"http://{address}/", "data:", "blob:"))
            ]
            assert outside == []

    asyncio.run(visit())
