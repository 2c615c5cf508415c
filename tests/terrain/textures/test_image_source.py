"""Images from files: where they lie, what their levels hold, and what is done about files that cannot be read."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
import rasterio
from PIL import Image
from rasterio.enums import Resampling
from rasterio.transform import from_origin

from terrain.errors import InputError
from terrain.heightfield import Georeference, Heightfield
from terrain.textures import image_source
from terrain.textures.image_placement import covered_share
from terrain.textures.image_source import ImageSource
from terrain.textures.tree import BORDER_PX, TILE_PX, TileNotReady, cut_tile, halve

UTM = Georeference("EPSG:32633", (10.0, 0.0, 500_000.0, 0.0, -10.0, 5_000_000.0))

pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture
def opened():
    made = []

    def make(path, terrain):
        made.append(ImageSource(path, terrain))
        return made[-1]

    yield make
    for source in made:
        source.close()


def field(posts=101, spacing_m=10.0, **others):
    return Heightfield(np.zeros((posts, posts), np.float32), (spacing_m, spacing_m), **others)


def noise(rows, cols, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (rows, cols, 3), np.uint8)


def geotiff(path, pixels, transform=None, crs=None, **options):
    with rasterio.open(
        path, "w", driver="GTiff", width=pixels.shape[1], height=pixels.shape[0], count=pixels.shape[2],
        dtype=pixels.dtype.name, crs=crs, transform=transform or from_origin(500_000, 5_000_000, 1, 1), **options,
    ) as out:  # fmt: skip
        out.write(np.moveaxis(pixels, -1, 0))
    return path


def read_when_ready(source, level, row, col):
    until_s = time.monotonic() + 10.0
    while time.monotonic() < until_s:
        try:
            tile = source.read_tile(level, row, col)
            if source.is_final:
                return source.read_tile(level, row, col)
            del tile
        except TileNotReady:
            pass
        time.sleep(0.01)
    raise AssertionError("the tile was never ready")


def test_an_image_without_place_covers_the_whole_terrain(opened, tmp_path):
    Image.fromarray(noise(64, 64)).save(tmp_path / "map.png")
    source = opened(tmp_path / "map.png", field(65))
    assert any("covers the whole terrain" in note for note in source.notes)
    # Posts stand for the area around them, like pixels.
    assert np.allclose(source.image_from_post @ [[-0.5, 64.5], [-0.5, 64.5], [1, 1]], [[0, 1], [0, 1]])


def test_a_georeferenced_image_lies_where_it_says_and_may_cover_a_part(opened, tmp_path):
    path = geotiff(tmp_path / "a.tif", noise(50, 50), from_origin(500_500, 4_999_900, 10, 10), 32633)
    source = opened(path, field(georeference=UTM))
    # The image's north-west corner is post (col 50, row 10), its south-east one (100, 60).
    corners = np.array([[50, 10, 1], [100, 60, 1]]) @ source.image_from_post.T
    assert np.allclose(corners, [[0, 0], [1, 1]], atol=1e-9)
    assert any("covers 25%" in note for note in source.notes)


def test_cover_is_told_however_small(opened, tmp_path):
    path = geotiff(tmp_path / "a.tif", noise(9, 9), from_origin(500_501, 4_999_901, 1, 1), 32633)
    source = opened(path, field(georeference=UTM))
    assert any("covers less than 0.1%" in note for note in source.notes)  # 81 of 1 000 000 square metres


@pytest.mark.parametrize(("turn_deg", "scale"), [(0.0, 0.5), (30.0, 0.4), (45.0, 2.0), (10.0, 0.01)])
def test_covered_share_is_exact(turn_deg, scale):
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = np.array([[c, -s], [s, c]]) / (100.0 * scale)
    image_from_post = np.column_stack([turned, 0.5 - turned @ [50.0, 50.0]])
    grid = np.linspace(0, 100, 801)
    col, row = np.meshgrid(grid, grid)
    uv = np.stack([col, row, np.ones_like(col)], axis=-1) @ image_from_post.T
    counted = ((uv > 0) & (uv < 1)).all(axis=-1).mean()
    assert covered_share(field(), image_from_post) == pytest.approx(counted, abs=3e-3)


def test_an_image_in_another_coordinate_system_is_laid_where_it_belongs(opened, tmp_path):
    from rasterio.warp import transform

    posts = 801  # 64 km: degrees and metres disagree by more than a pixel
    terrain = field(posts, 80.0, georeference=Georeference(
        "EPSG:32633", (80.0, 0.0, 400_000.0, 0.0, -80.0, 6_600_000.0)))  # fmt: skip
    (west, east), (north, south) = transform(32633, 4326, [400_000, 464_000], [6_600_000, 6_536_000])
    size = 600
    step_x, step_y = (east - west + 0.2) / size, (north - south + 0.1) / size
    col, row = np.meshgrid(np.arange(size), np.arange(size))
    pixels = np.stack([(col * 255 / size), (row * 255 / size), 0 * col], axis=-1).astype(np.uint8)
    path = geotiff(tmp_path / "b.tif", pixels, from_origin(west - 0.1, north + 0.05, step_x, step_y), 4326)
    source = opened(path, terrain)
    assert any("Warped" in note for note in source.notes)
    for post in ((100, 100), (400, 700), (790, 20)):
        x, y = (source.image_from_post @ (*post, 1) * source.size_px).astype(int)
        tile = source.read_tile(0, y // TILE_PX, x // TILE_PX)
        seen = tile[y % TILE_PX + BORDER_PX, x % TILE_PX + BORDER_PX]
        lon, lat = transform(32633, 4326, [400_000 + 80 * post[0]], [6_600_000 - 80 * post[1]])
        expected = ((lon[0] - west + 0.1) / step_x * 255 / size, (north + 0.05 - lat[0]) / step_y * 255 / size)
        assert seen[3] == 255
        assert np.abs(seen[:2] - np.array(expected)).max() < 2.0


def test_an_image_beside_the_terrain_is_refused(tmp_path):
    path = geotiff(tmp_path / "c.tif", noise(9, 9), from_origin(600_000, 4_000_000, 10, 10), 32633)
    with pytest.raises(InputError, match="beside the terrain"):
        ImageSource(path, field(georeference=UTM))


def test_a_file_that_is_no_image_is_refused_in_one_line(tmp_path):
    (tmp_path / "no.png").write_text("nothing")
    with pytest.raises(InputError, match=r"no\.png") as caught:
        ImageSource(tmp_path / "no.png", field(9))
    assert "\n" not in str(caught.value)


def test_files_that_nothing_could_read_quickly_are_refused_with_advice(tmp_path, monkeypatch):
    path = geotiff(tmp_path / "big.tif", noise(1500, 1500), crs=32633)
    monkeypatch.setattr(image_source, "SMALL_PX", 1000)
    for limit, advice in (("FOLDER_LIMIT_BYTES", "gdaladdo"), ("MOST_BLOCK_ROW_BYTES", "TILED=YES")):
        with monkeypatch.context() as patched:
            patched.setattr(image_source, limit, 1000)
            with pytest.raises(InputError, match=advice):
                ImageSource(path, field(georeference=UTM))


LEVELS = [(0, 1, 1), (1, 0, 1), (2, 0, 0)]


@pytest.mark.parametrize("kind", ["in memory", "overviews", "pyramid", "sequential"])
def test_tiles_are_the_same_whichever_way_they_are_read(opened, tmp_path, monkeypatch, kind):
    row, col, _ = np.mgrid[:701, :597, :3]  # neither a power of two, nor a multiple of one
    pixels = (127 + 120 * np.sin(0.05 * row) * np.cos(0.04 * col)).astype(np.uint8)
    path = tmp_path / ("a.png" if kind == "sequential" else "a.tif")
    if kind == "sequential":
        Image.fromarray(pixels).save(path)
    else:
        geotiff(path, pixels, crs=32633, tiled=True, blockxsize=128, blockysize=128)
    if kind != "in memory":
        monkeypatch.setattr(image_source, "SMALL_PX", 1000)
        monkeypatch.setattr(image_source, "OVERVIEW_REACH", 1)
    if kind == "overviews":
        with rasterio.open(path, "r+") as file:
            file.build_overviews([2, 4], Resampling.average)
    source = opened(path, field(georeference=UTM))
    level_pixels, levels = pixels, []
    for level in range(3):
        if level:
            level_pixels = halve(level_pixels)
        levels.append(level_pixels)
    for level, row, col in LEVELS:
        tile = read_when_ready(source, level, row, col)
        off = np.abs(tile.astype(int) - cut_tile(levels[level], row, col))
        if kind == "overviews" and level:  # sizes of GDAL's overviews are rounded, so its texels lie a little aside
            assert off.max() <= 3 * 2**level  # half a texel
        else:
            assert off.max() <= 1


def test_a_pyramid_is_built_once_and_kept(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(image_source, "SMALL_PX", 1000)
    path = geotiff(tmp_path / "a.tif", noise(1500, 1200), crs=32633)
    first = opened(path, field(georeference=UTM))
    tile = read_when_ready(first, 2, 0, 0)
    (kept,) = (tmp_path / "cache" / "textures").iterdir()
    assert kept.suffix == ".pyramid"
    again = opened(path, field(georeference=UTM))
    assert again.is_final
    assert np.array_equal(again.read_tile(2, 0, 0), tile)


def test_a_preview_is_shown_until_the_pyramid_is_there(tmp_path, monkeypatch):
    monkeypatch.setattr(image_source, "SMALL_PX", 1000)
    monkeypatch.setattr(image_source, "DIRECT_LEVELS", 1)
    monkeypatch.setattr(image_source.RawPyramid, "build", lambda self, read, cancelled: cancelled.wait(5.0))
    path = geotiff(tmp_path / "a.tif", np.full((1500, 1500, 3), 77, np.uint8), crs=32633)
    source = ImageSource(path, field(georeference=UTM))
    until_s = time.monotonic() + 5.0
    while not source._preview and time.monotonic() < until_s:
        with pytest.raises(TileNotReady):
            source.read_tile(3, 0, 0)
        time.sleep(0.05)
    assert (source.read_tile(3, 0, 0)[5:100, 5:100, :3] == 77).all()
    assert (source.read_tile(0, 2, 2)[5:100, 5:100, :3] == 77).all()  # straight from the file
    assert not source.is_final
    source.close()  # ends the builder


def test_without_room_for_a_pyramid_tiles_still_come_from_the_file(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(image_source, "SMALL_PX", 1000)
    monkeypatch.setattr("terrain.textures.raw_pyramid.LEFT_FREE_BYTES", 1 << 60)
    pixels = noise(700, 700)
    source = opened(geotiff(tmp_path / "a.tif", pixels, crs=32633), field(georeference=UTM))
    tile = read_when_ready(source, 2, 0, 0)
    assert np.abs(tile.astype(int) - cut_tile(halve(halve(pixels)), 0, 0)).max() <= 1


def test_when_a_pyramid_cannot_be_built_tiles_still_come_from_the_file(opened, tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError("a driver's own idea of an error")

    monkeypatch.setattr(image_source, "SMALL_PX", 1000)
    monkeypatch.setattr(image_source.RawPyramid, "build", fail)
    pixels = noise(600, 600)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    tile = read_when_ready(opened(tmp_path / "a.png", field()), 0, 1, 1)
    assert np.array_equal(tile, cut_tile(pixels, 1, 1))


def test_what_a_file_marks_as_absent_is_clear(opened, tmp_path):
    pixels = np.dstack([noise(60, 60), np.zeros((60, 60), np.uint8)])
    pixels[:30, :, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "a.png")
    tile = opened(tmp_path / "a.png", field()).read_tile(0, 0, 0)[BORDER_PX:, BORDER_PX:]
    assert np.array_equal(tile[:30, :60], pixels[:30])
    assert not tile[30:60, :60].any()


def test_other_depths_are_stretched_to_8_bits_and_tables_become_colours(opened, tmp_path):
    deep = np.linspace(1000, 3000, 3600).reshape(60, 60, 1).astype(np.uint16)
    source = opened(geotiff(tmp_path / "deep.tif", deep, crs=32633), field(georeference=UTM))
    tile = source.read_tile(0, 0, 0)[1:61, 1:61]
    assert any("Stretched" in note for note in source.notes)
    assert (np.diff(tile[..., 0].ravel().astype(int)) >= 0).all()
    assert tile[0, 0, 0] == 0
    assert tile[59, 59, 0] == 255
    picture = Image.fromarray(np.tile(np.arange(4, dtype=np.uint8), (60, 15)))
    picture.putpalette([10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120])
    picture.save(tmp_path / "table.png")
    tile = opened(tmp_path / "table.png", field()).read_tile(0, 0, 0)
    assert tile[1, 1:5].tolist() == [[10, 20, 30, 255], [40, 50, 60, 255], [70, 80, 90, 255], [100, 110, 120, 255]]


def test_a_file_is_closed_when_the_last_reader_has_finished(tmp_path):
    source = ImageSource(geotiff(tmp_path / "a.tif", noise(60, 60), crs=32633), field(georeference=UTM))
    with source._reader.dataset() as dataset:
        closing = threading.Thread(target=source.close)
        closing.start()
        closing.join(0.1)
        assert closing.is_alive()
        assert not dataset.closed
    closing.join(5.0)
    assert dataset.closed
    source.close()  # a second time does nothing
    with pytest.raises(OSError, match="closed"):
        source.read_tile(0, 0, 0)
