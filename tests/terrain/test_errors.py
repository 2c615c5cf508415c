"""Messages look alike wherever they come from."""

from __future__ import annotations

import pytest

from terrain.errors import InputError, as_sentence


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("expected a file, found none; correct the path", "Expected a file, found none; correct the path."),
        ("Expected a name.", "Expected a name."),
        ("alps.tif cannot be read.", "alps.tif cannot be read."),
        ("expected.tif cannot be read", "expected.tif cannot be read."),
        ("two\n  lines", "two lines."),
        ("", ""),
    ],
)  # fmt: skip
def test_messages_are_one_sentence(message, shown):
    assert as_sentence(InputError(message)) == shown
