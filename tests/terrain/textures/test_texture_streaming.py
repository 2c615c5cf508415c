"""Worker threads: urgent tiles first, failures told once, nothing left behind."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from terrain.textures.streaming import MOST_RESULTS, Request, TileStream
from terrain.textures.tree import SLOT_PX, TileNotReady

PIXELS = np.zeros((SLOT_PX, SLOT_PX, 4), np.uint8)


class Recorder:
    """A source that remembers what was read, and waits until it may."""

    name, size_px, notes, revision, is_final = "recorder", (9999, 9999), (), 3, True

    def __init__(self, fails=(), waits_for=None):
        self.read, self._fails, self._gate = [], set(fails), waits_for

    def read_tile(self, level, row, col):
        if self._gate is not None:
            self._gate.wait(5.0)
        self.read.append(col)
        if col in self._fails:
            raise OSError("two\nlines")
        return PIXELS


@pytest.fixture
def stream():
    made = TileStream(workers=1)
    yield made
    made.release()
    assert not any(thread.name.startswith("tiles-") for thread in threading.enumerate())


def requests(source, cols, handle=0):
    return [Request(handle, col, source, 0, 0, col) for col in cols]


def collect(stream, count, within_s=5.0):
    found, until_s = [], time.monotonic() + within_s
    while len(found) < count and time.monotonic() < until_s:
        stream.wait(0.05)
        found += stream.collect(100)
    return found


def test_the_newest_list_decides_what_is_read_next(stream):
    gate = threading.Event()
    source = Recorder(waits_for=gate)
    stream.want(requests(source, [1, 2, 3]))
    while not stream._reading:  # the worker has taken the first one
        time.sleep(0.001)
    stream.want(requests(source, [7, 3]))
    gate.set()
    assert [result.number for result in collect(stream, 3)] == [1, 7, 3]
    assert source.read == [1, 7, 3]


def test_what_is_read_already_is_not_read_twice(stream):
    source = Recorder()
    for _ in range(5):
        stream.want(requests(source, [1, 2]))
        time.sleep(0.01)
    assert sorted(result.number for result in collect(stream, 2)) == [1, 2]
    assert stream.collect(9) == []
    assert sorted(source.read) == [1, 2]


def test_workers_stop_when_nobody_takes_what_they_read(stream):
    source = Recorder()
    stream.want(requests(source, range(3 * MOST_RESULTS)))
    time.sleep(0.2)
    assert len(source.read) <= MOST_RESULTS + 1


def test_failures_are_told_once_in_one_line_and_given_as_tiles_without_pixels(stream):
    source = Recorder(fails={1, 2})
    stream.want(requests(source, [1, 2, 3]))
    found = {result.number: result for result in collect(stream, 3)}
    assert found[1].pixels is None
    assert found[2].pixels is None
    assert found[3].pixels is PIXELS
    assert found[3].revision == 3
    (message,) = stream.take_messages()
    assert "recorder" in message
    assert "\n" not in message
    assert stream.take_messages() == []


def test_a_tile_that_is_not_ready_is_asked_for_again_later(stream):
    class Late(Recorder):
        def read_tile(self, level, row, col):
            super().read_tile(level, row, col)
            if len(self.read) < 2:
                raise TileNotReady
            return PIXELS

    source = Late()
    until_s = time.monotonic() + 5.0
    while not (found := stream.collect(1)) and time.monotonic() < until_s:
        stream.want(requests(source, [4]))
        stream.wait(0.02)
    assert found[0].number == 4
    assert source.read == [4, 4]


def test_what_is_forgotten_brings_no_results(stream):
    gate = threading.Event()
    stream.want(requests(Recorder(waits_for=gate), [1, 2, 3], handle=8))
    while not stream._reading:  # a slow machine has not woken the thread yet
        time.sleep(0.001)
    threading.Timer(0.05, gate.set).start()
    stream.forget(8)  # returns when nothing of it is being read
    assert gate.is_set()
    assert stream.collect(9) == []
    assert stream.loading == 0
