"""Bounds and the numpy ray caster: against every triangle one by one, against marching, and against closed forms."""

from __future__ import annotations

import itertools
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays, first_descent, surface_at

INTERPOLATIONS = ("triangles", "bilinear", "bicubic")


def rough(rows, cols, seed=0, scale=2.0):
    return (np.random.default_rng(seed).normal(size=(rows, cols)) * scale).astype(np.float32)


def hostile_rays(rows, cols, count, seed=0, scale=2.0):
    """``count`` rays of every kind that has broken a ray caster: (n, 3) origins and directions in (u, v, h)."""
    rng = np.random.default_rng(seed)

    def origins(n):
        return rng.uniform([-0.3 * cols, -0.3 * rows, -4 * scale], [1.3 * cols, 1.3 * rows, 4 * scale], (n, 3))

    kinds = []
    kinds.append((origins(count), rng.normal(size=(count, 3))))  # anything, from below and outside too
    o, d = origins(count), rng.normal(size=(count, 3))
    d[:, 2] *= 0.02  # grazing
    kinds.append((o, d))
    for axis in (0, 1, 2):  # parallel to each axis, to each side; the vertical ones among them
        o, d = origins(count), np.zeros((count, 3))
        d[:, axis] = rng.choice([-1.0, 1.0], count)
        kinds.append((o, d))
    o, d = np.round(origins(count)), rng.integers(-2, 3, (count, 3)).astype(np.float64)
    o[:, 2] += rng.uniform(-1, 1, count)
    d[(d == 0).all(axis=1)] = (0, 0, -1)  # along edges, diagonals and the rim, through posts
    kinds.append((o, d))
    o = origins(count)
    post = np.stack([rng.integers(0, cols, count), rng.integers(0, rows, count)], axis=1).astype(np.float64)
    kinds.append((o, np.concatenate([post - o[:, :2], rng.uniform(-8, 0, (count, 1))], axis=1)))
    far = rng.normal(size=(count, 3))
    far *= 1e5 / np.linalg.norm(far, axis=1, keepdims=True)
    inside = rng.uniform([0, 0, -scale], [cols - 1, rows - 1, scale], (count, 3))
    kinds.append((far, (inside - far) / 1e5))  # from far away
    return tuple(np.concatenate(part) for part in zip(*kinds, strict=True))


def every_triangle(heights, origin, direction):
    """The nearest front face among all triangles, one by one: shares nothing with the caster but the diagonal rule."""
    rows, cols = heights.shape
    posts = {(r, c): np.array([c, r, float(heights[r, c])]) for r in range(rows) for c in range(cols)}
    nearest = np.full(len(origin), np.inf)
    for r in range(rows - 1):
        for c in range(cols - 1):
            nw, ne, sw, se = posts[r, c], posts[r, c + 1], posts[r + 1, c], posts[r + 1, c + 1]
            pair = ((nw, ne, se), (nw, se, sw)) if (r + c) % 2 == 0 else ((nw, ne, sw), (ne, se, sw))
            for p, q, s in pair:
                normal = np.cross(q - p, s - p)  # north-west, then clockwise on a map with v to the south: upwards
                towards = direction @ normal
                with np.errstate(divide="ignore", invalid="ignore"):
                    t = (p - origin) @ normal / towards
                    at = origin + t[:, None] * direction - p
                    area = np.linalg.inv(np.array([(q - p)[:2], (s - p)[:2]]).T)
                    u, v = area @ at[:, :2].T
                    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (towards < 0) & (t >= 0)
                nearest = np.where(inside & (t < nearest), t, nearest)
    return nearest


