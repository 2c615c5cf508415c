"""Settings as text: what a frozen dataclass made of `setting` fields says, read from ``name=value``.

Serves the settings of every renderer and the look alike; the panel draws the same fields as widgets.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import Field, fields, replace
from typing import Any

from terrain.errors import InputError

_SWITCH = {"on": True, "true": True, "yes": True, "1": True, "off": False, "false": False, "no": False, "0": False}


def apply_settings(pairs: Iterable[str], *targets: Any) -> tuple[Any, ...]:
    """The dataclasses ``targets`` with each ``name=value`` set in every target that has a field of that name.

    Raises
    ------
    InputError
        If no target has such a field, or the value is not one that it takes.
    """
    changed = list(targets)
    for pair in pairs:
        name, equals, text = pair.partition("=")
        name = name.strip().replace("-", "_")
        if not equals:
            raise InputError(f"Expected a setting as name=value, found {pair!r}.")
        owners = [i for i, target in enumerate(changed) for f in fields(target) if f.name == name]
        if not owners:
            known = [f.name for target in targets for f in fields(target)]
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"the settings are {', '.join(known)}."
            raise InputError(f"There is no setting {name!r} here; {hint}")
        for i in owners:
            field = next(f for f in fields(changed[i]) if f.name == name)
            changed[i] = replace(changed[i], **{name: read_value(field, text.strip())})
    return tuple(changed)


def read_value(field: Field[Any], text: str) -> Any:
    """The value a field takes from text, of the type of its default.

    Raises
    ------
    InputError
        If the text is no such value, or lies outside the field's range or choices.
    """
    expected, choices, limits = expectation(field), field.metadata.get("choices"), field.metadata.get("range")
    problem = InputError(f"{field.name}: expected {expected}, found {text!r}.")
    if choices is not None:
        matching = [choice for choice in choices if str(choice).lower() == text.lower()]
        if not matching:
            raise problem
        return matching[0]
    kind: Any = type(field.default)
    if kind is bool:
        if text.lower() not in _SWITCH:
            raise problem
        return _SWITCH[text.lower()]
    if kind is str:
        return text
    try:
        value = kind(text)
    except ValueError:
        raise problem from None
    if not math.isfinite(value) or (limits and not limits[0] <= value <= limits[1]):
        raise problem
    return value


def expectation(field: Field[Any]) -> str:
    """What a field takes, in words: ``"8, 16 or 32"``, ``"0.25 to 16 px"``, ``"on or off"``."""
    choices, limits, unit = (field.metadata.get(key) for key in ("choices", "range", "unit"))
    if choices is not None:
        words = [str(choice) for choice in choices]
        return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else words[0]
    if isinstance(field.default, bool):
        return "on or off"
    if isinstance(field.default, str):
        return "text"
    kind = "a whole number" if isinstance(field.default, int) else "a number"
    return (f"{limits[0]:g} to {limits[1]:g}" if limits else kind) + (f" {unit}" if unit else "")


def settings_table(settings: Any, title: str) -> str:
    """One line per field, for ``--help``."""
    lines = [f"{title}:"]
    for field in fields(settings):
        value = "on" if field.default is True else "off" if field.default is False else field.default
        takes = f"{field.metadata.get('help', '')} [{expectation(field)}; {value}]"
        lines.append(f"  {field.name:<24} {takes}")
    return "\n".join(lines)
