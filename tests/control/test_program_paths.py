"""Paths of a program: their lengths and corners, refusals, and paths through arbitrary corners."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control.geometry.ways import PIECES_MAX, Way, way_of
from hil_bridge.control.steps.paths import CHORD_MM, Arc, Line, Polyline, Raster, Spiral

HERE = (3.0, -2.0)


def length_mm(path, start=HERE):
    return way_of(path.corners(start)).length * 1e3


# --- lines


def test_line_has_length_and_direction():
    assert Line(length_mm=5.0).corners(HERE) == [HERE, (8.0, -2.0)]
    (_, (x, y)) = Line(length_mm=2.0, direction_deg=90.0).corners(None)
    assert (x, y) == pytest.approx((0.0, 2.0))


def test_line_to_point_ends_there():
    assert Line(to_mm=(10.0, 4.0)).corners(HERE) == [HERE, (10.0, 4.0)]
    assert length_mm(Line(to_mm=(6.0, 2.0))) == pytest.approx(5.0)


@pytest.mark.parametrize("settings", [{}, {"length_mm": 5.0, "to_mm": (1.0, 1.0)}])
def test_line_needs_length_or_target(settings):
    with pytest.raises(ValueError, match="a line needs length_mm or to_mm, and not both"):
        Line(**settings)


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_line_without_length_is_refused(length):
    with pytest.raises(ValueError, match="length_mm"):
        Line(length_mm=length)


def test_line_without_direction_is_refused():
    with pytest.raises(ValueError, match="direction_deg must be a number"):
        Line(length_mm=5.0, direction_deg=math.nan)


@pytest.mark.parametrize("path", [Line(to_mm=(1.0, 1.0)), Arc()])
def test_path_without_known_start_is_refused(path):
    with pytest.raises(ValueError, match="where the path begins is not known: insert a move before"):
        path.corners(None)


# --- arcs


@pytest.mark.parametrize("angle", [90.0, -90.0, 360.0, 720.0, 1.0])
def test_arc_length_matches_circle(angle):
    arc = Arc(centre_mm=(0.0, 0.0), angle_deg=angle)
    assert length_mm(arc, (20.0, 0.0)) == pytest.approx(20.0 * math.radians(abs(angle)), rel=2e-3)
    (x, y) = arc.corners((20.0, 0.0))[-1]
    turn = math.radians(angle)
    assert (x, y) == pytest.approx((20.0 * math.cos(turn), 20.0 * math.sin(turn)), abs=1e-9)


@given(radius=st.floats(0.1, 1000.0), angle=st.floats(-400.0, 400.0).filter(lambda angle: abs(angle) > 0.1))
def test_arc_segments_stay_within_chord_error(radius, angle):
    corners = Arc(centre_mm=(7.0, 9.0), angle_deg=angle).corners((7.0 + radius, 9.0))
    for (x, y), (u, v) in itertools.pairwise(corners):
        assert math.hypot(x - 7.0, y - 9.0) == pytest.approx(radius)
        middle = math.hypot((x + u) / 2 - 7.0, (y + v) / 2 - 9.0)
        assert radius - middle <= CHORD_MM * (1 + 1e-6)


def test_arc_without_radius_is_refused():
    with pytest.raises(ValueError, match="the arc begins in its centre"):
        Arc(centre_mm=HERE).corners(HERE)


@pytest.mark.parametrize("angle", [0.0, math.nan, math.inf, 36001.0])
def test_arc_angle_out_of_range_is_refused(angle):
    with pytest.raises(ValueError, match="angle_deg must be a number up to ±36000 and not 0"):
        Arc(angle_deg=angle)


# --- polylines


def test_polyline_passes_through_its_points():
    line = Polyline(points_mm=((0.0, 0.0), (3.0, 4.0), (3.0, 10.0)))
    assert line.corners(None) == [(0.0, 0.0), (3.0, 4.0), (3.0, 10.0)]
    assert length_mm(line) == pytest.approx(11.0)


def test_polyline_with_one_point_is_refused():
    with pytest.raises(ValueError, match="points_mm must have at least two points"):
        Polyline(points_mm=((0.0, 0.0),))


@pytest.mark.parametrize("bad", [math.nan, math.inf, 2e6])
def test_path_points_must_be_finite(bad):
    for path, settings in (
        (Polyline, {"points_mm": ((0.0, 0.0), (bad, 1.0))}),
        (Line, {"to_mm": (0.0, bad)}),
        (Arc, {"centre_mm": (bad, 0.0)}),
        (Spiral, {"centre_mm": (bad, 0.0)}),
        (Raster, {"corner_mm": (bad, 0.0), "size_mm": (1.0, 1.0)}),
    ):
        with pytest.raises(ValueError, match="must be finite points in mm"):
            path(**settings)


def test_path_without_length_is_refused():
    with pytest.raises(ValueError, match="the path has no length"):
        way_of(Polyline(points_mm=(HERE, HERE)).corners(None))


# --- rasters


def test_raster_covers_rectangle():
    raster = Raster(corner_mm=(1.0, 2.0), size_mm=(10.0, 4.0), spacing_mm=2.0)
    assert raster.corners(None) == [
        pytest.approx(position)
        for position in ((1.0, 2.0), (11.0, 2.0), (11.0, 4.0), (1.0, 4.0), (1.0, 6.0), (11.0, 6.0))
    ]
    assert length_mm(raster) == pytest.approx(34.0)


def test_raster_along_y_is_transposed():
    along = Raster(corner_mm=(1.0, 2.0), size_mm=(4.0, 10.0), spacing_mm=2.0, along="y").corners(None)
    assert along[:3] == [pytest.approx(position) for position in ((1.0, 2.0), (1.0, 12.0), (3.0, 12.0))]


@given(
    width=st.floats(1.0, 300.0),
    height=st.floats(1.0, 300.0),
    spacing=st.floats(0.2, 50.0),
    along=st.sampled_from(("x", "y")),
)
def test_raster_lines_reach_borders_within_spacing(width, height, spacing, along):
    positions = Raster(size_mm=(width, height), spacing_mm=spacing, along=along).corners(None)
    across = sorted({y if along == "x" else x for x, y in positions})
    extent = height if along == "x" else width
    assert (across[0], across[-1]) == pytest.approx((0.0, extent))
    assert max(b - a for a, b in itertools.pairwise(across)) <= spacing * (1 + 1e-6)
    for (x, y), (u, v) in itertools.pairwise(positions):  # along one axis at a time: no line is skew
        assert x == pytest.approx(u, abs=1e-9) or y == pytest.approx(v, abs=1e-9)
    assert len(positions) == 2 * len(across)


def test_raster_lines_shorten_towards_triangle_tip():
    triangle = Raster(polygon_mm=((0.0, 0.0), (20.0, 0.0), (10.0, 10.0)), spacing_mm=5.0)
    positions = triangle.corners(None)
    widths = [abs(u - x) for (x, y), (u, v) in itertools.pairwise(positions) if y == v]
    assert widths[:2] == pytest.approx([20.0, 10.0], abs=1e-4)
    assert all(width < 1e-4 for width in widths[2:])
    assert positions[-1] == pytest.approx((10.0, 10.0), abs=1e-4)


@given(
    st.lists(
        st.tuples(st.floats(-math.pi, math.pi), st.floats(5.0, 50.0)),
        min_size=3,
        max_size=3,
        unique_by=lambda c: round(c[0], 1),
    )
)
def test_raster_points_lie_within_triangle(corners):
    polygon = [(r * math.cos(angle), r * math.sin(angle)) for angle, r in sorted(corners)]
    (a, b), (c, d), (e, f) = polygon
    area = (c - a) * (f - b) - (e - a) * (d - b)
    heights = [y for _, y in polygon]
    if abs(area) < 1.0 or max(heights) - min(heights) < 1.0:
        return
    for x, y in Raster(polygon_mm=tuple(polygon), spacing_mm=3.0).corners(None):
        for (p, q), (u, v) in itertools.pairwise([*polygon, polygon[0]]):
            side = ((u - p) * (y - q) - (v - q) * (x - p)) / math.hypot(u - p, v - q)
            assert side * math.copysign(1.0, area) > -1e-3


def test_raster_over_concave_polygon_is_refused():
    hollow = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 2.0), (0.0, 10.0))
    with pytest.raises(
        ValueError, match="the polygon is crossed 4 times by the line at y = 5 mm: every line must"
    ):
        Raster(polygon_mm=hollow, spacing_mm=5.0).corners(None)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"size_mm": (10.0, 0.0)}, "size_mm must be above 0 in both directions, got 10, 0"),
        ({}, "size_mm must be above 0 in both directions, got 0, 0"),
        ({"polygon_mm": ((0.0, 0.0), (1.0, 1.0))}, "polygon_mm must have at least three points"),
        ({"size_mm": (10.0, 10.0), "spacing_mm": 0.0}, "spacing_mm"),
    ],
)
def test_raster_without_area_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Raster(**settings)


def test_raster_with_too_many_lines_is_refused():
    with pytest.raises(ValueError, match=r"a raster of 1000000 lines; it needs 1 … 50000: change spacing_mm"):
        Raster(size_mm=(10.0, 1e3), spacing_mm=1e-3).corners(None)


def test_raster_over_flat_polygon_is_refused():
    with pytest.raises(ValueError, match="a raster of 0 lines"):
        Raster(polygon_mm=((0.0, 1.0), (5.0, 1.0), (9.0, 1.0))).corners(None)


# --- spirals


def test_spiral_length_matches_curve():
    spiral = Spiral(radius_mm=20.0, spacing_mm=5.0)
    turn, pitch = math.tau * 4, 5.0 / math.tau
    # source: the length of an Archimedean spiral r = pitch·angle
    exact = pitch / 2 * (turn * math.hypot(1.0, turn) + math.asinh(turn))
    assert length_mm(spiral) == pytest.approx(exact, rel=5e-3)
    positions = spiral.corners(None)
    assert positions[0] == (0.0, 0.0)
    assert positions[-1] == pytest.approx((20.0, 0.0))


def test_spiral_inwards_is_reversed():
    out, back = (Spiral(centre_mm=(5.0, 6.0), inwards=inwards).corners(None) for inwards in (False, True))
    assert back == out[::-1]


@given(radius=st.floats(1.0, 100.0), spacing=st.floats(0.5, 20.0))
def test_spiral_segments_stay_near_curve(radius, spacing):
    positions = Spiral(radius_mm=radius, spacing_mm=spacing).corners(None)
    angle = 0.0
    for (x, y), (u, v) in itertools.pairwise(positions):
        before, after = math.hypot(x, y), math.hypot(u, v)
        assert after > before
        step = math.tau * (after - before) / spacing
        angle += step
        middle = spacing * (angle - step / 2) / math.tau
        # of the outer turns, where the curve is nearly a circle; near its centre it is smaller than the chord
        if before > spacing:
            assert abs(middle - math.hypot((x + u) / 2, (y + v) / 2)) <= 1.6 * CHORD_MM
    assert math.hypot(*positions[-1]) == pytest.approx(radius)


def test_spiral_with_too_many_turns_is_refused():
    with pytest.raises(ValueError, match="a spiral may have 1000 turns at most: change spacing_mm"):
        Spiral(radius_mm=1001.0, spacing_mm=1.0)


# --- paths


CORNERS = st.lists(
    st.tuples(st.integers(-100, 100), st.integers(-100, 100)).map(lambda c: (float(c[0]), float(c[1]))),
    min_size=2,
    max_size=12,
).filter(lambda corners: len(set(corners)) > 1)


@given(CORNERS, st.floats(0.0, 1.0))
def test_path_passes_through_its_corners(corners, share):
    path = way_of(corners)
    total = sum(math.dist(a, b) for a, b in itertools.pairwise(corners))
    assert path.length * 1e3 == pytest.approx(total)
    assert all(math.hypot(*heading) == pytest.approx(1.0) for heading in path.headings)
    end = path.at(path.length)
    x0, y0 = corners[0]
    assert (end[0] * 1e3 + x0, end[1] * 1e3 + y0) == pytest.approx(corners[-1], abs=1e-9)
    travel = share * path.length
    piece = path.piece(travel)
    assert path.begins[piece] <= travel <= path.begins[piece + 1]
    low, high = max(travel - 1e-3, 0.0), min(travel + 1e-3, path.length)
    result = path.along(low, high, path.at(travel))
    # the path may cross itself within a millimetre: then another length has the same position
    assert math.dist(path.at(result), path.at(travel)) < 1e-9


@given(CORNERS)
def test_path_point_moves_by_its_length(corners):
    path = way_of(corners)
    lengths = [path.length * k / 50 for k in range(51)]
    positions = [path.at(length) for length in lengths]
    for (a, b), (p, q) in zip(itertools.pairwise(lengths), itertools.pairwise(positions), strict=True):
        assert math.dist(p, q) <= (b - a) * (1 + 1e-9) + 1e-12


def test_path_point_off_the_path_is_projected():
    path = way_of([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)])
    assert path.along(0.0, 5e-3, (4e-3, 1e-3)) == pytest.approx(4e-3)
    assert path.along(8e-3, 12e-3, (10.5e-3, 1e-3)) == pytest.approx(11e-3)
    assert path.along(8e-3, 12e-3, (10.5e-3, -1e-3)) == pytest.approx(10e-3)


def test_path_continues_straight_beyond_its_end():
    path = way_of([(0.0, 0.0), (0.0, 10.0)])
    assert path.at(12e-3) == pytest.approx((0.0, 12e-3))
    assert path.at(-1e-3) == pytest.approx((0.0, -1e-3))


def test_path_with_too_many_segments_is_refused():
    corners = [(k % 2 * 1.0, float(k)) for k in range(PIECES_MAX + 2)]
    with pytest.raises(ValueError, match=f"a path of {PIECES_MAX + 1} pieces; {PIECES_MAX} are the most"):
        way_of(corners)


def test_path_skips_duplicate_points():
    path = way_of([(0.0, 0.0), (0.0, 0.0), (5.0, 0.0), (5.0, 0.0)])
    assert path == Way(((0.0, 0.0), (5e-3, 0.0)), ((1.0, 0.0),), (0.0, 5e-3))
