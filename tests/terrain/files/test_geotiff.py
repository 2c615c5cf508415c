"""What is written comes back: heights bit for bit, spacing, place and holes; and `info` says the same of both."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from terrain.errors import InputError
from terrain.files.describe import describe, describe_text
from terrain.files.geotiff import write_geotiff
from terrain.files.sources import read_heightfield
from terrain.heightfield import Georeference, Heightfield

pytest.importorskip("rasterio")


def terrain(georeference=None, holes=False, spacing_m=(10.0, 20.0)):
    heights = np.random.default_rng(3).normal(500, 200, (37, 53)).astype(np.float32)
    mask = np.zeros(heights.shape, bool)
    mask[4:9, 20:30] = True
    heights[mask] = 321.5
    return Heightfield(heights, spacing_m, mask if holes else None, "written", georeference)


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize(
    "georeference",
    [
        None,
        Georeference("EPSG:32611", (10.0, 0.0, 400_005.0, 0.0, -20.0, 4_100_000.0)),
        Georeference("EPSG:32611", (8.0, -12.0, 400_005.0, -6.0, -16.0, 4_100_000.0)),
    ],
)
def test_written_terrain_comes_back(tmp_path, georeference, holes):
    written = terrain(georeference, holes)
    found = read_heightfield(write_geotiff(written, tmp_path / "written.tif"))
    data = ~written.holes if holes else np.ones(written.heights_m.shape, bool)
    np.testing.assert_array_equal(found.heights_m[data], written.heights_m[data])
    np.testing.assert_allclose(found.spacing_m, written.spacing_m)
    np.testing.assert_array_equal(found.holes, written.holes)
    if georeference:
        assert found.georeference.crs == georeference.crs
        np.testing.assert_allclose(found.georeference.map_from_post, georeference.map_from_post)
    left, right = describe(written), describe(found)
    assert {key: left[key] for key in ("rows", "cols", "height_m", "nodata_share", "crs")} == {
        key: right[key] for key in ("rows", "cols", "height_m", "nodata_share", "crs")
    }


def test_exaggeration_is_not_written(tmp_path):
    written = terrain()
    found = read_heightfield(write_geotiff(written.exaggerated(2.0), tmp_path / "a.tif"))
    np.testing.assert_array_equal(found.heights_m, written.heights_m)
    assert describe(written.exaggerated(2.0))["height_m"] == describe(written)["height_m"]


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path):
    path = write_geotiff(terrain(), tmp_path / "a.tif")
    before = path.read_bytes()
    wrong = replace(terrain(), georeference=Georeference("EPSG:nonsense", (10.0, 0.0, 0.0, 0.0, -20.0, 0.0)))
    with pytest.raises(InputError, match="expected to write"):
        write_geotiff(wrong, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_gives_one_line(tmp_path):
    with pytest.raises(InputError, match=r"expected to write .*nowhere"):
        write_geotiff(terrain(), tmp_path / "nowhere" / "a.tif")


def test_description_is_json_and_text(tmp_path):
    found = read_heightfield(write_geotiff(terrain(holes=True), tmp_path / "a {}.tif"))
    facts = json.loads(json.dumps(describe(found)))
    assert (facts["rows"], facts["cols"]) == (37, 53)
    assert facts["spacing_m"] == [10.0, 20.0]
    assert facts["units"] == "m"
    assert facts["crs"] is None
    assert facts["nodata_share"] == pytest.approx(50 / (37 * 53))
    text = describe_text(found)
    assert text.startswith("a {}: 53 x 37 posts, 10 x 20 m apart (0.52 x 0.72 km)\nheights ")
    assert "no data at 2.55 % of the posts" in text
    assert all(f"- {note}" in text for note in found.notes)


def test_long_coordinate_systems_are_shortened_for_people():
    wkt = 'PROJCS["Somewhere else",GEOGCS["x"]]'
    georeference = Georeference(wkt, (10.0, 0.0, 0.0, 0.0, -20.0, 0.0))
    assert 'coordinate system PROJCS["Somewhere else" ...]' in describe_text(terrain(georeference))
    assert describe(terrain(georeference))["crs"] == wkt
