"""The embedded scenes: the same bits each time, the same landscape at each size, and what each one promises."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from terrain.errors import InputError
from terrain.synthetic import MAX_POSTS, SCENES, make_scene
from terrain.synthetic.erosion import ShiftedGrid, downstream_sum, drain_pits, steepest_receivers, upstream_sum
from terrain.synthetic.noise import fbm, lattice_noise, refine, resample, smoothstep

LANDSCAPES = ("alps", "city", "plain", "snake")
ANALYTIC = ("flat", "ramp", "cone", "step", "needle", "waves")


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("size", [2, 3, 34, 129])
def test_every_scene_covers_its_extent_at_every_size(name, size):
    scene, fine = make_scene(name, size), make_scene(name, 257)
    assert scene.heights_m.shape == (size, size)
    assert scene.extent_m == pytest.approx(fine.extent_m)
    assert scene.name == name
    # A coarse grid may miss peaks, never find higher ones than the fine grid's by more than its finest detail.
    assert scene.height_range_m[1] <= fine.height_range_m[1] + 0.1 * np.ptp(fine.heights_m) + 1e-3


@pytest.mark.parametrize("name", SCENES)
def test_the_same_seed_gives_the_same_bits(name):
    first = make_scene(name, 65).sha256
    for module, kept in (("alps", "_eroded"), ("plain", "_base"), ("snake", "_beside")):
        if name == module:  # nothing may come from what was kept of the first time
            getattr(import_module(f"terrain.synthetic.{module}"), kept).cache_clear()
    assert make_scene(name, 65).sha256 == first


@pytest.mark.parametrize("name", LANDSCAPES)
def test_another_seed_gives_another_landscape(name):
    assert make_scene(name, 65, 0).sha256 != make_scene(name, 65, 1).sha256


@pytest.mark.parametrize("name", ["alps", "city", "cone", "waves", "ramp"])
def test_posts_of_a_coarse_grid_are_posts_of_a_fine_one(name):
    coarse, fine = make_scene(name, 129).heights_m, make_scene(name, 513).heights_m
    assert np.array_equal(coarse, fine[::4, ::4])


@pytest.mark.parametrize(("name", "detail_m"), [("alps", 40.0), ("plain", 0.6), ("snake", 9.0)])
def test_finer_grids_add_detail_and_move_nothing_else(name, detail_m):
    coarse, fine = make_scene(name, 513).heights_m, make_scene(name, 1025).heights_m[::2, ::2]
    difference = np.abs(coarse - fine)
    assert 0.0 < np.quantile(difference, 0.99) < detail_m


@pytest.mark.parametrize(("name", "size"), [("alps", 257), ("alps", 513), ("plain", 1025), ("snake", 1025)])
def test_changing_a_scene_changes_no_other(name, size):
    scene = make_scene(name, size)
    before = scene.heights_m.copy()
    scene.heights_m[:] = 0.0
    assert np.array_equal(make_scene(name, size).heights_m, before)


@pytest.mark.parametrize(("name", "size", "seed"), [("atlantis", 9, 0), ("alps", 1, 0), ("alps", MAX_POSTS + 1, 0)])
def test_what_cannot_be_made_is_one_clear_line(name, size, seed):
    with pytest.raises(InputError) as error:
        make_scene(name, size, seed)
    assert "\n" not in str(error.value)
    if name == "atlantis":
        assert all(scene in str(error.value) for scene in SCENES)


def test_a_negative_seed_is_refused():
    with pytest.raises(InputError, match="seed"):
        make_scene("alps", 9, -1)


def closed_form(name, x, z):
    return {
        "flat": lambda: 100.0 + 0.0 * x,
        "ramp": lambda: x / 4 + z / 8,
        "cone": lambda: np.maximum(0.0, 200.0 - np.hypot(x - 512, z - 512) / 2),
        "step": lambda: np.where(x >= 512, 100.0, 0.0),
        "waves": lambda: 50 + 25 * np.sin(2 * np.pi * x / 256) * np.cos(2 * np.pi * z / 256),
    }[name]()


@pytest.mark.parametrize("name", [name for name in ANALYTIC if name != "needle"])
@pytest.mark.parametrize("size", [5, 64, 129])
def test_analytic_scenes_follow_their_closed_form(name, size):
    scene = make_scene(name, size)
    z, x = np.mgrid[0:size, 0:size] * scene.spacing_m[0]
    assert scene.extent_m == (1024.0, 1024.0)
    np.testing.assert_allclose(scene.heights_m, closed_form(name, x, z), atol=1e-4)


def test_needle_is_one_post():
    heights = make_scene("needle", 65).heights_m
    assert heights[32, 32] == 200.0
    assert np.count_nonzero(heights) == 1


def slopes_deg(scene):
    down, across = np.gradient(scene.heights_m.astype(np.float64), *reversed(scene.spacing_m))
    return np.degrees(np.arctan(np.hypot(down, across)))


@pytest.mark.parametrize("seed", [0, 1])
def test_alps_look_like_mountains_in_figures(seed):
    scene = make_scene("alps", 513, seed)
    low, high = scene.height_range_m
    slopes = slopes_deg(scene)
    assert 500.0 < low < 700.0
    assert 3000.0 < high < 4200.0
    assert 12.0 < np.median(slopes) < 35.0  # the Bernese Alps: about 26 degrees
    assert np.quantile(slopes, 0.99) < 70.0
    assert np.quantile(slopes, 0.05) < 9.0  # valley floors and lakes


def test_alps_have_level_lakes():
    heights = make_scene("alps", 1025).heights_m
    level = (heights[1:-1, 1:-1] == heights[2:, 1:-1]) & (heights[1:-1, 1:-1] == heights[1:-1, 2:])
    assert level.mean() > 0.003


def test_water_leaves_the_alps_downhill():
    """Few pits: ground carved by rivers has hardly any, noise has one in twenty posts."""
    heights = make_scene("alps", 513).heights_m
    receivers, _ = steepest_receivers(heights, np.full(8, 1.0))
    inside = np.zeros(heights.shape, np.bool_)
    inside[1:-1, 1:-1] = True
    pits = (receivers == np.arange(receivers.size)).reshape(heights.shape) & inside
    is_lake = np.zeros_like(inside)
    is_lake[1:] |= heights[1:] == heights[:-1]
    noise, _ = steepest_receivers(lattice_noise((1,), 512, 513), np.full(8, 1.0))
    assert (pits & ~is_lake).sum() < 0.2 * (noise == np.arange(noise.size)).sum()


def test_city_has_vertical_walls_on_gentle_ground_and_level_water():
    heights = make_scene("city", 1025).heights_m
    step = np.abs(np.diff(heights, axis=1))
    assert (step > 6.0).mean() > 0.01  # walls
    assert np.median(step) < 0.05  # streets
    assert np.quantile(heights, 0.3) - heights.min() < 20.0
    assert (heights == heights.min()).mean() > 0.03  # the river
    assert heights.max() > 100.0  # towers


def test_plain_is_low_and_smooth_with_an_incised_river():
    scene = make_scene("plain", 1025)
    heights = scene.heights_m
    assert np.ptp(heights) < 60.0
    assert np.quantile(slopes_deg(scene), 0.9) < 6.0
    # A river enters in the west and leaves in the east: each column holds a bed well below its banks.
    lowest = heights.argmin(axis=0)
    banks = heights[np.clip(lowest - 25, 0, 1024), np.arange(1025)]
    assert np.median(banks - heights.min(axis=0)) > 1.5
    fall_m = np.polynomial.polynomial.polyfit(np.linspace(0.0, 1.0, 1025), heights.min(axis=0), 1)[1]
    assert -4.5 < fall_m < -2.0  # it flows east


def test_snake_keeps_its_detail_at_every_size():
    for size in (129, 513, 1025):
        scene = make_scene("snake", size)
        bend = np.diff(scene.heights_m, 2, axis=1) / scene.spacing_m[0]
        assert np.std(bend) > 0.15, size


# The tools they are made with.


@given(arrays(np.float32, (9, 9), elements=st.floats(0, 100, width=32)), st.integers(0, 2**32))
def test_rivers_end_at_outlets_and_carry_all_the_water(heights, seed):
    receivers, slope = steepest_receivers(heights, ShiftedGrid(9, 10.0, (seed,)).per_m)
    outlets = np.zeros((9, 9), np.bool_)
    outlets[0, :3] = True
    assert np.all((slope > 0) == (receivers != np.arange(81)))
    drain_pits(heights, receivers, outlets)
    end = receivers
    for _ in range(81):
        end = receivers[end]
    assert outlets.ravel()[end].all()
    water = upstream_sum(receivers, np.ones(81))
    assert water[outlets.ravel()].sum() == pytest.approx(81)
    np.testing.assert_allclose(water, naive_upstream(receivers))
    rise = np.linspace(0.1, 2.0, 81)
    np.testing.assert_allclose(downstream_sum(receivers, rise), naive_downstream(receivers, rise))


def naive_upstream(receivers):
    total = np.zeros(receivers.size)
    for post in range(receivers.size):
        at = post
        while True:
            total[at] += 1
            if receivers[at] == at:
                break
            at = receivers[at]
    return total


def naive_downstream(receivers, rise):
    total = np.zeros(receivers.size)
    for post in range(receivers.size):
        at = post
        while receivers[at] != at:
            total[post] += rise[at]
            at = receivers[at]
    return total


def test_a_pit_drains_over_its_lowest_pass():
    heights = np.full((7, 7), 9.0, np.float32)
    heights[2, 1:6] = [1.0, 6.0, 2.0, 4.0, 0.0]  # two pits: the west one drains into the east one, that one over the 4
    receivers, _ = steepest_receivers(heights, np.full(8, 1.0))
    outlets = np.zeros((7, 7), np.bool_)
    outlets[2, 5] = True
    drain_pits(heights, receivers, outlets)
    way, at = [], 2 * 7 + 1
    while receivers[at] != at:
        at = receivers[at]
        way.append(heights.ravel()[at])
    assert max(way) == 4.0
    assert way[-1] == 0.0


def test_upstream_sums_stop_after_their_doublings():
    chain = np.maximum(np.arange(40) - 1, 0)
    assert upstream_sum(chain, np.ones(40), 3)[0] == 8.0
    assert upstream_sum(chain, np.ones(40))[0] == 40.0


def test_noise_is_the_same_function_at_every_size():
    np.testing.assert_allclose(fbm((1,), 4, 3, 65)[::2, ::2], fbm((1,), 4, 3, 33), atol=1e-5)
    assert np.std(lattice_noise((2,), 200, 801)) == pytest.approx(1.0, rel=0.05)
    assert np.std(fbm((3,), 64, 4, 1025)) == pytest.approx(1.0, rel=0.1)


@given(st.integers(2, 40), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=25)
def test_resampling_keeps_planes_and_posts(size, across, down):
    row, col = np.mgrid[0:9, 0:9] / 8.0
    plane = (across * col + down * row).astype(np.float32)
    row, col = np.mgrid[0:size, 0:size] / (size - 1)
    np.testing.assert_allclose(resample(plane, size), across * col + down * row, atol=1e-5)
    np.testing.assert_array_equal(refine(plane)[::2, ::2], plane)
    np.testing.assert_allclose(refine(plane), resample(plane, 17), atol=1e-5)


def test_smoothstep_rises_and_falls():
    x = np.linspace(-1.0, 2.0, 7)
    np.testing.assert_allclose(smoothstep(0.0, 1.0, x), [0, 0, 0, 0.5, 1, 1, 1])
    np.testing.assert_allclose(smoothstep(1.0, 0.0, x), [1, 1, 1, 0.5, 0, 0, 0])
