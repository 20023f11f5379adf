"""Pictures: what is drawn is what is there, words have room, colours say where they end."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib import rc_context
from PIL import Image

from geometry import Assembly, box_block
from mbd import Rigid
from tests.support.answers import on_its_mesh
from validation import InputError, compare, load_case, solve
from validation.output.files import PICTURES, require_picture
from validation.output.pictures import assemblies, tubes
from validation.output.pictures import gallery as gallery_pictures
from validation.output.pictures.bodies import EYE, block_edges, eye, labelled, sharp_edges
from validation.output.pictures.canvas import Lines, Surface, View
from validation.output.pictures.gallery import Mark, Numbers, Panel, gallery, round_length
from validation.output.pictures.polyhedra import draw_polyhedra
from validation.output.pictures.scales import (
    Scale,
    drawing_scale,
    pressure_scale,
    scale_from_zero,
    symmetric_scale,
)
from validation.output.pictures.sections import section
from validation.output.pictures.style import Look, looking

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RED = np.array([255, 0, 0], dtype=np.uint8)
COARSE = ("assembly.layers=1", "mesh.around=24", "mesh.radial=2", "mesh.axial=4")
FINE = (*COARSE, "mesh.around=48")
BOX = ("fem.method=static", "mesh.divisions=[8,2,2]")


def square(size: float = 1.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Surface:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * size + np.array(at)
    return Surface(corners, np.array([[0, 1, 2, 3]]), RED[None], lit=False)


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


@given(arrays(float, 3, elements=st.floats(-1, 1)))
def test_the_eye_has_three_axes_at_right_angles_and_z_points_up(direction) -> None:
    if np.linalg.norm(direction) < 1e-3:
        return
    axes = View([square()], tuple(direction)).axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    # Looking along z there is no other choice than y.
    assert axes[1, 2] >= -0.05 * (abs(axes[2, 2]) > 0.99) - 1e-12
    np.testing.assert_allclose(axes[2] * np.linalg.norm(direction), direction, atol=1e-12)


def test_lines_on_a_surface_are_seen_and_faces_that_look_away_are_not() -> None:
    edge = Lines(np.array([[0.1, 0.5, 0.0], [0.9, 0.5, 0.0]]), np.array([[0, 1]]), width=4.0)
    pixels = View([square(), edge], (0.0, 0.0, 1.0), margin=0.0).render(100, 100)
    assert (pixels[48:52, 20:80] < 100).all(axis=2).any(axis=0).all()
    plain = square()
    away = Surface(plain.points, plain.polygons[:, ::-1], plain.colour, lit=False, two_sided=False)
    assert (View([away], (0.0, 0.0, 1.0)).render(50, 50) == 255).all()


def slow_edges(points: Any, polygons: Any, angle: float) -> set[tuple[int, int]]:
    """Edges between two polygons whose normals differ, one by one."""
    owners: dict[tuple[int, int], list[int]] = {}
    for number, corners in enumerate(polygons.tolist()):
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            owners.setdefault((min(a, b), max(a, b)), []).append(number)
    found = set()
    for edge, pair in owners.items():
        if len(pair) != 2:
            continue
        one, other = (
            sum(
                np.cross(points[a], points[b])
                for a, b in zip(polygons[k], np.roll(polygons[k], -1), strict=True)
            )
            for k in pair
        )
        cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
        if cosine < np.cos(np.radians(angle)):
            found.add(edge)
    return found


@pytest.mark.parametrize("angle", [5.0, 40.0, 80.0])
def test_sharp_edges_are_those_found_one_by_one(small_tube: Assembly, angle: float) -> None:
    block = small_tube.shape(4)
    quads = np.concatenate(list(block.faces.values()))
    found = {tuple(sorted(e)) for e in sharp_edges(block.mesh.nodes, quads, angle=angle).tolist()}
    assert found == slow_edges(block.mesh.nodes, quads, angle)


def test_a_box_has_twelve_edges_however_it_is_meshed() -> None:
    for divisions in ((1, 1, 1), (3, 2, 4)):
        block = box_block((1.0, 2.0, 3.0), divisions)
        length = np.linalg.norm(np.diff(block.mesh.nodes[block_edges(block)], axis=1), axis=2)
        assert length.sum() == pytest.approx(4 * (1 + 2 + 3))


# ---------------------------------------------------------------------------------------------
# Colours


def test_bars_have_an_arrow_where_values_go_beyond_their_colours() -> None:
    values = np.concatenate([np.linspace(-1.0, 1.0, 2001), [5.0]])
    scale = symmetric_scale("σ₁ [MPa]", "RdBu_r", [values])
    assert scale.high < 1.01
    assert scale.beyond == "both"
    assert scale.words == "σ₁ [MPa], min. −1, max. 5"
    assert scale_from_zero("p", "YlGnBu", [values]).beyond == "min"
    whole = Scale("p", "YlGnBu", 0.0, 1.0, (0.0, 1.0))
    assert (whole.beyond, whole.words) == ("neither", "p")
    assert (whole.of(np.array([-1.0, 2.0])) == whole.of(np.array([0.0, 1.0]))).all()
    nothing = scale_from_zero("p", "YlGnBu", [np.zeros(0)])
    assert nothing.high > nothing.low


def test_joints_without_pressure_are_grey_and_bars_are_labelled_at_both_ends() -> None:
    values = np.array([0.0, 1e-6, 0.293])
    scale = scale_from_zero("p", "YlGnBu", [values], nothing="open joint")
    plain = replace(scale, nothing="")
    assert (scale.of(values)[0] == 0xE4).all()
    assert (scale.of(values)[1:] == plain.of(values)[1:]).all()
    assert scale.lines == ["p", "grey: open joint"]
    for count in (3, 6):
        ticks = scale.ticks(count)
        assert (ticks[0], ticks[-1]) == (0.0, 0.293)
        assert min(np.diff(ticks)) > 0.293 / (2 * count)


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


@pytest.mark.parametrize("scene", ["arch", "wall", "tetrahedra", "versatile-panel"])
def test_pictures_of_all_methods_are_seen_from_one_side(scene: str) -> None:
    case = load_case(scene)
    solids = case.with_method("rigid").problem.blocks
    assert eye(case.problem.blocks) == eye(solids)


@given(st.floats(1e-6, 1e6))
def test_scale_bars_are_round(most: float) -> None:
    length = round_length(most)
    assert 0.39 * most <= length <= most * (1 + 1e-9)
    assert f"{length:e}"[0] in "125"


def test_unrolled_facets_keep_their_place_and_area() -> None:
    """∫ r dθ dr over the map is the area of the ring that the joint covers, seen along the axis."""
    run = solve(load_case("tsb1-tunnel", COARSE, method="rigid"))
    facets = assemblies.interface_facets(
        run.details.blocks, run.details.contact_index, run.details.contact_pressures
    )
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


def test_unrolled_side_joints_lie_apart_and_keep_their_area() -> None:
    """Four joints of TSB1 between the waves of a layer: thickness times height each."""
    run = solve(load_case("tsb1-tunnel", COARSE, method="rigid"))
    facets = assemblies.interface_facets(
        run.details.blocks, run.details.contact_index, run.details.contact_pressures
    )
    rows = facets.within(1)
    flat, middles = assemblies.side_by_side(facets, rows)
    x, z = flat[..., 0], flat[..., 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(z, -1, 1) - np.roll(x, -1, 1) * z, 1))
    assert area.sum() == pytest.approx(4 * 40.0 * 200.0, rel=1e-9)
    pair = facets.pair(rows)
    spans = sorted((x[pair == k].min(), x[pair == k].max()) for k in np.unique(pair))
    assert len(spans) == len(middles) == 4
    assert all(end < start for (_, end), (start, _) in pairwise(spans))
    angles = sorted(middles, key=lambda angle: middles[angle])
    assert np.diff(angles).tolist() == [90, 90, 90]


def test_sections_show_both_neighbours() -> None:
    """Where a layer's waves end, its neighbours fill the ring: nothing looks like a bite."""
    run = on_its_mesh("tsb1-pipe", FINE, method="static")
    for z in tubes.section_heights(run.details):
        cut = section(run.details, z)
        area = 0.0
        for triangles in (cut.triangles, cut.rigid):
            a, b, c = (cut.points[triangles[:, k]] for k in range(3))
            (x, y), (u, v) = (b - a).T, (c - a).T
            area += float(0.5 * np.abs(x * v - y * u).sum())
        polygon = 48 * 4 * 0.5 * np.sin(2 * np.pi / (48 * 4))
        # Ruled faces between layers are cut at heights that differ by what a facet is not flat.
        assert area == pytest.approx(polygon * (160.0**2 - 120.0**2), rel=1e-3)
    assert len(cut.rigid)


