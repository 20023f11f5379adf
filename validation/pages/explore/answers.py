"""What the page shows: a rigid answer at once, a deformable one from a process of its own."""

from __future__ import annotations

import base64
import io
import math
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geometry.answer import Answer
from geometry.errors import RefusedError
from validation.case import Case, solve
from validation.errors import InputError
from validation.output.answer_files import is_meshed, pictures
from validation.output.pictures.canvas import View
from validation.output.pictures.scales import Scale
from validation.output.pictures.view_3d import colour_gradient
from validation.pages.verdicts import verdicts
from validation.pages.views import layer_words, middle_layers, rigid_view, stressed
from validation.scene.keys.toml_text import toml_text

_STRESS = "maximum principal stress σ₁, red is tension"
_FRAMES = "end rings may lock a short tube: `tubelock mbd SCENE --layers-to-unlock` checks it"
#: Most pixels along one side of a picture, and the farthest that the eye comes near.
_LARGEST, _NEAREST = 2000, 8.0


@dataclass(frozen=True)
class Shown:
    """An answer as the page shows it; a process can send it to another."""

    views: tuple[tuple[View, Scale | None, str], ...]
    """All layers, and of a long tube the middle ones: with colours, and in words."""
    facts: dict[str, Any]
    """Verdicts, measures and more, as plain data."""
    picture: bytes = b""
    """The picture to download (PNG) where it is drawn already."""


def rigid_shown(file: Case) -> tuple[Answer, Shown]:
    """Answer a scene by rigid blocks."""
    start = time.process_time()
    run = solve(file.with_method("rigid"))
    found = [vars(v) for v in verdicts(run, None, {})]
    ignored = [
        key
        for key in file.key_use("rigid").idle
        if key.startswith(("block.", "assembly.", "load."))
    ]
    layers = dict.fromkeys((None, middle_layers(run.details.blocks)))
    views = []
    for some in layers:
        view, scale, words = rigid_view(run, some)
        views.append((view, scale, f"Rigid blocks{layer_words(some)}: {words}."))
    facts = {
        "verdicts": found,
        "rows": run.table.as_json(),
        "ignored": ignored,
        "note": _FRAMES if file.frames_may_lock else "",
        "mesh": _mesh_words(run),
        "milliseconds": 1e3 * (time.process_time() - start),
    }
    return run, Shown(tuple(views), facts)


def _mesh_words(run: Answer) -> str:
    """Facets of a block, where there is a mesh."""
    counts = run.case.element_counts.items() if is_meshed(run) else ()
    words = (f"{' × '.join(map(str, np.atleast_1d(n)))} {name}" for name, n in counts)
    return ", ".join(words) or f"{run.details.n_contacts} contact points"


def camera(drawn: View, view: Mapping[str, Any]) -> tuple[View, dict[str, float]]:
    """View from where the page looks, and its angles; where it names none, the usual ones."""
    x, y, z = drawn.direction
    usual = {
        "azimuth": math.degrees(math.atan2(y, x)),
        "elevation": math.degrees(math.atan2(z, math.hypot(x, y))),
        "zoom": 1.0,
    }
    seen = {name: _number(view, name, value) for name, value in usual.items()}
    turn, lift = (
        math.radians(seen["azimuth"]),
        math.radians(min(max(seen["elevation"], -89.0), 89.0)),
    )
    direction = math.cos(lift) * math.cos(turn), math.cos(lift) * math.sin(turn), math.sin(lift)
    zoom = min(max(seen["zoom"], 1.0 / _NEAREST), _NEAREST)
    return View(drawn.parts, direction, margin=1.02 / zoom - 1.0), seen


def _number(given: Mapping[str, Any], name: str, default: float) -> float:
    value = given.get(name)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{name}: got {value!r}; expected a number")
    return float(value)


