"""The terrain's own textures: post heights, and the ground colour baked from them."""

from __future__ import annotations

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.programs import UNITS
from terrain.heightfield import Heightfield

NADIR = Frame(Camera((0.0, 0.0, 0.0)), (1, 1))


class Ground:
    """Heights (R32F, one texel per post) and ground colour (RGBA8 with mip levels) of one height field."""

    def __init__(self, gpu: Gpu, heightfield: Heightfield) -> None:
        self._gpu, self._heightfield = gpu, heightfield
        size = (heightfield.cols, heightfield.rows)
        self.heights = gpu.ctx.texture(size, 1, heightfield.heights_m.data, dtype="f4")
        self.heights.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.colour = gpu.ctx.texture(size, 4, dtype="f1")
        self.colour.repeat_x = self.colour.repeat_y = False
        self.colour.anisotropy = 1.0
        self._mask: moderngl.Texture | None = None
        if heightfield.holes is not None:
            data = np.where(heightfield.holes, np.uint8(0), np.uint8(255))
            self._mask = gpu.ctx.texture(size, 1, np.ascontiguousarray(data).data, alignment=1)
        self._framebuffer = gpu.ctx.framebuffer([self.colour])
        self._array = gpu.ctx.vertex_array(gpu.program("fullscreen", "bake_ground", defines=self._defines), [])

    @property
    def _defines(self) -> dict[str, int]:
        return {} if self._mask is None else {"HOLES": 1}

    def bake(self, palette: moderngl.Texture, look: Look, block: FrameBlock) -> None:
        """Fill the ground colour: elevation tint times light."""
        gpu, terrain = self._gpu, self._heightfield
        block.write(NADIR, terrain, look)
        self.bind()
        palette.use(UNITS["u_palette"])
        if self._mask is not None:
            self._mask.use(UNITS["u_source"])
        low, high = terrain.height_range_m
        program = gpu.program("fullscreen", "bake_ground", defines=self._defines)
        program["u_tint_range"] = (low, 1.0 / max(high - low, 1e-6), 0.0, 0.0)
        self._framebuffer.use()
        gpu.ctx.disable(moderngl.DEPTH_TEST)
        self._array.render(moderngl.TRIANGLES, vertices=3)
        gpu.ctx.enable(moderngl.DEPTH_TEST)
        self.colour.build_mipmaps()
        self.colour.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)

    def bind(self) -> None:
        """Bind both textures to their units."""
        self.heights.use(UNITS["u_heights"])
        self.colour.use(UNITS["u_ground"])

    def release(self) -> None:
        for part in (self._array, self._framebuffer, self.colour, self.heights):
            part.release()
        if self._mask is not None:
            self._mask.release()


def palette_texture(gpu: Gpu, colours: npt.NDArray[np.uint8]) -> moderngl.Texture:
    """A one-row texture of elevation tints (n, 3), lowest first."""
    texture = gpu.ctx.texture((len(colours), 1), 3, np.ascontiguousarray(colours).tobytes(), alignment=1)
    texture.repeat_x = texture.repeat_y = False
    return texture