def assert_same_hits(found, expected, tolerance=1e-7):
    assert np.array_equal(np.isfinite(found), np.isfinite(expected))
    hit = np.isfinite(expected)
    np.testing.assert_allclose(found[hit], expected[hit], rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("sloped", [True, False])
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("shape", [(2, 2), (2, 9), (23, 40), (66, 35)])
def test_the_surface_stays_between_the_planes_of_every_node(shape, interpolation, sloped):
    heights = rough(*shape, seed=sum(shape))
    bounds = build_bounds(heights, interpolation, sloped=sloped)
    v, u = np.mgrid[0 : shape[0] - 1 : 0.25, 0 : shape[1] - 1 : 0.25]
    surface = surface_at(heights, interpolation, u, v)
    assert (surface > bounds.range_m[0]).all()
    assert (surface < bounds.range_m[1]).all()
    for level, nodes in enumerate(bounds.levels, start=1):
        row, col = (v.astype(int) >> level), (u.astype(int) >> level)
        a, b, upper, lower = np.moveaxis(nodes[row, col], -1, 0)
        plane = a * (u - (col << level)) + b * (v - (row << level))
        assert (surface <= plane + upper).all()
        assert (surface >= plane + lower).all()


def test_widened_planes_hold_half_a_node_further_out():
    heights = rough(50, 71, seed=5)
    bounds = build_bounds(heights)
    v, u = np.mgrid[0:49:0.5, 0:70:0.5]
    surface = surface_at(heights, "triangles", u, v)
    for level, nodes in enumerate(bounds.widened, start=2):
        size = 1 << level
        for row in range(nodes.shape[0]):
            for col in range(nodes.shape[1]):
                a, b, upper, lower = nodes[row, col]
                du, dv = u - col * size, v - row * size
                near = (np.abs(du - size / 2) <= size) & (np.abs(dv - size / 2) <= size)
                gap = surface[near] - (a * du + b * dv)[near]
                assert gap.max() <= upper
                assert gap.min() >= lower


def test_sloped_bounds_of_a_plane_have_no_thickness_and_constant_ones_do():
    v, u = np.mgrid[0:33, 0:33].astype(np.float32)
    heights = np.ascontiguousarray(3 * u - 2 * v + 100)
    sloped, constant = build_bounds(heights).levels[0], build_bounds(heights, sloped=False).levels[0]
    assert np.ptp(sloped[..., 2:], axis=-1).max() < 1e-3
    assert np.ptp(constant[..., 2:], axis=-1).min() >= 10
    np.testing.assert_allclose(sloped[..., 0], 3, atol=1e-5)
    np.testing.assert_allclose(sloped[..., 1], -2, atol=1e-5)


def test_constant_bounds_are_the_minimum_and_maximum():
    heights = rough(33, 33)
    node = build_bounds(heights, sloped=False).levels[1][1, 2]
    block = heights[4:9, 8:13]
    np.testing.assert_allclose(node, [0, 0, block.max(), block.min()], rtol=1e-5)


@pytest.mark.parametrize("sloped", [True, False])
@pytest.mark.parametrize("shape", [(2, 2), (6, 13), (9, 9), (12, 19)])
def test_rays_of_every_hostile_kind_meet_the_triangle_they_should(shape, sloped):
    heights = rough(*shape, seed=shape[0])
    origin, direction = hostile_rays(*shape, 250, seed=shape[1])
    hits = cast_rays(heights, build_bounds(heights, sloped=sloped), origin, direction)
    assert_same_hits(hits.t, every_triangle(heights, origin, direction))
    hit = np.isfinite(hits.t)
    assert hit.sum() > 100
    at = origin[hit] + direction[hit] * hits.t[hit, None]
    assert (np.abs(at[:, :2] - (hits.cell[hit] + 0.5)).max(axis=1) <= 0.5 + 1e-6).all()


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic"])
def test_smooth_surfaces_are_met_where_marching_meets_them(interpolation):
    heights = rough(9, 12, seed=8)
    origin, direction = hostile_rays(9, 12, 20, seed=3)
    near = np.abs(origin).max(axis=1) < 1e3
    origin, direction = origin[near], direction[near] / np.linalg.norm(direction[near], axis=1, keepdims=True)
    hits = cast_rays(heights, build_bounds(heights, interpolation), origin, direction, interpolation=interpolation)

    t = np.linspace(0, 40, 40001)  # marching
    expected = np.full(len(origin), np.inf)
    for k in range(len(origin)):
        u, v, h = (origin[k] + t[:, None] * direction[k]).T
        inside = (u >= 0) & (u <= 11) & (v >= 0) & (v <= 8)
        gap = np.where(inside, h - surface_at(heights, interpolation, u, v), np.nan)
        falls = np.flatnonzero((gap[:-1] > 0) & (gap[1:] <= 0))
        if falls.size:
            expected[k] = t[falls[0]]
    assert_same_hits(hits.t, expected, tolerance=2e-3)
    hit = np.isfinite(hits.t)
    at = origin[hit] + hits.t[hit, None] * direction[hit]
    np.testing.assert_allclose(at[:, 2], surface_at(heights, interpolation, at[:, 0], at[:, 1]), atol=1e-8)


@given(st.lists(st.floats(-2, 2), min_size=3, max_size=7))
@settings(max_examples=80)
def test_first_descent_is_the_first_place_where_the_polynomial_falls_to_zero(coefficients):
    is_above = coefficients[0] > 0
    root, after = first_descent(np.array([coefficients]), np.array([is_above]))
    degree, s = len(coefficients) - 1, np.linspace(0, 1, 2001)
    basis = np.stack([comb(degree, k) * s**k * (1 - s) ** (degree - k) for k in range(degree + 1)])
    value = np.array(coefficients) @ basis
    above = np.maximum.accumulate(value > 1e-6) | is_above
    falls = np.flatnonzero(above & (value < -1e-6))
    if falls.size:  # marching sees a fall: it must not have been missed
        assert root[0] <= s[falls[0]] + 1e-9
    if np.isfinite(root[0]):
        assert abs(np.interp(root[0], s, value)) < 1e-2
        assert not after[0]


def test_flat_ground_is_met_where_the_closed_form_says():
    heights = np.full((33, 33), 7.0, np.float32)
    rng = np.random.default_rng(1)
    origin = np.concatenate([rng.uniform(0, 32, (500, 2)), rng.uniform(8, 5000, (500, 1))], axis=1)
    target = np.concatenate([rng.uniform(0.01, 31.99, (500, 2)), np.full((500, 1), 7.0)], axis=1)
    for sloped in (True, False):
        hits = cast_rays(heights, build_bounds(heights, sloped=sloped), origin, target - origin)
        np.testing.assert_allclose(hits.t, 1.0, rtol=1e-9)


def test_a_ramp_is_met_where_the_closed_form_says():
    v, u = np.mgrid[0:65, 0:65].astype(np.float32)
    heights = np.ascontiguousarray(0.5 * u + 0.25 * v)
    origin = np.array([[32.0, 32.0, 100.0], [1.0, 63.0, 90.0]])
    direction = np.array([[0.3, -0.2, -1.0], [1.0, -0.9, -1.5]])
    hits = cast_rays(heights, build_bounds(heights), origin, direction)
    gap = origin[:, 2] - 0.5 * origin[:, 0] - 0.25 * origin[:, 1]
    np.testing.assert_allclose(
        hits.t, gap / (0.5 * direction[:, 0] + 0.25 * direction[:, 1] - direction[:, 2]), rtol=1e-6
    )


def test_rays_down_the_axis_of_a_cone_meet_its_tip_and_beside_it_its_flank():
    v, u = np.mgrid[0:33, 0:33]
    heights = np.ascontiguousarray(20.0 - np.hypot(u - 16, v - 16), np.float32)
    origin = np.array([[16.0, 16.0, 50.0], [16.0, 24.0, 50.0], [0.0, 16.0, 10.0]])
    direction = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    hits = cast_rays(heights, build_bounds(heights), origin, direction)
    np.testing.assert_allclose(hits.t, [30.0, 38.0, 6.0], rtol=1e-6)


def test_a_step_is_met_on_its_face_and_a_needle_on_its_side():
    step = np.zeros((17, 17), np.float32)
    step[:, 8:] = 10.0
    hits = cast_rays(step, build_bounds(step), np.array([[0.5, 5.3, 5.0]]), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(hits.t, 7.0)
    needle = np.zeros((17, 17), np.float32)
    needle[8, 8] = 100.0
    rays = np.array([[0.0, 8.0, 50.0], [0.0, 8.0, 99.0], [0.0, 9.0, 50.0]]), np.array([[1.0, 0.0, 0.0]] * 3)
    hits = cast_rays(needle, build_bounds(needle), *rays)
    np.testing.assert_allclose(hits.t, [7.5, 7.99, np.inf])


def test_rays_from_below_pass_the_surface_and_meet_what_faces_them():
    _, u = np.mgrid[0:33, 0:33]
    ridge = np.ascontiguousarray(10.0 * (u == 16), np.float32)
    hits = cast_rays(ridge, build_bounds(ridge), np.array([[16.0, 7.3, 5.0]]), np.array([[1.0, 0.0, 0.0]]))
    assert np.isinf(hits.t[0])  # out of the ridge it sees only backs
    origin, direction = np.array([[4.0, 7.3, -1.0]]), np.array([[1.0, 0.0, 0.3]])
    hits = cast_rays(ridge, build_bounds(ridge), origin, direction)
    # It comes out of the ground at t = 3.3 and meets the ridge's western face: -1 + 0.3 t = 10 (4 + t - 15).
    np.testing.assert_allclose(hits.t, (110.0 - 1.0) / (10.0 - 0.3), rtol=1e-9)


@pytest.mark.parametrize("tolerance", [0.3, 1.0, 4.0])
def test_level_of_detail_stays_within_half_the_allowed_thickness(tolerance):
    v, u = np.mgrid[0:257, 0:257]
    heights = np.ascontiguousarray(20 * np.sin(u / 13) * np.cos(v / 17) + rough(257, 257, scale=0.05), np.float32)
    rng = np.random.default_rng(4)
    origin = np.tile([128.0, 250.0, 60.0], (4000, 1))
    direction = np.stack([rng.uniform(-0.7, 0.7, 4000), -np.ones(4000), rng.uniform(-0.9, -0.05, 4000)], axis=1)
    bounds = build_bounds(heights)
    exact = cast_rays(heights, bounds, origin, direction)
    coarse = cast_rays(heights, bounds, origin, direction, thickness_per_m=0.01 * tolerance)
    hit = np.isfinite(coarse.t)
    at = origin[hit] + direction[hit] * coarse.t[hit, None]
    error = np.abs(at[:, 2] - surface_at(heights, "triangles", at[:, 0], at[:, 1]))
    away = coarse.t[hit] * np.linalg.norm(direction[hit], axis=1)
    assert (error <= 0.5 * 0.01 * tolerance * away + 1e-4).all()
    assert (error > 1e-3).any()
    assert coarse.steps.mean() < exact.steps.mean()
    assert (hit == np.isfinite(exact.t)).mean() > 0.97


@pytest.mark.parametrize("seed", range(4))
def test_below_a_ray_that_meets_the_ground_every_ray_does_at_every_level_of_detail(seed):
    """All rays of a vertical fan see one surface, which takes one answer to which nodes are thin."""
    rng = np.random.default_rng(seed)
    heights = np.cumsum(np.cumsum(rng.normal(size=(65, 65)), axis=0), axis=1) * 0.02 + rng.normal(size=(65, 65)) * 0.1
    heights = np.ascontiguousarray(heights, np.float32)
    bounds = build_bounds(heights)
    elevation, azimuth = np.linspace(0.3, -0.6, 300), rng.uniform(0.0, 2 * np.pi, 40)
    for angle, thickness in itertools.product(azimuth, (0.03, 0.1)):
        eye = np.array([*rng.uniform(0.0, 64.0, 2), heights.max() + rng.uniform(0.1, 5.0)])
        direction = np.column_stack([np.full(300, np.cos(angle)), np.full(300, np.sin(angle)), elevation])
        t = cast_rays(heights, bounds, np.tile(eye, (300, 1)), direction, thickness_per_m=thickness).t
        hit = np.isfinite(t)
        assert hit[np.argmax(hit) :].all() or not hit.any()


def test_a_node_is_passed_in_far_fewer_steps_than_it_has_cells():
    heights = rough(513, 513, scale=0.5)
    origin, direction = np.array([[0.5, 0.7, 30.0]]), np.array([[511.0, 510.0, -31.0]])
    assert cast_rays(heights, build_bounds(heights), origin, direction).steps[0] < 200


def test_a_flat_as_low_as_the_map_gets_is_met_at_every_level_of_detail():
    """A node across the flat's rim is thin far away, and its middle plane dips below the lowest post."""
    _, u = np.mgrid[0:129, 0:129]
    heights = np.ascontiguousarray(np.maximum(0, 0.4 * (u - 70)), np.float32)
    x, z = np.meshgrid(np.linspace(0.3, 127.7, 60), np.linspace(0.3, 127.7, 60))
    target = np.stack([x.ravel(), z.ravel(), surface_at(heights, "triangles", x.ravel(), z.ravel())], axis=1)
    origin = np.tile([-900.0, 64.0, 400.0], (len(target), 1))
    hits = cast_rays(heights, build_bounds(heights), origin, target - origin, thickness_per_m=0.008)
    assert np.isfinite(hits.t[np.abs(x.ravel() - 64) < 60]).all()


def test_nodes_on_the_rim_of_missing_data_are_never_thin():
    heights = np.zeros((130, 97), np.float32)
    holes = np.zeros(heights.shape, np.bool_)
    holes[40:90, 33:34] = True
    for level, nodes in enumerate(build_bounds(heights, holes=holes).levels, start=1):
        thickness = nodes[..., 2] - nodes[..., 3]
        rim = thickness > 1e20
        assert rim[(45 >> level), (33 >> level)]
        assert rim.sum() >= (50 >> level)
        assert np.isfinite(nodes).all()
        if level < 4:
            assert (thickness[~rim] < 1e-3).all()
            assert not rim[0, 0]
