"""How far long work is, as a bar on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from terrain.progress import listening


@contextmanager
def told_progress() -> Iterator[None]:
    """A bar for what is told in the block; nothing where nobody looks."""
    if not sys.stderr.isatty():
        yield
        return
    with progress_bar() as show, listening(lambda doing, share: show(share, doing)):
        yield


@contextmanager
def progress_bar() -> Iterator[Any]:
    """A bar on stderr with the time left; gives the function that moves it to a share and says what is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda share, doing: progress.update(task, completed=share, description=doing)
