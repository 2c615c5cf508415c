"""Bookmarks outlive the program, belong to one terrain, and nothing that happens to their file loses them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from app.places.bookmarks import Bookmark, Bookmarks
from app.places.framing import ground_m
from terrain.camera import Camera

VIEW = Camera((120.0, 90.0, 80.0), 33.0, -12.0, 0.0, 50.0)


def opened(hills, folder):
    return Bookmarks(hills, folder)


def kept(hills, folder, *names):
    bookmarks = opened(hills, folder)
    for name in names:
        bookmarks.add(Bookmark.of(name, VIEW, hills))
    return bookmarks


def test_bookmarks_outlive_the_program(hills, tmp_path):
    kept(hills, tmp_path, "above the pass", "Gipfel ü")
    again = opened(hills, tmp_path)
    assert [b.name for b in again.all] == ["above the pass", "Gipfel ü"]
    view = again.all[0].view(hills)
    assert view.position_m == pytest.approx(VIEW.position_m)
    assert replace(view, position_m=VIEW.position_m) == VIEW
    assert not again.problem
    assert not list(tmp_path.rglob("*.part"))


def test_a_view_keeps_its_height_above_the_ground_when_the_terrain_is_exaggerated(hills, tmp_path):
    bookmark = kept(hills, tmp_path, "a").all[0]
    tall = hills.exaggerated(3.0)
    height = VIEW.position_m[1] - ground_m(hills, 120.0, 80.0)
    assert bookmark.view(tall).position_m[1] - ground_m(tall, 120.0, 80.0) == pytest.approx(height)


def test_every_terrain_has_its_own(hills, tmp_path):
    kept(hills, tmp_path, "a")
    other = replace(hills, heights_m=hills.heights_m + np.float32(1.0))
    assert opened(other, tmp_path).all == ()
    renamed = replace(hills, name="../../etc/passwd\0")
    assert opened(renamed, tmp_path).all == ()
    kept(renamed, tmp_path, "b")
    assert all(path.parent == tmp_path / "bookmarks" for path in tmp_path.rglob("*.json"))


def test_two_windows_do_not_lose_each_others_bookmarks(hills, tmp_path):
    one, other = opened(hills, tmp_path), opened(hills, tmp_path)
    one.add(Bookmark.of("one", VIEW, hills))
    other.add(Bookmark.of("other", VIEW, hills))
    assert [b.name for b in opened(hills, tmp_path).all] == ["one", "other"]


def test_a_terrain_whose_file_changed_keeps_its_bookmarks(hills, tmp_path):
    old = kept(hills, tmp_path, "a", "b")
    changed = replace(hills, heights_m=hills.heights_m + np.float32(1.0))
    opened(changed, tmp_path).take_over(old)
    assert [b.name for b in opened(changed, tmp_path).all] == ["a", "b"]
    opened(changed, tmp_path).add(Bookmark.of("c", VIEW, changed))
    opened(changed, tmp_path).take_over(old)
    assert [b.name for b in opened(changed, tmp_path).all] == ["a", "b", "c"]


def test_bookmarks_are_renamed_replaced_and_removed(hills, tmp_path):
    bookmarks = kept(hills, tmp_path, "View 1", "b", "c")
    assert bookmarks.free_name() == "View 2"
    bookmarks.rename("b", "  the hut ")
    bookmarks.rename("c", "")
    bookmarks.rename("c", "the hut")
    bookmarks.remove("View 1")
    bookmarks.add(Bookmark.of("c", replace(VIEW, yaw_deg=1.0), hills))
    again = opened(hills, tmp_path)
    assert [b.name for b in again.all] == ["the hut", "c"]
    assert again.all[1].camera.yaw_deg == 1.0


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "other"}', '{"format": "reliefscope-bookmarks"}',
             '{"format": "reliefscope-bookmarks", "bookmarks": [{"name": "a"}]}',
             '{"format": "reliefscope-bookmarks", "bookmarks": [7]}', "\udcff" ]
)  # fmt: skip
def test_a_damaged_file_is_kept_aside_and_said_in_one_line(hills, tmp_path, text):
    kept(hills, tmp_path, "a")
    (path,) = tmp_path.rglob("*.json")
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    bookmarks = opened(hills, tmp_path)
    assert bookmarks.all == ()
    assert bookmarks.problem
    assert "\n" not in bookmarks.problem
    bookmarks.add(Bookmark.of("new", VIEW, hills))
    files = {p.name: p.read_bytes() for p in tmp_path.rglob("*.json")}
    assert text.encode("utf-8", "surrogateescape") in files.values()
    assert [b.name for b in opened(hills, tmp_path).all] == ["new"]


def test_values_that_make_no_camera_count_as_damage(hills, tmp_path):
    kept(hills, tmp_path, "a")
    (path,) = tmp_path.rglob("*.json")
    record = json.loads(path.read_text())
    record["bookmarks"][0]["fov"] = 500.0
    path.write_text(json.dumps(record))
    assert opened(hills, tmp_path).problem


def test_of_two_bookmarks_of_one_name_the_later_counts(hills, tmp_path):
    kept(hills, tmp_path, "a", "b")
    (path,) = tmp_path.rglob("*.json")
    path.write_text(path.read_text().replace('"b"', '"a"'))
    assert [b.name for b in opened(hills, tmp_path).all] == ["a"]


def test_a_folder_that_cannot_be_written_is_said_and_nothing_is_lost_meanwhile(hills, tmp_path):
    (tmp_path / "bookmarks").write_text("a file where the folder should be")
    bookmarks = kept(hills, tmp_path, "a", "b")
    assert "bookmarks" in bookmarks.problem
    assert [b.name for b in bookmarks.all] == ["a", "b"]


def test_without_a_folder_bookmarks_last_as_long_as_the_session(hills):
    bookmarks = kept(hills, None, "a", "b")
    assert [b.name for b in bookmarks.all] == ["a", "b"]
    assert not bookmarks.problem
