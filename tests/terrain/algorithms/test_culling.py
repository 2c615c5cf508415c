"""Culling judged by what is really seen: nodes of visible points are never dropped, hidden ones mostly are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms import culling
from terrain.algorithms.culling import Culler
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.pyramid import build_pyramid
from terrain.scene import Scene
from terrain.stage import Stage

SIZE = (96, 64)


def ridges(holes: bool = False) -> Scene:
    """Parallel ridges and noise: much is hidden at eye level."""
    z, x = np.mgrid[:201, :233]
    noise = np.random.default_rng(4).normal(size=z.shape)
    heights = 150 * np.abs(np.sin(x / 17 + 0.4 * np.sin(z / 30))) + 4 * noise + 0.3 * z
    mask = None
    if holes:
        mask = (x // 20 + z // 25) % 3 == 0
    field = Heightfield(heights.astype(np.float32), (20.0, 15.0), mask)
    return Scene(field, build_pyramid(field.heights_m))


@pytest.fixture(params=[False, True], ids=["whole", "holes"])
def stage(gpu, request):
    stage = Stage(gpu, ridges(request.param), "reference")
    yield stage
    stage.release()


def cameras(scene: Scene, count: int) -> list[Camera]:
    rng = np.random.default_rng(11)
    width, depth = scene.heightfield.extent_m
    result = []
    for i in range(count):
        x, z = rng.uniform(-0.1, 1.1) * width, rng.uniform(-0.1, 1.1) * depth
        ground = float(np.nan_to_num(scene.heightfield.heights_at(x, z), nan=100.0))
        y = ground + (0.5 if i % 4 == 0 else float(rng.exponential(60.0)) + 0.1)
        pitch = -90.0 if i % 9 == 0 else float(rng.normal(-5, 15))
        camera = Camera(
            (x, y, z), float(rng.uniform(0, 360)), pitch, float(rng.normal(0, 20)), float(rng.uniform(20, 110))
        )
        result.append(camera)
    return result


def covered_cells(culler: Culler, nodes, shape: tuple[int, int]) -> np.ndarray:
    covered = np.zeros(shape, bool)
    for level, row, col in zip(nodes.level, nodes.row, nodes.col, strict=True):
        size = 1 << level
        covered[row * size : (row + 1) * size, col * size : (col + 1) * size] = True
    return covered


@pytest.mark.parametrize("split_ratio", [None, 16.0, 2.0])
def test_no_visible_point_is_culled(stage, split_ratio) -> None:
    scene = stage.scene
    culler = Culler(scene, 3)
    dx, dz = scene.heightfield.spacing_m
    hidden = total = 0
    for camera in cameras(scene, 40):
        world = stage.positions(camera, SIZE)
        seen = world[np.isfinite(world[..., 0])]
        frame = Frame(camera, SIZE)
        in_frustum = culler.select(frame, horizon=False, split_ratio=split_ratio)
        nodes = culler.select(frame, horizon=True, split_ratio=split_ratio)
        hidden += len(in_frustum.level) - len(nodes.level)
        total += len(in_frustum.level)
        covered = covered_cells(culler, nodes, scene.pyramid.cells)
        # Points on a line between cells belong to either; look a little to both sides.
        either = np.zeros(len(seen), bool)
        for shift in (-1e-3, 1e-3):
            row = np.clip(seen[:, 2] / dz + shift, 0, scene.pyramid.cells[0] - 1).astype(int)
            col = np.clip(seen[:, 0] / dx + shift, 0, scene.pyramid.cells[1] - 1).astype(int)
            either |= covered[row, col]
        assert either.all()
    assert total > 0
    if scene.heightfield.holes is None and split_ratio != 2.0:  # so large nodes hide little
        assert hidden > 0.15 * total  # or horizon culling does nothing


@settings(max_examples=60)
@given(
    st.floats(-500, 6000), st.floats(-50, 2000), st.floats(-500, 4000), st.floats(0, 360), st.floats(-90, 90),
    st.floats(-180, 180), st.floats(3, 150),
)  # fmt: skip
def test_selected_nodes_are_disjoint_and_sorted_by_distance(x, y, z, yaw, pitch, roll, fov) -> None:
    scene = SCENE
    culler = Culler(scene, 3)
    nodes = culler.select(Frame(Camera((x, y, z), yaw, pitch, roll, fov), SIZE), split_ratio=4.0)
    assert (np.diff(nodes.distance_m) >= 0).all()
    count = np.zeros(scene.pyramid.cells, int)
    for level, row, col in zip(nodes.level, nodes.row, nodes.col, strict=True):
        size = 1 << level
        count[row * size : (row + 1) * size, col * size : (col + 1) * size] += 1
    assert count.max(initial=0) <= 1


SCENE = ridges()


@pytest.mark.parametrize("split_ratio", [None, 8.0, 0.5, 0.0])
def test_entering_the_hierarchy_below_its_root_changes_nothing(monkeypatch, split_ratio) -> None:
    culler = Culler(SCENE, 3)
    for camera in (*cameras(SCENE, 20), Camera((3000.0, 90_000.0, 1500.0), 0.0, -90.0)):
        frame = Frame(camera, SIZE)
        monkeypatch.setattr(culling, "FIRST_NODES", 256)
        entered = culler.select(frame, horizon=False, split_ratio=split_ratio)
        monkeypatch.setattr(culling, "FIRST_NODES", 1)
        from_root = culler.select(frame, horizon=False, split_ratio=split_ratio)
        assert set(zip(*entered[:3], strict=True)) == set(zip(*from_root[:3], strict=True))


def test_boxes_hold_their_posts() -> None:
    culler = Culler(SCENE, 3)
    nodes = culler.select(Frame(Camera((2000.0, 3000.0, 1500.0), 0.0, -90.0), SIZE), split_ratio=2.0)
    lower, upper = culler.boxes(nodes)
    heights = SCENE.heightfield.heights_m
    for level, row, col, low, high in zip(nodes.level, nodes.row, nodes.col, lower, upper, strict=True):
        size = 1 << level
        posts = heights[row * size : (row + 1) * size + 1, col * size : (col + 1) * size + 1]
        assert low[1] == posts.min()
        assert high[1] == posts.max()
        assert high[0] == (min((col + 1) * size, SCENE.pyramid.cells[1])) * SCENE.heightfield.spacing_m[0]


@pytest.mark.parametrize("eye", [(2000.0, -500.0, 1500.0), (2000.0, 60.0, -100.0)], ids=["below", "outside"])
def test_nothing_is_hidden_where_rays_may_start_under_the_ground(eye) -> None:
    culler = Culler(SCENE, 3)
    frame = Frame(Camera(eye, 180.0, 10.0), SIZE)
    with_horizon, without = culler.select(frame), culler.select(frame, horizon=False)
    assert len(with_horizon.level) == len(without.level)


def test_looking_away_from_the_terrain_selects_nothing() -> None:
    frame = Frame(Camera((2000.0, 500.0, -3000.0), 0.0, 0.0), SIZE)
    assert len(Culler(SCENE, 3).select(frame).level) == 0
