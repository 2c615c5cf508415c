"""An archive gives the one terrain inside, whatever lies beside it, or says what it found."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from terrain.errors import InputError
from terrain.files.sources import read_heightfield
from terrain.files.unpack import choose_entry


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (["N37W120.hgt"], "N37W120.hgt"),
        (["a/dem.tif", "a/dem.tfw", "a/dem.tif.aux.xml", "a/readme.txt", "a/thumb.jpg"], "a/dem.tif"),
        (["dem.flt", "dem.hdr", "dem.prj"], "dem.flt"),
        (["grid/hdr.adf", "grid/w001001.adf", "grid/sta.adf", "info/arc.dir.txt"], "grid/hdr.adf"),
        (["tile.png", "tile.json"], "tile.png"),
    ],
)
def test_the_terrain_among_other_files_is_chosen(names, chosen):
    assert choose_entry(names, "x.zip") == chosen


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ([], "found none"),
        (["readme.txt"], "found none"),
        (["a.hgt", "b.hgt"], r"found 2 \(a\.hgt, b\.hgt\)"),
        ([f"{i}.tif" for i in range(9)], r"found 9 \(0\.tif, 1\.tif, 2\.tif, 3\.tif \.\.\.\)"),
    ],
)
def test_none_or_several_are_refused(names, found):
    with pytest.raises(InputError, match=f"expected exactly one terrain in x.zip, {found}"):
        choose_entry(names, "x.zip")


def test_header_beside_the_data_comes_along(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("in/dem.flt", np.arange(6, dtype="<f4").tobytes())
        archive.writestr(
            "in/dem.hdr",
            "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 25\nNODATA_value -9999\nbyteorder LSBFIRST",
        )
    found = read_heightfield(tmp_path / "a.zip")
    np.testing.assert_array_equal(found.heights_m, [[0, 1, 2], [3, 4, 5]])
    assert found.spacing_m == (25, 25)
    assert found.name == "dem"


@pytest.mark.parametrize("suffix", [".zip", ".gz", ".bz2"])
def test_damaged_archives_give_one_line(tmp_path, suffix):
    path = tmp_path / f"a.tif{suffix}"
    path.write_bytes(b"PK\x03\x04 not really")
    with pytest.raises(InputError, match=f"expected an intact {suffix} file, found a.tif{suffix}"):
        read_heightfield(path)


def test_arrays_inside_archives_are_read(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(6.0).reshape(2, 3))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "a.npy", "a.npy")
    np.testing.assert_array_equal(read_heightfield(tmp_path / "a.zip").heights_m, np.arange(6.0).reshape(2, 3))
