"""The windows that ask: about unsaved edits, and how a track is to be flown."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from imgui_bundle import imgui, imgui_ctx

from app.session.session import Session
from app.windows.widgets import Form, button

UNSAVED, TRACK = "Unsaved changes", "Import a track"
WIDTH_EM = 30.0


def draw_questions(session: Session) -> None:
    """Whatever is asked now."""
    _draw_unsaved(session)
    _draw_track(session)


def _draw_unsaved(session: Session) -> None:
    dialogs = session.dialogs
    with _modal(UNSAVED, dialogs.question is not None) as popup:
        if not popup.visible:
            return
        if dialogs.question is None:
            imgui.close_current_popup()
            return
        imgui.text_wrapped(f"The flight has changes that are not saved. You want to {dialogs.question.doing}.")
        button("Save", "Save the flight under a new name, and go on.", lambda: dialogs.answer("save"))
        imgui.same_line()
        button("Discard", "Go on without the changes.", lambda: dialogs.answer("discard"))
        imgui.same_line()
        button("Stay", "Do neither (Escape).", lambda: dialogs.answer("cancel"))
        if imgui.is_key_pressed(imgui.Key.escape, False):
            dialogs.answer("cancel")


def _draw_track(session: Session) -> None:
    dialogs = session.dialogs
    with _modal(TRACK, dialogs.track is not None) as popup:
        if not popup.visible:
            return
        if dialogs.track is None:
            imgui.close_current_popup()
            return
        imgui.text_wrapped(dialogs.track.path.name)
        chosen = [field for field in fields(dialogs.track) if "label" in field.metadata]
        form = Form(field.metadata["label"] for field in chosen)
        dialogs.track = form.edit(dialogs.track, chosen)
        button("Import", "Fly along the track as chosen.", dialogs.finish_import)
        imgui.same_line()
        button("Leave it", "Do not import it (Escape).", lambda: dialogs.finish_import(wanted=False))
        if imgui.is_key_pressed(imgui.Key.escape, False):
            dialogs.finish_import(wanted=False)


def _modal(title: str, is_wanted: bool) -> Any:
    """A window above all others while it is wanted."""
    if is_wanted and not imgui.is_popup_open(title):
        imgui.open_popup(title)
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    imgui.set_next_window_pos((size.x / 2, size.y / 2), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((min(WIDTH_EM * em, size.x), 0.0))
    flags = imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_saved_settings
    return imgui_ctx.begin_popup_modal(title, flags)
