"""Legends say what the shaders draw, in colours that everybody tells apart; scale bar and compass are true."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from ui_harness import UiHarness

from app.viewer import overlay
from app.viewer.docking import Rectangle
from app.viewer.legends import COUNTS, HEAT, LEVEL_HUES, error_colour, heat, legend_of, normal_colour
from app.viewer.scale_bar import ground_depth_m, heading_text, length_text, round_length_m
from terrain.camera import Camera
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import create_target
from terrain.heightfield import Heightfield
from terrain.views import VIEWS

# Colours as people see them who lack one kind of cone (Machado, Oliveira and Fernandes, 2009), on linear RGB.
CONES = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
JUST_NOTICEABLE = 2.3  # CIE76 colour difference


def lab(colour):
    """CIE L*a*b* of a linear RGB colour."""
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ colour
    f = np.cbrt(np.clip(xyz / [0.9505, 1.0, 1.089], 1e-6, None))
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def difference(one, other, cones):
    """How different two sRGB colours look."""
    linear = [np.array(colour) ** 2.2 for colour in (one, other)]
    seen = [np.clip(np.array(CONES[cones]) @ c, 0.0, 1.0) if cones else c for c in linear]
    return float(np.linalg.norm(lab(seen[0]) - lab(seen[1])))


@pytest.mark.parametrize("cones", [None, *CONES])
def test_neighbouring_colours_of_every_debug_view_differ_for_every_eye(cones):
    signs = [error_colour(share) for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    for scale in (LEVEL_HUES, [heat(count) for count in COUNTS], signs):
        for one, other in pairwise(scale):
            assert difference(one, other, cones) > 3 * JUST_NOTICEABLE
    assert difference(signs[0], signs[-1], cones) > 10 * JUST_NOTICEABLE  # above and below


def test_overdraw_grows_lighter_all_the_way():
    light = [lab(np.array(heat(count)) ** 2.2)[0] for count in COUNTS]
    assert (np.diff(light) > 0.0).all()
    assert heat(1) == HEAT[0]
    assert heat(100) == HEAT[-1]


@pytest.fixture
def drawn(gpu):
    """Draws one fragment shader over values of a small texture; gives the colours, 0 to 1."""

    def draw(fragment, sampler, values, **uniforms):
        values = np.asarray(values, np.float32)
        size = len(values), 1
        source, target = gpu.ctx.texture(size, values.shape[1], values.tobytes(), dtype="f4"), create_target(gpu, size)
        geometry = Geometry(gpu, "fullscreen", fragment)
        program = geometry.program("flat")
        for name, value in uniforms.items():
            program[name] = value
        target.framebuffer.use()
        source.use(UNITS[sampler])
        gpu.ctx.disable(gpu.ctx.DEPTH_TEST)
        geometry.render("flat", vertices=3)
        colours = target.read()[0, :, :3] / 255.0
        for part in (geometry, target, source):
            part.release()
        return colours

    return draw


def test_the_error_legend_has_the_colours_of_the_shader(drawn):
    shares = [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]
    values = [[1.5 * share, 0.0, 0.0, 1.0] for share in shares]
    colours = drawn("view_error", "u_extra1", values, u_tolerance_px=1.5)
    assert colours == pytest.approx(np.array([error_colour(share) for share in shares]), abs=0.01)


def test_the_overdraw_legend_has_the_colours_of_the_shader(drawn):
    colours = drawn("view_overdraw", "u_source", [[float(count)] for count in COUNTS] * 40, u_legend=False)
    assert colours[:8] == pytest.approx(np.array([heat(count) for count in COUNTS]), abs=0.01)


def test_the_level_legend_has_the_colours_of_the_shader(session):
    """Light and shade change the brightness of a level's colour, not its hue: the ratios of its channels."""
    session.choose_view("levels")
    session.draw((64, 36))
    drawn_colours = session.picture.read()[..., :3].reshape(-1, 3) / 255.0
    drawn_colours = drawn_colours[drawn_colours.max(axis=1) > 0.2]
    hue = drawn_colours / drawn_colours.sum(axis=1, keepdims=True)
    known = np.array(LEVEL_HUES) / np.array(LEVEL_HUES).sum(axis=1, keepdims=True)
    nearest = np.abs(hue[:, None] - known).max(axis=-1).min(axis=1)
    assert np.median(nearest) < 0.02


