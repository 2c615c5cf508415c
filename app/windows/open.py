"""The window to open files with: folders and files, a path to type, the files opened lately."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui, imgui_ctx

from app.session.session import Session
from app.windows.widgets import button, text_field

LEAST_LIST_EM, BELOW_EM = 8.0, 8.5  # the list of files takes what the rest leaves, and at least this


def draw_open(session: Session) -> None:
    """The contents of the window."""
    browser, em = session.browser, imgui.get_font_size()
    button("Up", "To the folder around this one.", browser.up)
    imgui.same_line()
    imgui.set_next_item_width(-1.0)
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()  # one may type at once
    told = "A folder to look into, or a file to open; Enter confirms. Files can also be dropped here."
    entered, text = text_field("##Path", str(browser.folder), told, flags=imgui.InputTextFlags_.auto_select_all)
    if entered:
        _choose(session, text)
    height = max(imgui.get_content_region_avail().y - BELOW_EM * em, LEAST_LIST_EM * em)
    with imgui_ctx.begin_child("Files", imgui.ImVec2(0.0, height), imgui.ChildFlags_.borders):
        for entry in browser.entries():
            size = "" if entry.is_folder else f"  {_size(entry.size_bytes)}"
            if imgui.selectable(f"{entry.label}{size}##{entry.path.name}", False)[0]:
                _choose(session, entry.path.name)
    browser.shows_all = imgui.checkbox("All files", browser.shows_all)[1]
    imgui.set_item_tooltip("Also files whose names do not look like terrains, images, flights or tracks.")
    imgui.same_line()
    browser.as_terrain = imgui.checkbox("Pictures as terrain", browser.as_terrain)[1]
    imgui.set_item_tooltip("Take the brightness or the colours of a picture for heights, instead of laying it on top.")
    if browser.problem:
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(browser.problem)
        imgui.pop_text_wrap_pos()
    recent = session.preferences.current.recent_files
    if recent and imgui.collapsing_header("Opened lately", imgui.TreeNodeFlags_.default_open):
        for name in recent:
            if imgui.selectable(f"{Path(name).name}##{name}", False)[0]:
                _choose(session, name)
            imgui.set_item_tooltip(name)


def _choose(session: Session, text: str) -> None:
    path = session.browser.go(text)
    if path is not None:
        session.layout.show("open", False)
        session.loader.open(session, [path], session.browser.as_terrain)


def _size(size_bytes: int) -> str:
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= scale:
            return f"{size_bytes / scale:.1f} {unit}"
    return f"{size_bytes} bytes"
