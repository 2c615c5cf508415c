"""Layers: order, blends, visibility, lens and animation, in the numbers and in the picture."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.layers import BLENDS, Key, Layer, LayerStack, Lens, compose, layer_defines
from terrain.textures.library import Library
from terrain.textures.look import LookSettings

CLEAR = LookSettings(fog=False, palette="plaster", shading="slope")  # level ground has light 1
SIZE_PX = (96, 72)
LEVEL = Heightfield(np.zeros((49, 65), np.float32), (10.0, 10.0))
ABOVE = Camera((320.0, 520.0, 240.0), 0.0, -90.0, fov_deg=45.0)  # sees ground only


def layer(name, **values):
    return Layer(name, (Key(name),), **values)


def plain(colour, alpha=255):
    """An image of one colour."""
    pixels = np.full((4, 4, 4), alpha, np.uint8)
    pixels[..., :3] = colour
    return ArraySource("plain", pixels, whole_extent(LEVEL))


IMAGES = {
    "red": plain((200, 40, 30)),
    "blue": plain((30, 60, 190), 128),
    "grey": plain((120, 120, 120)),
    "white": plain((255, 255, 255)),
    "black": plain((0, 0, 0)),
    "clear": plain((0, 0, 0), 0),
}


@pytest.fixture
def stage(gpu):
    made = Stage(gpu, open_scene(LEVEL), "reference", look=CLEAR)
    yield made
    made.release()


def show(stage, stack, sources=IMAGES, camera=ABOVE):
    """The picture of a stack, with all its tiles."""
    stage.set_layers(stack, sources)
    while not stage.load_tiles(stage.frame(camera, SIZE_PX)):
        pass
    return stage.render(camera, SIZE_PX).astype(int)


def sample(name):
    """What the shader reads from an image of one colour."""
    return IMAGES[name]._levels[0][0, 0] / 255.0


def base_and_light(stage):
    return show(stage, LayerStack())[30, 40] / 255.0, np.ones(3)


@pytest.mark.parametrize("blend", BLENDS)
@pytest.mark.parametrize("name", ["red", "blue"])
@pytest.mark.parametrize("opacity", [1.0, 0.4])
def test_the_shader_blends_as_its_twin(stage, blend, name, opacity):
    layers = (layer(name, blend=blend, opacity=opacity),)
    base, light = base_and_light(stage)
    expected = compose(base, light, layers, {name: sample(name)})
    found = show(stage, LayerStack(layers))[30, 40] / 255.0
    assert np.abs(found - expected).max() < 2.5 / 255
    assert np.abs(found - base).max() > 0.03


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_blends_are_what_they_are_called(base, value, opacity):
    ground, light, image = np.full(3, base), np.full(3, 1.0), {"a": np.array([value, value, value, 1.0])}
    mixed, darkened, added = (
        compose(ground, light, [layer("a", blend=blend, opacity=opacity)], image)[0] for blend in BLENDS
    )
    assert np.isclose(mixed, base + opacity * (value - base))
    assert np.isclose(darkened, base * (1.0 - opacity + opacity * value))
    assert np.isclose(added, min(base + opacity * value, 1.0))


def test_layers_are_composed_from_the_lowest_to_the_uppermost(stage):
    one, other = layer("red"), layer("blue", opacity=0.9)
    base, light = base_and_light(stage)
    images = {name: sample(name) for name in ("red", "blue")}
    pictures = []
    for order in ((one, other), (other, one)):
        pictures.append(show(stage, LayerStack(order))[30, 40])
        assert np.abs(pictures[-1] / 255.0 - compose(base, light, order, images)).max() < 2.5 / 255
    assert np.abs(pictures[0] - pictures[1]).max() > 30


def test_a_visibility_texture_says_where_a_layer_shows(stage):
    ground = show(stage, LayerStack())
    full = show(stage, LayerStack((layer("red"),)))
    assert np.array_equal(show(stage, LayerStack((layer("red", visibility="white"),))), full)
    for hides in ("black", "clear"):
        assert np.array_equal(show(stage, LayerStack((layer("red", visibility=hides),))), ground)
    half = show(stage, LayerStack((layer("red", visibility="grey"),)))[30, 40]
    assert np.abs(half - (ground[30, 40] + 120 / 255 * (full[30, 40] - ground[30, 40]))).max() <= 2


def test_what_is_off_is_not_compiled():
    on = layer("red")
    assert layer_defines(LayerStack()) == {}
    assert layer_defines(LayerStack((replace(on, is_on=False), replace(on, opacity=0.0)))) == {}
    assert layer_defines(LayerStack((on,))) == {"LAYERS": 1}
    assert layer_defines(LayerStack((on, replace(on, visibility="grey")))) == {"LAYERS": 2, "VISIBILITY": 1}
    inside = replace(on, where="inside")
    assert layer_defines(LayerStack((inside,))) == {}  # there is no lens for it to be in
    assert layer_defines(LayerStack((inside,), Lens(True))) == {"LAYERS": 1, "LENS": 1}
    assert layer_defines(LayerStack((on,), Lens(True))) == {"LAYERS": 1}
    assert layer_defines(LayerStack((), Lens(True, dimming=0.5))) == {"LAYERS": 0, "LENS": 1}
    moving = Layer("m", (Key("red", 0.0), Key("blue", 1.0)))
    for time in (0.5, 1.0):  # nothing is compiled while time goes on
        assert layer_defines(LayerStack((moving,), time=time)) == {"LAYERS": 1, "KEY_FRAMES": 1}


def places(stage):
    """World x and z of every pixel."""
    world = stage.positions(ABOVE, SIZE_PX)
    return world[..., 0], world[..., 2]


def test_the_lens_shows_its_layer_inside_its_circle_and_nowhere_else(stage):
    lens = Lens(True, (300.0, 200.0), 90.0, rim=0.2)
    inside = lens.inside(*places(stage))[..., None]
    assert inside.min() == 0.0
    assert inside.max() == 1.0
    ground = show(stage, LayerStack())
    covered = show(stage, LayerStack((layer("red"),)))
    for where, share in (("inside", inside), ("outside", 1.0 - inside)):
        found = show(stage, LayerStack((layer("red", where=where),), lens))
        assert np.abs(found - (ground + share * (covered - ground))).max() <= 3


@pytest.mark.parametrize("name", [name for name in RENDERERS if name != "reference"])
def test_layers_look_the_same_in_every_renderer(gpu, stage, name):
    moving = Layer("m", (Key("white", 0.0), Key("red", 1.0)), where="inside", visibility="grey")
    stack = LayerStack((layer("blue", blend="modulate"), moving), Lens(True, (300.0, 200.0), 90.0, 0.5, 0.4), 0.6)
    other = Stage(gpu, stage.scene, name, look=CLEAR)
    pictures = [show(each, stack) for each in (stage, other)]
    other.release()
    assert pictures[0].std() > 10
    assert np.abs(pictures[0] - pictures[1]).max() <= 2


def test_the_highlight_lens_darkens_what_lies_outside_and_needs_no_layer(stage):
    ground = show(stage, LayerStack())
    lens = Lens(True, (300.0, 200.0), 120.0, dimming=0.7)
    found = show(stage, LayerStack((), lens))
    expected = ground * (1.0 - 0.7 * (1.0 - lens.inside(*places(stage))))[..., None]
    assert np.abs(found - expected).max() <= 2


def test_without_a_lens_what_belongs_inside_is_hidden_and_what_belongs_outside_shows(stage):
    ground, covered = show(stage, LayerStack()), show(stage, LayerStack((layer("red"),)))
    assert np.array_equal(show(stage, LayerStack((layer("red", where="inside"),))), ground)
    assert np.array_equal(show(stage, LayerStack((layer("red", where="outside"),))), covered)


def test_halfway_between_two_key_frames_is_their_mean(stage):
    moving = Layer("m", (Key("red", 10.0), Key("grey", 20.0), Key("white", 40.0)))
    ends = [show(stage, LayerStack((layer(name),))) for name in ("red", "grey", "white")]
    for time, expected in (
        (0.0, ends[0]), (10.0, ends[0]), (15.0, 0.5 * (ends[0] + ends[1])), (20.0, ends[1]),
        (25.0, 0.75 * ends[1] + 0.25 * ends[2]), (99.0, ends[2]),
    ):  # fmt: skip
        assert np.abs(show(stage, LayerStack((moving,), time=time)) - expected).max() <= 1.5


def test_only_neighbouring_key_frames_are_sampled():
    keys = tuple(Key(f"{i}", float(i)) for i in range(5))
    stack = LayerStack((Layer("m", keys),), time=2.25)
    assert stack.sources == ("2", "3")
    assert stack.layers[0].between(2.25) == ("2", "3", 0.25)
    assert stack.layers[0].between(3.0) == ("3", None, 0.0)


def test_layers_are_moved_and_named_apart():
    stack = LayerStack().with_layer(layer("a")).with_layer(layer("b")).with_layer(layer("a"))
    assert [each.name for each in stack.layers] == ["a", "b", "a 2"]
    assert [each.name for each in stack.moved(0, 1).layers] == ["b", "a", "a 2"]
    assert [each.name for each in stack.moved(0, -1).layers] == ["a", "b", "a 2"]
    assert [each.name for each in stack.moved(1, 9).layers] == ["a", "a 2", "b"]
    assert [each.name for each in stack.without(1).layers] == ["a", "a 2"]


def test_too_many_images_at_once_are_refused_and_the_old_layers_stay(stage):
    show(stage, LayerStack((layer("red"),)))
    many = tuple(layer(f"{i}", visibility=f"v{i}") for i in range(8))
    keyed = tuple(Layer(f"k{i}", (Key(f"{i}", 0.0), Key(f"m{i}", 1.0)), visibility=f"v{i}") for i in range(8))
    sources = dict.fromkeys([f"{kind}{i}" for i in range(9) for kind in ("", "m", "v")], IMAGES["grey"])
    stage.set_layers(LayerStack(many), sources)  # and their visibility: sixteen
    before = stage.drape.stack
    for stack, told in ((LayerStack(keyed, time=0.5), "16 images"), (LayerStack((*many, layer("red"))), "8 layers")):
        with pytest.raises(InputError, match=told):
            stage.set_layers(stack, sources | IMAGES)
    assert stage.drape.stack is before


def test_a_theme_is_computed_beside_the_picture_and_then_shown(stage):
    library = Library(LEVEL)
    stack = LayerStack((layer("aspect"),))
    found = show(stage, stack, library.open_all(stack.sources))
    level = next(swatch.colour for swatch in library.legend("aspect").swatches if swatch.label == "level")
    assert np.abs(found[30, 40] - level).max() <= 2
    library.close()


def test_what_is_neither_theme_nor_file_is_refused_in_one_line():
    with pytest.raises(InputError, match=r"slope, aspect.*'nothing\.png'"):
        Library(LEVEL).open("nothing.png")


def test_a_stage_with_layers_leaves_nothing_on_the_gpu(gpu):
    def count():
        exists = [gpu.function(f"glIs{kind}", ctypes.c_ubyte, ctypes.c_uint) for kind in ("Texture", "Framebuffer")]
        return [sum(each(name) for name in range(1, 2000)) for each in exists]

    def come_and_go():
        stage = Stage(gpu, open_scene(LEVEL), "reference", look=CLEAR)
        show(stage, LayerStack((layer("red"),)))
        stage.set_look(replace(CLEAR, shading="hillshade"))
        show(stage, LayerStack())
        stage.release()
        keep.append(stage)  # nothing may be left to the garbage collector

    keep = []
    come_and_go()  # compiles programs, which stay
    before = count()
    come_and_go()
    assert count() == before