def test_sections_have_the_area_of_the_tube_and_the_lines_of_its_joints() -> None:
    run = on_its_mesh("tsb1-pipe", FINE, method="static")
    # In the middle of the layer, away from the waves: four quarters of a ring.
    cut = section(run.details, float(np.mean(tubes.section_heights(run.details))))
    a, b, c = (cut.points[cut.triangles[:, k]] for k in range(3))
    (x, y), (u, v) = (b - a).T, (c - a).T
    area = 0.5 * np.abs(x * v - y * u).sum()
    polygon = 48 * 4 * 0.5 * np.sin(2 * np.pi / (48 * 4))
    assert area == pytest.approx(polygon * (160.0**2 - 120.0**2), rel=1e-9)
    length = np.linalg.norm(np.diff(cut.borders, axis=1), axis=2).sum()
    side = 2 * np.sin(np.pi / (48 * 4))
    assert length == pytest.approx(8 * 40.0 + 48 * 4 * side * (160.0 + 120.0), rel=1e-9)


# ---------------------------------------------------------------------------------------------
# Words and files


@pytest.fixture
def figures(monkeypatch) -> list[Figure]:
    """Figures as they would be saved."""
    from matplotlib.figure import Figure

    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: kept.append(self))
    monkeypatch.setattr(gallery_pictures, "write_whole", lambda path, write: write(path))
    return kept


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


