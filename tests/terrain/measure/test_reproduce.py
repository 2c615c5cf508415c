"""The frame of the reproductions, and the tables of the geomorphing tiles on a small terrain."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.measure.papers import geomorph
from terrain.measure.papers.geomorph import PAPER_FPS, Plan, coarsened, measure
from terrain.measure.reproduce import (
    Claim,
    Plot,
    Reproduction,
    Table,
    format_table,
    reproduce,
    reproducible,
    write_reproduction,
)

TABLE = Table(
    "table1", "Table 1: speeds", ("size", "ours [fps]", "paper [fps]"), [("513", 61.25, 66), ("1025", None, 28)]
)
SPEEDS = {"ours": [(513.0, 61.0), (1025.0, 30.0)], "paper": [(513.0, 66.0)]}
FOUND = Reproduction(
    [TABLE],
    [Plot("speeds", "Speeds", "size", "fps", SPEEDS, log_y=True)],
    [Claim("it is fast", "66 fps", "61.25 fps", False)],
)


def bumps(posts: int) -> Heightfield:
    z, x = np.mgrid[:posts, :posts] * (20.0 / (posts - 1))
    spacing = 1280.0 / (posts - 1)
    return Heightfield((50 * np.sin(x) * np.cos(z) + 9 * np.sin(7 * x)).astype(np.float32), (spacing, spacing))


def test_tables_plots_and_claims_are_written(tmp_path) -> None:
    paths = write_reproduction(tmp_path, "geomorph", {"cpu": "one"}, FOUND)
    names = [path.name for path in paths]
    assert names == ["reproduction.json", "table1.csv", "speeds.png", "speeds.svg"]
    assert all(path.stat().st_size > 30 for path in paths)
    record = json.loads(paths[0].read_text())
    assert record["source"].startswith("Larsen")
    assert record["tables"][0]["rows"][1] == ["1025", None, 28]
    assert record["claims"][0]["held"] is False
    rows = list(csv.reader(paths[1].read_text().splitlines()))
    assert rows == [["size", "ours [fps]", "paper [fps]"], ["513", "61.25", "66"], ["1025", "", "28"]]


def test_a_table_as_text_is_aligned() -> None:
    title, *lines = format_table(FOUND.tables[0]).splitlines()
    assert title == "Table 1: speeds"
    assert len({len(line) for line in lines}) == 1
    assert lines[2].split() == ["1025", "-", "28"]


def test_a_row_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="2 cells"):
        Table("t", "T", ("a", "b"), [(1,)])


def test_an_unknown_algorithm_is_refused_with_those_that_are_known(gpu, tmp_path) -> None:
    assert "geomorph" in reproducible()
    with pytest.raises(InputError, match="geomorph"):
        reproduce("reference", gpu, tmp_path, print)


def test_the_same_mesh_is_taken_at_other_resolutions() -> None:
    fine = bumps(65)
    coarse = coarsened(fine, 17)
    assert coarse.extent_m == pytest.approx(fine.extent_m)
    assert np.array_equal(coarse.heights_m, fine.heights_m[::4, ::4])
    with pytest.raises(ValueError, match="divides"):
        coarsened(fine, 18)


def test_tables_2_and_7_are_measured(gpu) -> None:
    cameras = [Camera((200.0 + 100 * i, 150.0, 1200.0), 20.0, -15.0) for i in range(3)]
    told = []
    found = measure(
        gpu, bumps(129), cameras, Plan((65, 129), (9, 17), 3, (96, 64)), lambda share, doing: told.append(share)
    )  # fmt: skip
    speed, levels = found.tables
    assert [row[:2] for row in speed.rows] == [
        ["65 x 65", "9 x 9"], ["65 x 65", "17 x 17"], ["129 x 129", "9 x 9"], ["129 x 129", "17 x 17"]
    ]  # fmt: skip
    assert all(row[2] > 0 and row[3] > 0 and row[5] > 0 for row in speed.rows)
    assert [row[2] for row in levels.rows] == pytest.approx([row[3] for row in levels.rows], abs=0.01)
    assert len(found.plots) == 2
    assert found.claims[-1].held
    assert told[0] == 0.0
    assert told[-1] == 1.0


def test_the_paper_s_numbers_stand_beside_ours() -> None:
    row = geomorph._Row(1025, 17, (50.0, 51.0, 60.0), 1234)
    table = geomorph._speed_table([row])
    assert tuple(table.rows[0][-2:]) == PAPER_FPS[1025, 17]
    assert table.rows[0][4] == pytest.approx(2.0)
