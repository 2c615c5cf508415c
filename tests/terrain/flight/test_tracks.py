"""Tracks of other programs become flights over the terrain they lie on; bad ones become one line."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import Flight, Keyframe, make_flight, write_flight
from terrain.flight.track_files import MAX_DEPTH, read_track_file
from terrain.flight.tracks import LEAST_ABOVE_M, UNTIMED_S, read_track, to_geographic, write_kml
from terrain.heightfield import Georeference, Heightfield

ROWS, COLS, SPACING_M = 41, 61, 25.0
HEIGHTS = np.fromfunction(lambda r, c: 500.0 + 5.0 * r + 60.0 * np.sin(c / 7.0), (ROWS, COLS)).astype(np.float32)
UTM = Georeference("EPSG:32632", (SPACING_M, 0.0, 600_000.0, 0.0, -SPACING_M, 5_200_000.0))
PLACED = Heightfield(HEIGHTS, (SPACING_M, SPACING_M), name="alp", georeference=UTM)
ADRIFT = Heightfield(HEIGHTS, (SPACING_M, SPACING_M), name="nowhere")
X, Z = np.linspace(200.0, 1300.0, 12), np.linspace(900.0, 150.0, 12)
LON, LAT = to_geographic(X, Z, PLACED)


def gpx(points, head=""):
    inner = "".join(f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}">{more}</trkpt>' for lon, lat, more in points)
    return f'<?xml version="1.0"?>{head}<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><name>Tour</name><trkseg>{inner}</trkseg></trk></gpx>'


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def test_gpx_is_flown_where_and_when_it_was_walked(tmp_path):
    points = [
        (lon, lat, f"<ele>{900 + i}</ele><time>2024-05-01T10:00:{2 * i:02d}Z</time>")
        for i, (lon, lat) in enumerate(zip(LON, LAT, strict=True))
    ]
    flight = read_track(written(tmp_path, "a.gpx", gpx(points)), PLACED)
    assert (flight.name, flight.terrain, flight.crs, flight.duration_s) == ("Tour", "alp", "EPSG:32632", 22.0)
    found = flight.positions_at(2.0 * np.arange(12))
    assert found[:, 0] == pytest.approx(X, abs=2.6)  # within a tenth of the spacing
    assert found[:, 2] == pytest.approx(Z, abs=2.6)
    assert found[:, 1] == pytest.approx(900.0 + np.arange(12), abs=2.6)
    middle = flight.camera_at(11.0)
    assert middle.yaw_deg == pytest.approx(np.degrees(np.arctan2(X[-1] - X[0], Z[0] - Z[-1])), abs=1.5)
    assert -15.0 < middle.pitch_deg < 0.0


@pytest.mark.parametrize("above_m", [5.0, 250.0])
def test_height_above_ground_replaces_the_files_heights(tmp_path, above_m):
    path = written(tmp_path, "a.gpx", gpx([(lon, lat, "<ele>9</ele>") for lon, lat in zip(LON, LAT, strict=True)]))
    flight = read_track(path, PLACED, above_ground_m=above_m, duration_s=30.0)
    assert flight.duration_s == pytest.approx(30.0)
    for key in flight.keyframes:
        x, y, z = key.camera.position_m
        assert y - PLACED.heights_at(x, z) == pytest.approx(above_m, abs=0.01)


def test_a_track_below_the_ground_is_lifted_above_it_and_one_without_times_is_even(tmp_path):
    path = written(tmp_path, "a.gpx", gpx([(lon, lat, "<ele>9</ele>") for lon, lat in zip(LON, LAT, strict=True)]))
    flight = read_track(path, PLACED)
    assert flight.duration_s == UNTIMED_S
    positions = np.array([key.camera.position_m for key in flight.keyframes])
    assert (positions[:, 1] - PLACED.heights_at(positions[:, 0], positions[:, 2]) >= LEAST_ABOVE_M - 1e-6).all()


def test_kml_lines_and_gx_tracks_are_read_with_their_altitude_modes(tmp_path):
    coordinates = " ".join(f"{lon:.9f},{lat:.9f},40" for lon, lat in zip(LON, LAT, strict=True))
    mode = "<altitudeMode>relativeToGround</altitudeMode>"
    line = f"<LineString>{mode}<coordinates>{coordinates}</coordinates></LineString>"
    kml = f'<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>n</name>{line}</Placemark></kml>'
    flight = read_track(written(tmp_path, "a.kml", kml), PLACED)
    x, y, z = flight.keyframes[0].camera.position_m
    assert y - PLACED.heights_at(x, z) == pytest.approx(40.0, abs=1e-3)
    when = "".join(f"<when>2024-05-01T10:00:{i:02d}Z</when>" for i in range(12))
    where = "".join(f"<gx:coord>{lon:.9f} {lat:.9f} 1200</gx:coord>" for lon, lat in zip(LON, LAT, strict=True))
    track = f"<gx:Track><altitudeMode>absolute</altitudeMode>{when}{where}</gx:Track>"
    kml = f'<kml xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark>{track}</Placemark></kml>'
    flight = read_track(written(tmp_path, "b.kml", kml), PLACED)
    assert (flight.duration_s, flight.keyframes[0].camera.position_m[1]) == (11.0, 1200.0)


@given(
    st.lists(
        st.tuples(st.floats(0, 1500), st.floats(770, 3000), st.floats(0, 1000), st.floats(-180, 180),
                  st.floats(-80, 30), st.floats(-60, 60), st.floats(20, 90)),
        min_size=2, max_size=6,
    )
)  # fmt: skip
@settings(max_examples=15)
def test_an_exported_tour_comes_back_as_it_was(tmp_path_factory, shots):
    keys = [Keyframe(2.0 * i, Camera((x, y, z), a, b, c, f)) for i, (x, y, z, a, b, c, f) in enumerate(shots)]
    flight = make_flight(keys, "there & <back>", PLACED)
    path = tmp_path_factory.mktemp("kml") / "a.kml"
    write_kml(flight, PLACED, path)
    back = read_track(path, PLACED)
    assert (back.name, back.duration_s) == (flight.name, pytest.approx(flight.duration_s))
    times = np.array([key.t_s for key in keys])
    distance_m, angle_deg, fov_deg = back.differences(flight, times)
    assert distance_m.max() < 0.02
    assert angle_deg.max() < 0.01
    assert fov_deg.max() < 0.01


def test_csv_columns_are_known_by_their_names(tmp_path):
    rows = "\n".join(f"{t};{lat:.9f};{lon:.9f};1500" for t, lat, lon in zip(range(12), LAT, LON, strict=True))
    flight = read_track(written(tmp_path, "a.csv", f"Time [s];Latitude;Longitude;Elevation (m)\n{rows}\n"), PLACED)
    assert flight.duration_s == 11.0
    assert flight.positions_at([0.0])[0] == pytest.approx([X[0], 1500.0, Z[0]], abs=0.01)
    world = "t,x,y,z,yaw,pitch\n0,100,900,100,10,-5\n4,500,950,300,20,-6\n"
    flight = read_track(written(tmp_path, "b.csv", world), ADRIFT)
    end = flight.camera_at(4.0)
    assert end.position_m == (500.0, 950.0, 300.0)
    assert (end.yaw_deg, end.pitch_deg, end.roll_deg) == pytest.approx((20.0, -6.0, 0.0))
    places = "easting,northing,height\n600100,5199900,1000\n600900,5199500,1100\n"
    flight = read_track(written(tmp_path, "c.csv", places), PLACED)
    assert flight.positions_at([0.0])[0] == pytest.approx([100.0, 1000.0, 100.0])


BOMB = '<!DOCTYPE g [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
NEAR = [(LON[0], LAT[0], ""), (LON[1], LAT[1], "")]
BAD = {
    "no.gpx": (None, "cannot be read"),
    "a.txt": ("x", "gpx"),
    "empty.gpx": ("", "XML"),
    "text.gpx": ("hello", "XML"),
    "cut.gpx": (gpx(NEAR)[:150], "XML"),
    "bomb.gpx": (gpx(NEAR, BOMB), "document type"),
    "external.kml": ('<!DOCTYPE k SYSTEM "file:///etc/passwd"><kml/>', "document type"),
    "deep.kml": ("<a>" * (MAX_DEPTH + 2), "nested"),
    "one.gpx": (gpx(NEAR[:1]), "2 points"),
    "nothing.kml": ("<kml/>", "2 points"),
    "words.gpx": ('<gpx><trkpt lat="x" lon="1"/></gpx>', "latitude"),
    "far.gpx": ('<gpx><trkpt lat="95" lon="1"/></gpx>', "degrees"),
    "nan.kml": ("<kml><LineString><coordinates>nan,1 2,2</coordinates></LineString></kml>", "longitude"),
    "beside.gpx": (gpx([(0.0, 0.0, ""), (1.0, 1.0, "")]), "beside"),
    "head.csv": ("1,2,3\n4,5,6\n", "names the columns"),
    "short.csv": ("lon,lat,height\n9\n", "line 2"),
    "word.csv": ("lon,lat,height\n9,47,high\n", "line 2"),
    "still.csv": ("t,x,y,z\n0,9,9,9\n0,8,8,8\n", None),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_tracks_are_told_in_one_line(tmp_path, name):
    text, expected = BAD[name]
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    if expected is None:  # times that stand still are no times
        assert read_track(path, PLACED).duration_s > 0.0
        return
    with pytest.raises(InputError, match=expected) as caught:
        read_track(path, PLACED)
    assert "\n" not in str(caught.value)


@given(st.binary(max_size=300), st.sampled_from([".gpx", ".kml", ".csv"]))
@settings(max_examples=60)
def test_any_bytes_are_a_track_or_one_line(tmp_path_factory, data, suffix):
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    path.write_bytes(data)
    with contextlib.suppress(InputError):
        read_track_file(path)


def test_a_terrain_without_a_place_takes_no_gpx_and_gives_no_kml(tmp_path):
    with pytest.raises(InputError, match="coordinate system"):
        read_track(written(tmp_path, "a.gpx", gpx(NEAR)), ADRIFT)
    with pytest.raises(InputError, match="coordinate system"):
        write_kml(Flight((Keyframe(0.0, Camera((0, 0, 0))),)), ADRIFT, tmp_path / "a.kml")
    assert [path.name for path in tmp_path.iterdir()] == ["a.gpx"]


def test_nothing_is_overwritten(tmp_path):
    flight = make_flight([Keyframe(0.0, Camera((0, 900, 0))), Keyframe(1.0, Camera((9, 900, 9)))], "f", PLACED)
    for name, write in (
        ("a.kml", lambda path: write_kml(flight, PLACED, path)),
        ("a.json", lambda path: write_flight(flight, path)),
    ):
        path = written(tmp_path, name, "mine")
        with pytest.raises(InputError, match="exists"):
            write(path)
        assert path.read_text() == "mine"