def rigid_pictures(path: Path) -> None:
    run = solve(load_case("tsb1-pipe", COARSE, method="rigid"))
    assemblies.draw_pressures(run, path)
    tube = load_case("tsb1-pillar", COARSE).problem
    assemblies.draw_assembly(tube.blocks, tube.load_case, path, title="a tube")
    assemblies.draw_pressures(solve(load_case("osteomorphic", method="rigid")), path)
    assemblies.draw_mechanism(solve(load_case("brick-stack", method="rigid")), path)


def polyhedral_pictures(path: Path) -> None:
    file = load_case("arch")
    run = solve(file.with_method("rigid"))  # type: ignore[arg-type]
    draw_polyhedra(run, path)
    assert "mechanism" not in run.fields  # it stands
    sliding = load_case("arch", ("effects.friction=0.1",))
    run = solve(sliding.with_method("rigid"))  # type: ignore[arg-type]
    assemblies.draw_mechanism(run, path)
    file = load_case("wall")
    draw_polyhedra(solve(file.with_method("rigid")), path)  # type: ignore[arg-type]


def tube_pictures(path: Path) -> None:
    tube = replace(load_case("tsb1-pipe", COARSE), name="a tube with a name that is long")
    run = on_its_mesh(tube, method="static")
    for draw in (tubes.draw_stresses, tubes.draw_contact, tubes.draw_sections):
        draw(run, path)
    tubes.draw_displacement(run, path)


def column_pictures(path: Path) -> None:
    run = on_its_mesh("column", {"load.pressure": 0.01}, method="static")
    tubes.draw_stresses(run, path)
    tubes.draw_contact(run, path)


def box_pictures(path: Path) -> None:
    tubes.draw_stresses(on_its_mesh("cantilever", BOX, method="static"), path)


def flat_pictures(path: Path) -> None:
    """Five views that are wide and low, below them bars with three lines of words."""
    sizes = ([200.0, 160.0, 40.0], [100.0, 60.0, 40.0])
    boxes = [{"size": size, "divisions": [2, 2, 1]} for size in sizes]
    sections = {
        "block": {"type": "boxes", "boxes": boxes},
        "load": {"pressure": 0.5},
        "material": "concrete",
        "fem": {"mesh": "scene"},
    }
    tubes.draw_stresses(on_its_mesh(load_case(sections), method="static"), path)


@pytest.mark.parametrize(
    "draw",
    [
        rigid_pictures,
        polyhedral_pictures,
        tube_pictures,
        column_pictures,
        box_pictures,
        flat_pictures,
    ],
)
def test_no_words_of_a_picture_overlap_or_leave_the_page(
    draw: Callable[[Path], None], figures: list[Figure], tmp_path: Path
) -> None:
    draw(tmp_path / "picture.png")
    assert figures
    for figure in figures:
        assert_words_have_room(figure)


