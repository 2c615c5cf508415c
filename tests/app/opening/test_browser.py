"""The file dialog shows what can be opened, and goes where it is told."""

from __future__ import annotations

import pytest

from app.opening.browser import Browser


@pytest.fixture
def browser(tmp_path):
    (tmp_path / "Alps").mkdir()
    for name in ("b.TIF", "a.hgt", "photo.jpg", "tour.flight.json", "way.gpx", "notes.txt", ".hidden.tif"):
        (tmp_path / name).write_text("x")
    return Browser(tmp_path)


def names(browser):
    return [entry.label for entry in browser.entries()]


def test_folders_come_first_then_what_can_be_opened(browser):
    assert names(browser) == ["Alps/", "a.hgt", "b.TIF", "photo.jpg", "tour.flight.json", "way.gpx"]
    browser.shows_all = True
    assert "notes.txt" in names(browser)
    assert ".hidden.tif" not in names(browser)


def test_what_appears_in_the_folder_is_shown(browser, tmp_path):
    names(browser)
    (tmp_path / "new.tif").write_text("x")
    assert "new.tif" in names(browser)


def test_names_and_paths_lead_to_folders_and_files(browser, tmp_path):
    assert browser.go("Alps") is None
    assert browser.folder == tmp_path / "Alps"
    assert browser.go("../a.hgt") == tmp_path / "a.hgt"
    browser.up()
    assert browser.folder == tmp_path
    assert browser.go(f" {tmp_path / 'b.TIF'} ") == tmp_path / "b.TIF"


def test_what_is_not_there_is_told(browser, tmp_path):
    assert browser.go("nothing.tif") is None
    assert "nothing.tif" in browser.problem
    assert browser.folder == tmp_path
    assert browser.go("\0") is None
    browser.folder = tmp_path / "gone"
    assert names(browser) == []
    assert "gone" in browser.problem
