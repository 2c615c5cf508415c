"""The windows that ask: about unsaved edits, and how a track is to be flown."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

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
    dialogs, question = session.dialogs, session.dialogs.question
    with _modal(UNSAVED, question is not None) as is_shown:
        if question is None or not is_shown:
            return
        imgui.text_wrapped(f"The flight has changes that are not saved. You want to {question.doing}.")
        button("Save", "Save the flight under a new name, and go on.", lambda: dialogs.answer("save"))
        imgui.same_line()
        button("Discard", "Go on without the changes.", lambda: dialogs.answer("discard"))
        imgui.same_line()
        button("Stay", "Do neither (Escape).", lambda: dialogs.answer("cancel"))
        if imgui.is_key_pressed(imgui.Key.escape, False):
            dialogs.answer("cancel")


def _draw_track(session: Session) -> None:
    dialogs, track = session.dialogs, session.dialogs.track
    with _modal(TRACK, track is not None) as is_shown:
        if track is None or not is_shown:
            return
        imgui.text_wrapped(track.path.name)
        chosen = [field for field in fields(track) if "label" in field.metadata]
        form = Form(field.metadata["label"] for field in chosen)
        dialogs.track = form.edit(track, chosen)
        button("Import", "Fly along the track as chosen.", dialogs.finish_import)
        imgui.same_line()
        button("Leave it", "Do not import it (Escape).", lambda: dialogs.finish_import(wanted=False))
        if imgui.is_key_pressed(imgui.Key.escape, False):
            dialogs.finish_import(wanted=False)


@contextmanager
def _modal(title: str, is_wanted: bool) -> Iterator[bool]:
    """A window above all others while it is wanted; whether its contents are to be drawn."""
    if is_wanted and not imgui.is_popup_open(title):
        imgui.open_popup(title)
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    imgui.set_next_window_pos((size.x / 2, size.y / 2), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((min(WIDTH_EM * em, size.x), 0.0))
    flags = imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_saved_settings
    with imgui_ctx.begin_popup_modal(title, flags) as popup:
        if popup.visible and not is_wanted:
            imgui.close_current_popup()
        yield popup.visible and is_wanted
