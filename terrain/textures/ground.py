"""The terrain's own textures: post heights, and what is baked from them.

Baking draws into textures, once per change of sun or palette: large-scale visibility of sky and sun on a coarse grid,
then elevation tint times light in one texel per post and, where images lie on the terrain, their light in another. A
frame only fetches (mip-nearest), whatever the level of detail of the geometry.

**Source**: the topographic texture of Doellner, Baumann and Hinrichs, *Texturing techniques for terrain visualization*
(2000).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import moderngl
import numpy as np

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.programs import UNITS
from terrain.heightfield import Heightfield
from terrain.textures.palettes import read_palette

NADIR = Frame(Camera((0.0, 0.0, 0.0)), (1, 1))  # a bake has no camera
NONE: Mapping[str, int] = {}
COARSE_TEXELS = 512  # per side at most: where shadows and open sky are found


class Ground:
    """Heights (R32F, one texel per post), ground colour and light on images (RGBA8 with mip levels) of a height field.

    Raises
    ------
    InputError
        If the grid is larger than the GPU's textures.
    """

    def __init__(self, gpu: Gpu, heightfield: Heightfield) -> None:
        self._gpu, self._heightfield = gpu, heightfield
        ctx, size = gpu.ctx, (heightfield.cols, heightfield.rows)
        most = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        if max(size) > most:
            raise InputError(
                f"{heightfield.name} has {size[0]} x {size[1]} posts; this GPU draws at most {most} per side. "
                "Cut it or reduce it first (gdal_translate -outsize)."
            )
        self.heights = ctx.texture(size, 1, heightfield.heights_m.data, dtype="f4")
        self.heights.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.colour = _colour_texture(gpu, size)
        self._mask: moderngl.Texture | None = None
        if heightfield.holes is not None:
            data = np.where(heightfield.holes, np.uint8(0), np.uint8(255))
            self._mask = ctx.texture(size, 1, np.ascontiguousarray(data).data, alignment=1)
            self._mask.filter = (moderngl.NEAREST, moderngl.NEAREST)

        step = max(1.0, max(size) / COARSE_TEXELS)
        coarse_size = (max(1, math.ceil(size[0] / step)), max(1, math.ceil(size[1] / step)))
        self._coarse_size = (*coarse_size, size[0] / coarse_size[0], size[1] / coarse_size[1])
        self._coarse = ctx.texture(coarse_size, 1, dtype="f4")
        self._visibility = ctx.texture(coarse_size, 4, dtype="f1")
        for texture in (self._coarse, self._visibility):
            texture.repeat_x = texture.repeat_y = False
        self._coarse_is_baked = False
        self._light: moderngl.Texture | None = None

    def bake(self, palette_name: str, look: Look, block: FrameBlock, *, with_light: bool) -> None:
        """Fill visibility, ground colour and, where images need it, their light. Leaves ``block`` without a camera."""
        gpu, terrain = self._gpu, self._heightfield
        low, high = terrain.height_range_m
        block.write(NADIR, terrain, look)
        self.heights.use(UNITS["u_heights"])
        if not self._coarse_is_baked:
            self._pass("bake_coarse", self._coarse, {"u_coarse_size": self._coarse_size})
            _finish_mips(self._coarse)
            self._coarse_is_baked = True
        self._coarse.use(UNITS["u_coarse"])
        uniforms = {"u_coarse_size": self._coarse_size, "u_height_range": (low, high, 0.0, 0.0)}
        self._pass("bake_visibility", self._visibility, uniforms)
        self._visibility.use(UNITS["u_visibility"])

        palette = read_palette(palette_name)
        colours = gpu.ctx.texture((palette.colours.shape[1], 2), 3, palette.colours.tobytes(), alignment=1)
        colours.repeat_x = colours.repeat_y = False
        colours.use(UNITS["u_palette"])
        if self._mask is not None:
            self._mask.use(UNITS["u_source"])
        span = max(high - low, palette.least_relief_m * terrain.exaggeration, 1e-3)
        defines = {"HOLES": 1} if self._mask is not None else {}
        self._pass("bake_ground", self.colour, {"u_tint_range": (low, 1.0 / span, 0.0, 0.0)}, defines)
        _finish_mips(self.colour)
        colours.release()

        if with_light:
            if self._light is None:
                self._light = _colour_texture(gpu, self.colour.size)
            self._pass("bake_light", self._light, {})
            _finish_mips(self._light)

    def _pass(
        self, fragment: str, into: moderngl.Texture, uniforms: Mapping[str, object], defines: Mapping[str, int] = NONE
    ) -> None:
        """Fill every texel of a texture."""
        ctx = self._gpu.ctx
        program = self._gpu.programs.get("fullscreen", fragment, defines)
        for name, value in uniforms.items():
            program[name] = value
        framebuffer = ctx.framebuffer([into])
        array = ctx.vertex_array(program, [])
        framebuffer.use()
        ctx.disable(moderngl.DEPTH_TEST)
        array.render(moderngl.TRIANGLES, vertices=3)
        ctx.enable(moderngl.DEPTH_TEST)
        array.release()
        self._gpu.release_framebuffer(framebuffer)

    def bind(self) -> None:
        """Bind what frames read to its units."""
        self.heights.use(UNITS["u_heights"])
        self.colour.use(UNITS["u_ground"])
        if self._light is not None:
            self._light.use(UNITS["u_light"])

    def release(self) -> None:
        parts = (self.colour, self.heights, self._mask, self._coarse, self._visibility, self._light)
        for part in parts:
            if part is not None:
                part.release()


def _colour_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    texture = gpu.ctx.texture(size, 4, dtype="f1")
    texture.repeat_x = texture.repeat_y = False
    return texture


def _finish_mips(texture: moderngl.Texture) -> None:
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
