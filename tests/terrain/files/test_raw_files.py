"""Arrays and bare numbers: laid out as asked, as the JSON says, or refused in one line; never unpickled."""

from __future__ import annotations

import json

import numpy as np
import pytest

from terrain.errors import InputError
from terrain.files.sources import read_heightfield


def hills(rows=20, cols=30):
    row, col = np.mgrid[0:rows, 0:cols]
    return np.round(1000 + 7 * row + 3 * col + 40 * np.sin(row / 3))


@pytest.mark.parametrize("dtype", ["<i2", ">i2", "<u2", "u1", "<i4", ">f4", "<f8", "<f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_of_any_type_and_order_gives_its_heights(tmp_path, dtype, order):
    heights = np.array(hills() % 200, dtype, order=order)
    np.save(tmp_path / "a.npy", heights)
    found = read_heightfield(tmp_path / "a.npy")
    np.testing.assert_array_equal(found.heights_m, heights.astype(np.float32))


def test_npz_gives_its_only_grid(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", heights=hills(), spacing=np.array([1.0, 2.0]), name=np.array("hills"))
    found = read_heightfield(tmp_path / "a.npz")
    np.testing.assert_array_equal(found.heights_m, hills())
    np.savez(tmp_path / "b.npz", first=hills(), second=hills())
    with pytest.raises(InputError, match=r"expected exactly one two-dimensional array .* found first, second"):
        read_heightfield(tmp_path / "b.npz")


def test_nothing_is_ever_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (tmp_path.joinpath("sprung").touch, ())

    np.save(tmp_path / "a.npy", np.array([[Trap(), Trap()], [Trap(), Trap()]], object), allow_pickle=True)
    np.savez(tmp_path / "b.npz", heights=np.array([[Trap()] * 2] * 2, object), allow_pickle=True)
    for name in ("a.npy", "b.npz"):
        with pytest.raises(InputError, match="expected"):
            read_heightfield(tmp_path / name)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    "array", [np.zeros(9), np.zeros((3, 4, 5)), np.zeros((1, 9)), np.zeros((9, 9), complex), np.zeros((9, 9), bool)]
)
def test_arrays_that_are_no_grid_of_numbers_are_refused(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match="expected a"):
        read_heightfield(tmp_path / "a.npy")


def test_leading_axis_of_one_is_dropped(tmp_path):
    np.save(tmp_path / "a.npy", hills()[None])
    np.testing.assert_array_equal(read_heightfield(tmp_path / "a.npy").heights_m, hills())


def test_truncated_npy_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", hills())
    (tmp_path / "b.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-1])
    with pytest.raises(InputError, match=r"expected 4928 bytes in b\.npy, found 4927"):
        read_heightfield(tmp_path / "b.npy")


@pytest.mark.parametrize("layout", ["30x20,uint16,little", "30x20,int16", "30x20", " 30X20 , LE "])
def test_raw_layout_is_followed(tmp_path, layout):
    hills().astype("<u2").tofile(tmp_path / "a.bin")
    np.testing.assert_array_equal(read_heightfield(tmp_path / "a.bin", raw=layout).heights_m, hills())


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<i2", ">i2", "<f4", ">f4", "<i4", ">f8"])
def test_byte_order_is_found_by_smoothness(tmp_path, dtype):
    hills(200, 300).astype(dtype).tofile(tmp_path / "a.raw")
    found = read_heightfield(tmp_path / "a.raw", raw=f"300x200,{np.dtype(dtype).name}")
    np.testing.assert_array_equal(found.heights_m, hills(200, 300))
    word = "big" if dtype[0] == ">" else "little"
    assert f"Byte order {word}-endian: the smoother of the two readings." in found.notes


def test_square_r16_and_r32_need_no_layout(tmp_path):
    hills(25, 25).astype("<u2").tofile(tmp_path / "a.r16")
    hills(25, 25).astype("<f4").tofile(tmp_path / "b.r32")
    for name in ("a.r16", "b.r32"):
        np.testing.assert_array_equal(read_heightfield(tmp_path / name).heights_m, hills(25, 25))


def test_json_beside_gives_layout_heights_and_spacing(tmp_path):
    stored = (np.arange(600) * 100).astype("<u2").reshape(20, 30)
    stored.tofile(tmp_path / "valley_le.r16")
    facts = {"width": 30, "height": 20, "endian": "little", "min_m": 100, "max_m": 1100, "pixel_m_approx": [70, 90]}
    (tmp_path / "valley.json").write_text(json.dumps(facts))
    found = read_heightfield(tmp_path / "valley_le.r16")
    np.testing.assert_allclose(found.heights_m, 100 + stored / 65535 * 1000, rtol=1e-6)
    assert found.spacing_m == (70, 90)


def test_json_beside_a_grey_image_gives_heights_and_spacing(tmp_path):
    from PIL import Image

    stored = (np.arange(600) * 100).astype(np.uint16).reshape(20, 30)
    Image.fromarray(stored).save(tmp_path / "valley.png")
    (tmp_path / "valley.json").write_text('{"min_m": -50, "max_m": 50, "spacing_m": 5}')
    found = read_heightfield(tmp_path / "valley.png")
    np.testing.assert_allclose(found.heights_m, -50 + stored / 65535 * 100, atol=1e-4)
    assert found.spacing_m == (5, 5)


@pytest.mark.parametrize(
    "text",
    ["[1, 2]", "{", '{"min_m": "low", "spacing_m": [0, -1]}', '{"spacing_m": null}', '{"max_m": 1e999}', "[" * 60000],
)
def test_json_that_says_nothing_useful_is_left_alone(tmp_path, text):
    hills(25, 25).astype("<u2").tofile(tmp_path / "a.r16")
    (tmp_path / "a.json").write_text(text)
    found = read_heightfield(tmp_path / "a.r16")
    np.testing.assert_array_equal(found.heights_m, hills(25, 25))
    assert found.spacing_m == (30, 30)


@pytest.mark.parametrize(
    ("layout", "line"),
    [
        ("30x21", "expected 1260 bytes for 30 x 21 uint16"),
        ("30x20,float32", "expected 2400 bytes for 30 x 20 float32 in a.r16, found 1200"),
        ("30,20", "expected --raw WxH"),
        ("30x20,uint16,uint16", "expected --raw WxH"),
        ("30x20,object", "expected --raw WxH"),
        ("1x600", "expected a grid of at least 2 x 2 posts in a.r16, found 1 x 600"),
        ("0x0", "expected a width, height and type"),
        (None, "expected a width, height and type for the 1200 bytes of a.r16"),
    ],
)
def test_layouts_that_do_not_fit_give_one_line(tmp_path, layout, line):
    hills().astype("<u2").tofile(tmp_path / "a.r16")
    with pytest.raises(InputError, match=line):
        read_heightfield(tmp_path / "a.r16", raw=layout)


@pytest.mark.parametrize("text", ['{"width": "30"}', '{"dtype": "object"}', '{"endian": "middle"}', '{"width": -1}'])
def test_json_with_a_wrong_layout_gives_one_line(tmp_path, text):
    hills().astype("<u2").tofile(tmp_path / "a.r16")
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"expected a .* in a\.json, found"):
        read_heightfield(tmp_path / "a.r16")


@pytest.mark.parametrize("order", ["C", "F"])
def test_large_array_is_thinned_without_shifting_it(tmp_path, monkeypatch, order):
    monkeypatch.setattr("terrain.files.raster.MAX_SIDE", 100)
    heights = hills(250, 301)
    np.save(tmp_path / "a.npy", np.asarray(heights, order=order))
    found = read_heightfield(tmp_path / "a.npy")
    np.testing.assert_array_equal(found.heights_m, heights[::4, ::4])
    assert found.spacing_m == (120, 120)
