"""Coordinates there and back, as people type them, and refused where they make no sense."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.places.coordinates import Coordinates, latlon, metres, read_latlon, read_pair, wind
from terrain.errors import InputError
from terrain.heightfield import Georeference, Heightfield

UTM = Georeference("EPSG:32611", (30.0, 0.0, 260000.0, 0.0, -30.0, 4190000.0))
DEGREES = Georeference("EPSG:4326", (1 / 1200, 0.0, 7.5, 0.0, -1 / 1200, 46.9), True)
NAD27 = Georeference("EPSG:4267", (1 / 1200, 0.0, -119.5, 0.0, -1 / 1200, 37.9), True)
ROTATED = Georeference("EPSG:32611", (26.0, 15.0, 260000.0, 15.0, -26.0, 4190000.0))
LOCAL = Georeference('LOCAL_CS["a mine",UNIT["metre",1]]', (1.0, 0.0, 0.0, 0.0, -1.0, 100.0))
share = st.floats(0.0, 1.0)


def terrain(georeference=None):
    return Heightfield(np.zeros((101, 151), np.float32), (30.0, 25.0), georeference=georeference)


@pytest.mark.parametrize("georeference", [UTM, DEGREES, NAD27, ROTATED])
@pytest.mark.parametrize("system", ["local", "map", "latlon"])
@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (0.3, 0.8), (1.0, 1.0)])
def test_places_come_back_from_every_system(georeference, system, u, v):
    coordinates = Coordinates(terrain(georeference))
    x, z = u * 4500.0, v * 2500.0
    place = coordinates.place(x, z)
    pair = {"local": place.local_m, "map": place.map_xy, "latlon": place.latlon_deg}[system]
    assert coordinates.read(f"{pair[0]:.9f}, {pair[1]:.9f}", system) == pytest.approx((x, z), abs=0.01)


def test_latitudes_are_those_of_other_programs():
    """Mount Whitney: 36.5785 N 118.2920 W is 384,351 E 4,048,880 N in UTM zone 11."""
    whitney = Georeference("EPSG:32611", (30.0, 0.0, 384351.0, 0.0, -30.0, 4048880.0))
    latitude, longitude = Coordinates(terrain(whitney)).place(0.0, 0.0).latlon_deg
    assert (latitude, longitude) == pytest.approx((36.5785, -118.2920), abs=3e-3)


def test_another_datum_is_taken_into_account():
    place = Coordinates(terrain(NAD27)).place(0.0, 0.0)
    assert place.map_xy == (-119.5, 37.9)
    off_m = np.hypot(*((np.array(place.latlon_deg) - (37.9, -119.5)) * (111e3, 88e3)))
    assert 30.0 < off_m < 150.0


def test_a_terrain_that_does_not_say_where_it_lies_knows_local_metres_only():
    coordinates = Coordinates(terrain())
    assert coordinates.known == ["local"]
    assert coordinates.place(3.0, 4.0) == ((3.0, 4.0), None, None)
    with pytest.raises(InputError, match="local metres"):
        coordinates.read("1, 2", "map")


def test_a_coordinate_system_off_the_globe_knows_no_latitudes():
    coordinates = Coordinates(terrain(LOCAL))
    assert coordinates.known == ["local", "map"]
    assert coordinates.place(0.0, 0.0).latlon_deg is None
    with pytest.raises(InputError, match="no latitudes"):
        coordinates.read("1, 2", "latlon")


def test_map_units_have_names():
    feet = Georeference("EPSG:2227", (100.0, 0.0, 6e6, 0.0, -100.0, 2e6))
    assert [Coordinates(terrain(g)).map_unit for g in (UTM, feet, DEGREES, None)] == ["m", "ft", "°", ""]


@pytest.mark.parametrize("text", ["1200 3400", "1200, 3400", " 1200;3400 ", "1.2e3,\t3400.0"])
def test_pairs_are_read_however_they_are_separated(text):
    assert read_pair(text) == (1200.0, 3400.0)


@pytest.mark.parametrize("text", ["", "1200", "1 2 3", "here, there", "nan, 3", "1, inf"])
def test_what_is_no_pair_is_refused_in_one_line(text):
    with pytest.raises(InputError) as refused:
        read_pair(text)
    assert "\n" not in str(refused.value)
    assert "Expected two" in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        "46.5, -7.25", "46.5 -7.25", "46.5N 7.25W", "46.5° N, 7.25° W", "46°30'N 7°15'W",
        "46°30'0\"N 7°15'0\"W", "7.25W 46.5N", "+46.5; -7.25",
    ],
)  # fmt: skip
def test_latitudes_are_read_however_they_are_written(text):
    assert read_latlon(text) == pytest.approx((46.5, -7.25))


@pytest.mark.parametrize("text", ["", "46.5", "91, 7", "46, 400", "46N 7N", "46.5, seven", "1 2 3", "46°", "46E 7E"])
def test_what_is_no_latitude_and_longitude_is_refused(text):
    with pytest.raises(InputError, match="Expected latitude and longitude"):
        read_latlon(text)


@given(st.text(max_size=30))
def test_nothing_typed_breaks_anything(text):
    coordinates = Coordinates(terrain(DEGREES))
    for system in coordinates.known:
        try:
            x, z = coordinates.read(text, system)
        except InputError:
            continue
        assert 0.0 <= x <= 4500.0
        assert 0.0 <= z <= 2500.0


@pytest.mark.parametrize(
    ("system", "text", "told"),
    [("local", "9999, 1", "0 to 4,500 m east"), ("map", "0, 0", "x from"), ("latlon", "10, 10", "latitudes from 46.")],
)
def test_beside_the_terrain_one_is_told_where_it_lies(system, text, told):
    with pytest.raises(InputError, match=told):
        Coordinates(terrain(DEGREES)).read(text, system)


def test_words_have_units():
    assert (metres(12.34), metres(1234.5), metres(123456.0)) == ("12.3 m", "1,234 m", "123.46 km")
    assert [wind(a) for a in (None, 0.0, 44.0, 312.0, 359.0)] == ["flat", "N (0°)", "NE (44°)", "NW (312°)", "N (359°)"]
    assert latlon((46.5, -7.25)) == "46.50000° N  7.25000° W"
