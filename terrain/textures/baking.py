"""Topographic textures: light and tint of the ground, baked off screen from the full-resolution terrain, in tiles.

One texel per post, whatever the level of detail of the geometry; a frame only fetches. When the sun moves, or another
design rule is chosen, the tiles are baked anew within a budget of time per frame: those in sight first, of these the
ones that have waited longest, then the nearest. Until its turn comes a tile keeps its old light. Tiles baked one by one
end in the same bits as all baked at once.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", sections
"Shading by Topographic Textures" and "Generating Topographic Textures". Multi-directional hillshade: R. Mark,
*Multidirectional, oblique-weighted, shaded-relief image of the Island of Hawaii* (USGS Open-File Report 92-422, 1992).

**Deviations** The paper draws the terrain's triangles in orthogonal projection; here a fragment finds the surface at
its texel from the heights themselves. Shadows of ground farther than a few posts are found on coarser heights.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.mipmaps import Mipmaps, Rect
from terrain.gpu.programs import UNITS
from terrain.heightfield import Heightfield
from terrain.textures.palettes import read_palette

NADIR = Frame(Camera((0.0, 0.0, 0.0)), (1, 1))  # a bake has no camera
NONE: Mapping[str, object] = {}
COARSE_TEXELS = 512  # per side at most: where open sky and far shadows are found
TILE_POSTS = 128  # a few milliseconds on a software rasteriser
NEUTRAL = 0.5  # texel of light that changes nothing
RULES: Mapping[str, str] = {
    "sunlight": "the sun with the shadows it casts, and the open sky",
    "hillshade": "light from four sides, weighted by where a slope faces: no slope is lost in shadow",
    "slope": "the steeper, the darker",
}
RULES_HELP = "; ".join(f"{name}: {text}" for name, text in RULES.items()).capitalize() + "."


@dataclass(frozen=True)
class Design:
    """What a topographic texture looks like; another one is baked where any of this changes.

    Attributes
    ----------
    palette : str
        A name of `terrain.textures.palettes.PALETTES`.
    rule : str
        A key of `RULES`.
    sun : tuple of float
        Azimuth and elevation [deg].
    """

    palette: str
    rule: str
    sun: tuple[float, float]


class Baker:
    """Bakes the ground of one height field.

    Parameters
    ----------
    gpu : Gpu
    heightfield : Heightfield
    heights, mask : moderngl.Texture
        R32F heights and, where there are posts without data, R8 with 0 there.

    Attributes
    ----------
    colour : moderngl.Texture
        RGBA8: tint times light; alpha 0 where there is no data.
    light : moderngl.Texture or None
        RGB8 and one to spare: light relative to that on level ground, half of it; for images laid over the ground.
    """

    def __init__(
        self, gpu: Gpu, heightfield: Heightfield, heights: moderngl.Texture, mask: moderngl.Texture | None
    ) -> None:
        self._gpu, self._heightfield, self._heights, self._mask = gpu, heightfield, heights, mask
        size = (heightfield.cols, heightfield.rows)
        self.colour = _create_texture(gpu, size)
        self.light: moderngl.Texture | None = None
        self._mipmaps = [Mipmaps(gpu, self.colour)]
        self._framebuffer = gpu.ctx.framebuffer([self.colour])
        self._palette: tuple[str, moderngl.Texture] | None = None

        step = max(1.0, max(size) / COARSE_TEXELS)
        coarse = (max(1, math.ceil(size[0] / step)), max(1, math.ceil(size[1] / step)))
        self._coarse_size = (*coarse, size[0] / coarse[0], size[1] / coarse[1])
        self._coarse = gpu.ctx.texture(coarse, 1, dtype="f4")
        self._visibility = gpu.ctx.texture(coarse, 4, dtype="f1")
        for texture in (self._coarse, self._visibility):
            texture.repeat_x = texture.repeat_y = False
        self._visibility_framebuffer = gpu.ctx.framebuffer([self._visibility])
        self._sky_is_baked = False

        self._tiles = tile_rects(size, TILE_POSTS)
        self._baked_at = np.zeros(len(self._tiles), np.int64)  # 0: never
        self._is_stale = np.ones(len(self._tiles), np.bool_)
        self._turn = 0
        self._design: Design | None = None
        self._generation = gpu.programs.generation
        self._tile_ms = 0.0  # what a tile costs here; measured when it matters

    @property
    def is_done(self) -> bool:
        """Whether every tile shows the design that was asked for last."""
        return not self._is_stale.any()

    def want_light(self, is_wanted: bool) -> None:
        """Keep light apart from tint as well, or no longer; until a tile is baked its light is even."""
        if is_wanted == (self.light is not None):
            return
        self._gpu.release_framebuffer(self._framebuffer)
        if self.light is not None:
            self._mipmaps.pop().release()
            self.light.release()
            self.light = None
            self._framebuffer = self._gpu.ctx.framebuffer([self.colour])
            return
        self.light = _create_texture(self._gpu, self.colour.size)
        only = self._gpu.ctx.framebuffer([self.light])
        only.clear(NEUTRAL, NEUTRAL, NEUTRAL, 1.0)
        self._gpu.release_framebuffer(only)
        self._mipmaps.append(Mipmaps(self._gpu, self.light))
        self._framebuffer = self._gpu.ctx.framebuffer([self.colour, self.light])
        self._is_stale[:] = True

    def bake(
        self, design: Design, look: Look, block: FrameBlock, frame: Frame | None = None, budget_ms: float = math.inf
    ) -> None:
        """Bake what does not show ``design`` yet, for about ``budget_ms``; everything where nothing was baked before.

        ``frame`` says what is in sight. Leaves ``block`` without a camera where anything was baked.
        """
        if design != self._design:
            self._design = design
            self._is_stale[:] = True
        if self._gpu.programs.generation != self._generation:  # shaders were reloaded
            self._generation = self._gpu.programs.generation
            self._is_stale[:], self._sky_is_baked = True, False
        if self.is_done:
            return
        block.write(NADIR, self._heightfield, look)
        self._bind_sources(design.palette)
        is_first = self._turn == 0
        self._turn += 1
        stale = np.flatnonzero(self._is_stale)
        if is_first or math.isinf(budget_ms):
            parts = [(0, 0, *self.colour.size)] if len(stale) == len(self._tiles) else self._rects(stale)
            self._bake_parts(design, parts)
        else:
            if not self._tile_ms:
                self._tile_ms = self._measure_tile(design)
            order = bake_order(self._tiles[stale], self._baked_at[stale], self._heightfield, frame)
            stale = stale[order][: max(1, int(budget_ms / max(self._tile_ms, 1e-3)))]
            self._bake_parts(design, self._rects(stale))
        self._baked_at[stale] = self._turn
        self._is_stale[stale] = False

    def _measure_tile(self, design: Design) -> float:
        """What a tile costs here [ms]; baked twice, since the first time may compile shaders."""
        for _ in range(2):
            self._gpu.ctx.finish()
            begin = time.perf_counter()
            self._bake_parts(design, self._rects(np.array([len(self._tiles) // 2])))
            self._gpu.ctx.finish()
        return 1e3 * (time.perf_counter() - begin)

    def _rects(self, tiles: npt.NDArray[np.intp]) -> list[Rect]:
        return [(x, y, width, height) for x, y, width, height in self._tiles[tiles].tolist()]

    def _bind_sources(self, palette_name: str) -> None:
        """What the shaders read; open sky is found once per terrain."""
        self._heights.use(UNITS["u_heights"])
        if self._palette is None or self._palette[0] != palette_name:
            if self._palette is not None:
                self._palette[1].release()
            colours = read_palette(palette_name).colours
            texture = self._gpu.ctx.texture((colours.shape[1], 2), 3, colours.tobytes(), alignment=1)
            texture.repeat_x = texture.repeat_y = False
            self._palette = (palette_name, texture)
        self._palette[1].use(UNITS["u_palette"])
        if not self._sky_is_baked:
            framebuffer = self._gpu.ctx.framebuffer([self._coarse])
            self._pass("bake_coarse", framebuffer, [(0, 0, *self._coarse.size)], {"u_coarse_size": self._coarse_size})
            self._gpu.release_framebuffer(framebuffer)
            self._coarse.build_mipmaps()
            self._coarse.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
        self._coarse.use(UNITS["u_coarse"])
        if not self._sky_is_baked:
            self._bake_visibility([(0, 0, *self._coarse.size)], {"SKY": 1})
            self._sky_is_baked = True
        self._visibility.use(UNITS["u_visibility"])

    def _bake_visibility(self, parts: list[Rect], defines: Mapping[str, int]) -> None:
        """The share of the sky (red) or, without ``SKY``, of the sun (green) that coarse texels see."""
        low, high = self._heightfield.height_range_m
        self._visibility_framebuffer.color_mask = "SKY" in defines, "SKY" not in defines, False, False
        uniforms = {"u_coarse_size": self._coarse_size, "u_height_range": (low, high, 0.0, 0.0)}
        self._pass("bake_visibility", self._visibility_framebuffer, parts, uniforms, defines)

    def _bake_parts(self, design: Design, parts: list[Rect]) -> None:
        """Shadows, then tint times light, then their mip levels, of some parts of the ground."""
        terrain = self._heightfield
        if design.rule == "sunlight":
            self._bake_visibility([self._coarse_rect(part) for part in parts], {})
        palette, (low, high) = read_palette(design.palette), terrain.height_range_m
        span = max(high - low, palette.least_relief_m * terrain.exaggeration, 1e-3)
        defines = {f"RULE_{design.rule.upper()}": 1}
        if self.light is not None:
            defines["LIGHT"] = 1
        if self._mask is not None:
            self._mask.use(UNITS["u_source"])  # which mip levels use too
        self._pass("bake_ground", self._framebuffer, parts, {"u_tint_range": (low, 1.0 / span, 0.0, 0.0)}, defines)
        for mipmaps in self._mipmaps:
            mipmaps.update(parts)

    def _coarse_rect(self, part: Rect) -> Rect:
        """The coarse texels that a part of the ground reads, with those that bilinear sampling takes beside them."""
        (cols, rows), per_col, per_row = self._coarse.size, self._coarse_size[2], self._coarse_size[3]
        x, y, width, height = part
        left, top = max(math.floor(x / per_col) - 1, 0), max(math.floor(y / per_row) - 1, 0)
        right, bottom = math.ceil((x + width) / per_col) + 1, math.ceil((y + height) / per_row) + 1
        return left, top, min(right, cols) - left, min(bottom, rows) - top

    def _pass(
        self, fragment: str, into: moderngl.Framebuffer, parts: list[Rect], uniforms: Mapping[str, object],
        defines: Mapping[str, int] = NONE,  # type: ignore[assignment]
    ) -> None:  # fmt: skip
        """Fill every texel of some parts of a framebuffer."""
        ctx, program = self._gpu.ctx, self._gpu.programs.get("fullscreen", fragment, defines)
        for name, value in uniforms.items():
            if name in program:
                program[name] = value
        array = ctx.vertex_array(program, [])
        into.use()
        ctx.disable(moderngl.DEPTH_TEST)
        for part in parts:
            into.viewport = part
            array.render(moderngl.TRIANGLES, vertices=3)
        ctx.enable(moderngl.DEPTH_TEST)
        array.release()

    def release(self) -> None:
        """Release what was made here."""
        for framebuffer in (self._framebuffer, self._visibility_framebuffer):
            self._gpu.release_framebuffer(framebuffer)
        palette = None if self._palette is None else self._palette[1]
        for part in (*self._mipmaps, self.colour, self.light, self._coarse, self._visibility, palette):
            if part is not None:
                part.release()


def tile_rects(size: tuple[int, int], tile_posts: int) -> npt.NDArray[np.int64]:
    """(n, 4): x, y, width and height of the tiles of a texture, row by row; the last ones are cut by its edge."""
    x, y = (np.arange(0, length, tile_posts) for length in size)
    x, y = (grid.ravel() for grid in np.meshgrid(x, y))
    return np.stack([x, y, np.minimum(tile_posts, size[0] - x), np.minimum(tile_posts, size[1] - y)], axis=1)


def bake_order(
    tiles: npt.NDArray[np.int64], baked_at: npt.NDArray[np.int64], heightfield: Heightfield, frame: Frame | None
) -> npt.NDArray[np.intp]:
    """The order in which to bake tiles (n, 4): in sight before out of sight, then longest not baked, then nearest."""
    if frame is None:
        return np.argsort(baked_at, kind="stable")
    spacing = np.array(heightfield.spacing_m)
    low_m, high_m = heightfield.height_range_m
    begin, end = tiles[:, :2] * spacing, (tiles[:, :2] + tiles[:, 2:] - 1) * spacing
    lower = np.stack([begin[:, 0], np.full(len(tiles), low_m), begin[:, 1]], axis=1) - frame.eye_m
    upper = np.stack([end[:, 0], np.full(len(tiles), high_m), end[:, 1]], axis=1) - frame.eye_m
    seen = np.all([(np.where(plane > 0, upper, lower) @ plane) >= 0 for plane in frame.side_planes], axis=0)
    away = np.linalg.norm(np.clip(0.0, lower, upper), axis=1)
    return np.lexsort((away, baked_at, ~seen))


def _create_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    texture = gpu.ctx.texture(size, 4, dtype="f1")
    texture.repeat_x = texture.repeat_y = False
    return texture
