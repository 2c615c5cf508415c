"""A virtual screen for windows."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest


@pytest.fixture
def desktop(tmp_path):
    """A virtual screen; the environment that shows windows on it."""
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed (apt-get install xvfb xdotool)")
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x720x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    number = server.stdout.readline().strip()  # the first display that is free, told when it is ready
    environment = {**os.environ, "DISPLAY": f":{number}", "RELIEFSCOPE_CACHE": str(tmp_path / "cache")}
    environment.pop("WAYLAND_DISPLAY", None)
    yield environment
    server.terminate()
    server.communicate(timeout=10)
