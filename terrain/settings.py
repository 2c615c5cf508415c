"""Fields of settings that describe themselves: panel, command line and JSON are built from their metadata."""

from __future__ import annotations

from dataclasses import field
from typing import Any


def setting(
    default: Any, label: str, help: str, *, unit: str = "", range: tuple[float, float] | None = None,
    choices: tuple[Any, ...] | None = None, rebuild: bool = False,
) -> Any:  # fmt: skip
    """A field of a frozen dataclass of settings: ``label``, ``help``, ``unit``, ``range`` or ``choices``.

    ``rebuild`` marks what cannot change on a living renderer: the stage then makes a new one.
    """
    metadata = {"label": label, "help": help, "unit": unit, "range": range, "choices": choices, "rebuild": rebuild}
    return field(default=default, metadata=metadata)
