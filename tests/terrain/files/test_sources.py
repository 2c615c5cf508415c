"""Files of every kind become the same terrain, in metres, north up, holes marked; and the notes say how."""

from __future__ import annotations

import gzip
import zipfile

import numpy as np
import pytest

from terrain.errors import InputError
from terrain.files.sources import read_heightfield

rasterio = pytest.importorskip("rasterio")
UTM = "EPSG:32611"


def hills(rows=20, cols=30):
    row, col = np.mgrid[0:rows, 0:cols]
    return (1000 + 7 * row + 3 * col + 40 * np.sin(row / 3) * np.cos(col / 4)).astype(np.float32)


def write_tif(path, heights, transform=(30, 0, 500_000, 0, -30, 4_000_000), crs=UTM, units=None, scale=None, **options):
    """A GeoTIFF; ``transform`` at pixel corners."""
    bands = np.atleast_3d(heights.T).T if heights.ndim == 2 else heights
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=bands.shape[0],
        height=bands.shape[1],
        width=bands.shape[2],
        dtype=bands.dtype,
        transform=None if transform is None else rasterio.Affine(*transform),
        crs=crs,
        **options,
    ) as dataset:
        dataset.write(bands)
        if units:
            dataset.units = (units,)
        if scale:
            dataset.scales, dataset.offsets = (scale[0],), (scale[1],)
    return path


def read_quietly(path, **options):
    heightfield = read_heightfield(path, **options)
    assert all(note.endswith((".", ")")) for note in heightfield.notes)
    return heightfield


def test_geotiff_keeps_heights_and_places_posts_at_pixel_centres(tmp_path):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills()))
    np.testing.assert_array_equal(heightfield.heights_m, hills())
    assert heightfield.spacing_m == (30, 30)
    assert heightfield.holes is None
    assert heightfield.name == "a"
    assert heightfield.georeference.crs == UTM
    assert heightfield.georeference.to_map(0, 0) == (500_015, 3_999_985)
    assert heightfield.georeference.to_map(29, 19) == (500_015 + 29 * 30, 3_999_985 - 19 * 30)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"])
def test_number_types_give_the_same_heights(tmp_path, dtype):
    heights = np.round(hills() / 10).astype(dtype)
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", heights))
    np.testing.assert_array_equal(heightfield.heights_m, heights.astype(np.float32))


def test_smallest_grid_is_two_by_two(tmp_path):
    assert read_quietly(write_tif(tmp_path / "a.tif", hills(2, 2))).heights_m.shape == (2, 2)
    with pytest.raises(InputError, match=r"expected at least 2 x 2 posts in b\.tif, found 1 x 9"):
        read_heightfield(write_tif(tmp_path / "b.tif", hills(9, 1)))


@pytest.mark.parametrize("latitude", [0.0, 37.0, -60.0, 80.0])
def test_degrees_become_metres_at_the_centre_latitude(tmp_path, latitude):
    step = 1 / 3600
    heights = hills(21, 31)
    path = write_tif(
        tmp_path / "a.tif", heights, (step, 0, 10 - 15.5 * step, 0, -step, latitude + 10.5 * step), crs="EPSG:4326"
    )
    heightfield = read_quietly(path)
    # arcs of the WGS 84 ellipsoid by small differences of geocentric positions: an independent derivation
    a, f = 6378137.0, 1 / 298.257223563

    def position(longitude, latitude):
        lon, lat = np.radians(longitude), np.radians(latitude)
        n = a / np.sqrt(1 - f * (2 - f) * np.sin(lat) ** 2)
        return np.array([n * np.cos(lat) * np.cos(lon), n * np.cos(lat) * np.sin(lon), n * (1 - f) ** 2 * np.sin(lat)])

    across = np.linalg.norm(position(10 + step / 2, latitude) - position(10 - step / 2, latitude))
    down = np.linalg.norm(position(10, latitude + step / 2) - position(10, latitude - step / 2))
    np.testing.assert_allclose(heightfield.spacing_m, (across, down), rtol=1e-6)
    np.testing.assert_array_equal(heightfield.heights_m, heights)  # not resampled
    assert heightfield.georeference.geographic
    np.testing.assert_allclose(heightfield.georeference.to_map(15, 10), (10, latitude), atol=1e-9)


