"""The ray caster on the GPU: against the float64 caster ray by ray, against the reference mesh, and by itself."""

from __future__ import annotations

from functools import partial

import moderngl
import numpy as np
import pytest

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays
from terrain.camera import Camera
from terrain.gpu.context import Gpu, create_offscreen_context
from terrain.heightfield import Heightfield
from terrain.measure.accuracy import count_holes
from terrain.planes import BasePlane, place_plane
from terrain.renderers.perturbation import PerturbationRenderer, PerturbationSettings
from terrain.scene import open_scene
from terrain.stage import Stage

SIZE = (161, 101)  # odd: a ray along the sight line itself
EXACT = {"detail": False}


@pytest.fixture
def stage_of(stages):
    return partial(stages, "perturbation")


def ridges(rows=70, cols=131, spacing=(10.0, 12.0)):
    row, col = np.indices((rows, cols))
    heights = 120 * np.abs(np.sin(row / 11.0) * np.cos(col / 17.0))
    heights += np.random.default_rng(7).normal(0, 2, (rows, cols))
    return Heightfield(heights.astype(np.float32), spacing)


def towers(rows=65, cols=65):
    heights = np.zeros((rows, cols), np.float32)
    heights[20:40, 10:30] = 80.0
    heights[44:46, 8:60] = 25.0
    heights[12, 50] = 200.0
    return Heightfield(heights, (10.0, 10.0))


