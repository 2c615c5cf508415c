"""The window of layers: what lies over the ground, in which order and how; the lens; the time; the legend."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from imgui_bundle import imgui

from app.session.layers import Layers
from app.session.session import Session
from app.windows.theme import packed
from app.windows.widgets import Form, button, text_field
from terrain.textures.layers import BLENDS, PLACES, Layer
from terrain.textures.library import title_of
from terrain.textures.thematic import THEMES, Legend, Swatch

LABELS = ("Blend", "Opacity", "Place", "Visible", "Key frame", "Radius", "Soft rim", "Darkness", "Time")
ADD_THEME, ADD_KEY, EVERYWHERE = "add a theme ...", "add a key frame ...", "everywhere"
LENS_REACH = 0.75  # largest radius of the lens, as a share of the terrain's longer side
ROW_BUTTONS_EM = 5.6  # what the three buttons of a row take
SWATCH_EM = 1.1
_path = [""]  # what is typed into the field


def draw_layers(session: Session) -> None:
    """The contents of the window."""
    form = Form(LABELS)
    layers = session.layers
    _draw_adding(layers)
    _draw_list(layers)
    if layers.stack.layers:
        _draw_selected(layers, form)
    _draw_animation(layers, form)
    _draw_lens(session, form)
    if (legend := _chosen_legend(layers)) is not None:
        imgui.separator()
        _draw_legend(legend)


def _draw_adding(layers: Layers) -> None:
    imgui.set_next_item_width(-1.0)
    titles = [kind.title for kind in THEMES.values()]
    chosen = imgui.combo("##Add theme", 0, [ADD_THEME, *titles], len(titles) + 1)[1]
    imgui.set_item_tooltip("Put a layer made from the terrain itself on top.")
    if chosen:
        layers.add(list(THEMES)[chosen - 1])
    imgui.set_next_item_width(-3.6 * imgui.get_font_size())
    told = "An image of any size; several joined by + are key frames: a.png+b.png, a.png@1990+b.png@2020."
    entered, _path[0] = text_field("##Image file", _path[0], told, "an image file")
    imgui.same_line()
    imgui.begin_disabled(not _path[0].strip())
    button("Add", "Put the image on top.", lambda: _add_typed(layers))
    imgui.end_disabled()
    if entered and _path[0].strip():
        _add_typed(layers)


def _add_typed(layers: Layers) -> None:
    if layers.add(_path[0]):
        _path[0] = ""


def _draw_list(layers: Layers) -> None:
    """From the uppermost layer down; what is to be done is done after all are drawn."""
    em = imgui.get_font_size()
    todo: Callable[[], object] | None = None
    count = len(layers.stack.layers)
    for index in reversed(range(count)):
        layer = layers.stack.layers[index]
        imgui.push_id(layer.name)
        is_on = imgui.checkbox("##Shown", layer.is_on)[1]
        imgui.set_item_tooltip("Show this layer.")
        if is_on != layer.is_on:
            todo = partial(layers.edit, index, is_on=is_on)
        imgui.same_line()
        size = max(imgui.get_content_region_avail().x - ROW_BUTTONS_EM * em, em), 0.0
        if imgui.selectable(f"{layer.name}##Layer", index == layers.selected, 0, size)[0]:
            layers.selected = index
        imgui.set_item_tooltip(f"{_sentence(layer)} Click to change it.")
        imgui.same_line()
        imgui.begin_disabled(index == count - 1)
        if imgui.arrow_button("##Up", imgui.Dir.up):
            todo = partial(layers.move, index, 1)
        imgui.set_item_tooltip("Move this layer over the one above it.")
        imgui.end_disabled()
        imgui.same_line()
        imgui.begin_disabled(index == 0)
        if imgui.arrow_button("##Down", imgui.Dir.down):
            todo = partial(layers.move, index, -1)
        imgui.set_item_tooltip("Move this layer below the one under it.")
        imgui.end_disabled()
        imgui.same_line()
        if imgui.button("x"):
            todo = partial(layers.remove, index)
        imgui.set_item_tooltip("Take this layer away.")
        imgui.pop_id()
    if todo is not None:
        todo()


def _sentence(layer: Layer) -> str:
    """What a layer is, in words."""
    shown = " to ".join(title_of(key.source) for key in (layer.keys if layer.is_animated else layer.keys[:1]))
    return f"{shown}: {BLENDS[layer.blend]}."


def _draw_selected(layers: Layers, form: Form) -> None:
    index = layers.selected
    layer = layers.stack.layers[index]
    imgui.separator_text(layer.name)
    blends = list(BLENDS)
    told = "How it is combined with what lies below. " + " ".join(f"{name}: {text}." for name, text in BLENDS.items())
    blend = blends[form.combo("Blend", blends.index(layer.blend), blends, told)]
    opacity = form.slider("Opacity", layer.opacity, "How much of it shows.", (0.0, 1.0), "%.2f")
    places = list(PLACES)
    told = "Where it shows: everywhere, or only on one side of the lens's rim."
    where = places[form.combo("Place", places.index(layer.where), list(PLACES.values()), told)]
    names = [name for name in layers.library.names if name not in (key.source for key in layer.keys)]
    masks = [None, *names]
    current = masks.index(layer.visibility) if layer.visibility in masks else 0
    told = "An image that says where it shows: where that is white it does, where black or clear it does not."
    visibility = masks[form.combo("Visible", current, [EVERYWHERE, *map(title_of, names)], told)]
    told = "Animate this layer: it changes from image to image as time goes on."
    key = form.combo("Key frame", 0, [ADD_KEY, *map(title_of, layers.library.names)], told)
    changed = {"blend": blend, "opacity": opacity, "where": where, "visibility": visibility}
    if any(getattr(layer, name) != value for name, value in changed.items()):
        layers.edit(index, **changed)
    if key:
        layers.add_key(index, layers.library.names[key - 1])


def _draw_animation(layers: Layers, form: Form) -> None:
    span = layers.stack.time_range
    if span is None:
        return
    imgui.separator_text("Animation")
    time = form.slider("Time", layers.stack.time, "Between key frames their images are mixed.", span, "%.2f")
    if time != layers.stack.time:
        layers.set_time(time)
    button("Stop##animation" if layers.is_playing else "Play##animation", "Let the time run, over and over.",
           layers.toggle_playing)  # fmt: skip


def _draw_lens(session: Session, form: Form) -> None:
    layers = session.layers
    lens = layers.stack.lens
    imgui.separator_text("Lens")
    is_on = imgui.checkbox("Lens follows the mouse", lens.is_on)[1]
    imgui.set_item_tooltip(
        "A circle on the ground, in which chosen layers show, and around which it may be darker (O)."
    )
    if is_on != lens.is_on:
        layers.toggle_lens()
        return
    if not lens.is_on:
        return
    reach_m = LENS_REACH * max(session.heightfield.extent_m)
    radius_m = form.slider("Radius", lens.radius_m, "Of the lens.", (0.002 * reach_m, reach_m), "%.0f m")
    rim = form.slider("Soft rim", lens.rim, "Width of its soft edge, as a share of the radius.", (0.0, 1.0), "%.2f")
    dimming = form.slider("Darkness", lens.dimming, "How dark it is outside.", (0.0, 1.0), "%.2f")
    if (radius_m, rim, dimming) != (lens.radius_m, lens.rim, lens.dimming):
        layers.change_lens(radius_m=radius_m, rim=rim, dimming=dimming)


def _chosen_legend(layers: Layers) -> Legend | None:
    """Of the selected layer; of the uppermost that has one, where that has none."""
    if layers.stack.layers:
        source = layers.stack.layers[layers.selected].between(layers.stack.time)[0]
        if (legend := layers.library.legend(source)) is not None:
            return legend
    return layers.legend


def _draw_legend(legend: Legend) -> None:
    """Classes below each other; a ramp from its last colour down to its first."""
    em, draw = imgui.get_font_size(), imgui.get_window_draw_list()
    imgui.text_disabled(f"{legend.title} [{legend.unit}]" if legend.unit else legend.title)
    width, height = SWATCH_EM * em, SWATCH_EM * em
    swatches = list(reversed(legend.swatches)) if legend.is_ramp else list(legend.swatches)
    x, y = imgui.get_cursor_screen_pos()
    for number, swatch in enumerate(swatches):
        top = y + number * height
        colour = _ink(swatch)
        if legend.is_ramp and number + 1 < len(swatches):
            below = _ink(swatches[number + 1])
            middle = top + height / 2
            draw.add_rect_filled_multi_color((x, middle), (x + width, middle + height), colour, colour, below, below)
        elif not legend.is_ramp:
            draw.add_rect_filled((x, top + 1.0), (x + width, top + height - 1.0), colour, 0.15 * em)
        if swatch.label:
            ink = imgui.get_color_u32(imgui.Col_.text)
            draw.add_text((x + width + 0.5 * em, top + (height - em) / 2), ink, swatch.label)
    imgui.dummy((width, height * len(swatches)))


def _ink(swatch: Swatch) -> int:
    """A swatch's colour as draw lists take it."""
    red, green, blue = (channel / 255.0 for channel in swatch.colour)
    return packed((red, green, blue, 1.0))
