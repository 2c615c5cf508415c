"""The terrain's own textures: post heights, and what is baked from them (`terrain.textures.baking`).

A frame only fetches (mip-nearest), whatever the level of detail of the geometry.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from terrain.errors import InputError
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.programs import UNITS
from terrain.heightfield import Heightfield
from terrain.textures.baking import Baker, Design


class Ground:
    """Heights (R32F, one texel per post), ground colour and light of one height field.

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
        self._mask: moderngl.Texture | None = None
        if heightfield.holes is not None:
            data = np.where(heightfield.holes, np.uint8(0), np.uint8(255))
            self._mask = ctx.texture(size, 1, np.ascontiguousarray(data).data, alignment=1)
            self._mask.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._baker = Baker(gpu, heightfield, self.heights, self._mask)

    @property
    def is_done(self) -> bool:
        """Whether all that was asked for is baked."""
        return self._baker.is_done

    def want_light(self, is_wanted: bool) -> None:
        """Keep light apart from tint as well, for what lies on the ground, or no longer."""
        self._baker.want_light(is_wanted)

    def bake(
        self, design: Design, look: Look, block: FrameBlock, frame: Frame | None = None, budget_ms: float = math.inf
    ) -> None:
        """Bake what does not show ``design`` yet; see `Baker.bake`."""
        self._baker.bake(design, look, block, frame, budget_ms)

    def bind(self) -> None:
        """Bind what frames read to its units."""
        self.heights.use(UNITS["u_heights"])
        self._baker.colour.use(UNITS["u_ground"])
        if self._baker.light is not None:
            self._baker.light.use(UNITS["u_light"])

    def release(self) -> None:
        for part in (self._baker, self.heights, self._mask):
            if part is not None:
                part.release()
