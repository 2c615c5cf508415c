"""Waiting for what another process does."""

from __future__ import annotations

import time

PATIENCE_S = 60.0


def wait_for(condition, what):
    """Poll until ``condition()`` is neither None nor False, and return it; the machine may be slow."""
    end = time.monotonic() + PATIENCE_S
    while (value := condition()) is None or value is False:
        assert time.monotonic() < end, f"waited {PATIENCE_S} s in vain for {what}"
        time.sleep(0.05)
    return value