def test_other_planets_use_their_own_radius(tmp_path):
    mars = "+proj=longlat +a=3396190 +b=3396190 +no_defs"
    path = write_tif(tmp_path / "a.tif", hills(21, 31), (0.01, 0, 0, 0, -0.01, 0.105), crs=mars)
    np.testing.assert_allclose(read_quietly(path).spacing_m, np.full(2, np.radians(0.01) * 3396190), rtol=1e-5)


def test_feet_of_the_map_become_metres(tmp_path):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills(), crs="EPSG:2227"))  # California, US survey feet
    np.testing.assert_allclose(heightfield.spacing_m, (30 * 1200 / 3937,) * 2)
    assert heightfield.georeference.to_map(0, 0) == (500_015, 3_999_985)  # in the map's own feet
    np.testing.assert_array_equal(heightfield.heights_m, hills())


def test_web_mercator_is_not_taken_at_its_word(tmp_path):
    y = 6378137 * np.arcsinh(np.tan(np.radians(60)))
    path = write_tif(tmp_path / "a.tif", hills(21, 31), (30, 0, 0, 0, -30, y + 10.5 * 30), crs="EPSG:3857")
    np.testing.assert_allclose(read_quietly(path).spacing_m, (15, 15), rtol=1e-6)


@pytest.mark.parametrize(
    ("units", "crs", "metres"),
    [
        ("ft", UTM, 0.3048),
        ("US survey foot", UTM, 1200 / 3937),
        ("m", UTM, 1.0),
        ("cm", UTM, 0.01),
        (None, "EPSG:26910+6360", 1200 / 3937),  # NAVD 88 in US survey feet
    ],
)
def test_heights_in_other_units_become_metres_where_the_file_says_so(tmp_path, units, crs, metres):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills(), units=units, crs=crs))
    np.testing.assert_allclose(heightfield.heights_m, hills() * metres, rtol=1e-6)
    assert any("converted to metres" in note for note in heightfield.notes) == (metres != 1)


def test_unknown_unit_is_said_and_taken_as_metres(tmp_path):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills(), units="smoots"))
    np.testing.assert_array_equal(heightfield.heights_m, hills())
    assert any("'smoots' is unknown" in note for note in heightfield.notes)


def test_scale_and_offset_are_applied_after_nodata(tmp_path):
    stored = np.arange(600, dtype=np.uint16).reshape(20, 30)
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", stored, scale=(2.5, 100), nodata=0))
    expected = stored * 2.5 + 100
    np.testing.assert_allclose(heightfield.heights_m.ravel()[1:], expected.ravel()[1:])
    assert heightfield.holes.ravel().nonzero()[0].tolist() == [0]


def test_options_override_spacing_and_scale_heights(tmp_path):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills()), spacing_m=12.5, height_scale=0.3048)
    assert heightfield.spacing_m == (12.5, 12.5)
    np.testing.assert_allclose(heightfield.heights_m, hills() * 0.3048, rtol=1e-6)


def test_south_up_is_turned_round(tmp_path):
    path = write_tif(tmp_path / "a.tif", hills()[::-1], (30, 0, 500_000, 0, 30, 4_000_000 - 20 * 30))
    expected = read_quietly(write_tif(tmp_path / "b.tif", hills()))
    found = read_quietly(path)
    np.testing.assert_array_equal(found.heights_m, expected.heights_m)
    assert found.georeference == expected.georeference


def test_east_to_west_is_turned_round(tmp_path):
    path = write_tif(tmp_path / "a.tif", hills()[:, ::-1], (-30, 0, 500_000 + 30 * 30, 0, -30, 4_000_000))
    expected = read_quietly(write_tif(tmp_path / "b.tif", hills()))
    found = read_quietly(path)
    np.testing.assert_array_equal(found.heights_m, expected.heights_m)
    assert found.georeference == expected.georeference


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("angle_deg", [-75, -30, 0.5, 30, 89, 100, 150])
def test_rotated_grid_keeps_its_spacing_and_every_post_its_place(tmp_path, angle_deg, mirrored):
    turn = np.radians(angle_deg)
    a, d = 20 * np.cos(turn), 20 * np.sin(turn)
    b, e = np.array([10 * np.sin(turn), -10 * np.cos(turn)]) * (-1 if mirrored else 1)
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills(), (a, b, 1e5, d, e, 2e5)))
    np.testing.assert_allclose(heightfield.spacing_m, (20, 10))
    across = np.subtract(heightfield.georeference.to_map(1, 0), heightfield.georeference.to_map(0, 0))
    down = np.subtract(heightfield.georeference.to_map(0, 1), heightfield.georeference.to_map(0, 0))
    assert across[0] * down[1] - across[1] * down[0] < 0  # a right-handed world: rows turn clockwise from columns
    # every post is still where the file put it
    row, col = np.mgrid[0:20, 0:30]
    x, y = a * (col + 0.5) + b * (row + 0.5) + 1e5, d * (col + 0.5) + e * (row + 0.5) + 2e5
    post_col, post_row = heightfield.georeference.to_post(x, y)
    np.testing.assert_allclose(
        heightfield.heights_m[np.rint(post_row).astype(int), np.rint(post_col).astype(int)], hills()
    )


