"""The house keeps its rules: import contracts, style and types are checked by their tools in every test run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOOLS = Path(sys.executable).parent
MOST_LINES = 400  # of a module or a shader

CHECKS = {
    "import contracts": ["lint-imports", "--no-cache"],
    "ruff check": ["ruff", "check", "."],
    "ruff format": ["ruff", "format", "--check", "."],
    "mypy": ["mypy"],
}


@pytest.mark.parametrize("name", CHECKS)
def test_source_passes(name):
    tool, *options = CHECKS[name]
    # The tools look at the source beside the tests, also where another copy is installed.
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
    done = subprocess.run(
        [TOOLS / tool, *options], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{name}:\n{done.stdout[-6000:]}{done.stderr[-2000:]}"


def test_modules_and_files_named_in_comments_exist():
    modules = re.compile(r"`((?:app|terrain)(?:\.\w+)+)`")
    files = re.compile(r"`((?:app|assets|shaders|terrain|tests)/[\w/.]+)`")
    for source in (ROOT / "README.md", *sources("app", "terrain", "shaders", "tests")):
        text = source.read_text(encoding="utf-8")
        for name in modules.findall(text):
            assert leads_somewhere(name), f"{source}: {name}"
        for name in files.findall(text):
            assert (ROOT / name).exists(), f"{source}: {name}"


def test_no_module_is_longer_than_one_can_keep_in_mind():
    lengths = {
        path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources("app", "terrain", "shaders")
    }
    assert {path: lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def sources(*folders):
    """All source files in some folders."""
    found = [path for folder in folders for path in (ROOT / folder).rglob("*")]
    return [path for path in found if path.suffix in (".py", ".glsl", ".vert", ".frag")]


def leads_somewhere(name):
    """Whether a dotted name is that of a module, or of something that a module defines."""
    path, *rest = ROOT, *name.split(".")
    while rest and (path / rest[0]).is_dir():
        path /= rest.pop(0)
    if rest and (path / f"{rest[0]}.py").exists():
        path /= f"{rest.pop(0)}.py"
    elif rest:
        path /= "__init__.py"
    return not rest or re.search(rf"^(class |def |){rest[0]}\b", path.read_text(encoding="utf-8"), re.M) is not None