@pytest.mark.parametrize("pressure", [1e-6, 1.0])
@pytest.mark.usefixtures("small_meshes")
def test_no_words_of_a_comparison_overlap_or_leave_the_page(
    pressure: float, figures: list[Figure], tmp_path: Path
) -> None:
    """One column of panels for each answer, and numbers of any size."""
    case = load_case("column", {"load.pressure": pressure})
    methods = (Rigid(norm="force"), Rigid(norm="pressure"), "static")
    runs = (solve(case.with_method(method)) for method in methods)
    compare(*runs).draw(tmp_path / "comparison.png")
    (figure,) = figures
    assert_words_have_room(figure)


def test_titles_name_scene_load_and_program(figures: list[Figure], tmp_path: Path) -> None:
    assemblies.draw_pressures(
        solve(load_case("tsb1-pipe", COARSE, method="rigid")), tmp_path / "p.png"
    )
    words = " ".join(words_of(figures[0]))
    for part in (
        "tsb1-pipe",
        "internal pressure 0.01 MPa",
        f"tubelock {version('tubelock')}+",
        "layer 1",
    ):
        assert part in words


def test_a_third_stress_is_one_line(figures: list[Figure], tmp_path: Path, monkeypatch) -> None:
    """What is made of principal stresses gets its panel, its bar and its mark."""
    run = on_its_mesh("cantilever", BOX, method="static")
    middle = tubes.Stress("σ₂", lambda principal: principal[:, 1], "largest", "sigma_1_max")
    monkeypatch.setattr(tubes, "STRESSES", (*tubes.STRESSES, middle))
    tubes.draw_stresses(run, tmp_path / "s.png")
    titles = [
        "σ₁",
        "σ₃",
        "σ₂",
        f"deformed shape,\nscale factor {drawing_scale(run.details):g}",
    ]
    assert [words for words in words_of(figures[0]) if words in titles] == titles


def words_of(figure: Figure) -> list[str]:
    from matplotlib.text import Text

    return [t.get_text() for t in figure.findobj(Text)]


def test_the_line_at_the_foot_can_be_left_out(figures: list[Figure], tmp_path: Path) -> None:
    columns = [[Panel("a square", View([square()], (0.0, 0.0, 1.0)))]]
    for footer in (True, False):
        with looking(Look(footer=footer)):
            gallery(columns, "title", tmp_path / "a.png")
        assert any("tubelock" in text for text in words_of(figures[-1])) is footer


def test_a_plot_is_drawn_once_and_keeps_its_shape(figures: list[Figure], tmp_path: Path) -> None:
    """Layouts widen the limits of a plot whose axes have another shape than it."""
    drawn = []

    def plot(axes: Axes) -> None:
        drawn.append(axes)
        axes.plot([0.0, 2.0], [0.0, 2.0])
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.set_aspect("equal")

    gallery([[Panel("a line", plot=plot, shape=1.0)]], "title", tmp_path / "a.png")
    (axes,) = drawn
    assert len(figures) == 1
    axes.apply_aspect()  # as drawing does
    box = axes.get_window_extent()
    spans = [np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim())]
    assert min(spans) >= 1.0
    assert spans[0] / spans[1] == pytest.approx(box.width / box.height, rel=1e-6)


def test_numbers_stand_on_the_blocks_that_are_seen_and_gravity_has_an_arrow(
    figures: list[Figure], tmp_path: Path
) -> None:
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
    gallery([[panel]], "title", tmp_path / "a.png")
    assert {"0", "1", "x", "y", "g"} <= set(words_of(figures[0]))
    gallery([[replace(panel, view=replace(view, weight=None))]], "title", tmp_path / "a.png")
    assert "g" not in words_of(figures[1])


