"""Shader maths against its twins on the CPU: surface, depth, positions, sight rays."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.programs import SHADERS, flatten
from terrain.gpu.targets import create_target
from terrain.heightfield import Heightfield, surface_heights

HEADER = '#version 330 core\n#include "lib/frame.glsl"\n#include "lib/surface.glsl"\n#include "lib/depth.glsl"\n'


@pytest.fixture
def evaluate(gpu, tmp_path):
    """``evaluate(body, points, terrain, frame)``: what GLSL writes to ``result`` for each ``point`` (n, 4)."""
    root = tmp_path / "shaders"
    root.mkdir()
    (root / "lib").symlink_to(SHADERS / "lib")
    made = []
    bound = create_target(gpu, (1, 1))  # GL draws nothing, not even into buffers, without a framebuffer
    bound.framebuffer.use()

    def run(body, points, terrain, frame, **defines):
        text = f"{HEADER}in vec4 in_point;\nout vec4 result;\nvoid main() {{ vec4 point = in_point; {body} }}\n"
        (root / "twin.vert").write_text(text)
        switches = {**gpu.programs.defines, **defines}
        program = gpu.ctx.program(vertex_shader=flatten(root, "twin.vert", switches)[0], varyings=["result"])
        block = FrameBlock(gpu)
        block.write(frame, terrain, Look())
        program["Frame"].binding = 0
        heights = gpu.ctx.texture((terrain.cols, terrain.rows), 1, terrain.heights_m.data, dtype="f4")
        heights.use(0)
        if "u_heights" in program:
            program["u_heights"] = 0
        source = gpu.ctx.buffer(np.ascontiguousarray(points, np.float32))
        target = gpu.ctx.buffer(reserve=16 * len(points))
        array = gpu.ctx.vertex_array(program, [(source, "4f", "in_point")])
        array.transform(target, moderngl.POINTS, len(points))
        made.extend([program, block, heights, source, target, array])
        return np.frombuffer(target.read(), np.float32).reshape(-1, 4)

    yield run
    for part in reversed(made):
        part.release()
    bound.release()


def terrain(seed=0, offset_m=0.0):
    heights = np.random.default_rng(seed).uniform(-50, 50, (19, 23)) + offset_m
    return Heightfield(heights.astype(np.float32), (8.0, 16.0))


FRAME = Frame(Camera((70.3, 120.7, 133.1), 33.0, -21.0, 8.0, 50.0), (320, 200), 0.05)


@pytest.mark.parametrize("diagonal", ["alternating", "uniform"])
def test_surface_height_is_the_same_in_both_worlds(evaluate, diagonal):
    field = terrain()
    points = np.zeros((500, 4), np.float32)
    points[:, :2] = np.random.default_rng(1).uniform(0, 1, (500, 2)) * [field.cols - 1, field.rows - 1]
    points[:9, :2] = [(0, 0), (22, 18), (22, 0), (0, 18), (3, 4), (3.5, 4.5), (4.5, 4.5), (3.5, 18), (22, 4.25)]
    defines = {"UNIFORM_DIAGONALS": 1} if diagonal == "uniform" else {}
    result = evaluate("result = vec4(surface_height(point.xy));", points, field, FRAME, **defines)
    col, row = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    assert np.abs(result[:, 0] - surface_heights(field.heights_m, col, row, diagonal)).max() < 1e-3
    other = surface_heights(field.heights_m, col, row, "uniform" if diagonal == "alternating" else "alternating")
    assert np.abs(result[:, 0] - other).max() > 1.0  # the test can tell the rules apart


def test_position_of_a_post_is_exact_a_million_metres_up_and_away(evaluate):
    field = terrain(offset_m=1e6)
    frame = Frame(Camera((70.3, 1e6 + 60.7, 133.1)), (320, 200), 0.05)
    row, col = np.mgrid[:19, :23].reshape(2, -1)
    points = np.stack([col, row, field.heights_m[row, col], 0 * row], axis=1)
    result = evaluate("result = vec4(position_of(point.xy, point.z), 1.0);", points, field, frame)
    true_heights = field.heights_m[row, col].astype(np.float64)
    exact = np.stack([col * 8.0, true_heights, row * 16.0], axis=1) - frame.eye_m
    assert np.abs(result[:, :3] - exact).max() < 1e-4


def test_post_of_is_the_inverse_of_position_of(evaluate):
    points = np.random.default_rng(2).uniform(0, 18, (100, 4)).astype(np.float32)
    result = evaluate("result = vec4(post_of(position_of(point.xy, 5.0)), 0.0, 0.0);", points, terrain(), FRAME)
    assert np.abs(result[:, :2] - points[:, :2]).max() < 1e-4


def test_depth_of_is_that_of_the_cameras_matrix(evaluate):
    rng = np.random.default_rng(3)
    ahead = FRAME.camera.ray_directions(320, 200)[rng.integers(0, 200, 300), rng.integers(0, 320, 300)]
    points = np.ones((300, 4))
    points[:, :3] = ahead * 10.0 ** rng.uniform(-1, 5.3, (300, 1))
    result = evaluate("result = vec4(depth_of(point.xyz));", points, terrain(), FRAME)
    clip = points @ FRAME.camera.clip_from_eye(FRAME.aspect, FRAME.near_m, True).T
    assert np.allclose(result[:, 0], clip[:, 2] / clip[:, 3], rtol=1e-5)


def test_logarithmic_depth_falls_with_distance_and_resolves_it(evaluate):
    distance = np.array([0.05, 1.0, 1.0001, 1e3, 1e3 * 1.0001, 2e5, 2e5 * 1.0001])
    points = np.repeat(distance[:, None], 4, axis=1)
    depth = evaluate("result = vec4(depth_at(point.x));", points, terrain(), FRAME, LOG_DEPTH=1)[:, 0]
    assert depth[0] == 1.0
    assert (np.diff(depth) < 0).all()
    assert depth[-1] > 0


def test_sight_rays_are_those_of_the_camera(evaluate):
    width, height = FRAME.viewport_px
    col, row = np.meshgrid(np.arange(0, width, 13), np.arange(0, height, 11))
    points = np.zeros((col.size, 4))
    points[:, 0], points[:, 1] = (col.ravel() + 0.5) / width, 1 - (row.ravel() + 0.5) / height
    result = evaluate("result = vec4(sight_ray(point.xy), 0.0);", points, terrain(), FRAME)
    exact = FRAME.camera.ray_directions(width, height)[row.ravel(), col.ravel()]
    assert np.abs(result[:, :3] - exact).max() < 1e-6