def hostile_cameras(terrain):
    """Cameras whose rays are of every kind that has broken a ray caster."""
    (dx, dz), (width, depth) = terrain.spacing_m, terrain.extent_m
    peak = float(terrain.heights_m.max())

    def above(x, z, clearance):
        return (x, float(terrain.heights_at(x, z)) + clearance, z)

    post = (terrain.cols // 2 * dx, terrain.rows // 2 * dz)
    return {
        "usual": Camera(above(width * 0.3, depth * 0.7, 60), 30, -15),
        "grazing": Camera(above(width * 0.2, depth * 0.6, 2), 80, 0),
        "north, level, over a post": Camera(above(*post, 5), 0, 0),
        "east, level, over an edge": Camera(above(post[0], post[1] + 0.4 * dz, 5), 90, 0),
        "straight down on a post": Camera(above(*post, 300), 0, -90),
        "straight down, turned": Camera(above(width * 0.6, depth * 0.4, 900), 37, -90, 20),
        "up into the sky": Camera(above(*post, 5), 200, 60),
        "rolled, wide": Camera(above(width * 0.5, depth * 0.9, 80), 300, -25, 70, 120),
        "below the surface": Camera(above(width * 0.4, depth * 0.5, -40), 120, 20),
        "outside, looking at the cut side": Camera((-0.2 * width, 0.3 * peak, depth * 0.5), 90, 2),
        "outside, above": Camera((width * 0.5, 2 * peak, depth * 1.4), 0, -25),
        "outside a corner, low": Camera((-150.0, 10.0, -150.0), 135, 5),
        "on the rim, along it": Camera((0.0, peak + 5, depth), 0, -8),
        "far away": Camera((width * 0.5, 3e5, 5e5), 0, -31, 0, 0.3),
    }


def oracle(stage, camera, interpolation="triangles"):
    """View depth (height, width) of the first hit of every pixel's ray with the terrain, inf for none."""
    return depth_of_plane(BasePlane(stage.scene.heightfield), stage, camera, interpolation)


def nearest_of_all(stage, camera):
    """View depth of the first hit with the terrain or a plane."""
    planes = (BasePlane(stage.scene.heightfield), *stage.scene.planes)
    return np.min([depth_of_plane(plane, stage, camera) for plane in planes], axis=0)


def depth_of_plane(plane, stage, camera, interpolation="triangles"):
    g = plane.map_from_world
    heights = plane.heightfield.heights_m
    direction = camera.ray_directions(*SIZE).reshape(-1, 3) @ g[:3, :3].T
    origin = np.tile((g @ np.append(camera.eye_m, 1.0))[:3], (len(direction), 1))
    bounds = build_bounds(heights, interpolation)
    hits = cast_rays(
        heights, bounds, origin, direction, interpolation=interpolation, t_start=stage.frame(camera, SIZE).near_m
    )
    return hits.t.reshape(SIZE[::-1])


def depths(stage, camera):
    depth = (stage.positions(camera, SIZE) - camera.eye_m) @ camera.forward
    return np.where(np.isfinite(depth), depth, np.inf)


def share_equal(found, expected, tolerance=1e-4):
    """Share of rays with the same answer: both nothing, or the same depth to ``tolerance`` of the distance."""
    both = np.isfinite(found) & np.isfinite(expected)
    same = np.isinf(found) & np.isinf(expected)
    same[both] = np.abs(found[both] - expected[both]) <= tolerance * expected[both]
    return same.mean()


@pytest.mark.parametrize("bounds", ["planes", "heights"])
@pytest.mark.parametrize("terrain", [ridges(), towers()], ids=["ridges", "towers"])
def test_every_hostile_ray_ends_where_the_oracle_says(stage_of, terrain, bounds):
    stage = stage_of(terrain, bounds=bounds, **EXACT)
    for kind, camera in hostile_cameras(terrain).items():
        found, expected = depths(stage, camera), oracle(stage, camera)
        # A ray within float32's reach of an edge may fall on either side of it.
        assert share_equal(found, expected) >= (0.9995 if kind != "far away" else 0.997), kind
        assert np.isfinite(found).any() == np.isfinite(expected).any(), kind


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic"])
def test_smooth_surfaces_end_rays_where_the_oracle_says(stage_of, interpolation):
    terrain = ridges(33, 45)
    stage = stage_of(terrain, interpolation=interpolation, **EXACT)
    cameras = hostile_cameras(terrain)
    for kind in ("grazing", "outside, above"):
        found, expected = depths(stage, cameras[kind]), oracle(stage, cameras[kind], interpolation)
        assert share_equal(found, expected) >= 0.999, kind


def test_the_smooth_surface_runs_through_the_posts(stage_of):
    terrain = ridges(33, 45)
    stage = stage_of(terrain, interpolation="bicubic", **EXACT)
    row, col = 12, 20
    eye = (col * 10.0, 500.0, row * 12.0)
    depth = depths(stage, Camera(eye, 0, -90, 0, 20))[SIZE[1] // 2, SIZE[0] // 2]
    assert depth == pytest.approx(500.0 - terrain.heights_m[row, col], abs=1e-2)


def test_bundles_change_nothing_but_the_cost(stage_of):
    for terrain in (ridges(200, 300), towers()):
        with_bundles, without = stage_of(terrain, **EXACT), stage_of(terrain, bundles=False, **EXACT)
        steps = []
        for kind, camera in hostile_cameras(terrain).items():
            found, counts = [], []
            for stage in (with_bundles, without):
                found.append(depths(stage, camera))
                counts.append(stage.renderer.count_steps(stage.frame(camera, SIZE)).mean())
            assert share_equal(*found, 1e-6) >= 0.9999, kind
            steps.append(counts)
        assert np.sum(steps, axis=0)[0] < 0.9 * np.sum(steps, axis=0)[1]


@pytest.mark.parametrize("tolerance", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("bounds", ["planes", "heights"])
def test_level_of_detail_stays_within_the_tolerance_and_leaves_no_holes(stage_of, tolerance, bounds):
    terrain = ridges(257, 257, (30.0, 30.0))
    stage = stage_of(terrain, bounds=bounds, tolerance_px=tolerance)
    reached = []
    for kind in ("usual", "grazing", "rolled, wide", "outside, above", "straight down, turned"):
        camera = hostile_cameras(terrain)[kind]
        world = stage.positions(camera, SIZE)
        covered = np.isfinite(world[..., 0])
        at = world[covered]
        error = np.abs(at[:, 1] - terrain.heights_at(at[:, 0], at[:, 2]))
        error *= camera.pixels_per_radian(SIZE[1]) / np.linalg.norm(at - camera.eye_m, axis=1)
        assert np.nanmax(error) <= 1.02 * tolerance
        reached.append(np.nanmax(error))
        assert count_holes(covered, np.isfinite(oracle(stage, camera)), tolerance) == 0
    assert max(reached) > 0.3 * tolerance  # it does stop early


def test_when_steps_run_out_there_is_ground_not_a_hole(stage_of):
    terrain = ridges(257, 257)
    short, full = stage_of(terrain, step_limit=8, bundles=False, **EXACT), stage_of(terrain, **EXACT)
    camera = hostile_cameras(terrain)["grazing"]
    covered, true = np.isfinite(depths(short, camera)), np.isfinite(depths(full, camera))
    assert covered[true].all()
    assert full.renderer.count_steps(full.frame(camera, SIZE)).max() < full.renderer.settings.step_limit / 4
    depths(short, camera)
    assert short.renderer.count_steps(short.frame(camera, SIZE)).max() == 8


def test_from_below_and_from_outside_the_same_faces_are_seen_as_in_the_mesh(stage_of):
    for terrain in (ridges(), towers()):
        stage = stage_of(terrain, **EXACT)
        found = {kind: depths(stage, camera) for kind, camera in hostile_cameras(terrain).items()}
        stage.set_renderer("reference")
        for kind, camera in hostile_cameras(terrain).items():
            if kind != "far away":
                assert share_equal(found[kind], depths(stage, camera), 1e-3) >= 0.996, kind


def test_ground_without_data_is_open_and_what_lies_behind_is_seen(stage_of):
    terrain = ridges()
    holes = np.zeros(terrain.heights_m.shape, np.bool_)
    holes[30:50, 40:90] = True
    stage = stage_of(Heightfield(terrain.heights_m, terrain.spacing_m, holes=holes), **EXACT)
    cameras = [hostile_cameras(terrain)[kind] for kind in ("usual", "straight down on a post", "outside, above")]
    found = [depths(stage, camera) for camera in cameras]
    stage.set_renderer("reference")
    for depth, camera in zip(found, cameras, strict=True):
        expected = depths(stage, camera)
        assert share_equal(depth, expected, 1e-3) >= 0.999
        assert np.isinf(expected[60:]).any()


def slabs():
    """A wall standing on the terrain, turned, and a slab that pierces it and hangs over with its face down."""
    bricks = Heightfield(np.random.default_rng(3).uniform(0, 4, (41, 61)).astype(np.float32), (2.0, 2.0))
    wall = BasePlane(bricks, place_plane((500.0, 180.0, 420.0), yaw_deg=25.0, tilt_deg=90.0), (1.0, 0.2, 0.1))
    slab = BasePlane(
        bricks, place_plane((620.0, 205.0, 400.0), yaw_deg=10.0, tilt_deg=25.0, roll_deg=180.0), (1.0, 0.2, 0.1)
    )
    return wall, slab


PLANES_CAMERA = Camera((590.0, 150.0, 560.0), -12, 0)


def test_planes_that_overlap_hide_each_other_as_the_oracle_says(stage_of):
    planes = slabs()
    stage = stage_of(ridges(), planes, **EXACT)
    each = [oracle(stage, PLANES_CAMERA), *(depth_of_plane(plane, stage, PLANES_CAMERA) for plane in planes)]
    nearest = np.argmin(each, axis=0)[np.isfinite(np.min(each, axis=0))]
    assert np.bincount(nearest, minlength=3).min() > 200  # all three are to be seen
    assert share_equal(depths(stage, PLANES_CAMERA), np.min(each, axis=0)) >= 0.999
    assert stage.renderer.stats.draw_calls == 6
    red = stage.render(PLANES_CAMERA, SIZE).astype(int) @ [1, -2, 0] > 0
    assert (red == (np.argmin(each, axis=0) > 0)).mean() > 0.97  # the planes' own colour


def test_ordinary_polygons_are_hidden_by_planes_and_hide_them(stage_of, gpu):
    stage = stage_of(ridges(), slabs(), **EXACT)
    expected = np.min(
        [oracle(stage, PLANES_CAMERA)] + [depth_of_plane(p, stage, PLANES_CAMERA) for p in slabs()], axis=0
    )
    frame, target = stage.frame(PLANES_CAMERA, SIZE), stage.target(SIZE)
    stage.draw(frame, target)
    distance = float(np.median(expected[np.isfinite(expected)]))
    program = gpu.ctx.program(
        "#version 330 core\nuniform float u_depth;\n"
        "void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, u_depth, 1.0); }",
        "#version 330 core\nout vec4 c;\nvoid main() { c = vec4(1.0, 0.0, 1.0, 1.0); }",
    )
    program["u_depth"] = frame.near_m / distance  # reversed z: a polygon that faces the viewer
    array = gpu.ctx.vertex_array(program, [])
    target.framebuffer.use()
    array.render(moderngl.TRIANGLES, vertices=3)
    in_front = (target.read()[..., :3] == (255, 0, 255)).all(axis=-1)
    clear = np.abs(expected - distance) > 1e-3 * distance
    assert np.array_equal(in_front[clear], (expected > distance)[clear])
    assert 0.2 < in_front.mean() < 0.95
    array.release()
    program.release()


def test_the_eye_may_be_millions_of_metres_from_the_origin(stage_of):
    """A plane placed at a northing of six million metres is drawn as sharply as one at the origin."""
    bumps = Heightfield(ridges(40, 40).heights_m, (5.0, 5.0))
    flat = Heightfield(np.full((2, 2), -500.0, np.float32), (1.0, 1.0))
    at = np.array([4e5, 900.0, 6.1e6])
    pictures = []
    for origin in (np.zeros(3), at):
        stage = stage_of(flat, (BasePlane(bumps, place_plane(tuple(origin), 20, 5, 0)),), **EXACT)
        pictures.append(depths(stage, Camera(tuple(origin + np.array([90.0, 160.0, 190.0])), -20, -25)))
    assert np.isfinite(pictures[0]).mean() > 0.2
    assert share_equal(pictures[1], pictures[0], 1e-5) >= 0.9995


def test_a_fine_plane_seen_from_farther_than_integers_reach_is_no_error(stage_of):
    fine = Heightfield(ridges(40, 40).heights_m, (1e-4, 1e-4))
    stage = stage_of(ridges(), (BasePlane(fine),), **EXACT)
    assert np.isfinite(depths(stage, Camera((0.0, 3e5, 5e5), 0, -31, 0, 0.3))).any()


def test_while_frozen_the_detail_stays_where_it_was_chosen(stage_of):
    terrain = ridges(257, 257, (30.0, 30.0))
    stage = stage_of(terrain, tolerance_px=8.0)
    far, near = hostile_cameras(terrain)["outside, above"], hostile_cameras(terrain)["usual"]
    free = depths(stage, near)
    stage.freeze(stage.frame(far, SIZE))
    frozen = depths(stage, near)
    stage.thaw()
    assert share_equal(free, frozen, 1e-5) < 0.9
    assert share_equal(free, depths(stage, near), 1e-6) == 1.0


def test_steps_can_be_seen_and_counted(stage_of):
    stage = stage_of(ridges(257, 257), level_view="steps")
    camera = hostile_cameras(stage.scene.heightfield)["usual"]
    by_steps = stage.render(camera, SIZE, "levels")
    steps = stage.renderer.count_steps(stage.frame(camera, SIZE))
    assert steps.shape == SIZE[::-1]
    assert stage.renderer.stats.ray_steps == pytest.approx(steps.mean())
    stage.set_renderer("perturbation", PerturbationSettings(level_view="levels"))
    assert (stage.render(camera, SIZE, "levels") != by_steps).any()
    assert stage.renderer.stats.ray_steps is None


def test_at_full_detail_every_ray_ends_on_the_finest_level(stage_of):
    stage = stage_of(ridges(257, 257), **EXACT)
    camera = hostile_cameras(stage.scene.heightfield)["usual"]
    covered = np.isfinite(depths(stage, camera))
    assert (stage.render(camera, SIZE, "levels")[covered][:, 0] == 0).all()  # level 0 is blue, without red


def test_constant_bounds_cost_more_steps_than_planes_do(stage_of):
    terrain = ridges(257, 257)
    camera = hostile_cameras(terrain)["usual"]
    mean = {}
    for bounds in ("planes", "heights"):
        stage = stage_of(terrain, bounds=bounds, **EXACT)
        stage.render(camera, SIZE)
        mean[bounds] = stage.renderer.count_steps(stage.frame(camera, SIZE)).mean()
    assert mean["planes"] < 0.8 * mean["heights"]


def test_boxes_cover_what_is_seen(stage_of):
    terrain = ridges(257, 257)
    stage = stage_of(terrain)
    camera = hostile_cameras(terrain)["usual"]
    world = stage.positions(camera, SIZE)
    seen = world[np.isfinite(world[..., 0])][::37]
    boxes = stage.renderer.boxes()
    inside = (seen[:, None] >= boxes.lower_m - 0.5) & (seen[:, None] <= boxes.upper_m + 0.5)
    assert inside.all(axis=2).any(axis=1).all()
    assert len(np.unique(boxes.level)) > 1


def test_all_views_are_drawn_and_pixels_are_covered_once(stage_of):
    stage = stage_of(ridges(257, 257))
    camera = hostile_cameras(stage.scene.heightfield)["usual"]
    pictures = [stage.render(camera, SIZE, view) for view in ("shaded", "wireframe", "boxes", "levels", "normals")]
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)
    assert stage.overdraw(camera, SIZE) == (1.0, 1.0)


def test_the_picture_is_that_of_the_reference(stage_of):
    """At full detail also the ground's texture is filtered as on the mesh: by the surface, not by the pixel beside."""
    stage = stage_of(ridges(257, 257), **EXACT)
    camera = hostile_cameras(stage.scene.heightfield)["usual"]
    picture = stage.render(camera, SIZE).astype(int)
    stage.set_renderer("reference")
    difference = np.abs(picture - stage.render(camera, SIZE).astype(int)).max(axis=-1)
    assert (difference > 8).mean() < 4e-3
    assert difference.mean() < 0.05


def test_large_grids_do_without_packed_corners_and_look_the_same(stage_of, monkeypatch):
    camera = hostile_cameras(ridges())["usual"]
    packed = stage_of(ridges(), **EXACT)
    expected, bytes_packed = depths(packed, camera), packed.renderer.stats.resident_bytes
    monkeypatch.setattr("terrain.renderers.perturbation.PACKED_CELLS", 0)
    unpacked = stage_of(ridges(), **EXACT)
    assert np.array_equal(depths(unpacked, camera), expected)
    assert unpacked.renderer.stats.resident_bytes < bytes_packed


def test_the_renderer_says_what_it_holds(stage_of):
    stage = stage_of(ridges(257, 257))
    assert isinstance(stage.renderer, PerturbationRenderer)
    assert stage.renderer.stats.resident_bytes > 256 * 256 * 16
    assert stage.renderer.stats.prepare_s > 0


def test_without_clip_control_the_depths_are_of_the_same_sense(gpu):
    other = Gpu(create_offscreen_context(), clip_control=False)
    stage = Stage(other, open_scene(ridges(), slabs()), "perturbation", PerturbationSettings(**EXACT))
    assert share_equal(depths(stage, PLANES_CAMERA), nearest_of_all(stage, PLANES_CAMERA)) >= 0.999
    stage.release()
    other.release()
    other.ctx.release()
    gpu.ctx.__enter__()  # the module's own context is current again
