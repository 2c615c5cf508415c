"""The window of the preferences: theme, scale, frame limit, what lies over the picture."""

from __future__ import annotations

from dataclasses import asdict, fields

from app.session.session import Session
from app.windows.widgets import Form


def draw_preferences(session: Session) -> None:
    """The contents of the window; what is changed is kept at once."""
    shown = [field for field in fields(session.preferences.current) if "label" in field.metadata]
    form = Form(field.metadata["label"] for field in shown)
    changed = form.edit(session.preferences.current, shown)
    if changed != session.preferences.current:
        chosen = asdict(changed)
        session.preferences.change(**{field.name: chosen[field.name] for field in shown})
        session.touch()
