"""Breaklines arrive where they lie, whatever the file calls its coordinates; what is no line is said in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from terrain.breaklines import read_breaklines
from terrain.errors import InputError
from terrain.heightfield import Georeference, Heightfield

UTM = Georeference("EPSG:32632", (10.0, 0.0, 500_000.0, 0.0, -10.0, 5_000_000.0))
LON_LAT = Georeference("EPSG:4326", (0.001, 0.0, 9.0, 0.0, -0.001, 45.0), geographic=True)


def ground(place: Georeference | None = None) -> Heightfield:
    return Heightfield(np.zeros((41, 51), np.float32), (10.0, 10.0), georeference=place)


def write(folder, name: str, content: object):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def feature(*coordinates, kind="LineString"):
    return {"type": "Feature", "properties": {}, "geometry": {"type": kind, "coordinates": list(coordinates)}}


def test_geojson_is_longitude_and_latitude(tmp_path):
    path = write(tmp_path, "road.geojson", feature([9.01, 44.99, 7.0], [9.02, 44.98, 8.0]))
    (line,) = read_breaklines(path, ground(LON_LAT)).lines
    np.testing.assert_allclose(line, [[10, 10, 7], [20, 20, 8]], atol=1e-6)
    (line,) = read_breaklines(write(tmp_path, "utm.json", feature([9.0, 45.1529], [9.004, 45.1529])), ground(
        Georeference("EPSG:32632", (10.0, 0.0, 499_900.0, 0.0, -10.0, 5_000_200.0)))).lines  # fmt: skip
    assert line[0, 0] == pytest.approx(10.0, abs=1e-3)  # 9 degrees east is the zone's meridian, 500 km
    assert line[1, 0] - line[0, 0] == pytest.approx(31.46, abs=0.05)  # 0.004 degrees at 45 north


def test_geojson_may_name_its_coordinates_and_hold_any_geometry(tmp_path):
    inner = {"type": "GeometryCollection", "geometries": [
        {"type": "MultiLineString", "coordinates": [[[500_000, 5_000_000], [500_100, 4_999_900]]]},
        {"type": "Point", "coordinates": [1, 2]},
    ]}  # fmt: skip
    ring = [[500_200, 4_999_800], [500_300, 4_999_800], [500_200, 4_999_700], [500_200, 4_999_800]]
    record = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}},
        "features": [{"type": "Feature", "geometry": inner}, feature(ring, kind="Polygon"), {"type": "Feature"}],
    }
    line, shore = read_breaklines(write(tmp_path, "a.geojson", record), ground(UTM)).lines
    np.testing.assert_allclose(line[:, :2], [[0, 0], [10, 10]], atol=1e-6)
    np.testing.assert_allclose(shore[:, :2], [[20, 20], [30, 20], [20, 30], [20, 20]], atol=1e-6)
    assert np.isnan(line[:, 2]).all()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y,z\n500100,4999900,5\n500200,4999900,6\n", [[[10, 10, 5], [20, 10, 6]]]),
        ("500100;4999900\n500200;4999900\n", [[[10, 10, np.nan], [20, 10, np.nan]]]),
        ("line\teasting\tnorthing\th\na\t500100\t4999900\t1\na\t500110\t4999900\t2\nb\t500100\t4999800\t3\n"
         "b\t500110\t4999800\t\n", [[[10, 10, 1], [11, 10, 2]], [[10, 20, np.nan], [11, 20, np.nan]]]),
        ("\ufeffx, y\n500100, 4999900\n500100, 4999900\n500110, 4999900\n\n500100, 4999800\n500110, 4999800\n",
         [[[10, 10, np.nan], [11, 10, np.nan]], [[10, 20, np.nan], [11, 20, np.nan]]]),
    ],
    ids=["header", "bare", "line column", "empty row, repeated point"],
)  # fmt: skip
def test_csv(tmp_path, text, expected):
    lines = read_breaklines(write(tmp_path, "a.csv", text), ground(UTM)).lines
    assert len(lines) == len(expected)
    for line, wanted in zip(lines, expected, strict=True):
        np.testing.assert_allclose(line, wanted, atol=1e-6)


def test_csv_of_longitudes_and_of_metres_where_nothing_is_known(tmp_path):
    (line,) = read_breaklines(write(tmp_path, "a.csv", "lat,lon\n44.99,9.01\n44.98,9.02\n"), ground(LON_LAT)).lines
    np.testing.assert_allclose(line[:, :2], [[10, 10], [20, 20]], atol=1e-6)
    (line,) = read_breaklines(write(tmp_path, "b.csv", "x,y\n100,50\n120,50\n"), ground()).lines
    np.testing.assert_allclose(line[:, :2], [[10, 5], [12, 5]], atol=1e-9)


def test_what_lies_beside_is_told(tmp_path):
    text = "x,y\n0,0\n100,100\n\n9000,9000\n9100,9100\n\n5,5\n"
    found = read_breaklines(write(tmp_path, "a.csv", text), ground())
    assert len(found.lines) == 1
    assert any("beside" in note for note in found.notes)
    assert any("fewer than two points" in note for note in found.notes)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "empty"),
        ("{", "no JSON"),
        ('{"type": "FeatureCollection", "features": []}', "found none"),
        ('{"type": "LineString", "coordinates": [[1, 2], "x"]}', "points as"),
        ('{"type": "LineString", "coordinates": [[1, 2], [NaN, 2]]}', "points as"),
        ('{"type": "LineString", "coordinates": [[1, 2], [true, 2]]}', "points as"),
        ('{"type": "LineString", "coordinates": 7}', "list of points"),
        ('{"type": "LineString", "crs": 3, "coordinates": [[1, 2], [2, 3]]}', "crs"),
        (
            '{"type": "LineString", "crs": {"properties": {"name": "EPSG:1"}}, "coordinates": [[1, 2], [2, 3]]}',
            "EPSG:1",
        ),
        ('{"type": "LineString", "coordinates": [[100, 2], [101, 3]]}', "beside"),
        ("[" * 100_000, "nesting"),
        ("hello,world\n1,2\n", "header"),
        ("x,y\n1,two\n", "line 2"),
        ("x,y\n1\n", "line 2"),
        ("x,y,z\n1,2,inf\n3,4,5\n", "finite"),
        ("x,y\n1,2\n", "two points"),
    ],
)
def test_bad_files_are_answered_in_one_line(tmp_path, content, told):
    with pytest.raises(InputError, match=told) as caught:
        read_breaklines(write(tmp_path, "a.txt", content), ground(UTM))
    assert "\n" not in str(caught.value)


def test_no_file_no_text_no_place(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_breaklines(tmp_path / "none.csv", ground())
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        read_breaklines(tmp_path / "a.csv", ground())
    with pytest.raises(InputError, match="does not say where it lies"):
        read_breaklines(write(tmp_path, "a.json", feature([9.0, 45.0], [9.1, 45.0])), ground())
