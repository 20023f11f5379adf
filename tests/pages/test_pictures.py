"""Pictures: what is drawn is what is there, words have room, colours say where they end."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from geometry import Assembly, RefusedError, box_block
from tests.support.answers import on_its_mesh
from tests.support.commands import set_words
from validation import load_case, solve
from validation.output.pictures import assemblies, scales, tubes
from validation.output.pictures import canvas as drawing
from validation.output.pictures import gallery as gallery_pictures
from validation.output.pictures.bodies import EYE, blocks, edges_of, eye, labelled, turn_colours
from validation.output.pictures.canvas import Lines, Polygons, View
from validation.output.pictures.gallery import Panel, gallery
from validation.output.pictures.scales import (
    Scale,
    pressure_scale,
    scale_from_zero,
    symmetric_scale,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RED = np.array([255, 0, 0], dtype=np.uint8)
COARSE = ("assembly.layers=1", "mesh.around=24", "mesh.radial=2", "mesh.axial=4")


def square(size: float = 1.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Polygons:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * size + np.array(at)
    return Polygons(corners, np.array([[0, 1, 2, 3]]), RED[None], lit=False)


# ---------------------------------------------------------------------------------------------
# What is seen


def test_a_view_shows_what_is_there_at_its_place() -> None:
    """Two squares, 1 mm apart: seen from above they fill their thirds, and nothing between."""
    view = View([square(), square(at=(2.0, 0.0, 0.0))], (0.0, 0.0, 1.0), margin=0.0)
    assert view.size == pytest.approx((3.0, 1.0))
    for _ in range(2):  # the first picture of a program is no other than the second
        pixels = view.render(300, 100)
        assert pixels.shape == (100, 300, 3)
        drawn = (pixels == RED).all(axis=2)
        assert drawn[2:-2, 2:98].all()
        assert drawn[2:-2, 202:298].all()
        assert (pixels[:, 103:197] == 255).all()
    x, y = view.place(np.array([2.5, 0.25, 0.0]))
    assert (x, y) == pytest.approx((2.5, 0.25))


def test_lines_on_a_surface_are_seen_and_faces_that_look_away_are_not() -> None:
    edge = Lines(np.array([[0.1, 0.5, 0.0], [0.9, 0.5, 0.0]]), np.array([[0, 1]]), width=4.0)
    pixels = View([square(), edge], (0.0, 0.0, 1.0), margin=0.0).render(100, 100)
    assert (pixels[48:52, 20:80] < 100).all(axis=2).any(axis=0).all()
    plain = square()
    away = Polygons(plain.points, plain.polygons[:, ::-1], plain.colour, lit=False, two_sided=False)
    assert (View([away], (0.0, 0.0, 1.0)).render(50, 50) == 255).all()


def test_a_box_has_twelve_edges_however_it_is_meshed() -> None:
    for divisions in ((1, 1, 1), (3, 2, 4)):
        block = box_block((1.0, 2.0, 3.0), divisions)
        length = np.linalg.norm(np.diff(block.mesh.nodes[edges_of(block)], axis=1), axis=2)
        assert length.sum() == pytest.approx(4 * (1 + 2 + 3))


def test_a_view_of_the_same_parts_from_another_side_is_that_of_new_ones() -> None:
    """The camera moves round parts that are there; nothing is kept of other parts."""
    for parts in ([square(), square(at=(0.0, 0.0, 2.0))], [square(2.0)]):
        for direction in ((0.0, 0.0, 1.0), (1.0, -1.0, 1.0), (1.0, 0.0, 0.1)):
            pixels = View(parts, direction).render(60, 40)
            np.testing.assert_array_equal(pixels, View(list(parts), direction).render(60, 40))


def test_faces_of_closed_blocks_that_look_away_are_hidden() -> None:
    """Drawn or not, from any side: pictures of deformed blocks leave them out."""
    tube = load_case("tsb1-pipe", COARSE).problem.blocks
    for direction in (EYE, (0.3, 1.0, -1.0)):
        drawn = [
            View(blocks(tube, turn_colours(tube), two_sided=both, lit=False), direction)
            for both in (True, False)
        ]
        one, other = (view.render(200, 200) for view in drawn)
        assert (one != other).mean() < 1e-3  # where faces of two blocks lie on each other


def test_blocks_stand_where_they_are_asked_to() -> None:
    """Of two boxes of one shape one is drawn, moved by a vector: its surface, edges and colour."""
    box = box_block((1.0, 2.0, 3.0), (2, 2, 2))
    two = Assembly(
        name="two",
        shapes=(box,),
        shape_of=np.zeros(2, dtype=np.int64),
        rotations=np.array([np.eye(3)] * 2),
        translations=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]),
        layer=np.array([0, 1]),
        fixed=np.array([True, False]),
    )
    moved = np.array([5.0, 0.0, 1.0])
    skin, lines = blocks(two, lambda _: "#FF0000", lambda b: two.nodes(b) + moved, only=[1])
    stands = two.nodes(1) + moved
    for part in (skin, lines):
        assert part.points.min(axis=0) == pytest.approx(stands.min(axis=0))
        assert part.points.max(axis=0) == pytest.approx(stands.max(axis=0))
    assert (skin.colour == RED).all()
    corners = skin.points[skin.polygons]
    sides = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert 0.5 * np.linalg.norm(sides, axis=1).sum() == pytest.approx(2 * (2 + 3 + 6))


# ---------------------------------------------------------------------------------------------
# Colours


def test_each_quantity_has_colours_of_its_own() -> None:
    maps = [value for name, value in vars(scales).items() if name.endswith("_MAP")]
    assert len(set(maps)) == len(maps) >= 6


def test_bars_have_an_arrow_where_values_go_beyond_their_colours() -> None:
    values = np.concatenate([np.linspace(-1.0, 1.0, 2001), [5.0]])
    scale = symmetric_scale("σ₁ [MPa]", "RdBu_r", [values])
    assert scale.high < 1.01
    assert scale.beyond == "both"
    assert scale.words == "σ₁ [MPa], min. −1, max. 5"
    small = symmetric_scale("σ₁ [MPa]", "RdBu_r", [1e-5 * values])
    assert small.words == "σ₁ [10⁻⁶ MPa], min. −10, max. 50"
    assert scale_from_zero("p", "YlGnBu", [values]).beyond == "min"
    # The end of the bar says what a remark would repeat.
    assert Scale("p", "YlGnBu", 0.0, 0.5159, (0.0, 0.5161)).words == "p"
    whole = Scale("p", "YlGnBu", 0.0, 1.0, (0.0, 1.0))
    assert (whole.beyond, whole.words) == ("neither", "p")
    assert (whole.of(np.array([-1.0, 2.0])) == whole.of(np.array([0.0, 1.0]))).all()
    nothing = scale_from_zero("p", "YlGnBu", [np.zeros(0)])
    assert nothing.high > nothing.low


@given(st.floats(0.01, 10.0), st.floats(0.01, 10.0))
def test_colours_about_zero_are_the_same_on_both_sides_however_far_each_goes(low, high) -> None:
    """Equal stresses have equal colours, and zero is the middle of the map at any range."""
    scale = Scale("σ", "RdBu_r", -low, high, (-low, high), diverging=True)
    reach = max(low, high)
    both = Scale("σ", "RdBu_r", -reach, reach, (-reach, reach), diverging=True)
    values = np.linspace(-low, high, 7)
    assert (scale.of(values) == both.of(values)).all()
    assert (scale.of(np.zeros(1)) == both.of(np.zeros(1))).all()
    assert (scale.gradient(2) == both.of(np.array([-low, high]))).all()


def test_pressures_far_below_the_largest_have_colours_of_their_own() -> None:
    """Two of three joints carry a fiftieth: equal ratios are equal lengths of a bar."""
    joints = np.array([0, 1, 2, 3])
    scale = pressure_scale("p [MPa]", np.array([1.0, 0.02, 0.01, 0.0]), joints)
    assert (scale.low, scale.high) == pytest.approx((1e-3, 1.0))
    np.testing.assert_allclose(
        scale.position(np.array([1e-3, 1e-2, 0.1, 1.0])), [0, 1 / 3, 2 / 3, 1]
    )
    assert scale.ticks(6) == pytest.approx([1e-3, 1e-2, 0.1, 1.0])
    linear = replace(scale, low=0.0, decades=0.0)
    shades = [one.of(np.array([0.02, 0.01])).astype(int) for one in (scale, linear)]
    apart = [np.abs(np.diff(shade, axis=0)).max() for shade in shades]
    assert apart[0] > 2 * apart[1]
    assert (scale.of(np.zeros(1)) == 0xE4).all()
    assert scale.words == "p [MPa], logarithmic"
    even = pressure_scale("p [MPa]", np.array([1.0, 0.5, 0.01]), np.array([0, 1, 2]))
    assert not even.decades


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0, 4.0])
def test_a_tube_is_seen_from_the_side_of_a_point(small_tube: Assembly, turn: float) -> None:
    arm = np.array([np.cos(turn), np.sin(turn), 0.3])
    x, y, z = eye(small_tube, small_tube.origin + arm)
    assert z == EYE[2]
    assert (x, y) @ arm[:2] / np.hypot(x, y) > np.cos(np.pi / 4) - 1e-9
    view = View([square()], (x, y, z)).axes
    seen = np.sort(np.abs(view[0, :2]))
    assert seen == pytest.approx(np.sort(np.abs(View([square()], EYE).axes[0, :2])))


def test_unrolled_facets_keep_their_place_and_area() -> None:
    """∫ r dθ dr over the map is the area of the ring that the joint covers, seen along the axis."""
    run = solve(load_case("tsb1-tunnel", COARSE, method="rigid"))
    facets = assemblies.rigid_facets(run)
    rows = facets.between(1)
    flat = assemblies.unrolled_corners(run.details.blocks, facets.corners[rows])
    angle, radius = np.radians(flat[..., 0]), flat[..., 1]
    assert np.ptp(angle, axis=1).max() < 0.5
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    np.testing.assert_allclose(np.stack([x, y], axis=2), facets.corners[rows][..., :2], atol=1e-9)
    area = 0.5 * np.abs(
        np.sum(angle * np.roll(radius**2 / 2, -1, 1) - np.roll(angle, -1, 1) * radius**2 / 2, 1)
    )
    assert area.sum() == pytest.approx(np.pi * (160.0**2 - 120.0**2), rel=1e-2)


# ---------------------------------------------------------------------------------------------
# Words and files


def assert_words_have_room(figure: Figure) -> None:
    """No text overlaps another one or leaves the page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip()]
    boxes = [t.get_window_extent(renderer) for t in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert box.x0 >= 0.0, text
        assert box.y0 >= 0.0, text
        assert box.x1 <= figure.bbox.width, text
        assert box.y1 <= figure.bbox.height, text
    for i, box in enumerate(boxes):
        for j in range(i):
            assert not box.overlaps(boxes[j]), (texts[i], texts[j])


def test_words_of_a_picture_have_room_and_name_scene_load_and_program() -> None:
    tube = replace(load_case("tsb1-pipe", COARSE), name="a tube with a name that is long")
    run = on_its_mesh(tube, method="static")
    drawn = [tubes.draw_stresses(run), tubes.draw_contact(run)]
    drawn.append(assemblies.draw_pressures(solve(tube.with_method("rigid"))))
    for figure in drawn:
        gallery_pictures.png_of(figure)  # with its foot
        assert_words_have_room(figure)
    words = " ".join(words_of(drawn[-1]))
    program = f"tubelock {version('tubelock')}+"
    for part in ("name that is long", "internal pressure 0.01 MPa", program, "layer 1"):
        assert part in words


def words_of(figure: Figure) -> list[str]:
    from matplotlib.text import Text

    return [t.get_text() for t in figure.findobj(Text)]


def test_numbers_stand_on_the_blocks_that_are_seen_and_gravity_has_an_arrow() -> None:
    """Of two squares above each other only the upper one is named, in its middle."""
    lower, upper = square(), square(0.5, (0.5, 0.5, 1.0))
    hidden = square(0.2, (0.6, 0.6, 0.5))
    view = View([lower, upper, hidden], (0.0, 0.0, 1.0), weight=(0.0, -9810.0, 0.0))
    bodies = [(s.points, s.polygons) for s in (lower, upper, hidden)]
    panel = labelled(Panel("squares", view), "012", bodies)
    assert set(dict(panel.labels)) == {"0", "1"}
    np.testing.assert_allclose(dict(panel.labels)["1"], (0.75, 0.75), atol=0.01)
    # Blocks of one shape have one name: it stands on each of them.
    alike = labelled(panel, "aaa", bodies)
    assert [name for name, _ in alike.labels] == ["a", "a"]
    assert {"0", "1", "x", "y", "g"} <= set(words_of(gallery([[panel]], "title")))
    weightless = replace(panel, view=replace(view, weight=None))
    assert "g" not in words_of(gallery([[weightless]], "title"))


def test_a_picture_states_its_program_and_takes_words_as_they_are(tmp_path: Path) -> None:
    figure, axes = gallery_pictures.subplots(1, 1, size=(3.0, 2.0))
    axes.set_title("a square $x^{2$")
    gallery_pictures.save_figure(figure, tmp_path / "chart.png")
    drawn = gallery_pictures.pixels_of(figure)
    with Image.open(tmp_path / "chart.png") as image:
        assert image.size == (390, 260)
        assert image.info["dpi"] == pytest.approx((130, 130), rel=1e-3)
        np.testing.assert_array_equal(np.asarray(image), drawn)
        assert f"tubelock {version('tubelock')}+" in image.text["Software"]


@pytest.mark.parametrize("dpi", [65, 130, 200])
def test_blocks_lie_in_their_place_however_large_a_notebook_shows_a_figure(
    dpi: int, tmp_path: Path
) -> None:
    """Without margins the red square touches its own axes and words, at their distance."""
    figure = gallery([[Panel("a square", View([square()], (0.0, 0.0, 1.0)))]], "title")
    figure.savefig(tmp_path / "a.png", dpi=dpi, bbox_inches="tight", pad_inches=0.0)
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    rows, columns = np.nonzero((pixels[..., 0] > 200) & (pixels[..., 1:].max(axis=2) < 60))
    side = np.array([np.ptp(rows), np.ptp(columns)]) / dpi
    np.testing.assert_allclose(side, side.mean(), rtol=0.02)
    above = rows.min() / dpi  # title of the page and of the panel
    assert 0.4 < above < 0.8
    assert len(rows) / (np.ptp(rows) * np.ptp(columns)) > 0.97


@pytest.mark.usefixtures("undrawn")
def test_keys_of_pictures_are_ignored_where_none_is_drawn(tubelock) -> None:
    settings = _set((*COARSE, "pictures.labels=names"))
    status, out, _ = tubelock("mbd", "tsb1-pipe", *settings, "-o", "out")
    assert status == 0
    assert Path("out", "contact_pressures.png").exists()
    assert "pictures.labels" not in out.partition("ignored")[2]
    assert (
        "ignored   pictures.labels"
        in tubelock("mbd", "tsb1-pipe", *settings, "--json", "a.json")[1]
    )


def _set(settings: tuple[str, ...]) -> list[str]:
    return set_words(settings)


def test_too_few_addresses_for_pictures_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under `ulimit -v` VTK ended the process by a signal, or with a traceback."""
    monkeypatch.setattr(drawing, "address_space_left", lambda: 0.3 * 2**30)
    monkeypatch.delattr(drawing._WINDOWS, "window", raising=False)
    with pytest.raises(RefusedError, match=r"leaves 0\.3 \(ulimit -v\); raise it, or take --json"):
        drawing._window()
