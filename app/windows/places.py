"""The window of cameras and places: how one moves, going to a coordinate, bookmarks.

What its widgets do lives in `app.session.navigation` and `app.session.places`.
"""

from __future__ import annotations

from functools import partial

from imgui_bundle import imgui

from app.places.coordinates import EXAMPLES, SYSTEMS
from app.session.navigation import MODES
from app.session.session import Session
from app.windows.theme import bad
from app.windows.widgets import button, text_field


def draw_places(session: Session) -> None:
    """The contents of the window."""
    _draw_camera(session)
    imgui.separator_text("Go to")
    _draw_go_to(session)
    imgui.separator_text("Bookmarks")
    _draw_bookmarks(session)


def _draw_camera(session: Session) -> None:
    navigation = session.navigation
    for mode, told in MODES.items():
        if imgui.radio_button(mode.capitalize(), navigation.mode == mode):
            navigation.choose_mode(mode)
        imgui.set_item_tooltip(f"{told} C chooses the next.")
        imgui.same_line()
    imgui.new_line()
    if imgui.checkbox("Stop at the ground", navigation.collides)[0]:
        navigation.toggle_collision()
    imgui.set_item_tooltip("Without, one flies through the ground and looks from below (X).")


def _draw_go_to(session: Session) -> None:
    places = session.places
    systems = places.coordinates.known
    imgui.set_next_item_width(-1.0)
    chosen = imgui.combo("##System", systems.index(places.system), [SYSTEMS[system] for system in systems])[1]
    imgui.set_item_tooltip("Which coordinates are meant; maps and the globe only where the file says where it lies.")
    places.system = systems[chosen]
    imgui.set_next_item_width(-4.0 * imgui.get_font_size())
    hint = f"such as {EXAMPLES[places.system]}"
    if session.layout.raised == "places":
        imgui.set_keyboard_focus_here()  # G, then a coordinate, then Enter
    told = f"Two numbers, {hint}; Enter flies there."
    entered, places.typed = text_field("##Coordinate", places.typed, told, hint)
    imgui.same_line()
    if imgui.button("Go", (-1.0, 0.0)) or entered:
        places.go_to(places.typed)
    imgui.set_item_tooltip("Fly to the coordinate.")
    _draw_problem(places.problem)


def _draw_bookmarks(session: Session) -> None:
    places = session.places
    button("Keep this view", "Make the view a bookmark (B).", places.keep_view)
    kept = places.bookmarks.all
    _draw_problem(places.bookmarks.problem)
    for number, bookmark in enumerate(kept):
        imgui.push_id(bookmark.name)
        button("Go", f"Fly to it{' (N: the next)' if number == 0 else ''}.", partial(places.visit, bookmark.name))
        imgui.same_line()
        imgui.set_next_item_width(-5.0 * imgui.get_font_size())
        entered, name = text_field("##Name", bookmark.name, "Its name: type another, Enter keeps it.")
        if entered:
            places.bookmarks.rename(bookmark.name, name)
        imgui.same_line()
        button("Delete", "Delete the bookmark.", partial(places.bookmarks.remove, bookmark.name))
        imgui.pop_id()
    if not kept:
        imgui.text_disabled("None yet.")


def _draw_problem(problem: str) -> None:
    if problem:
        imgui.push_text_wrap_pos(0.0)
        imgui.text_colored(bad(), problem)
        imgui.pop_text_wrap_pos()
