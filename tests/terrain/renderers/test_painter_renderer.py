"""The painter's picture is the depth buffer's, on every path and from everywhere; so is the order made on the GPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np
import pytest
from painter_orders import doubled_area, eyes_over, violations
from scipy.ndimage import minimum_filter

from terrain.algorithms.painter import Foot, foot_at
from terrain.algorithms.painter_errors import build_level_errors
from terrain.algorithms.painter_levels import order_blocks, tile_edges
from terrain.algorithms.painter_tiles import CELLS, TileGrid, Tiles, order_runs
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.programs import FRAME_BINDING, SHADERS, UNITS, flatten
from terrain.gpu.targets import create_target
from terrain.heightfield import Heightfield
from terrain.renderers.painter import PainterRenderer, PainterSettings
from terrain.stage import Stage

SIZE = (96, 64)


def rough(rows: int, cols: int, spacing: tuple[float, float] = (10.0, 10.0), seed: int = 1) -> Heightfield:
    """Steep hills, cliffs and spikes: whatever is out of order shows."""
    random = np.random.default_rng(seed)
    row, col = np.indices((rows, cols))
    heights = 90 * np.abs(np.sin(row / 7.0 + seed) * np.cos(col / 9.0)) + random.normal(0, 6, (rows, cols))
    heights[rows // 3 : rows // 2, cols // 4 : cols // 2] += 80.0
    return Heightfield(heights.astype(np.float32), spacing)


def cameras(terrain: Heightfield, count: int, seed: int) -> Iterator[Camera]:
    """Eyes near and far, over posts and edges, around the grid, looking anywhere."""
    random = np.random.default_rng(seed)
    width, depth = terrain.extent_m
    dx, dz = terrain.spacing_m
    for _ in range(count):
        x, z = random.uniform(-0.3, 1.3, 2) * (width, depth)
        kind = random.integers(5)
        if kind == 1:
            x, z = round(x / dx) * dx, round(z / dz) * dz
        elif kind == 2:
            x = round(x / dx) * dx
        elif kind == 3:
            z = (round(x / dx + z / dz) - x / dx) * dz  # the bisector through a post
        ground = terrain.heights_at(np.clip(x, 0, width), np.clip(z, 0, depth))
        y = float(ground) + float(random.choice([2.0, 20.0, 100.0, 600.0]))
        yield Camera((float(x), y, float(z)), float(random.uniform(0, 360)), float(random.uniform(-60, 15)), 0.0, 60.0)


def differing(a: np.ndarray, b: np.ndarray) -> int:
    return int((np.abs(a.astype(int) - b.astype(int)).max(-1) > 1).sum())


@pytest.fixture
def stage_of(stages):
    return partial(stages, "painter")


def pictures(stage: Stage, camera: Camera, **chosen) -> tuple[np.ndarray, np.ndarray]:
    """The same view in correct and in z-buffer mode."""
    both = []
    for mode in ("correct", "z-buffer"):
        stage.set_renderer("painter", PainterSettings(mode=mode, **chosen))
        both.append(stage.render(camera, SIZE))
    return both[0], both[1]


@pytest.mark.parametrize("levels", [False, True])
@pytest.mark.parametrize("path", ["procedural", "cells", "indexed"])
def test_painted_pictures_are_those_of_the_depth_buffer(stage_of, path, levels):
    terrain = rough(97, 130, (10.0, 14.0))
    stage, total = stage_of(terrain, depth=4), 0
    for camera in cameras(terrain, 40, seed=5):
        total += differing(*pictures(stage, camera, path=path, levels=levels, depth=4, tolerance_px=2.0))
    assert total <= 1e-4 * 40 * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("depth", [0, 1, 3, 8])
@pytest.mark.parametrize("path", ["procedural", "indexed"])
def test_every_depth_of_the_quadtree_gives_the_same_picture(stage_of, path, depth):
    terrain = rough(65, 65)
    camera = Camera((333.0, 190.0, 470.0), 20.0, -20.0, 0.0, 70.0)
    expected = stage_of(terrain, mode="z-buffer", levels=False, depth=5).render(camera, SIZE)
    assert differing(stage_of(terrain, path=path, levels=False, depth=depth).render(camera, SIZE), expected) == 0


@pytest.mark.parametrize("shape", [(2, 2), (2, 9), (3, 3), (9, 2), (33, 18)])
def test_tiny_and_narrow_grids_are_drawn_too(stage_of, shape):
    terrain = rough(*shape)
    stage = stage_of(terrain)
    for camera in cameras(terrain, 6, seed=2):
        for path in ("procedural", "cells", "indexed"):
            assert differing(*pictures(stage, camera, path=path)) == 0


@pytest.mark.parametrize("output", ["shaded", "position", "levels", "normals", "overdraw", "flat"])
def test_no_path_and_no_output_causes_a_gl_error(gpu, stage_of, output):
    terrain = rough(65, 65)
    stage = stage_of(terrain)
    camera = Camera((300.0, 160.0, 500.0), 10.0, -15.0, 0.0, 60.0)
    target = stage.target(SIZE, {"overdraw": "count", "position": "position"}.get(output, "colour"))
    frame = replace(stage.frame(camera, SIZE), output=output)
    stage.draw_output(frame, target)
    for path in ("procedural", "cells", "indexed", "shuffled"):
        for mode in ("correct", "z-buffer", "wrong"):
            stage.set_renderer("painter", PainterSettings(path=path, mode=mode))
            stage.renderer.select(frame)
            gpu.ctx.error  # noqa: B018 (reading it clears it)
            stage.renderer.draw(frame)
            assert gpu.ctx.error == "GL_NO_ERROR"


def test_the_wrong_mode_is_wrong(stage_of):
    """The check of the pictures can fail: a fixed order shows hidden ground where the eye is not in its corner."""
    terrain = rough(97, 97)
    stage = stage_of(terrain)
    camera = Camera((480.0, 140.0, 100.0), 190.0, -10.0, 0.0, 60.0)
    correct, _ = pictures(stage, camera, levels=False)
    stage.set_renderer("painter", PainterSettings(mode="wrong", levels=False))
    assert differing(stage.render(camera, SIZE), correct) > 300


def test_depth_is_that_of_the_depth_buffer_or_is_not_written(stage_of):
    terrain = rough(97, 97)
    stage = stage_of(terrain, levels=False)
    camera = Camera((300.0, 160.0, 800.0), 10.0, -15.0, 0.0, 60.0)
    target, depth = stage.target(SIZE), {}
    for name, mode, writes in (
        ("painted", "correct", True),
        ("tested", "z-buffer", True),
        ("unwritten", "correct", False),
    ):
        stage.set_renderer("painter", PainterSettings(levels=False, mode=mode))
        stage.renderer.writes_depth = writes
        stage.draw_output(stage.frame(camera, SIZE), target)
        depth[name] = target.read_depth().copy()
    # The last bits depend on which corner of a triangle comes first.
    assert np.allclose(depth["painted"], depth["tested"], rtol=1e-4, atol=0.0)
    assert (depth["painted"] > 0).mean() > 0.5
    assert not depth["unwritten"].any()


def test_levels_of_detail_stay_within_the_tolerance_and_leave_no_hole(stage_of, gpu):
    """K |vertical error| n_y / distance <= tolerance at every pixel, against the uniform surface."""
    terrain = rough(129, 129)
    stage = stage_of(terrain)
    seen = 0
    for camera in cameras(terrain, 12, seed=8):
        stage.set_renderer("painter", PainterSettings(levels=False))
        truth = ~np.isnan(stage.positions(camera, SIZE)[..., 0])
        for tolerance in (0.5, 2.0, 6.0):
            stage.set_renderer("painter", PainterSettings(tolerance_px=tolerance, depth=4))
            world = stage.positions(camera, SIZE)
            covered = ~np.isnan(world[..., 0])
            inside = minimum_filter(truth, 2 * int(np.ceil(tolerance)) + 1)  # the horizon may shift by the tolerance
            assert not (inside & ~covered).any()
            x, y, z = world[covered].T
            width, depth = terrain.extent_m
            error_m = np.abs(y - terrain.heights_at(np.clip(x, 0, width), np.clip(z, 0, depth), "uniform"))
            distance_m = np.linalg.norm(world[covered] - camera.eye_m, axis=1)
            assert (camera.pixels_per_radian(SIZE[1]) * error_m / distance_m <= tolerance + 0.02).all()
            seen += int(stage.renderer.stats.extra["stitched tiles"])
    assert seen > 50


def test_the_slider_paints_the_far_triangles_first(stage_of):
    terrain = rough(97, 97)
    stage = stage_of(terrain, levels=False)
    camera = Camera((480.0, 260.0, 900.0), 0.0, -25.0, 0.0, 60.0)
    distance_m, covered = [], []
    for painted in (0.0, 25.0, 50.0, 100.0):
        stage.set_renderer("painter", PainterSettings(levels=False, painted=painted))
        world = stage.positions(camera, SIZE)
        seen = ~np.isnan(world[..., 0])
        covered.append(int(seen.sum()))
        if painted:
            distance_m.append(float(np.linalg.norm(world[seen] - camera.eye_m, axis=1).min()))
    assert covered[0] == 0
    assert covered == sorted(covered)
    assert distance_m == sorted(distance_m, reverse=True)


@pytest.mark.parametrize("path", ["procedural", "cells"])
def test_the_procedural_paths_upload_nothing_when_the_eye_moves(stage_of, path):
    stage = stage_of(rough(97, 97), path=path, levels=False)
    for x in (200.0, 210.0, 500.0):
        stage.render(Camera((x, 200.0, 600.0), 30.0, -20.0), SIZE)
        assert stage.renderer.stats.uploaded_bytes == 0


def test_the_indexed_path_uploads_an_order_once(stage_of):
    stage = stage_of(rough(97, 97), path="indexed", levels=False)
    first, second = Camera((200.0, 200.0, 600.0), 30.0, -20.0), Camera((207.0, 200.0, 603.0), 30.0, -20.0)
    uploaded = []
    for camera in (first, first, second, first):
        stage.render(camera, SIZE)
        uploaded.append(stage.renderer.stats.uploaded_bytes)
    assert uploaded[0] > 0
    assert uploaded[1] == uploaded[3] == 0


def test_shuffled_indices_need_a_depth_buffer_and_then_change_nothing(stage_of):
    stage = stage_of(rough(97, 97), mode="z-buffer", levels=False)
    camera = Camera((300.0, 160.0, 800.0), 10.0, -15.0, 0.0, 60.0)
    expected = stage.render(camera, SIZE)
    stage.set_renderer("painter", PainterSettings(mode="z-buffer", path="shuffled", randomness=100.0, levels=False))
    assert differing(stage.render(camera, SIZE), expected) == 0


def test_a_frozen_order_can_be_watched_from_elsewhere(stage_of):
    """What is drawn was chosen for the frozen eye; from another it is drawn with a depth test, and stays right."""
    terrain = rough(97, 97)
    stage = stage_of(terrain, levels=False, horizon=False)
    inside, above = Camera((480.0, 200.0, 900.0), 0.0, -20.0), Camera((100.0, 700.0, 100.0), 135.0, -50.0)
    stage.freeze(stage.frame(inside, SIZE))
    frozen = stage.render(above, SIZE)
    stage.set_renderer("painter", PainterSettings(mode="z-buffer", levels=False, horizon=False))
    assert differing(frozen, stage.render(above, SIZE)) == 0


@pytest.mark.parametrize("path", ["procedural", "cells", "indexed"])
def test_sector_colours_lie_around_the_eye(stage_of, path):
    """Seen from above, north is up: NE1 east, NE2 and NW north, SW1 west, SW2 and SE south (figure 13)."""
    stage = stage_of(Heightfield(np.zeros((65, 65), np.float32), (1.0, 1.0)), path=path, levels=False, depth=5)
    picture = stage.render(Camera((32.4, 60.0, 32.4), 0.0, -89.99, 0.0, 50.0), (90, 90), "levels").astype(int)
    places = [(28, 80), (10, 62), (10, 28), (62, 10), (80, 28), (62, 80)]  # NE1, NE2, NW, SW1, SW2, SE
    colours = {tuple(picture[p]) for p in places}
    assert len(colours) == 6


def gpu_order(gpu, terrain: Heightfield, foot: Foot, tiles: Tiles, grid: TileGrid, cells_only: bool) -> np.ndarray:
    """Triangles as painter.vert emits them, in order, read back by transform feedback: (n, 3, 2) posts (row, col)."""
    text, _, _ = flatten(SHADERS, "painter.vert", {"OUTPUT_FLAT": 1})
    program = gpu.ctx.program(vertex_shader=text, varyings=["v_ground"])
    program["Frame"].binding = FRAME_BINDING
    program["u_heights"], program["u_extra0"] = UNITS["u_heights"], UNITS["u_extra0"]
    heights = gpu.ctx.texture((terrain.cols, terrain.rows), 1, terrain.heights_m.tobytes(), dtype="f4")
    table = order_blocks()
    orders = gpu.ctx.texture(table.shape[::-1], 1, table.tobytes(), dtype="u4")
    orders.filter = heights.filter = moderngl.NEAREST, moderngl.NEAREST
    heights.use(UNITS["u_heights"])
    orders.use(UNITS["u_extra0"])
    block = FrameBlock(gpu)
    block.write(Frame(Camera((0.0, 10.0, 0.0)), (8, 8)), terrain, Look())
    array = gpu.ctx.vertex_array(program, [])
    target = create_target(gpu, (1, 1))  # nothing is rasterized, but there must be a framebuffer
    target.framebuffer.use()
    program["u_foot"], program["u_tiles"] = tuple(foot), (*grid.shape, grid.tile_level)
    runs = order_runs(foot, tiles, grid, cells_only=cells_only)
    found = []
    for run, vertices in zip(runs.run.tolist(), runs.vertices.tolist(), strict=True):
        program["u_run"] = run
        is_strip = run[2] < CELLS
        count = 3 * (vertices - 2) if is_strip else vertices
        buffer = gpu.ctx.buffer(reserve=8 * count)
        array.transform(buffer, moderngl.TRIANGLE_STRIP if is_strip else moderngl.TRIANGLES, vertices)
        ground = np.frombuffer(buffer.read(), np.float32).reshape(-1, 3, 2) * (terrain.cols, terrain.rows) - 0.5
        found.append(np.round(ground[..., ::-1]).astype(np.int64))
        buffer.release()
    for part in (array, program, heights, orders, block, target):
        part.release()
    triangles = np.concatenate(found)
    return triangles[doubled_area(triangles) != 0]


@pytest.mark.parametrize("cells_only", [False, True])
@pytest.mark.parametrize("shape", [(32, 32), (21, 38)])
def test_the_order_made_on_the_gpu_has_no_violation(gpu, shape, cells_only):
    terrain = Heightfield(np.zeros([n + 1 for n in shape], np.float32), (1.0, 1.0))
    grid = TileGrid(shape, 3)
    row, col = (a.ravel() for a in np.mgrid[: grid.shape[0], : grid.shape[1]])
    tiles = Tiles(row, col, np.zeros_like(row), np.zeros_like(row))
    for eye in eyes_over(32, 28, seed=3):
        triangles = gpu_order(gpu, terrain, foot_at(*eye), tiles, grid, cells_only)
        assert (doubled_area(triangles) == 1).all()  # counter-clockwise: none is culled by mistake
        assert len(triangles) == 2 * shape[0] * shape[1] == grid.triangles(tiles)
        assert violations(triangles, *eye) == 0, eye


@pytest.mark.parametrize("seed", range(3))
def test_levels_and_fans_ordered_on_the_gpu_have_no_violation(gpu, seed):
    terrain, grid = Heightfield(np.zeros((65, 73), np.float32), (1.0, 1.0)), TileGrid((64, 72), 3)
    allowed_m = np.random.default_rng(seed).choice([-1.0, 1.0, 1.0, 1.0, 1.0], grid.shape)
    levels = build_level_errors(terrain.heights_m, 8).select(allowed_m)
    row, col = (a.ravel() for a in np.mgrid[: grid.shape[0], : grid.shape[1]])
    tiles = Tiles(row, col, levels.ravel(), tile_edges(levels).ravel())
    assert len(set(tiles.edges)) > 7
    for eye in eyes_over(32, 14, seed):
        triangles = gpu_order(gpu, terrain, foot_at(*eye), tiles, grid, cells_only=False)
        assert (doubled_area(triangles) > 0).all()
        assert len(triangles) == grid.triangles(tiles)
        assert doubled_area(triangles).sum() == 2 * 64 * 72
        assert violations(triangles, *eye) == 0, eye


def test_the_renderer_promises_the_uniform_surface():
    assert PainterRenderer.diagonal == "uniform"