def test_sheared_grid_is_refused_in_one_line(tmp_path):
    path = write_tif(tmp_path / "a.tif", hills(), (30, 15, 0, 0, -30, 0))
    with pytest.raises(InputError, match=r"at right angles to rows, found 63\.4 degrees .*gdalwarp"):
        read_heightfield(path)


def test_singular_transform_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected posts that span a map"):
        read_heightfield(write_tif(tmp_path / "a.tif", hills(), (30, 30, 0, 30, 30, 0)))


def test_missing_crs_means_metres_unless_steps_look_like_arc_seconds(tmp_path):
    metres = read_quietly(write_tif(tmp_path / "a.tif", hills(), (30, 0, 0, 0, -30, 0), crs=None))
    assert metres.spacing_m == (30, 30)
    assert metres.georeference is None
    degrees = read_quietly(write_tif(tmp_path / "b.tif", hills(), (1 / 1200, 0, 8, 0, -1 / 1200, 0), crs=None))
    np.testing.assert_allclose(degrees.spacing_m, (92.77, 92.15), atol=0.01)
    assert "The file names no coordinate system: degrees assumed." in degrees.notes


def test_huge_eastings_stay_out_of_the_geometry(tmp_path):
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", hills(), (0.5, 0, 1e7, 0, -0.5, 1.2e7)))
    assert heightfield.spacing_m == (0.5, 0.5)
    assert heightfield.georeference.to_map(1, 1) == (1e7 + 0.75, 1.2e7 - 0.75)


def test_without_georeference_thirty_metres_are_assumed_and_said(tmp_path):
    from PIL import Image

    grey = np.round(hills() % 200).astype(np.uint8)
    Image.fromarray(grey).save(tmp_path / "a.png")
    heightfield = read_quietly(tmp_path / "a.png")
    np.testing.assert_array_equal(heightfield.heights_m, grey)
    assert heightfield.spacing_m == (30, 30)
    assert any("30 m between posts assumed" in note for note in heightfield.notes)
    assert any("8 bits" in note for note in heightfield.notes)
    assert read_quietly(tmp_path / "a.png", spacing_m=60, height_scale=10.004).spacing_m == (60, 60)


def test_sixteen_bit_image_keeps_all_its_bits(tmp_path):
    from PIL import Image

    grey = (np.arange(600).reshape(20, 30) * 109).astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_quietly(tmp_path / "a.png").heights_m, grey)


def test_alpha_makes_holes(tmp_path):
    from PIL import Image

    grey = np.full((20, 30), 100, np.uint8)
    alpha = np.full((20, 30), 255, np.uint8)
    alpha[5:8, 3:9] = 0
    Image.merge("LA", (Image.fromarray(grey), Image.fromarray(alpha))).save(tmp_path / "a.png")
    heightfield = read_quietly(tmp_path / "a.png")
    np.testing.assert_array_equal(heightfield.holes, alpha == 0)
    assert heightfield.height_range_m == (100, 100)


def test_palette_of_greys_is_looked_up(tmp_path):
    from PIL import Image

    image = Image.fromarray(np.arange(600, dtype=np.uint16).reshape(20, 30).astype(np.uint8) % 50, "P")
    image.putpalette([level for index in range(256) for level in (255 - index,) * 3])
    image.save(tmp_path / "a.png")
    np.testing.assert_array_equal(
        read_quietly(tmp_path / "a.png").heights_m, 255.0 - (np.arange(600) % 256 % 50).reshape(20, 30)
    )


