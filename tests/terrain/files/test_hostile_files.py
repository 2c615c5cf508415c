"""Broken, lying and oversized files give terrain or one line: no crash, no hang, no gigabytes, nothing printed."""

from __future__ import annotations

import gzip
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("resource", reason="limits on children need POSIX")
RUNNER = Path(__file__).with_name("hostile_runner.py")
LIMIT_S, LIMIT_MIB = 20, 1024
ASCII_GRID = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 30\n1 2\n3 4\n"


def outcomes(paths, **environment):
    """What becomes of each file, read in a child of its own."""
    command = [sys.executable, "-W", "error", str(RUNNER), *map(str, paths)]
    finished = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment)
    reports = [json.loads(line) for line in finished.stdout.splitlines()]
    assert [report["path"] for report in reports] == [str(path) for path in paths]
    return reports


def assert_harmless(report):
    kind, _, text = report["outcome"].partition(": ")
    assert kind in ("terrain", "line"), report
    assert kind == "terrain" or text.startswith("expected "), report
    assert text.isprintable(), report
    assert report["printed"] == "", report
    assert report["seconds"] < LIMIT_S, report
    assert report["peak_mib"] < LIMIT_MIB, report


def test_collected_hostile_files_do_no_harm(dem):
    reports = outcomes(sorted(path for path in dem("hostile").rglob("*") if path.is_file()))
    assert len(reports) > 80
    for report in reports:
        assert_harmless(report)


def png_that_claims(side):
    """A greyscale PNG whose header promises side^2 posts."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes((side + 1) * 16))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def sparse_tif(path, side, block, dtype="int16"):
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=side,
        height=side,
        count=1,
        dtype=dtype,
        crs="EPSG:32611",
        transform=rasterio.Affine(30, 0, 0, 0, -30, 0),
        tiled=True,
        blockxsize=block,
        blockysize=block,
        compress="deflate",
        sparse_ok=True,
        BIGTIFF="YES",
    ):
        pass
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Outcomes of files made here, by name."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "claims.asc").write_text("ncols 2000000\nnrows 2000000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n")
    sparse_tif(folder / "wide.tif", 200_000, 512)
    sparse_tif(folder / "thick.tif", 20_000, 8192, "float64")
    (folder / "claims.png").write_bytes(png_that_claims(40_000))
    (folder / "bomb.tif.gz").write_bytes(gzip.compress(bytes(1 << 24)) * 65)  # members in a row unpack to 1040 MB
    for name, size in (("claims.zip", 3 << 30), ("lies.zip", 10)):
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("heights.asc", ASCII_GRID * 100)
            archive.filelist[0].file_size = size
    with (folder / "claims.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 10**9)})
    with (folder / "sparse.r32").open("wb") as file:
        file.truncate(20_000 * 20_000 * 4)
    with (folder / "sparse.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": True, "shape": (90_000, 90_000)})
        file.truncate(128 + 90_000**2 * 8)
    (folder / "vast.vrt").write_text(
        '<VRTDataset rasterXSize="1000000" rasterYSize="1000000"><VRTRasterBand dataType="Byte" band="1"/></VRTDataset>'
    )
    (folder / "self.vrt").write_text(
        '<VRTDataset rasterXSize="99" rasterYSize="99"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        '<SourceFilename relativeToVRT="1">self.vrt</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>'
    )
    with zipfile.ZipFile(folder / "escape.zip", "w") as archive:
        archive.writestr("../../escaped.asc", ASCII_GRID)
    temporary = folder / "away" / "temporary"
    files = sorted(folder.iterdir())
    temporary.mkdir(parents=True)
    reports = {Path(report["path"]).name: report for report in outcomes(files, TMPDIR=str(temporary))}
    return reports | {"left": [path for path in folder.rglob("*") if path.is_file() and path not in files]}


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("claims.asc", "line: expected 2000000 x 2000000 numbers in claims.asc, found "),
        ("wide.tif", "line: expected at most 4096 MB of posts in a GTiff file, found 200000 x 200000"),
        ("thick.tif", "line: expected rows of blocks below 300 MB in thick.tif"),
        ("claims.png", "line: expected at most 400 MB of posts in a PNG file"),
        ("bomb.tif.gz", "line: expected at most 1024 MB unpacked"),
        ("claims.zip", "line: expected at most 1024 MB unpacked"),
        ("lies.zip", "line: expected an intact .zip file, found lies.zip"),
        ("claims.npy", "line: expected 8000000000000000"),
        ("sparse.npy", "line: expected at most 4096 MB to be read from sparse.npy"),
        ("sparse.r32", "terrain: 6667 x 6667"),
        ("vast.vrt", "line: expected at most 4096 MB of posts in a VRT file"),
        ("self.vrt", "line: expected 99 x 99 readable posts in self.vrt"),
        ("escape.zip", "terrain: 2 x 2"),
    ],
)
def test_made_hostile_files_do_no_harm(made, name, line):
    assert_harmless(made[name])
    assert made[name]["outcome"].startswith(line)


def test_archives_leave_nothing_behind_and_write_nowhere_else(made):
    assert made["escape.zip"]["outcome"].startswith("terrain")
    assert made["left"] == []


def test_a_pipe_is_not_waited_for(tmp_path):
    from terrain.errors import InputError
    from terrain.files.sources import read_heightfield

    os.mkfifo(tmp_path / "pipe.tif")
    with pytest.raises(InputError, match="found a device"):
        read_heightfield(tmp_path / "pipe.tif")
