"""Preferences outlive the program, whatever happens to their file."""

from __future__ import annotations

import json

import pytest

from app.session.preferences import FILE_NAME, LAYOUT_NAME, RECENT_FILES, PreferenceFile, Preferences, config_folder


def test_what_was_chosen_is_there_in_the_next_run(tmp_path):
    first = PreferenceFile(tmp_path / "new" / "folder")
    first.change(theme="light", ui_scale=1.5, vsync=False, open_windows={"laboratory": True})
    first.remember_file("/data/höhe.tif")
    second = PreferenceFile(tmp_path / "new" / "folder")
    assert second.current == first.current
    assert second.current.theme == "light"
    assert second.current.recent_files[0].endswith("höhe.tif")
    assert second.problem == ""


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kept = PreferenceFile(None)
    kept.change(theme="light")
    assert kept.current.theme == "light"
    kept.write_layout("[Window]")
    assert kept.read_layout() == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["", "{", '{"theme": ', "[1, 2]", '{"format": "other"}', "\x00\xff", "[" * 100_000])
def test_a_damaged_file_is_kept_aside_and_the_defaults_hold(tmp_path, text):
    path = tmp_path / FILE_NAME
    path.write_text(text, encoding="utf-8")
    found = PreferenceFile(tmp_path)
    assert found.current == Preferences()
    (aside,) = tmp_path.glob("preferences-damaged-*.json")
    assert aside.read_text(encoding="utf-8") == text
    assert str(aside) in found.problem
    found.change(theme="light")
    assert PreferenceFile(tmp_path).current.theme == "light"
    assert aside.exists()


def test_a_file_that_is_no_text_is_kept_aside(tmp_path):
    (tmp_path / FILE_NAME).write_bytes(b"\xff\xfe\x80")
    assert PreferenceFile(tmp_path).current == Preferences()
    assert len(list(tmp_path.glob("preferences-damaged-*.json"))) == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [("theme", "pink"), ("ui_scale", 99), ("ui_scale", "1"), ("ui_scale", True), ("frame_limit_fps", 30.5),
     ("vsync", 1), ("recent_files", "a"), ("recent_files", [1]), ("open_windows", {"a": 2}), ("ui_scale", None)],
)  # fmt: skip
def test_a_wrong_value_takes_the_default_and_spoils_no_other(tmp_path, name, value):
    record = {"format": "reliefscope-preferences", "shows_legend": False, "unknown": 1, name: value}
    (tmp_path / FILE_NAME).write_text(json.dumps(record), encoding="utf-8")
    found = PreferenceFile(tmp_path).current
    assert getattr(found, name) == getattr(Preferences(), name)
    assert found.shows_legend is False


def test_two_windows_do_not_undo_each_others_choices(tmp_path):
    one, other = PreferenceFile(tmp_path), PreferenceFile(tmp_path)
    one.change(theme="light")
    other.change(vsync=False)
    found = PreferenceFile(tmp_path).current
    assert (found.theme, found.vsync) == ("light", False)
    assert other.current.theme == "dark"  # an open window does not change by itself


def test_recent_files_are_few_each_once_the_newest_first(tmp_path):
    kept = PreferenceFile(tmp_path)
    for number in [*range(15), 9]:
        kept.remember_file(tmp_path / f"{number}.tif")
    names = [name.rpartition("/")[2].rpartition("\\")[2] for name in kept.current.recent_files]
    assert names == ["9.tif", "14.tif", "13.tif", "12.tif", "11.tif", "10.tif", "8.tif", "7.tif", "6.tif", "5.tif"]
    assert len(names) == RECENT_FILES


def test_a_folder_that_cannot_be_written_is_told_and_choices_hold(tmp_path):
    (tmp_path / "file").write_text("")
    kept = PreferenceFile(tmp_path / "file" / "folder")
    kept.change(theme="light")
    assert kept.current.theme == "light"
    assert "cannot be" in kept.problem
    kept.write_layout("[Window]")
    assert kept.read_layout() == ""
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_nothing_is_left_beside_the_file(tmp_path):
    kept = PreferenceFile(tmp_path)
    kept.change(theme="light")
    kept.change(theme="light")
    assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]


def test_the_folder_is_the_one_named_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("RELIEFSCOPE_CONFIG", str(tmp_path))
    assert config_folder() == tmp_path
    monkeypatch.delenv("RELIEFSCOPE_CONFIG")
    assert config_folder().name == "reliefscope"


def test_the_layout_is_there_in_the_next_run_and_a_damaged_one_is_ignored(tmp_path):
    text = "[Window][Höhe]\nPos=1,2\n"
    PreferenceFile(tmp_path).write_layout(text)
    kept = PreferenceFile(tmp_path)
    assert kept.read_layout() == text
    path = tmp_path / LAYOUT_NAME
    whole = path.read_bytes()
    for damaged in (whole[:-3], whole[:20], b"", b"\xff\xfe", whole.replace(b"1,2", b"9,2"), b"[Window]\nPos=1\n"):
        path.write_bytes(damaged)
        assert kept.read_layout() == ""
    kept.write_layout(text)
    assert kept.read_layout() == text