@pytest.mark.parametrize("ending", PICTURES)
def test_the_ending_of_a_name_is_its_format(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"square{ending}"
    gallery([[Panel("a square $x^{2$", View([square()], (1.0, -1.0, 1.0)))]], "[/x] $", path)
    head = path.read_bytes()[:300]
    assert {".png": b"\x89PNG", ".svg": b"<svg", ".pdf": b"%PDF"}[ending] in head
    text = path.read_bytes()
    assert f"tubelock {version('tubelock')}+".encode() in text
    if ending == ".svg":  # words stay words
        assert b"a square $x^{2$" in text


def test_bodies_stand_where_they_are_seen_in_every_kind_of_file(tmp_path: Path) -> None:
    """One red square: its box in the page is the same on paper as on the screen, to a dot."""
    columns = [[Panel("a square", View([square()], (0.0, 0.0, 1.0), margin=0.0))]]
    gallery(columns, "title", tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        pixels = np.asarray(picture.convert("RGB"))
    rows, places = np.nonzero((pixels == RED).all(axis=2))
    height, width = pixels.shape[:2]
    seen = [v.min() / width for v in (places,)] + [places.max() / width]
    seen += [1 - rows.max() / height, 1 - rows.min() / height]

    with rc_context({"pdf.compression": 0}):
        gallery(columns, "title", tmp_path / "a.pdf")
    drawn = (tmp_path / "a.pdf").read_bytes().decode("latin1")
    (place,) = re.findall(r"q ([\d.]+) 0 0 ([\d.]+) ([\d.]+) ([\d.]+) cm /I1 Do", drawn)
    across, tall, x, y = (float(v) for v in place)
    wide, high = page_size(tmp_path / "a.pdf")
    found = [x / wide, (x + across) / wide, y / high, (y + tall) / high]
    np.testing.assert_allclose(found, seen, atol=2.5 / min(width, height))

    gallery(columns, "title", tmp_path / "a.svg")
    (image,) = re.findall(r"<image[^>]*>", (tmp_path / "a.svg").read_text("utf-8"))
    # It is turned upside down: its own y counts upwards from the upper edge of the page.
    assert "scale(1 -1)" in image
    upper = high - y - tall
    for name, value in (("x", x), ("width", across), ("height", tall), ("y", -upper)):
        assert float(re.findall(rf' {name}="([-\d.]+)"', image)[0]) == pytest.approx(value, abs=0.1)


def page_size(path: Path) -> tuple[float, float]:
    """Width and height of the one page of a PDF [pt]."""
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", path.read_bytes())
    return float(box[0]), float(box[1])


@pytest.mark.parametrize("kind", ["svg", "pdf"])
@pytest.mark.usefixtures("undrawn")
def test_pictures_in_a_folder_have_the_format_that_a_scene_asks_for(kind, tubelock) -> None:
    settings = _set((*COARSE, f"pictures.format={kind}"))
    status, said, _ = tubelock("mbd", "tsb1-pipe", *settings, "-o", "out")
    assert status == 0
    assert Path("out", f"contact_pressures.{kind}").exists()
    assert f"contact_pressures.{kind}" in said


def test_a_name_and_a_scene_that_ask_for_two_formats_are_refused(tubelock) -> None:
    pdf = _set((*COARSE, "pictures.format=pdf"))
    status, _, error = tubelock("show", "tsb1-pipe", *pdf, "-o", "a.png")
    assert status == 2
    assert "another than pictures.format = 'pdf'" in error
    assert not Path("a.png").exists()
    assert tubelock("show", "tsb1-pipe", *pdf)[0] == 0
    assert tubelock("mbd", "tsb1-pipe", *pdf, "--disassemble")[0] == 0
    for name in ("assembly", "explosion"):
        (found,) = Path().rglob(f"{name}.pdf")
        assert found.read_bytes()[:4] == b"%PDF"


@pytest.mark.usefixtures("undrawn")
def test_keys_of_pictures_are_unused_where_none_is_drawn(tubelock) -> None:
    plain = _set((*COARSE, "pictures.labels=numbers"))
    for options, unused in ((("--json", "a.json"), True), (("-o", "out"), False)):
        status, said, _ = tubelock("mbd", "tsb1-pipe", *plain, *options)
        assert status == 0
        assert ("[pictures]" in said or "pictures.labels" in said) is unused


def test_a_format_that_is_not_drawn_is_refused(tubelock) -> None:
    status, _, error = tubelock("mbd", "tsb1-pipe", "--set", "pictures.format=jpg")
    assert status == 2
    assert "'png', 'svg' or 'pdf'" in error
    assert len(error.strip().splitlines()) == 1


@pytest.mark.parametrize("shape", [0.5, 1.9, 4.0])
def test_columns_fill_the_width_or_are_as_high_as_asked_for(
    figures: list[Figure], tmp_path: Path, shape: float
) -> None:
    columns = [[Panel("p", plot=lambda _: None, shape=shape, bare=True)] for _ in range(5)]
    gallery(columns, "title", tmp_path / "p.png", height=5.5, widest=16.0)
    boxes = [axes.get_position().transformed(figures[0].transFigure) for axes in figures[0].axes]
    high = {round(box.height / box.width * shape, 3) for box in boxes}
    assert high == {1.0}  # they keep their shape
    wide, tall = figures[0].get_size_inches()
    assert (wide == pytest.approx(16.0)) == (shape > 1.0)
    assert (tall > 5.5) == (shape < 1.0)


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.lists(st.lists(st.floats(0.1, 8.0), min_size=1, max_size=3), min_size=1, max_size=4),
    st.floats(5.0, 16.0),
)
def test_panels_of_any_shape_lie_apart_on_the_page(
    figures: list[Figure], tmp_path: Path, shapes, widest
) -> None:
    """No panel covers another or leaves the page."""
    columns = [[Panel("p", plot=lambda _: None, shape=s) for s in column] for column in shapes]
    figures.clear()
    gallery(columns, "title", tmp_path / "p.png", widest=widest)
    (figure,) = figures
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    assert len(boxes) == sum(map(len, shapes))
    for number, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= figure.bbox.width
        assert box.y1 <= figure.bbox.height
        assert not any(box.overlaps(other) for other in boxes[:number])


def ring_places(figure: Figure) -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        line.get_xydata()[0] * figure.get_size_inches()
        for line in figure.findobj(Line2D)
        if line.get_marker() == "o"
    ]


