"""Generators that measure in steps, run to their end."""

from __future__ import annotations


def finish(steps):
    """The value a generator returns."""
    while True:
        try:
            next(steps)
        except StopIteration as stopped:
            return stopped.value
