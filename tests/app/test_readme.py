"""What the README says of the window is what the window does."""

from __future__ import annotations

import re
from pathlib import Path

from app.pictures import FOLDER, LARGEST_BYTES
from app.viewer.keys import keys_table

README = Path(__file__).resolve().parents[2] / "README.md"


def test_the_readme_lists_the_keys_as_they_are():
    assert keys_table() in README.read_text("utf-8"), "print the table with: python -m app.viewer.keys"


def test_the_pictures_of_the_readme_are_all_there_and_small():
    named = re.findall(r"\((assets/pictures/[^)]+)\)", README.read_text("utf-8"))
    paths = [README.parent / name for name in named]
    assert {path.name for path in paths} == {path.name for path in (README.parent / FOLDER).iterdir()}
    assert all(path.stat().st_size <= LARGEST_BYTES for path in paths)
    assert len(paths) >= 7
