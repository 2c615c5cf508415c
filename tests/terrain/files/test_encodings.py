"""Heights packed in colours are recognised by what they would mean, and photographs are not taken for terrain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.errors import InputError
from terrain.files.encodings import detect, heights_from_rgb
from terrain.files.sources import read_heightfield


def terrarium(heights):
    packed = np.round((heights + 32768) * 256).astype(np.int64)
    return [(packed >> shift & 255).astype(np.uint8) for shift in (16, 8, 0)]


def mapbox(heights):
    packed = np.round((heights + 10000) * 10).astype(np.int64)
    return [(packed >> shift & 255).astype(np.uint8) for shift in (16, 8, 0)]


def waves(amplitude_m, level_m, wavelength_posts=20.0, side=64):
    row, col = np.mgrid[0:side, 0:side] / wavelength_posts
    return level_m + amplitude_m * (np.sin(row) + np.cos(0.7 * col + row / 3)) / 2


@settings(max_examples=60)
@given(
    amplitude_m=st.floats(0, 3000),
    level_m=st.floats(-4000, 5000),
    wavelength=st.floats(8, 200),
    whole=st.booleans(),
)
def test_packed_terrain_is_recognised_and_decoded_within_one_unit(amplitude_m, level_m, wavelength, whole):
    heights = waves(amplitude_m, level_m, wavelength)
    heights = np.round(heights) if whole else heights
    for pack, name, unit_m in ((terrarium, "terrarium", 1 / 256), (mapbox, "mapbox", 0.1)):
        notes: list[str] = []
        found, black = heights_from_rgb(*pack(heights), encoding=None, name="a.png", notes=notes)
        assert name in notes[0]
        assert np.abs(found - heights).max() <= unit_m / 2 + 1e-3  # float32 at these heights
        assert not black.any()


def test_equal_channels_are_grey_and_exact():
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert detect(grey, grey, grey) == "grey"
    heights, black = heights_from_rgb(grey, grey, grey, encoding=None, name="a.png", notes=[])
    np.testing.assert_array_equal(heights, grey)
    assert black is None


def photographs():
    row, col = np.mgrid[0:100, 0:120]
    noise = np.random.default_rng(7).normal(0, 6, (3, 100, 120))
    sky = np.stack([100 + col / 4, 130 + row / 3, 200 + row / 5])
    forest = np.stack([40 + 30 * np.sin(row / 5), 90 + 40 * np.sin(row / 5 + 0.2), 30 + 20 * np.sin(col / 3)])
    yield from (("smooth sky", sky), ("sky", sky + noise), ("forest", forest + noise), ("dusk", sky / 3 + noise))
    yield "noise", np.random.default_rng(8).uniform(100, 150, (3, 100, 120))
    yield "night", np.random.default_rng(9).uniform(0, 2, (3, 100, 120))


@pytest.mark.parametrize(("name", "picture"), [*photographs()])
def test_photographs_are_not_taken_for_terrain(name, picture):
    channels = np.clip(picture, 0, 255).astype(np.uint8)
    assert detect(*channels) is None
    with pytest.raises(InputError, match=r"found a picture in colours in a\.png"):
        heights_from_rgb(*channels, encoding=None, name="a.png", notes=[])


def test_encoding_can_be_forced():
    channels = terrarium(waves(500, 1000))
    as_mapbox, _ = heights_from_rgb(*channels, encoding="mapbox", name="a.png", notes=[])
    red, green, blue = (channel.astype(np.float64) for channel in channels)
    np.testing.assert_allclose(as_mapbox, 0.1 * (65536 * red + 256 * green + blue) - 10000, rtol=1e-6)
    brightness, _ = heights_from_rgb(*channels, encoding="grey", name="a.png", notes=[])
    np.testing.assert_allclose(brightness, 0.299 * red + 0.587 * green + 0.114 * blue, rtol=1e-6)


@pytest.mark.parametrize("pack", [terrarium, mapbox])
def test_black_and_transparent_posts_are_holes(tmp_path, pack):
    from PIL import Image

    heights = waves(300, 400)
    channels = np.stack([*pack(heights), np.full(heights.shape, 255)], axis=-1).astype(np.uint8)
    channels[:20, :10, :3] = 0
    channels[50:, 40:, 3] = 0
    Image.fromarray(channels).save(tmp_path / "a.png")
    heightfield = read_heightfield(tmp_path / "a.png")
    expected = np.zeros(heights.shape, bool)
    expected[:20, :10] = expected[50:, 40:] = True
    np.testing.assert_array_equal(heightfield.holes, expected)
    assert np.abs(heightfield.heights_m - heights)[~expected].max() < 0.06


def test_deep_colours_cannot_be_unpacked():
    deep = np.arange(300, dtype=np.uint16).reshape(15, 20)
    with pytest.raises(InputError, match="expected 8 bits per colour for terrarium, found uint16"):
        heights_from_rgb(deep, deep, deep + 1, encoding="terrarium", name="a.tif", notes=[])
