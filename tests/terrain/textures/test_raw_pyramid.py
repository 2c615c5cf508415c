"""Raw pyramids: made once, whole or not at all, by several at once, within bounds."""

from __future__ import annotations

import os
import threading
import time

import numpy as np
import pytest

from terrain.textures.raw_pyramid import ABANDONED_S, RawPyramid, drop_oldest
from terrain.textures.tree import halve

SHAPES = [(1300, 700), (650, 350), (325, 175)]
PIXELS = np.random.default_rng(0).integers(0, 256, (1300, 700, 3), np.uint8)


@pytest.fixture(autouse=True)
def folder(own_cache):
    return own_cache / "textures"


def pyramid():
    return RawPyramid("key", 0, SHAPES, 3)


def read_rows(first, last):
    return PIXELS[first:last]


def is_right(made):
    levels = [PIXELS, halve(PIXELS), halve(halve(PIXELS))]
    return all(
        np.array_equal(made.level(k, slice(0, len(level))), level) for k, level in enumerate(levels)
    )  # fmt: skip


def test_what_is_built_is_found_again(folder):
    made = pyramid()
    assert not made.is_complete
    assert made.build(read_rows, threading.Event())
    assert made.is_complete
    assert is_right(made)
    again = pyramid()
    assert again.is_complete
    assert is_right(again)
    assert [path.suffix for path in folder.iterdir()] == [".pyramid"]


def test_several_may_build_the_same_at_once(folder):
    both = [pyramid(), pyramid()]
    meeting = threading.Barrier(2)

    def read(first, last):
        if first == 256:
            meeting.wait(5.0)  # both are in the middle of it
        return PIXELS[first:last]

    threads = [threading.Thread(target=each.build, args=(read, threading.Event())) for each in both]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(each.is_complete and is_right(each) for each in both)
    assert is_right(pyramid())
    assert [path.suffix for path in folder.iterdir()] == [".pyramid"]


def test_rows_can_be_read_as_soon_as_they_are_made():
    made = pyramid()
    seen = []

    def read(first, last):
        seen.append((made.level(0, slice(0, 256)) is not None, made.level(2, slice(0, 64)) is not None))
        return PIXELS[first:last]

    made.build(read, threading.Event())
    assert seen[0] == (False, False)
    assert seen[1] == (True, True)


def test_a_cancelled_or_failed_build_leaves_nothing(folder):
    cancelled = threading.Event()
    cancelled.set()
    assert not pyramid().build(read_rows, cancelled)

    def broken(first, last):
        raise OSError("damaged")

    assert not pyramid().build(broken, threading.Event())
    assert list(folder.iterdir()) == []
    assert not pyramid().is_complete


def test_a_file_of_another_size_counts_as_absent(folder):
    pyramid().build(read_rows, threading.Event())
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    assert not pyramid().is_complete


def test_the_longest_unused_are_dropped_and_so_is_what_was_abandoned(tmp_path):
    now_s = time.time()
    for name, age_s in (
        ("a.pyramid", 30),
        ("b.pyramid", 20),
        ("c.pyramid", 10),
        ("d.building", 2 * ABANDONED_S),
        ("e.building", 5),
    ):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (now_s - age_s, now_s - age_s))
    drop_oldest(tmp_path, 250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.pyramid", "c.pyramid", "e.building"]
