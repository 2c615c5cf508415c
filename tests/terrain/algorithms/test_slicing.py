"""Slice counts, costs and the cut of adaptive slicing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.slicing import BOX_BITS, LAST_NUMBER, front_to_back, name_slices, select_cut
from terrain.algorithms.slicing_cost import (
    POLYGONS,
    X_SLICES,
    Y_SLICES,
    Z_SLICES,
    Boxes,
    Speeds,
    View,
    chord_cells,
    paper_bundles,
    projected_px,
    refined_bundles,
    search_cost_ms,
)
from terrain.algorithms.slicing_tree import CHORDS, STRIDES, Nodes, build_slice_tree
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.pyramid import build_pyramid
from terrain.scene import Scene

SPEEDS = Speeds(
    vertex_ms=6e-5, pixel_ms=2e-6, slice_ms=3e-4, slice_pixel_ms=2e-6, plane_pixel_ms=1e-6, found_pixel_ms=2e-5,
    triangle_ms=8e-5, polygon_pixel_ms=8e-6, search_ms=0.2,
)  # fmt: skip
SIZE = (320, 240)


def scene_of(heights: np.ndarray, spacing: tuple[float, float] = (10.0, 10.0)) -> Scene:
    terrain = Heightfield(np.ascontiguousarray(heights, np.float32), spacing)
    return Scene(terrain, build_pyramid(terrain.heights_m))


def hills(posts: int = 257, seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    row, col = np.indices((posts, posts))
    heights = 60 * np.sin(row / 17.0) * np.cos(col / 23.0) + 25 * np.sin((row + col) / 5.0)
    return heights + random.normal(0, 2, heights.shape)


@pytest.fixture(scope="module")
def tree():
    return build_slice_tree(scene_of(hills()))


def frame_at(x: float, y: float, z: float, yaw: float = 45.0, pitch: float = -10.0) -> Frame:
    return Frame(Camera((x, y, z), yaw, pitch), SIZE, 0.1)


FRAMES = {
    "low": frame_at(300.0, 110.0, 2200.0),
    "from above": frame_at(1280.0, 900.0, 1280.0, 0.0, -90.0),
    "from outside": frame_at(-400.0, 300.0, 2900.0),
    "aslant": frame_at(700.0, 600.0, 1900.0, 30.0, -45.0),
}


def one_box(lower: tuple[float, ...], upper: tuple[float, ...], peak_m: float = 0.0) -> Boxes:
    corners = (np.array([corner], np.float32) for corner in (lower, upper))
    return Boxes(
        *corners,
        np.ones(1, np.float32),
        np.full(1, 64.0, np.float32),
        np.full((1, CHORDS), peak_m, np.float32),
        np.full((1, STRIDES), np.inf, np.float32),
    )


def test_a_metre_at_distance_one_metre_covers_k_pixels() -> None:
    assert projected_px(np.float32(1.0), np.float32(1.0), 1.0, 500.0) == 500.0
    assert projected_px(np.float32(8.0), np.float32(100.0), 0.5, 500.0) == pytest.approx(20.0)


@pytest.mark.parametrize("tolerance", [0.5, 1.0, 4.0])
def test_the_papers_upright_slices_stand_a_tolerance_apart_at_the_nearest_corner(tolerance: float) -> None:
    view = View(tolerance, 500.0, 76800, (10.0, 10.0))
    # 80 m deep, nearest corner at (1000, -10, 40)
    bundles = paper_bundles(one_box((1000.0, -20.0, -40.0), (1080.0, -10.0, 40.0)), view, SPEEDS)
    expected = np.ceil(80.0 * 500.0 / np.sqrt(1000.0**2 + 10.0**2 + 40.0**2) / tolerance)
    assert bundles.direction[0] == X_SLICES
    assert bundles.planes[0] == expected


def test_the_paper_slices_horizontally_above_45_degrees_only() -> None:
    view = View(1.0, 500.0, 76800, (10.0, 10.0))
    steep = paper_bundles(one_box((100.0, -520.0, -40.0), (180.0, -500.0, 40.0)), view, SPEEDS)
    flat = paper_bundles(one_box((900.0, -520.0, -40.0), (980.0, -500.0, 40.0)), view, SPEEDS)
    assert steep.direction[0] == Y_SLICES
    assert flat.direction[0] == X_SLICES
    nearest = np.sqrt(100.0**2 + 500.0**2 + 40.0**2)
    assert steep.planes[0] <= np.ceil(20.0 * 500.0 / nearest)


def test_the_papers_polygons_cost_ten_vertices_per_fan_and_their_ground() -> None:
    view = View(1.0, 500.0, 76800, (10.0, 10.0))
    bundles = paper_bundles(one_box((900.0, -520.0, -40.0), (980.0, -500.0, 40.0)), view, SPEEDS)
    corner = np.array([[x, y, z] for x in (900, 980) for y in (-520, -500) for z in (-40, 40)], float)
    distance = np.linalg.norm(corner, axis=1)
    sine = (-corner[:, 1] / distance).max()
    expected = 160 * SPEEDS.vertex_ms + SPEEDS.pixel_ms * 80 * 80 * sine * (500 / distance.min()) ** 2
    assert bundles.polygons_ms[0] == pytest.approx(expected, rel=1e-4)


def test_flat_ground_needs_one_slice() -> None:
    view = View(1.0, 500.0, 76800, (10.0, 10.0))
    bundles = refined_bundles(one_box((2000.0, -30.0, -40.0), (2080.0, -29.0, 40.0)), view, SPEEDS)
    assert bundles.planes[0] == 1


@given(
    x=st.floats(-3000, 3000), z=st.floats(-3000, 3000), y=st.floats(-500, 300), height=st.floats(0, 200),
    peak=st.floats(0, 50), tolerance=st.floats(0.25, 8),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_upright_slices_are_never_denser_than_a_fifth_of_a_pixel(x, z, y, height, peak, tolerance) -> None:
    box = one_box((x, y, z), (x + 80.0, y + height, z + 80.0), peak)
    refined = refined_bundles(box, View(tolerance, 400.0, 76800, (10.0, 10.0)), SPEEDS)
    gap = np.maximum(np.maximum(box.lower_m, -box.upper_m), 0)[0]
    nearest = max(float(np.linalg.norm(gap)), 1e-3)
    if refined.direction[0] != Y_SLICES:
        assert refined.planes[0] <= np.ceil(5 * 80.0 * 400.0 / nearest / tolerance) + 1
    elif np.isfinite(refined.slices_ms[0]):
        assert y + height < 0, "horizontal slices are seen from above only"


@given(
    peaks=st.lists(st.floats(0, 100, width=32), min_size=CHORDS, max_size=CHORDS), allowed=st.floats(0, 120, width=32)
)
def test_no_chord_within_the_allowed_length_has_a_higher_peak(peaks: list[float], allowed: float) -> None:
    known = np.maximum.accumulate(np.array([peaks], np.float32), axis=1)
    chord = float(chord_cells(known, np.array([allowed], np.float32))[0])
    assert 0.0 <= chord <= 2.0**CHORDS
    for k in range(CHORDS):
        if 2.0 ** (k + 1) <= chord:
            assert known[0, k] <= allowed


@pytest.mark.parametrize("ridge_at", [16, 19, 20])
def test_a_ridge_stands_out_of_chords_wherever_it_runs(ridge_at: int) -> None:
    """A ridge along posts of a coarse level costs that level nothing, but no ray that passes between planes."""
    col = np.abs(np.arange(65) - ridge_at)
    tree = build_slice_tree(scene_of(np.tile(-3.0 * col, (65, 1))))
    peak = tree.peak_m[: 8 * 8].reshape(8, 8, CHORDS)[:, ridge_at // 8]
    assert np.allclose(peak[:, :2], [3.0, 6.0])
    assert (peak[:, 2] >= 0.75 * 12.0).all(), "long chords are centred at every quarter of their length"
    assert (peak[:, 2] <= 12.0).all()


def test_slopes_and_valleys_have_no_peaks() -> None:
    row, col = np.indices((65, 65))
    for heights in (4.0 * row - 2.0 * col, (row - 32.0) ** 2 + (col - 30.0) ** 2):
        assert build_slice_tree(scene_of(heights)).peak_m.max() <= 1e-3


@given(seed=st.integers(0, 1000), rows=st.integers(9, 40), cols=st.integers(9, 40))
@settings(max_examples=25, deadline=None)
def test_peaks_of_short_chords_are_exact(seed: int, rows: int, cols: int) -> None:
    heights = np.random.default_rng(seed).normal(0, 10, (rows, cols)).astype(np.float32)
    tree = build_slice_tree(scene_of(heights))
    shape = tuple(-(-(n - 1) // 8) for n in (rows, cols))
    finest = tree.peak_m[: shape[0] * shape[1]].reshape(*shape, CHORDS)
    expected = np.zeros((*shape, 2))
    for k, half in enumerate((1, 2)):
        for r in range(rows):
            for c in range(cols):
                for i, j in ((0, half), (half, 0), (half, half), (half, -half)):
                    ends = [(r + i, c + j), (r - i, c - j)]
                    if all(0 <= a < rows and 0 <= b < cols for a, b in ends):
                        rise = heights[r, c] - (heights[ends[0]] + heights[ends[1]]) / 2
                        for i, j in {
                            (r // 8, c // 8),
                            ((r - 1) // 8, c // 8),
                            (r // 8, (c - 1) // 8),
                            ((r - 1) // 8, (c - 1) // 8),
                        }:
                            if 0 <= i < shape[0] and 0 <= j < shape[1]:
                                expected[i, j, k] = max(expected[i, j, k], rise)
    expected[..., 1] = np.maximum(expected[..., 1], expected[..., 0])
    assert np.allclose(finest[..., :2], expected, atol=1e-3)


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("mode", ["hybrid", "slices", "polygons"])
@pytest.mark.parametrize("rule", ["secant", "paper"])
def test_the_cut_covers_what_is_seen_exactly_once(tree, name: str, mode: str, rule: str) -> None:
    frame = FRAMES[name]
    cut = select_cut(tree, frame, SPEEDS, 1.0, mode, rule, horizon=False)
    covered = np.zeros((256, 256), np.int32)
    for level, row, col in zip(*cut.nodes, strict=True):
        covered[row << level : (row + 1) << level, col << level : (col + 1) << level] += 1
    assert covered.max() <= 1
    heights = hills().astype(np.float32)
    row, col = np.indices((256, 256))
    centre = np.stack([col * 10.0 + 5, heights[:-1, :-1], row * 10.0 + 5], axis=-1) - frame.eye_m
    seen = (centre @ frame.side_planes.T > 10.0).all(axis=-1) & (centre @ frame.camera.forward > frame.near_m)
    assert covered[seen].all()
    assert covered.any()


@pytest.mark.parametrize("name", FRAMES)
def test_modes_draw_what_they_say(tree, name: str) -> None:
    frame = FRAMES[name]
    polygons = select_cut(tree, frame, SPEEDS, 1.0, "polygons")
    slices = select_cut(tree, frame, SPEEDS, 1.0, "slices")
    assert (polygons.direction == POLYGONS).all()
    assert not polygons.planes.any()
    assert (slices.planes[slices.direction != POLYGONS] >= 1).all()
    around = np.flatnonzero(slices.direction == POLYGONS)
    holds_eye = (slices.lower_m <= frame.eye_m) & (slices.upper_m >= frame.eye_m)
    assert holds_eye[around][:, [0, 2]].all(), "only boxes around the eye stay polygons"


@pytest.mark.parametrize("name", FRAMES)
def test_hybrid_is_estimated_to_cost_no_more_than_either_way_alone(tree, name: str) -> None:
    hybrid, slices, polygons = (
        select_cut(tree, FRAMES[name], SPEEDS, 1.0, mode).cost_ms for mode in ("hybrid", "slices", "polygons")
    )
    assert hybrid <= 1.15 * min(slices, polygons)


def test_speeds_decide_between_slices_and_polygons(tree) -> None:
    frame = FRAMES["low"]
    slow_slices = select_cut(tree, frame, replace(SPEEDS, slice_ms=1.0), 1.0)
    slow_triangles = select_cut(tree, frame, replace(SPEEDS, triangle_ms=1.0), 1.0)
    assert (slow_slices.direction == POLYGONS).all()
    assert (slow_triangles.direction != POLYGONS).mean() > 0.9


def test_no_slice_is_drawn_where_finding_them_costs_more_than_they_save(tree) -> None:
    cut = select_cut(tree, FRAMES["low"], replace(SPEEDS, search_ms=1e3), 1.0)
    assert (cut.direction == POLYGONS).all()


@pytest.mark.parametrize("rule", ["secant", "paper"])
def test_fewer_slices_at_a_larger_tolerance(tree, rule: str) -> None:
    counts = [
        select_cut(tree, FRAMES["low"], SPEEDS, t, "slices", rule).planes.sum() for t in (0.25, 1.0, 4.0, 16.0)
    ]  # fmt: skip
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 2 * counts[-1]


@given(
    x=st.floats(-500, 3000), z=st.floats(-500, 3000), yaw=st.floats(0, 360), seed=st.integers(0, 100)
)  # fmt: skip
@settings(max_examples=25, deadline=None)
def test_rays_pass_boxes_in_their_order(tree, x: float, z: float, yaw: float, seed: int) -> None:
    frame = frame_at(x, 150.0, z, yaw, -12.0)
    cut = select_cut(tree, frame, SPEEDS, 1.0, horizon=False)
    lower, upper = (c[:, [0, 2]] - frame.eye_m[[0, 2]] for c in (cut.lower_m, cut.upper_m))
    aside = ((lower > 0) | (upper < 0)).all(axis=1)  # not on the eye's own row or column
    rank = np.flatnonzero(aside)
    random = np.random.default_rng(seed)
    for angle in random.uniform(0, 2 * np.pi, 12):
        ray = np.array([np.cos(angle), np.sin(angle)])
        at = np.stack([lower[rank] / ray, upper[rank] / ray])
        enter, leave = at.min(axis=0).max(axis=1), at.max(axis=0).min(axis=1)
        met = (leave > enter + 1e-6) & (enter > 0)
        assert (np.diff(enter[met]) > -1e-6).all()


def test_front_to_back_starts_at_the_eye(tree) -> None:
    frame = frame_at(1285.0, 200.0, 1285.0)
    row, col = (a.ravel().astype(np.int32) for a in np.indices((32, 32)))
    order = front_to_back(tree, frame, Nodes(np.full(1024, 3, np.int32), row, col))
    assert (row[order[0]], col[order[0]]) == (16, 16)


@pytest.mark.parametrize("name", FRAMES)
def test_bundles_are_closed_by_the_faces_rays_leave_through(tree, name: str) -> None:
    frame = FRAMES[name]
    cut = select_cut(tree, frame, SPEEDS, 1.0, "slices")
    names = name_slices(cut, frame.eye_m, closed=True)
    box, number = names & ((1 << BOX_BITS) - 1), names >> BOX_BITS
    assert (np.diff(box.astype(np.int64)) >= 0).all(), "box by box"
    for b in range(len(cut.planes)):
        mine = number[box == b].astype(int)
        planes = mine[mine < LAST_NUMBER - 5]
        assert (planes == np.arange(cut.planes[b])).all()
        faces = {LAST_NUMBER - n for n in mine if n >= LAST_NUMBER - 5}
        leaving = set()
        for axis in range(3):
            if cut.lower_m[b, axis] < frame.eye_m[axis]:
                leaving.add(2 * axis)
            if cut.upper_m[b, axis] > frame.eye_m[axis] and axis != 1:
                leaving.add(2 * axis + 1)
        own = {X_SLICES: {0, 1}, Y_SLICES: {2, 3}, Z_SLICES: {4, 5}, POLYGONS: set(range(6))}[int(cut.direction[b])]
        assert faces == leaving - own


def test_paper_bundles_are_open(tree) -> None:
    cut = select_cut(tree, FRAMES["low"], SPEEDS, 1.0, "slices", "paper")
    assert len(name_slices(cut, FRAMES["low"].eye_m, closed=False)) == cut.planes.sum()


def test_a_frame_that_looks_away_draws_nothing(tree) -> None:
    for rule in ("secant", "paper"):
        cut = select_cut(tree, frame_at(-500.0, 100.0, 1280.0, 270.0, 0.0), SPEEDS, 1.0, rule=rule)
        assert len(cut.planes) == 0
        assert cut.cost_ms == 0.0


def test_triangles_cost_more_where_none_hides_another() -> None:
    view = View(1.0, 400.0, 320 * 240, (10.0, 10.0))
    along = refined_bundles(one_box((-40.0, -30.0, 460.0), (40.0, -10.0, 540.0)), view, SPEEDS)
    above = refined_bundles(one_box((-40.0, -510.0, -40.0), (40.0, -490.0, 40.0)), view, SPEEDS)
    assert above.polygons_ms[0] > 1.5 * along.polygons_ms[0]


def test_looking_for_slices_costs_by_the_area_looked_at() -> None:
    half = np.array([[0.0, 0.0, 0.5, 0.5], [0.5, 0.5, 1.0, 1.0]], np.float32)
    whole = np.array([[0.0, 0.0, 1.0, 1.0]], np.float32)
    costs = [search_cost_ms(patches, SIZE, SPEEDS) - SPEEDS.search_ms for patches in (half[:0], half, whole)]
    assert costs[0] == 0
    assert costs[2] == pytest.approx(2 * costs[1])


def test_small_gains_are_none(tree) -> None:
    """Slices that would save little beside polygons are left out altogether."""
    frame = FRAMES["low"]
    dear = next(
        cut
        for factor in np.geomspace(1, 100, 30)
        if not (cut := select_cut(tree, frame, replace(SPEEDS, slice_ms=SPEEDS.slice_ms * factor), 1.0)).planes.any()
    )
    assert not len(dear.patches)
    assert (dear.direction == POLYGONS).all()
