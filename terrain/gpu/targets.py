"""Where pictures are drawn: colour or data textures with a float depth buffer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.gpu.context import Gpu

Kind = Literal["colour", "position", "error", "count"]
_FORMAT = {"colour": (4, "f1"), "position": (4, "f4"), "error": (4, "f4"), "count": (1, "f4")}


@dataclass
class Target:
    """A framebuffer with one texture and a depth texture of its own."""

    gpu: Gpu
    framebuffer: moderngl.Framebuffer
    texture: moderngl.Texture
    depth: moderngl.Texture
    size_px: tuple[int, int]

    def read(self) -> npt.NDArray[Any]:
        """The picture (height, width, components), row 0 at the top; uint8 colour or float32 data."""
        dtype = np.uint8 if self.texture.dtype == "f1" else np.float32
        width, height = self.size_px
        raw = np.frombuffer(self.texture.read(), dtype)  # four components: three are read far slower
        return raw.reshape(height, width, self.texture.components)[::-1]

    def read_depth(self) -> npt.NDArray[np.float32]:
        """The depth buffer (height, width), row 0 at the top: larger is nearer, 0 where nothing was drawn."""
        width, height = self.size_px
        return np.frombuffer(self.depth.read(), np.float32).reshape(height, width)[::-1]

    def release(self) -> None:
        self.gpu.release_framebuffer(self.framebuffer)
        self.texture.release()
        self.depth.release()


def create_target(gpu: Gpu, size_px: tuple[int, int], kind: Kind = "colour") -> Target:
    """A target of ``size_px`` (width, height): RGBA8 colour, RGBA32F position or error, or R32F count."""
    components, dtype = _FORMAT[kind]
    texture = gpu.ctx.texture(size_px, components, dtype=dtype)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    texture.repeat_x = texture.repeat_y = False
    depth = gpu.depth_texture(size_px)
    framebuffer = gpu.ctx.framebuffer([texture], depth)
    return Target(gpu, framebuffer, texture, depth, size_px)
