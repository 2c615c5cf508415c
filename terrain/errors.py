"""The one exception people see: one line that says what was expected, what was found and what to do."""

from __future__ import annotations


class InputError(Exception):
    """Bad input from outside (a file, an option, a missing system piece); printed as one line with exit status 2."""


def as_sentence(message: object) -> str:
    """A message as people see it: one line that begins with a capital and ends with a full stop.

    Only words of ours are capitalised, never the name of a file that a message may begin with.
    """
    text = " ".join(str(message).split())
    if text.startswith("expected "):
        text = text.replace("expected", "Expected", 1)
    return text if not text or text.endswith((".", "!", "?")) else f"{text}."
