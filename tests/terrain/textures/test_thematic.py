"""Thematic layers made from the terrain: what their colours and their legends say."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.textures.thematic import THEMES, make_theme

ALL = pytest.mark.parametrize("name", THEMES)

# Viénot, Brettel and Mollon (1999): linear RGB as who lacks one kind of cone sees it.
DICHROMATS = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def field(heights, spacing_m=(10.0, 10.0), **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), spacing_m, **others)


def ramp(rise, posts=17):
    return field(np.tile(np.arange(posts) * 10.0 * rise, (posts, 1)))


def mountains(posts=65):
    z, x = np.mgrid[:posts, :posts] * 0.2
    return field(900.0 * (1.2 + np.sin(x) * np.cos(z)) + 40.0 * np.sin(3.1 * x + z), (60.0, 60.0))


def lab(colours, seen_by=None):
    """CIE L*a*b* (n, 3) of sRGB colours (n, 3), 0..255."""
    display = np.asarray(colours, float) / 255.0
    linear = np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)
    if seen_by is not None:
        linear = np.clip(linear @ np.array(DICHROMATS[seen_by]).T, 0.0, 1.0)
    xyz = linear @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    f = xyz / [0.9505, 1.0, 1.089]
    f = np.where(f > 0.008856, np.cbrt(f), 7.787 * f + 16 / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


@ALL
@pytest.mark.parametrize("shape", [(2, 2), (3, 40), (97, 33)])
def test_every_theme_is_made_of_any_size(name, shape):
    terrain = field(np.random.default_rng(2).normal(300, 60, shape))
    theme = make_theme(name, terrain)
    assert theme.pixels.shape == (*shape, 4)
    assert theme.pixels.dtype == np.uint8
    assert THEMES[name].help.endswith(".")


@ALL
def test_ground_without_data_is_transparent_and_all_else_has_colour(name):
    holes = np.zeros((40, 40), bool)
    holes[10:20, 12:30] = True
    pixels = make_theme(name, field(mountains(40).heights_m, holes=holes)).pixels
    assert (pixels[holes] == 0).all()
    if name != "drainage":
        assert (pixels[~holes][:, 3] == 255).all()


@ALL
def test_all_ground_without_data_is_no_trouble(name):
    theme = make_theme(name, field(np.zeros((9, 9)), holes=np.ones((9, 9), bool)))
    assert (theme.pixels == 0).all()


@ALL
def test_a_level_plain_is_no_trouble(name):
    assert make_theme(name, field(np.full((30, 30), 7.0))).legend.swatches


@ALL
def test_exaggeration_changes_no_theme(name):
    terrain = mountains(33)
    once, more = (make_theme(name, t).pixels.astype(int) for t in (terrain, terrain.exaggerated(3.0)))
    assert (np.abs(once - more).max(axis=-1) > 3).mean() < 0.02  # rounding may tip single posts


@ALL
def test_legends_hold_the_colours_of_the_picture(name):
    theme = make_theme(name, mountains())
    swatches = np.array([swatch.colour for swatch in theme.legend.swatches])
    assert any(swatch.label for swatch in theme.legend.swatches)
    found = np.unique(theme.pixels[theme.pixels[..., 3] > 0][:, :3], axis=0)
    if not theme.legend.is_ramp:
        assert all((swatches == colour).all(axis=1).any() for colour in found)
        return
    ends = np.stack([swatches[:-1], swatches[1:]], axis=1)[:, None]
    share = np.linspace(0, 1, 200)[None, :, None]
    bar = (ends[:, :, 0] * (1 - share) + ends[:, :, 1] * share).reshape(-1, 3)
    assert max(np.abs(bar - colour).max(axis=1).min() for colour in found) <= 26  # stops between labels bend the bar


@ALL
@pytest.mark.parametrize("seen_by", [None, "protan", "deutan"])
def test_colour_blind_eyes_tell_the_colours_apart(name, seen_by):
    legend = make_theme(name, mountains()).legend
    colours = lab([swatch.colour for swatch in legend.swatches], seen_by)
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=-1)
    assert apart[~np.eye(len(apart), dtype=bool)].min() > 12.0


@pytest.mark.parametrize(("name", "rises"), [("slope", False), ("drainage", False)])
def test_ramps_of_one_quantity_change_steadily_in_lightness(name, rises):
    legend = make_theme(name, mountains()).legend
    lightness = lab([swatch.colour for swatch in legend.swatches])[:, 0]
    assert (np.diff(lightness) > 2.0).all() if rises else (np.diff(lightness) < -2.0).all()


def test_slope_colours_say_how_steep_it_is():
    colours = [make_theme("slope", ramp(rise)).pixels[8, 8, :3] for rise in np.tan(np.radians([0.0, 30.0, 59.9]))]
    swatches = np.array([swatch.colour for swatch in make_theme("slope", ramp(1.0)).legend.swatches])
    assert np.allclose(colours, swatches[[0, 2, 4]], atol=4)  # 0, 30 and 60 degrees of five labels


def test_aspect_colours_say_where_it_faces():
    legend = {swatch.label: swatch.colour for swatch in make_theme("aspect", ramp(1.0)).legend.swatches}
    assert tuple(make_theme("aspect", ramp(0.5)).pixels[5, 5, :3]) == legend["W"]  # it rises to the east
    assert tuple(make_theme("aspect", ramp(-0.5)).pixels[5, 5, :3]) == legend["E"]
    assert tuple(make_theme("aspect", ramp(0.0)).pixels[5, 5, :3]) == legend["level"]


def test_ridges_and_hollows_have_opposite_colours():
    x = np.abs(np.arange(41) - 20) * 10.0
    ridge, hollow = (
        make_theme("curvature", field(np.tile(sign * 0.5 * x, (41, 1)))).pixels[20, 20] for sign in (-1, 1)
    )
    assert int(ridge[0]) - int(ridge[2]) > 40  # brown
    assert int(hollow[2]) - int(hollow[0]) > 40  # blue


def test_rivers_show_and_dry_ground_is_clear():
    z, x = np.mgrid[:60, :60] * 10.0
    pixels = make_theme("drainage", field(0.5 * np.abs(x - 300.0) - 0.2 * z)).pixels  # a valley that falls to the south
    assert pixels[58, 30, 3] > 200
    assert pixels[:, 5, 3].max() < 40


def test_land_cover_follows_height_and_slope():
    cover = make_theme("cover", mountains(257)).pixels
    legend = {swatch.label: swatch.colour for swatch in make_theme("cover", mountains()).legend.swatches}
    heights = mountains(257).heights_m
    snowy = (cover[..., :3] == legend["snow"]).all(axis=-1)
    forest = (cover[..., :3] == legend["forest"]).all(axis=-1)
    assert snowy.any()
    assert forest.any()
    assert np.median(heights[snowy]) > np.median(heights[forest])
    steep = make_theme("cover", ramp(2.0, 65)).pixels[32, 32, :3]
    assert tuple(steep) == legend["rock"]


def test_an_unknown_theme_is_refused_in_one_line():
    with pytest.raises(InputError, match="slope, aspect"):
        make_theme("moisture", mountains(9))