def test_band_one_of_many_is_taken_and_said(tmp_path):
    bands = np.stack([hills(), hills() * 2, hills() * 3])
    heightfield = read_quietly(write_tif(tmp_path / "a.tif", bands, photometric="MINISBLACK"))
    np.testing.assert_array_equal(heightfield.heights_m, hills())
    assert "The file has 3 bands: band 1 was taken as heights." in heightfield.notes


def test_complex_numbers_are_refused(tmp_path):
    path = write_tif(tmp_path / "a.tif", hills().astype(np.complex64))
    with pytest.raises(InputError, match=r"expected real heights in a\.tif, found numbers of type complex64"):
        read_heightfield(path)


@pytest.mark.parametrize("chunk", [1 << 20, 7])
def test_asterisks_of_a_grass_grid_are_holes_and_zeros_are_not(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr("terrain.files.raster.TEXT_BYTES", chunk)
    header = "north: 200\nsouth: 170\neast: 340\nwest: 300\nrows: 3\ncols: 4\n"
    path = tmp_path / "grass.asc"
    path.write_text(f"{header}* 11 12 0\n20 * 22\n0 30 31 32 *")  # rows need not be lines
    heightfield = read_quietly(path)
    assert np.argwhere(heightfield.holes).tolist() == [[0, 0], [1, 1], [2, 3]]
    assert heightfield.height_range_m == (0, 32)


def test_grid_without_any_data_is_refused(tmp_path):
    path = write_tif(tmp_path / "a.tif", np.full((9, 9), -9999, np.int16), nodata=-9999)
    with pytest.raises(InputError, match="expected heights in a, found 81 posts without data"):
        read_heightfield(path)


def test_impossible_heights_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"expected heights within 1e\+07 m .* byte order"):
        read_heightfield(write_tif(tmp_path / "a.tif", hills() * np.float32(1e20)))


def test_large_grid_is_thinned_and_stays_in_place(tmp_path, monkeypatch):
    monkeypatch.setattr("terrain.files.raster.MAX_SIDE", 100)
    row, col = np.mgrid[0:250, 0:301]
    heights = (row * 2 + col).astype(np.float32)
    path = write_tif(tmp_path / "a.tif", heights, (10, 0, 0, 0, -10, 0))
    heightfield = read_quietly(path)
    assert heightfield.heights_m.shape == (62, 75)
    assert heightfield.spacing_m == (40, 40)
    assert any("one in 4 was read" in note for note in heightfield.notes)
    col, row = np.meshgrid(np.arange(75), np.arange(62))
    x, y = heightfield.georeference.to_map(col, row)
    truth = -y / 10 * 2 + x / 10 - 1.5  # height as a function of the map
    assert np.abs(heightfield.heights_m - truth).max() <= 2  # each post is a post of the file, at most half a post away


def test_zip_and_gz_give_what_is_inside(tmp_path):
    path = write_tif(tmp_path / "a.tif", hills())
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.write(path, "folder/a.tif")
        archive.writestr("folder/readme.txt", "about")
        archive.writestr("folder/preview.jpg", "picture")
    (tmp_path / "c.tif.gz").write_bytes(gzip.compress(path.read_bytes()))
    for packed in ("b.zip", "c.tif.gz"):
        heightfield = read_quietly(tmp_path / packed)
        np.testing.assert_array_equal(heightfield.heights_m, hills())
        assert heightfield.georeference.crs == UTM
    assert "folder/a.tif was read from the archive b.zip." in read_quietly(tmp_path / "b.zip").notes


def test_world_file_inside_a_zip_is_used(tmp_path):
    from PIL import Image

    Image.fromarray(np.round(hills() % 200).astype(np.uint8)).save(tmp_path / "a.png")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.write(tmp_path / "a.png", "a.png")
        archive.writestr("a.wld", "25\n0\n0\n-25\n1000\n2000\n")
    assert read_quietly(tmp_path / "b.zip").spacing_m == (25, 25)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"encoding": "jpeg"}, "expected an encoding of terrarium, mapbox, grey, found 'jpeg'"),
        ({"encoding": "mapbox"}, "expected red, green and blue bands for the mapbox encoding, found gray"),
        ({"spacing_m": 0.0}, "expected a spacing"),
        ({"spacing_m": float("nan")}, "expected a spacing"),
        ({"height_scale": 0.0}, "expected a height scale"),
        ({"raw": "big"}, "expected --raw WxH"),
    ],
)
def test_wrong_options_give_one_line(tmp_path, options, line):
    with pytest.raises(InputError, match=line):
        read_heightfield(write_tif(tmp_path / "a.tif", hills()), **options)


