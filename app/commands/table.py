"""The table of commands. A new one: a function, another for its options, and one line here."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

from app.commands.laboratory import chart, chart_options, check, check_options, reproduce, reproduce_options
from app.commands.render import render, render_options
from app.commands.terrain import info, info_options, make, make_options
from app.commands.view import view, view_options


class Command(NamedTuple):
    """What a command does, and what it takes. The first line of ``run``'s docstring is its help."""

    run: Callable[[argparse.Namespace], int | None]
    add_options: Callable[[argparse.ArgumentParser], None]


COMMANDS: dict[str, Command] = {
    "view": Command(view, view_options),
    "render": Command(render, render_options),
    "chart": Command(chart, chart_options),
    "check": Command(check, check_options),
    "reproduce": Command(reproduce, reproduce_options),
    "info": Command(info, info_options),
    "make": Command(make, make_options),
}
DEFAULT_COMMAND = "view"
