"""The dock space behind all windows: its first layout, the part of the window that is left free, and how it is kept."""

from __future__ import annotations

from typing import NamedTuple

from imgui_bundle import imgui, imgui_ctx

from app.session.preferences import PreferenceFile
from app.session.session import Session
from app.windows.table import WINDOWS, Window
from app.windows.theme import WINDOW_OPACITY

DOCK_SPACE = 0x5EC0FE  # any number, the same in every run: the kept layout refers to it
SIDE_EM = {"left": 23.5, "right": 26.0}
BOTTOM_EM = 14.0
LEAST_FREE_EM = 24.0  # between the left and the right side; with less, all windows share the left
# Windows that are not docked: where the first appears, beside the left side; the next ones; their size.
FLOAT_AT_EM, CASCADE_EM, FLOAT_EM = (26.0, 6.0), 1.6, (28.0, 19.0)


class Rectangle(NamedTuple):
    """A part of the window [px], y down."""

    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.left + self.width

    @property
    def bottom(self) -> float:
        return self.top + self.height


def draw_windows(session: Session) -> None:
    """The dock space and all open windows."""
    if session.layout.wants_first or imgui.internal.dock_builder_get_node(DOCK_SPACE) is None:
        session.layout.wants_first = False
        _build_layout()
    imgui.dock_space_over_viewport(DOCK_SPACE, None, imgui.DockNodeFlags_.passthru_central_node)
    floating = [window.name for window in WINDOWS if window.side == "float"]
    for window in WINDOWS:
        if session.layout.open.setdefault(window.name, window.is_open):
            _draw_window(session, window, floating.index(window.name) if window.name in floating else 0)


def free_rectangle(session: Session) -> Rectangle:
    """The part of the window that no docked window covers."""
    node = imgui.internal.dock_builder_get_central_node(DOCK_SPACE) if session.layout.shows_windows else None
    if node is None:
        return Rectangle(0.0, 0.0, *imgui.get_io().display_size)
    return Rectangle(*node.pos, *node.size)


def rescale_layout(factor: float) -> None:
    """Make the docked sides wider or narrower: the text in them has grown by ``factor``."""
    builder = imgui.internal
    sizes = {}
    for window in WINDOWS:
        found = builder.find_window_by_name(window.title)
        if found is not None and found.dock_id:
            node = builder.dock_builder_get_node(found.dock_id)
            if node is not None and not node.is_central_node():
                sizes[node.id_] = (factor * node.size.x, factor * node.size.y)
    for node_id, size in sizes.items():
        builder.dock_builder_set_node_size(node_id, size)


def keep_layout(preferences: PreferenceFile) -> None:
    """Write the layout where ImGui says that it changed."""
    io = imgui.get_io()
    if io.want_save_ini_settings:
        io.want_save_ini_settings = False
        preferences.write_layout(imgui.save_ini_settings_to_memory())


def _draw_window(session: Session, window: Window, number: int) -> None:
    em, opacity = imgui.get_font_size(), WINDOW_OPACITY
    if window.side == "float":
        opacity = 1.0
        step = CASCADE_EM * number
        imgui.set_next_window_size((FLOAT_EM[0] * em, FLOAT_EM[1] * em), imgui.Cond_.first_use_ever)
        imgui.set_next_window_pos(
            ((FLOAT_AT_EM[0] + step) * em, (FLOAT_AT_EM[1] + step) * em), imgui.Cond_.first_use_ever
        )
    imgui.set_next_window_bg_alpha(opacity)
    with imgui_ctx.begin(window.title, True, imgui.WindowFlags_.no_focus_on_appearing) as shown:
        if shown.expanded:
            window.draw(session)
    if session.layout.raised == window.name:
        _raise_tab(window.title)
        if shown.expanded:  # it was drawn, and knew that it is asked for
            session.layout.raised = ""
    if not shown.opened:
        session.layout.show(window.name, False)


def _raise_tab(title: str) -> None:
    """Show a docked window before those that share its place; the keyboard stays where it is."""
    found = imgui.internal.find_window_by_name(title)
    if found is not None and found.dock_node is not None:
        found.dock_node.selected_tab_id = found.tab_id
        if found.dock_node.tab_bar is not None:
            found.dock_node.tab_bar.next_selected_tab_id = found.tab_id


def _build_layout() -> None:
    """Windows left and right of the picture, others below it."""
    builder, io = imgui.internal, imgui.get_io()
    em, size = imgui.get_font_size(), io.display_size
    builder.dock_builder_remove_node(DOCK_SPACE)
    builder.dock_builder_add_node(DOCK_SPACE, imgui.internal.DockNodeFlagsPrivate_.dock_space)
    builder.dock_builder_set_node_size(DOCK_SPACE, size)
    left_px, right_px = (SIDE_EM[side] * em for side in ("left", "right"))
    parts = builder.dock_builder_split_node(DOCK_SPACE, imgui.Dir.left, _share(left_px, size.x))
    places = {"left": parts.id_at_dir, "right": parts.id_at_dir}
    middle = parts.id_at_opposite_dir
    if size.x - left_px - right_px >= LEAST_FREE_EM * em:
        parts = builder.dock_builder_split_node(middle, imgui.Dir.right, _share(right_px, size.x - left_px))
        places["right"], middle = parts.id_at_dir, parts.id_at_opposite_dir
    parts = builder.dock_builder_split_node(middle, imgui.Dir.down, _share(BOTTOM_EM * em, size.y))
    places["bottom"] = parts.id_at_dir
    for window in WINDOWS:
        if window.side in places:
            builder.dock_builder_dock_window(window.title, places[window.side])
    builder.dock_builder_finish(DOCK_SPACE)


def _share(wanted_px: float, total_px: float) -> float:
    """A part of a length, as the dock builder takes it."""
    return min(max(wanted_px / max(total_px, 1.0), 0.05), 0.95)
