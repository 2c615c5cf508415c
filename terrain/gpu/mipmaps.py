"""Mip levels of a part of a texture: what changed is averaged again, and nothing else.

OpenGL alone makes all levels of the whole texture. Each texel of a level is one bilinear sample of the level above, as
drivers do it, so that any sequence of parts ends in the same bits.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence

import moderngl

from terrain.gpu.context import GL_TEXTURE_2D, Gpu
from terrain.gpu.programs import UNITS

GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 = 0x8D40, 0x8CE0
GL_TEXTURE_BASE_LEVEL, GL_TEXTURE_MAX_LEVEL = 0x813C, 0x813D
ALL_LEVELS = 1000  # what OpenGL starts with

Rect = tuple[int, int, int, int]
"""``(x, y, width, height)`` in texels."""


class Mipmaps:
    """The mip levels of one texture of four 8-bit components.

    Parameters
    ----------
    gpu : Gpu
    texture : moderngl.Texture
        Gets all its levels here; their content is undefined until `update`.
    """

    def __init__(self, gpu: Gpu, texture: moderngl.Texture) -> None:
        self._gpu, self._texture = gpu, texture
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
        attach = gpu.function("glFramebufferTexture2D", None, *[ctypes.c_uint] * 4, ctypes.c_int)
        limit = gpu.function("glTexParameteri", None, ctypes.c_uint, ctypes.c_uint, ctypes.c_int)
        assert attach is not None  # both are in OpenGL 3.0
        assert limit is not None
        self._attach, self._limit = attach, limit
        width, height = texture.size
        self._sizes = [(max(width >> l, 1), max(height >> l, 1)) for l in range(int(math.log2(max(width, height))) + 1)]
        self._framebuffer = gpu.ctx.framebuffer([texture])
        self._array: tuple[moderngl.Program, moderngl.VertexArray] | None = None

    def update(self, parts: Sequence[Rect]) -> None:
        """Average anew what lies below some parts of the finest level."""
        program = self._gpu.programs.get("fullscreen", "bake_mipmap", {})
        if self._array is None or self._array[0] is not program:  # or the shader was reloaded
            self._release_array()
            self._array = (program, self._gpu.ctx.vertex_array(program, []))
        ctx, texture = self._gpu.ctx, self._texture
        self._framebuffer.use()
        ctx.disable(moderngl.DEPTH_TEST)
        texture.use(UNITS["u_source"])
        current = list(parts)
        for level in range(1, len(self._sizes)):
            current = merged([_below(part, self._sizes[level - 1], self._sizes[level]) for part in current])
            # Read one level and write the next: with these limits that is no feedback.
            self._limit(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, level - 1)
            self._limit(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, level - 1)
            self._attach(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture.glo, level)
            program["u_size"] = self._sizes[level]
            for part in current:
                self._framebuffer.viewport = part
                self._array[1].render(moderngl.TRIANGLES, vertices=3)
        self._limit(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, 0)
        self._limit(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, ALL_LEVELS)
        self._attach(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture.glo, 0)
        ctx.enable(moderngl.DEPTH_TEST)

    def _release_array(self) -> None:
        if self._array is not None:
            self._array[1].release()
            self._array = None

    def release(self) -> None:
        """Release what is used for averaging; the texture belongs to who made it."""
        self._release_array()
        self._gpu.release_framebuffer(self._framebuffer)


def merged(parts: Sequence[Rect]) -> list[Rect]:
    """The parts, those that have grown into each other as one: small levels need few passes."""
    rest = list(dict.fromkeys(parts))
    if len(rest) < 2:
        return rest
    left, top = min(p[0] for p in rest), min(p[1] for p in rest)
    right, bottom = max(p[0] + p[2] for p in rest), max(p[1] + p[3] for p in rest)
    whole = (left, top, right - left, bottom - top)
    return [whole] if whole[2] * whole[3] <= 2 * sum(w * h for _, _, w, h in rest) else rest


def _below(part: Rect, size: tuple[int, int], half: tuple[int, int]) -> Rect:
    """The texels of the next level that see a part of this one; a bilinear sample reaches one texel further."""
    x, y, width, height = part
    left, top = math.floor((x - 1) * half[0] / size[0]), math.floor((y - 1) * half[1] / size[1])
    right, bottom = math.ceil((x + width + 1) * half[0] / size[0]), math.ceil((y + height + 1) * half[1] / size[1])
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, half[0]), min(bottom, half[1])
    return left, top, right - left, bottom - top
