"""Texture trees: every texel of every level belongs to one tile, and tiles carry what lies around them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.textures.array_source import ArraySource, premultiplied
from terrain.textures.tree import BORDER_PX, MOST_CELLS, SLOT_PX, TILE_PX, TextureTree, cut_tile, halve

WHOLE = np.array([[0.01, 0.0, 0.0], [0.0, 0.01, 0.0]])
SIZES = st.tuples(st.integers(1, 30_000), st.integers(1, 30_000))


def tree_of(size):
    return TextureTree(size, WHOLE, (10.0, 10.0))


@given(SIZES)
def test_the_coarsest_level_is_one_tile_and_the_one_before_is_not(size):
    tree = tree_of(size)
    assert tuple(tree.shapes[-1]) == (1, 1)
    assert tree.top_level == 0 or tree.shapes[-2].prod() > 1
    assert max(tree.level_size(tree.top_level)) <= TILE_PX


@given(SIZES)
def test_tiles_of_every_level_cover_the_image_and_none_lies_beside_it(size):
    tree = tree_of(size)
    for level, (rows, cols) in enumerate(tree.shapes):
        reach = TILE_PX << level
        assert (cols - 1) * reach < size[0] <= cols * reach
        assert (rows - 1) * reach < size[1] <= rows * reach


@given(SIZES, st.data())
def test_numbers_name_tiles_uniquely(size, data):
    tree = tree_of(size)
    number = data.draw(st.integers(0, tree.tile_count - 1))
    level, row, col = tree.locate(number)
    assert 0 <= row < tree.shapes[level, 0]
    assert 0 <= col < tree.shapes[level, 1]
    assert tree.number_of(level, row, col) == number
    if level < tree.top_level:  # its parent exists
        assert 0 <= tree.number_of(level + 1, row // 2, col // 2) < tree.tile_count


def test_images_beyond_the_page_table_are_refused():
    tree_of((MOST_CELLS * TILE_PX, 1))
    with pytest.raises(ValueError, match="pixels per side"):
        tree_of((MOST_CELLS * TILE_PX + 1, 1))


@given(st.integers(1, 33), st.integers(1, 33), st.integers(0, 2**32 - 1))
def test_a_coarser_texel_is_the_mean_of_those_below_it(rows, cols, seed):
    pixels = np.random.default_rng(seed).integers(0, 256, (rows, cols, 4), np.uint8)
    half = halve(pixels)
    assert half.shape == (-(-rows // 2), -(-cols // 2), 4)
    for row, col in np.ndindex(half.shape[:2]):
        block = pixels[2 * row : 2 * row + 2, 2 * col : 2 * col + 2].astype(float)
        assert np.abs(half[row, col] - block.mean(axis=(0, 1))).max() <= 0.5


@settings(max_examples=25)
@given(st.integers(1, 600), st.integers(1, 600), st.data())
def test_tiles_and_their_borders_hold_the_levels_texels(width, height, data):
    pixels = np.random.default_rng(width * height).integers(0, 256, (height, width, 3), np.uint8)
    row = data.draw(st.integers(0, (height - 1) // TILE_PX))
    col = data.draw(st.integers(0, (width - 1) // TILE_PX))
    tile = cut_tile(pixels, row, col)
    assert tile.shape == (SLOT_PX, SLOT_PX, 4)
    at = np.arange(SLOT_PX) - BORDER_PX
    expected = pixels[np.clip(row * TILE_PX + at, 0, height - 1)][:, np.clip(col * TILE_PX + at, 0, width - 1)]
    assert np.array_equal(tile[..., :3], expected)
    assert (tile[..., 3] == 255).all()


def test_an_array_gives_its_levels_and_says_when_it_changed():
    source = ArraySource("grey", np.full((500, 300, 3), 7, np.uint8), WHOLE)
    assert (source.read_tile(1, 0, 0)[..., :3] == 7).all()
    source.replace(np.full((500, 300, 3), 9, np.uint8))
    assert source.revision == 1
    assert (source.read_tile(1, 0, 0)[..., :3] == 9).all()


def test_colours_are_multiplied_by_alpha_before_they_are_mixed():
    pixels = np.array([[[200, 100, 0, 255], [255, 255, 255, 0]]], np.uint8)
    assert premultiplied(pixels).tolist() == [[[200, 100, 0, 255], [0, 0, 0, 0]]]
    # What is absent lends no colour to its neighbour: half as much of the same red.
    assert halve(premultiplied(pixels))[0, 0].tolist() == [100, 50, 0, 128]
