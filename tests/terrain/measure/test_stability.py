"""The check judged: sound renderers pass, broken ones are caught, each by what is wrong with it."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from terrain.camera import Camera
from terrain.flight import read_flight
from terrain.heightfield import Heightfield
from terrain.measure import stability
from terrain.measure.cards import replay_command, write_card, write_verdicts
from terrain.measure.hidden import count_misplaced, passes_below
from terrain.measure.hostile import FRAME_S, HOSTILE_SCENES, hostile_paths, hostile_scene
from terrain.measure.stability import Checker
from terrain.pyramid import build_pyramid
from terrain.renderers import RENDERERS
from terrain.renderers.geomorph import GeomorphRenderer
from terrain.renderers.reference import ReferenceRenderer
from terrain.scene import Scene


def scene_of(name: str) -> Scene:
    field = hostile_scene(name)
    return Scene(field, build_pyramid(field.heights_m))


@pytest.fixture
def checker(gpu, request, monkeypatch):
    """``checker(kind, scene)``: a checker of a renderer class under a name of its own."""
    made = []

    def make(kind: type, scene: str = "129x129") -> Checker:
        monkeypatch.setitem(RENDERERS, "tested", kind)
        made.append(Checker(gpu, scene_of(scene), "tested"))
        return made[-1]

    yield make
    for each in made:
        each.release()


def judge(checker: Checker, case: str):
    return checker.check(case, hostile_paths(checker.stage.scene.heightfield)[case])


def test_every_scene_is_as_hostile_as_its_name_says() -> None:
    scenes = {name: hostile_scene(name) for name in HOSTILE_SCENES}
    assert scenes["2x5000"].heights_m.shape == (2, 5000)
    assert scenes["million-high"].height_range_m == (-1e6, 1e6)
    assert scenes["offset-1e7"].heights_m.min() >= 9.9e6
    assert scenes["ring"].holes.mean() > 0.6
    assert scenes["1mm"].spacing_m == (0.001, 0.001)
    assert np.ptp(scenes["cliffs"].heights_m) > 500
    for name, scene in scenes.items():
        assert scene.name == name
        assert hostile_paths(scene).keys() == hostile_paths(scenes["flat"]).keys()


@pytest.mark.parametrize("name", ["needles", "2x2", "million-high", "ring"])
def test_most_cameras_see_the_scene(gpu, name) -> None:
    checker = Checker(gpu, scene_of(name), "reference")
    paths = hostile_paths(checker.stage.scene.heightfield)
    seen = [np.isfinite(checker.stage.positions(path[-1], (64, 48))[..., 0]).any() for path in paths.values()]
    checker.release()
    assert np.mean(seen) > 0.7


@pytest.mark.parametrize("case", ["exactly 45 degrees", "along east", "to and fro", "standing still"])
@pytest.mark.parametrize("name", ["reference", "geomorph"])
@pytest.mark.parametrize("scene", ["cliffs", "2x5000", "10km"])
def test_sound_renderers_pass(gpu, name, scene, case) -> None:
    checker = Checker(gpu, scene_of(scene), name)
    verdict = judge(checker, case)
    checker.release()
    assert verdict.outcome == "ok", verdict.line


class Torn(GeomorphRenderer):
    def select(self, frame) -> None:
        super().select(frame)
        self._counts = np.maximum(self._counts - 1, 0)


class Loose(GeomorphRenderer):
    def _steered_tolerance(self) -> float:
        return 6.0


class Unordered(ReferenceRenderer):
    """What is farther wins."""

    def draw(self, frame) -> None:
        ctx = self._gpu.ctx
        ctx.depth_func = "1"
        super().draw(frame)
        ctx.depth_func = ">"

    def __init__(self, gpu, scene, settings) -> None:
        super().__init__(gpu, scene, settings)
        self._gpu = gpu


class Restless(GeomorphRenderer):
    """Draws coarser with every frame, however long the eye rests."""

    draws = 0

    def _steered_tolerance(self) -> float:
        Restless.draws += 1
        return 0.25 + 0.1 * (Restless.draws % 9)


class Crashing(ReferenceRenderer):
    def select(self, frame) -> None:
        super().select(frame)
        np.zeros(0).max()


class Wrong(ReferenceRenderer):
    """Makes a GL error."""

    def __init__(self, gpu, scene, settings) -> None:
        super().__init__(gpu, scene, settings)
        self._gpu = gpu

    def draw(self, frame) -> None:
        super().draw(frame)
        self._gpu.ctx.enable_direct(0x7FFFFFFF)


@pytest.mark.parametrize(
    ("kind", "case", "complaint"),
    [
        (Torn, "straight down", "holes"),
        (Loose, "exactly 45 degrees", "exceeds 1.25 px"),
        (Unordered, "along north", "the reference hides"),
        (Restless, "standing still", "popping"),
        (Restless, "exactly 45 degrees", "drawn twice"),
        (Crashing, "rolled", "raised ValueError"),
        (Wrong, "rolled", "GL_"),
    ],
)
def test_a_broken_renderer_is_caught(checker, kind, case, complaint) -> None:
    verdict = judge(checker(kind), case)
    assert verdict.outcome == "FAIL"
    assert any(complaint in text for text in verdict.complaints), verdict.line
    assert complaint in verdict.line


def test_a_documented_limit_is_told_and_does_not_fail(checker) -> None:
    class Honest(Loose):
        limits = {"129x129/exactly *": "loose by design"}  # noqa: RUF012

    made = checker(Honest)
    verdict = judge(made, "exactly 45 degrees")
    assert verdict.outcome == "limit"
    assert "loose by design" in verdict.line
    assert "exceeds" in verdict.line
    assert judge(made, "straight down").outcome == "FAIL"  # not covered by the limit


def test_the_search_climbs(gpu, monkeypatch) -> None:
    checker = Checker(gpu, scene_of("129x129"), "geomorph")
    scores = []
    score = checker._score
    monkeypatch.setattr(checker, "_score", lambda *a: scores.append(score(*a)) or scores[-1])
    monkeypatch.setattr(stability, "SEARCH_RANDOM", 8)
    monkeypatch.setattr(stability, "SEARCH_STEPS", 12)
    worst = checker.find_worst(seed=3)
    begin = stability.SEARCH_RANDOM
    assert max(scores[begin:]) > max(scores[:begin])
    assert worst == checker.find_worst(seed=3)
    checker.release()


def test_a_card_flies_again(checker, tmp_path) -> None:
    made = checker(Loose)
    verdict = judge(made, "fast flight")
    flight_path, scene_path, picture = write_card(tmp_path, verdict, made)
    flight = read_flight(flight_path)
    for i, camera in enumerate(verdict.path):
        again = flight.camera_at(i * FRAME_S)
        np.testing.assert_allclose(again.position_m, camera.position_m, rtol=1e-9)
        np.testing.assert_allclose(again.clip_from_eye(1.0, 1.0), camera.clip_from_eye(1.0, 1.0), atol=1e-9)
    assert scene_path.exists()
    with Image.open(picture) as image:
        assert image.size == (3 * stability.SIZE_PX[0], stability.SIZE_PX[1])
    assert str(flight_path) in replay_command(tmp_path, verdict)
    assert '"outcome": "FAIL"' in write_verdicts(tmp_path, {}, [verdict]).read_text()


def test_frames_are_slow_only_by_comparison_and_where_one_can_see_it() -> None:
    assert stability._slow_frames([900.0, 5.0, 5.0, 70.0]) == [3]  # the first makes what the others use
    assert stability._slow_frames([1.0, 0.5, 0.5, 12.0]) == []
    assert stability._slow_frames([300.0, 200.0, 300.0, 1900.0]) == []
    assert stability._slow_frames([5.0, 900.0]) == []  # two frames have no usual time


def test_what_the_truth_hides_is_told_from_what_is_shifted() -> None:
    truth = np.full((40, 40), np.inf)
    truth[10:25] = 900.0  # a hill behind
    truth[25:] = 100.0  # a hill in front
    assert count_misplaced(truth, truth, 3, 0.01) == 0
    assert count_misplaced(np.roll(truth, 2, axis=0), truth, 3, 0.01) == 0
    seen_through = truth.copy()
    seen_through[32, 20] = 900.0
    assert count_misplaced(seen_through, truth, 3, 0.01) == 1
    in_the_sky = truth.copy()
    in_the_sky[4:8, 10:14] = 500.0
    assert count_misplaced(in_the_sky, truth, 2, 0.01) > 0
    for rows, expected in ((slice(17, 19), 0), (slice(15, 20), 3 * 32)):  # a crest lifted into sight; a hill in front
        in_front = truth.copy()
        in_front[rows, 3:37] = 400.0
        assert count_misplaced(in_front, truth, 2, 0.01) == expected


def test_rays_below_the_ground_are_known() -> None:
    field = Heightfield(np.full((11, 11), 50.0, np.float32), (10.0, 10.0))
    size = (16, 12)
    assert not passes_below(Camera((50.0, 60.0, 50.0), 0.0, -20.0), size, field, "alternating").any()
    assert passes_below(Camera((50.0, 40.0, 50.0), 0.0, -20.0), size, field, "alternating").all()
    beside = passes_below(Camera((50.0, 50.0, 200.0), 0.0, 0.0, 0.0, 40.0), size, field, "alternating")
    assert not beside[:6].any()  # enters the area above the ground
    assert beside[7:, 6:10].all()  # enters it through its side
    assert not passes_below(Camera((50.0, 0.0, 200.0), 180.0), size, field, "alternating").any()  # looks away
    axis = passes_below(Camera((50.0, 40.0, 200.0), 0.0, 0.0, 0.0, 1.0), (3, 3), field, "uniform")
    assert axis[1, 1]  # parallel to two sides
