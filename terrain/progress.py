"""How far long work is: told by who works, heard by who waits, who may also end it.

The one who waits calls the work within `listening`; whoever works below says `tell` now and then. A listener that
raises `Cancelled` ends the work. Nothing is told across threads, and without a listener nothing happens.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, float], None]
"""``listener(doing, share)``: what is being done, in words, and the share of it that is done."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


class Cancelled(Exception):
    """Who waits does so no longer."""


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Hear what is told in this thread while the block runs."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(doing: str, share: float = 0.0) -> None:
    """Say what is being done and how much of it is done.

    Raises
    ------
    Cancelled
        If who waits does so no longer.
    """
    listener = _listener.get()
    if listener is not None:
        listener(doing, share)