def drawn(shown: Shown, view: Mapping[str, Any]) -> dict[str, Any]:
    """Picture of an answer with its colour bar, as plain data."""
    from PIL import Image

    whole, scale, caption = shown.views[-1 if view.get("middle") is True else 0]
    seen, angles = camera(whole, view)
    size = (_number(view, name, 700.0) for name in ("width", "height"))
    width, height = (round(min(max(value, 16.0), _LARGEST)) for value in size)
    buffer = io.BytesIO()
    Image.fromarray(seen.render(width, height)).save(buffer, format="PNG", compress_level=1)
    picture = f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    return {"picture": picture, "view": angles, "bar": _bar(scale), "caption": caption}


def _bar(scale: Scale | None) -> dict[str, Any] | None:
    """Colours and numbers of a colour bar; None where no colours mean anything."""
    if scale is None:
        return None
    beyond = scale.beyond in ("max", "both")
    ticks = [f"{value:.3g}" for value in np.linspace(scale.low, scale.high, 3)]
    return {
        "gradient": colour_gradient(scale),
        "ticks": ticks,
        "label": scale.label + (f", max. {scale.reached[1]:.3g}" if beyond else ""),
        "lines": scale.lines[1:],
    }


# ---------------------------------------------------------------------------------------------
# Deformable blocks


def solve_deformable(connection: Any, file: Case) -> None:
    """Solve a case in a process of its own; send its progress, and what is shown at the end.

    What is sent are pairs: ``progress`` or ``failed`` with a line, ``done`` with a `Shown`.
    """
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server ends this process
    try:
        connection.send(("done", _deformable_shown(file, partial(_send, connection))))
    except RefusedError as error:
        connection.send(("failed", str(error)))
    except MemoryError:
        connection.send(("failed", "deformable blocks need more memory than there is"))


def _send(connection: Any, words: str) -> None:
    connection.send(("progress", words))


def _deformable_shown(file: Case, tell: Any) -> Shown:
    from validation.case import solve
    from validation.output.pictures.gallery import png_of
    from validation.output.pictures.scales import drawing_scale
    from validation.output.pictures.tubes import draw_stresses

    tell("first mesh")
    start = time.process_time()
    answer = solve(file, lambda now: tell(str(now)))
    tell("pictures")
    layers = dict.fromkeys((None, middle_layers(answer.details.whole.assembly)))
    moved = f"displacement scaled × {drawing_scale(answer.details):g}"
    views = tuple(
        (*stressed(answer, some), f"Deformable blocks{layer_words(some)}: {_STRESS}, {moved}.")
        for some in layers
    )
    facts = {
        "verdicts": [vars(v) for v in verdicts(None, answer, {})],
        "rows": answer.table.as_json(),
        "ignored": [],
        "mesh": answer.title,
        "milliseconds": 1e3 * (time.process_time() - start),
    }
    return Shown(views, facts, png_of(draw_stresses(answer)))


# ---------------------------------------------------------------------------------------------
# Downloads


def download(what: str, file: Case, run: Answer | None, shown: Shown | None) -> tuple[str, bytes]:
    """Name and content of what the page asks for: ``scene``, ``picture`` or ``deck``."""
    if what == "scene":
        data = file.keys
        return f"{file.name}.toml", toml_text(data).encode()
    if what == "deck":
        return f"{file.name}.inp", _deck(file)
    if what != "picture":
        raise InputError(f"download: got {what[:40]!r}; expected scene, picture or deck")
    if shown is not None and shown.picture:
        return f"{file.name}.png", shown.picture
    if run is None:
        raise InputError("picture: there is no answer to draw; move a slider first")
    return f"{file.name}.png", _drawing(run)


def _deck(file: Case) -> bytes:
    from validation.output.decks import export_deck

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.inp"
        export_deck(file, None, path)
        return path.read_bytes()


def _drawing(run: Answer) -> bytes:
    """The first picture of `tubelock mbd`."""
    from validation.output.pictures.gallery import png_of

    drawings = pictures(run)
    if not drawings:
        raise InputError("picture: the load is not carried; there are no pressures to draw")
    return png_of(next(iter(drawings.values()))())
