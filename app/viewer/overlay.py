"""What is drawn over the picture itself: the legend of its colours, a scale bar and a north arrow.

On dark cards in both themes, in the corners of what the windows leave free.
"""

from __future__ import annotations

import math

from imgui_bundle import imgui

from app.session.session import Session
from app.viewer.docking import Rectangle, free_rectangle
from app.viewer.legends import Legend, legend_of
from app.viewer.scale_bar import ground_depth_m, heading_text, length_text, round_length_m
from app.windows.theme import packed

MARGIN_EM, PADDING_EM = 0.6, 0.45
BAR_EM, BAR_HEIGHT_EM = 9.0, 0.3  # the scale bar is at most so long
COMPASS_EM = 1.5  # its radius
SWATCH_EM = 2.6
_WHITE, _GREY, _CARD = (1.0, 1.0, 1.0, 1.0), (0.78, 0.78, 0.78, 1.0), (0.05, 0.06, 0.08, 0.62)
_NORTH = (0.98, 0.55, 0.20, 1.0)


def draw_overlay(session: Session) -> None:
    """Legend at the upper left; scale and north at the upper right, or below the legend where there is no room."""
    chosen, free = session.preferences.current, free_rectangle(session)
    if min(imgui.get_io().display_size) < 1.0:
        return
    taken = Rectangle(free.left, free.top, 0.0, 0.0)
    if chosen.shows_legend and (legend := legend_of(session)) is not None:
        taken = _draw_legend(legend, free)
    if chosen.shows_scale_bar:
        _draw_scale(session, free, taken)


def _draw_legend(legend: Legend, free: Rectangle) -> Rectangle:
    """The legend, where there is room for it; where it is."""
    em, draw = imgui.get_font_size(), imgui.get_background_draw_list()
    margin, padding = MARGIN_EM * em, PADDING_EM * em
    widest = max(imgui.calc_text_size(label).x for label in legend.labels) + 0.5 * em
    step = max(SWATCH_EM * em, widest)
    width = max(step * len(legend.colours), imgui.calc_text_size(legend.title).x) + 2 * padding
    if width > free.width - 2 * margin:
        return Rectangle(free.left, free.top, 0.0, 0.0)
    card = Rectangle(free.left + margin, free.top + margin, width, 3.1 * em + 2 * padding)
    _draw_card(card)
    x, y = card.left, card.top
    x, y = x + padding, y + padding
    draw.add_text((x, y), packed(_GREY), legend.title)
    y += 1.2 * em
    for number, (colour, label) in enumerate(zip(legend.colours, legend.labels, strict=True)):
        at = x + number * step
        draw.add_rect_filled((at, y), (at + step, y + 0.8 * em), packed((*colour, 1.0)))
        draw.add_text((at + (step - imgui.calc_text_size(label).x) / 2, y + 0.9 * em), packed(_WHITE), label)
    return card


def _draw_card(card: Rectangle) -> None:
    corners = (card.left, card.top), (card.right, card.bottom)
    imgui.get_background_draw_list().add_rect_filled(*corners, packed(_CARD), 0.3 * imgui.get_font_size())


def _draw_scale(session: Session, free: Rectangle, taken: Rectangle) -> None:
    """A north arrow with the heading; beside it a bar that says how long things are at the middle of the picture."""
    em, draw = imgui.get_font_size(), imgui.get_background_draw_list()
    margin, padding, radius = MARGIN_EM * em, PADDING_EM * em, COMPASS_EM * em
    heading, bar = heading_text(session.camera.yaw_deg), _scale(session, free)
    compass_width = max(2 * radius, imgui.calc_text_size("000° NW").x)
    bar_width = 0.0 if bar is None else max(bar[0], imgui.calc_text_size(bar[1]).x, imgui.calc_text_size(bar[2]).x)
    width = compass_width + 2 * padding + (bar_width + em if bar is not None else 0.0)
    if width > free.width - 2 * margin:
        return
    x = free.right - margin - width
    y = (free.top if x > taken.right + margin else taken.bottom) + margin
    _draw_card(Rectangle(x, y, width, 2 * radius + 1.3 * em + 2 * padding))
    if bar is not None:
        length, text, away = bar
        left, top = x + padding, y + padding + radius - 0.9 * em
        draw.add_text((left, top), packed(_WHITE), text)
        top += 1.3 * em
        draw.add_rect_filled((left, top), (left + length, top + BAR_HEIGHT_EM * em), packed(_WHITE))
        draw.add_rect_filled((left, top), (left + length / 2, top + BAR_HEIGHT_EM * em), packed((0.0, 0.0, 0.0, 1.0)))
        draw.add_rect((left, top), (left + length, top + BAR_HEIGHT_EM * em), packed(_WHITE))
        draw.add_text((left, top + 0.6 * em), packed(_GREY), away)
    _draw_compass(session.camera.yaw_deg, (x + width - padding - compass_width / 2, y + padding + radius), radius)
    at = x + width - padding - compass_width / 2 - imgui.calc_text_size(heading).x / 2
    draw.add_text((at, y + padding + 2 * radius + 0.2 * em), packed(_WHITE), heading)


def _scale(session: Session, free: Rectangle) -> tuple[float, str, str] | None:
    """Length of the bar [px], what it stands for, and how far away; None where there is only sky."""
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    middle = free.left + free.width / 2
    for down in (0.5, 0.65, 0.8, 0.95):
        pixel = middle, free.top + down * free.height
        depth_m = ground_depth_m(session.heightfield, session.camera, (size.x, size.y), pixel)
        if depth_m is not None:
            m_per_px = depth_m / session.camera.pixels_per_radian(round(size.y))
            length_m = round_length_m(BAR_EM * em * m_per_px)
            place = "in the middle" if down == 0.5 else "below the middle"
            return length_m / m_per_px, length_text(length_m), f"{place}, {length_text(_two_digits(depth_m))} away"
    return None


def _two_digits(length_m: float) -> float:
    return float(f"{length_m:.2g}")


def _draw_compass(yaw_deg: float, centre: tuple[float, float], radius: float) -> None:
    """A needle that points north, as seen from above with the sight line up."""
    draw, (x, y) = imgui.get_background_draw_list(), centre
    angle = math.radians(-yaw_deg)
    north, east = (math.sin(angle), -math.cos(angle)), (math.cos(angle), math.sin(angle))
    tips = [(x + sign * 0.95 * radius * north[0], y + sign * 0.95 * radius * north[1]) for sign in (1, -1)]
    sides = [(x + sign * 0.3 * radius * east[0], y + sign * 0.3 * radius * east[1]) for sign in (1, -1)]
    draw.add_circle(centre, radius, packed(_GREY), 0, 1.0)
    draw.add_triangle_filled(tips[0], sides[0], sides[1], packed(_NORTH))
    draw.add_triangle_filled(tips[1], sides[1], sides[0], packed(_WHITE))