@pytest.mark.parametrize("name", ["missing.tif", "", "nul\0byte.tif", "a" * 5000])
def test_names_that_do_not_open_give_one_line(tmp_path, name):
    with pytest.raises(InputError, match="expected") as error:
        read_heightfield(f"{tmp_path}/{name}")
    assert len(str(error.value).splitlines()) == 1


def test_message_is_one_line_even_for_odd_names(tmp_path):
    path = tmp_path / "two\nlines\x1b[31m.tif"
    path.write_bytes(b"nothing")
    with pytest.raises(InputError, match="expected a raster that GDAL reads, found two lines") as error:
        read_heightfield(path)
    assert str(error.value).isprintable()


VARIANTS = [
    "helens.npy",
    "helens_ehdr_be.bil",
    "helens_f32_nan_nonodatatag.tif",
    "helens_gridfloat_le.flt",
    "helens_i16_undeclared_-32768_packbits.tif",
    "helens_nocrs.tif",
    "helens_rotated30.tif",
    "helens_scale_offset_u8.tif",
    "helens_southup.tif",
    "helens_u16_feet.tif",
]


@pytest.mark.parametrize("name", VARIANTS)
def test_the_volcano_is_the_same_in_every_container(dem, name):
    expected = read_quietly(dem("SainteHelens.dem"))
    assert expected.spacing_m == (30, 30)
    # this file keeps silent about its feet; 8 bits in steps of 7.5 m; whole feet
    found = read_quietly(dem(name), height_scale=0.3048 if "feet" in name else 1.0)
    tolerance_m = 7.5 if "u8" in name else 0.1525 if "feet" in name else 0.0
    np.testing.assert_array_equal(found.holes, expected.holes)
    data = ~expected.holes
    assert np.abs(found.heights_m - expected.heights_m)[data].max() <= tolerance_m
    np.testing.assert_allclose(found.spacing_m, (30, 30))


def test_the_volcano_in_degrees_covers_the_same_ground(dem):
    found = read_quietly(dem("helens_4326_f32.tif"))
    np.testing.assert_allclose(found.extent_m, read_quietly(dem("SainteHelens.dem")).extent_m, rtol=0.02)


@pytest.mark.parametrize(
    ("name", "shape", "heights_m"),
    [
        ("sierra_deathvalley_4097_cog.tif", (4097, 4097), (-85, 4404)),
        ("N48W125.hgt.zip", (3601, 3601), (-13, 1095)),
        ("TM1_564_146.tif", (1000, 1000), (254.97, 325.05)),
        ("gcanyon_elev_crop.bw.png", (1200, 1200), (35, 187)),
        ("essen_dom1_1m.tif", (1000, 1000), (87.29, 167.74)),
        ("SainteHelens.dem", (468, 327), (682, 2543)),
        ("N37W120.hgt", (1201, 1201), (91, 3968)),
        ("srtm_41_19_4326.tif", (619, 919), (0, 1699)),
        ("n33_w116_3arc_v2.dt1", (1201, 1201), (-87, 1619)),
        ("nz_elev.tif", (1450, 1115), (0, 4140.33)),
        ("opengeos_dsm.tif", (259, 283), (6.955, 39.05)),
        ("mongon_dem.tif", (117, 117), (238, 1094)),
        ("whitebox_DEM.tif", (188, 237), (212.23, 1233.1)),
        ("fuji_mapbox_rgb.png", (512, 512), (13.7, 3751)),
        ("loadersgl_terrarium.png", (256, 256), (852.12, 2475.07)),
        ("yosemite_512_terrarium.png", (512, 512), (373, 3292)),
        ("yosemite_1025_gray16.png", (1025, 1025), (113, 3968)),
        ("yosemite_1025_le.r16", (1025, 1025), (113, 3968)),
        ("hugo_site.asc", (55, 76), (1660, 1711)),
        ("spearfish_dem.asc.gz", (477, 634), (1066, 1840)),
    ],
)
def test_real_terrains_open(dem, name, shape, heights_m):
    heightfield = read_quietly(dem(name))
    assert heightfield.heights_m.shape == shape
    np.testing.assert_allclose(heightfield.height_range_m, heights_m, atol=0.006)
