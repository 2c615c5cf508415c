"""The menu bar: every key is in it, so that all can be found with the mouse and reached by the keyboard (F10)."""

from __future__ import annotations

from imgui_bundle import imgui, imgui_ctx

from app.session.session import Session
from app.viewer.keys import bindings
from app.windows.table import WINDOWS

MENUS = ("File", "Algorithm", "View", "Camera", "Flight", "Windows", "Help")


def draw_menu(session: Session) -> None:
    """The bar at the top of the window; F10 takes the keyboard there."""
    if imgui.is_key_pressed(imgui.Key.f10, False):
        _focus_menu()
    with imgui_ctx.begin_main_menu_bar() as bar:
        if not bar:
            return
        for title in MENUS:
            with imgui_ctx.begin_menu(title) as menu:
                if menu:
                    _draw_items(session, title)


def _focus_menu() -> None:
    """Move the keyboard to the first menu. ImGui itself does so for the menus of other windows only."""
    bar = imgui.internal.find_window_by_name("##MainMenuBar")
    if bar is not None:
        imgui.internal.focus_window(bar)
        imgui.get_current_context().nav_layer = imgui.internal.NavLayer.menu
        imgui.internal.nav_init_window(bar, True)
        imgui.internal.set_nav_cursor_visible_after_move()


def _draw_items(session: Session, title: str) -> None:
    if title == "Windows":
        for window in WINDOWS:
            is_open = session.layout.is_open(window.name)
            if imgui.menu_item(window.title, window.key, is_open)[0]:
                session.layout.show(window.name, not is_open)
        imgui.separator()
    for binding in bindings():
        if binding.menu != title:
            continue
        is_on = binding.is_on is not None and binding.is_on(session)
        if imgui.menu_item(binding.help[:1].upper() + binding.help[1:], binding.key, is_on)[0]:
            binding.act(session)