def test_a_ring_marks_what_is_seen_and_words_say_what_is_not(
    figures: list[Figure], tmp_path: Path
) -> None:
    """A point on the upper of two squares has a ring, one on the lower below it has none."""
    lower, upper = square(2.0), square(1.0, (0.0, 0.0, 0.1))
    view = View([lower, upper], (0.0, 0.0, 1.0))
    scale = Scale("p [MPa]", "viridis", 0.0, 1.0, (0.0, 1.0))
    for x, height, seen in ((0.5, 0.1, True), (0.5, 0.0, False), (1.5, 0.0, True)):
        mark = Mark(np.array([x, 0.5, height]), "here")
        panel = Panel("squares", view, scale=scale, mark=mark)
        gallery([[panel]], "title", tmp_path / "a.png")
        assert len(ring_places(figures[-1])) == seen
        assert ("p [MPa]\n○ here" in words_of(figures[-1])) == seen
        assert ("p [MPa]\nhere; not seen here" in words_of(figures[-1])) != seen


def test_numbers_round_a_flat_view_stand_at_their_places(
    figures: list[Figure], tmp_path: Path
) -> None:
    numbers = Numbers("angle", "radius", {"a": 0.0, "b": 1.0}, {"c": 0.25})
    panel = Panel("p", View([square()], (0.0, 0.0, 1.0), margin=0.0), numbers=numbers)
    gallery([[panel]], "title", tmp_path / "a.png")
    place = {text.get_text(): text.get_position() for text in figures[0].texts}
    (x0, y0), (x1, _), (_, y2) = place["a"], place["b"], place["c"]
    wide, high = figures[0].get_size_inches()
    side = (x1 - x0) * wide
    assert side > 1.0
    assert (y2 - y0) * high == pytest.approx(0.25 * side + 0.09)


def test_other_endings_are_refused(tubelock) -> None:
    with pytest.raises(InputError, match=r"\.png, \.svg or \.pdf"):
        require_picture(Path("tube.jpg"))
    assert tubelock("show", "tsb1-pipe", *_set(COARSE), "-o", "tube.pdf")[0] == 0
    assert Path("tube.pdf").read_bytes()[:4] == b"%PDF"


def test_one_block_is_drawn_with_all_its_measures(tubelock) -> None:
    settings = ("block.height=150", "block.shift=0.25", *COARSE)
    assert tubelock("show", "tsb1-pipe", "--block", *_set(settings), "-o", "block.svg")[0] == 0
    words = Path("block.svg").read_text("utf-8")  # words stay words
    for measure in ("h = 150 mm", "a = 20 mm", "f = 1.5 waves", "s = 0.25", "n = 4", "t = 40 mm"):
        assert measure in words
    assert "= 120 mm" in words  # r_i
    status, _, error = tubelock("show", "thb0-pipe", "--block", "-o", "other.png")
    assert status == 2
    assert "'hexagon'" in error
    assert not Path("other.png").exists()


def _set(settings: tuple[str, ...]) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]
