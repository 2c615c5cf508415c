"""The stability strip marks what is wrong, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.strip import StripFrame, find_marks, measure_strip
from terrain.renderers.geomorph import GeomorphRenderer
from terrain.scene import open_scene
from terrain.stage import Stage

QUIET = [StripFrame(i / 30, 0, 0.1, 10.0) for i in range(20)]


def test_a_quiet_flight_has_no_mark():
    marks = find_marks(QUIET, 1.0)
    assert (marks.holes, marks.pops, marks.slow) == ((), (), ())
    assert find_marks([], 1.0) == marks


def test_each_kind_of_trouble_is_marked_where_it_happens():
    frames = list(QUIET)
    frames[3] = replace(frames[3], holes_px=1)
    frames[5] = replace(frames[5], popping_px=2.6)
    frames[7] = replace(frames[7], frame_ms=31.0)
    frames[0] = replace(frames[0], frame_ms=900.0)  # compiles programs
    marks = find_marks(frames, 1.0)
    assert (marks.holes, marks.pops, marks.slow) == ((3,), (5,), (7,))
    assert find_marks(frames, 2.0).pops == ()


def test_what_nobody_sees_is_not_slow():
    frames = [replace(frame, frame_ms=1.0 + 9.0 * (i == 4)) for i, frame in enumerate(QUIET)]
    assert find_marks(frames, 1.0).slow == ()


class GappyRenderer(GeomorphRenderer):
    """Draws nothing in the middle of the flight."""

    def draw(self, frame):
        if frame.time_s != 0.2:
            super().draw(frame)


def test_holes_of_a_renderer_that_skips_a_frame_are_found(gpu):
    z, x = np.mgrid[:65, :65] * 0.2
    scene = open_scene(Heightfield((30 * np.sin(x) * np.cos(z)).astype(np.float32), (20.0, 20.0)))
    stage = Stage(gpu, scene, "reference")
    renderer = GappyRenderer(gpu, scene, GeomorphRenderer.Settings())
    views = [(0.1 * i, Camera((640.0, 200.0, 1250.0 - 5.0 * i), 0.0, -25.0)) for i in range(4)]
    frames = list(measure_strip(stage, renderer, views))
    assert [frame.time_s for frame in frames] == [time_s for time_s, _ in views]
    assert find_marks(frames, 1.0).holes == (2,)
    assert all(frame.frame_ms > 0.0 for frame in frames)
    assert 0.0 < frames[1].popping_px < 2.5
    renderer.release()
    stage.release()