def test_normals_of_level_ground_and_of_slopes():
    assert normal_colour((0.0, 1.0, 0.0)) == (0.5, 0.5, 1.0)
    assert normal_colour((1.0, 0.0, 0.0)) == (1.0, 0.5, 0.5)
    assert normal_colour((0.0, 0.0, -1.0)) == (0.5, 1.0, 0.5)


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_has_a_legend_with_a_word_for_every_colour(session, view):
    session.choose_view(view)
    legend = legend_of(session)
    assert len(legend.colours) == len(legend.labels) >= 5
    assert all(0.0 <= channel <= 1.0 for colour in legend.colours for channel in colour)


def test_the_height_legend_spans_the_true_heights(session):
    assert legend_of(session).labels == ("0", "10", "20", "30", "40")
    session.exaggerate(3.0)
    assert legend_of(session).labels == ("0", "10", "20", "30", "40")


def test_depth_of_the_ground_below_a_pixel():
    plain = Heightfield(np.zeros((65, 65), np.float32), (100.0, 100.0))
    camera = Camera((3200.0, 500.0, 3200.0), yaw_deg=30.0, pitch_deg=-30.0)
    # 500 m above a plain, the sight line meets it after 500 / sin 30 degrees
    assert ground_depth_m(plain, camera, (1280, 720), (640, 360)) == pytest.approx(1000.0, rel=0.03)
    assert ground_depth_m(plain, camera, (1280, 720), (640, -2000)) is None
    below = math.radians(30.0) + math.atan(math.tan(math.radians(30.0)))
    depth_m = 500.0 / math.sin(below) * math.cos(math.radians(30.0))
    assert ground_depth_m(plain, camera, (1280, 720), (640, 720)) == pytest.approx(depth_m, rel=0.03)
    sky = Camera((3200.0, 500.0, 3200.0), pitch_deg=10.0)
    assert ground_depth_m(plain, sky, (1280, 720), (640, 360)) is None


@pytest.mark.parametrize(
    ("longest", "expected"), [(1.0, 1.0), (1.9, 1.0), (2.0, 2.0), (7.0, 5.0), (9999.0, 5000.0), (0.3, 0.2)]
)
def test_lengths_of_scale_bars_are_round(longest, expected):
    assert round_length_m(longest) == pytest.approx(expected)


def test_lengths_and_headings_in_words():
    texts = [length_text(length) for length in (0.05, 0.5, 5.0, 500.0, 2000.0, 3200.0, 50_000.0, 2e6)]
    assert texts == ["5 cm", "50 cm", "5 m", "500 m", "2 km", "3.2 km", "50 km", "2,000 km"]
    assert [heading_text(yaw) for yaw in (0.0, 46.0, 90.0, 359.8, 337.0, 202.0)] == [
        "0° N", "46° NE", "90° E", "0° N", "337° NW", "202° S",
    ]  # fmt: skip


def test_cards_stay_in_the_free_part_and_apart(session, monkeypatch):
    cards = []
    monkeypatch.setattr(overlay, "_draw_card", cards.append)
    with UiHarness(session) as ui:
        for scale, lab in ((1.0, False), (1.0, True), (1.5, False)):
            session.preferences.change(ui_scale=scale)
            session.layout.show("laboratory", lab)
            for _ in range(4):
                ui.frame()
            free = overlay.free_rectangle(session)
            cards.clear()
            ui.frame()
            assert len(cards) == 2
            one, other = cards
            for card in cards:
                assert free.left <= card.left < card.right <= free.right
                assert free.top <= card.top < card.bottom <= free.bottom
            assert one.right < other.left or one.bottom < other.top
        session.preferences.change(shows_scale_bar=False, shows_legend=False)
        cards.clear()
        ui.frame()
        assert cards == []


def test_a_rectangle_knows_its_sides():
    assert (Rectangle(1.0, 2.0, 3.0, 4.0).right, Rectangle(1.0, 2.0, 3.0, 4.0).bottom) == (4.0, 6.0)
