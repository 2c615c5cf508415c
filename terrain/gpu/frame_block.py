"""The one uniform block every program shares: ``layout(std140) uniform Frame`` in ``shaders/lib/frame.glsl``."""

from __future__ import annotations

from dataclasses import dataclass, fields

import moderngl
import numpy as np

from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.programs import FRAME_BINDING
from terrain.heightfield import Heightfield

MOST_LAYERS = 8  # that show at once; as in shaders/lib/frame.glsl

# Field by field as in the shader; every one is a vec4, so that std140 needs no padding.
FRAME_DTYPE = np.dtype(
    [
        ("clip_from_eye", np.float32, (4, 4)),
        ("eye_post", np.float32, 4),
        ("eye_height", np.float32, 4),
        ("grid", np.float32, 4),
        ("viewport", np.float32, 4),
        ("ray", np.float32, (3, 4)),
        ("axis", np.float32, 4),
        ("sun", np.float32, 4),
        ("sunlight", np.float32, 4),
        ("sky_light", np.float32, 4),
        ("fog", np.float32, 4),
        ("fog_colour", np.float32, 4),
        ("zenith", np.float32, 4),
        ("horizon", np.float32, 4),
        ("contour", np.float32, 4),
        ("water", np.float32, 4),
        ("layer_what", np.float32, (MOST_LAYERS, 4)),
        ("layer_how", np.float32, (MOST_LAYERS, 4)),
        ("lens", np.float32, 4),
        ("lens_effect", np.float32, 4),
    ]
)


@dataclass(frozen=True)
class Look:
    """The part of the block that does not depend on the camera; made by `terrain.textures.look` and `layers`."""

    sun: tuple[float, ...] = (0.0, 1.0, 0.0, 0.0)
    sunlight: tuple[float, ...] = (1.8, 1.6, 1.2, 0.0)
    sky_light: tuple[float, ...] = (0.3, 0.4, 0.5, 0.0)
    fog: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # w: falloff as the eye rises [1/m]; the rest as in the shader
    fog_colour: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    zenith: tuple[float, ...] = (0.3, 0.5, 0.8, 1.0)
    horizon: tuple[float, ...] = (0.8, 0.9, 1.0, 1.0)
    contour: tuple[float, ...] = (1.0, 5.0, 1.0, 1.0)
    water: tuple[float, ...] = (0.0, 1.0, 0.0, 0.0)
    layer_what: tuple[tuple[float, ...], ...] = ((0.0, 0.0, 0.0, 0.0),) * MOST_LAYERS
    layer_how: tuple[tuple[float, ...], ...] = ((0.0, 0.0, 0.0, 0.0),) * MOST_LAYERS
    lens: tuple[float, ...] = (0.0, 0.0, 1.0, 1.0)
    lens_effect: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


class FrameBlock:
    """The buffer behind the block, written once per frame."""

    def __init__(self, gpu: Gpu) -> None:
        self._buffer: moderngl.Buffer = gpu.ctx.buffer(reserve=FRAME_DTYPE.itemsize, dynamic=True)

    def write(self, frame: Frame, heightfield: Heightfield, look: Look) -> None:
        """Upload the block of ``frame`` and bind it."""
        self._buffer.write(pack_frame(frame, heightfield, look).tobytes())
        self._buffer.bind_to_uniform_block(FRAME_BINDING)

    def release(self) -> None:
        self._buffer.release()


def pack_frame(frame: Frame, heightfield: Heightfield, look: Look) -> np.ndarray:
    """The bytes of the block: one record of FRAME_DTYPE."""
    block = np.zeros((), FRAME_DTYPE)
    x, y, z = frame.eye_m
    dx, dz = heightfield.spacing_m
    width, height = frame.viewport_px
    block["clip_from_eye"] = frame.clip_from_eye.T  # GLSL stores columns
    col, row = np.floor(x / dx), np.floor(z / dz)
    block["eye_post"] = (col, row, x - col * dx, z - row * dz)
    high = np.float32(y)  # two floats: heights minus the eye lose no bit at 1e6 m
    block["eye_height"] = (high, y - np.float64(high), frame.near_m, frame.pixels_per_radian)
    block["grid"] = (heightfield.cols, heightfield.rows, dx, dz)
    block["viewport"] = (width, height, 1.0 / width, 1.0 / height)
    (left, bottom), (right, top) = frame.corners
    corner = np.array([[left, bottom], [right, bottom], [left, top]])
    corner *= np.tan(np.radians(frame.camera.fov_deg) / 2) * np.array([frame.aspect, 1.0])
    view = np.concatenate([corner, -np.ones((3, 1))], axis=1) @ frame.camera.view_from_eye()
    block["ray"][:, :3] = view[0], view[1] - view[0], view[2] - view[0]  # lower left, then across, then up
    block["axis"][:2] = -frame.corners[0] / (frame.corners[1] - frame.corners[0])
    block["ray"][1:, 3] = np.square(block["ray"][1:, :3]).sum(axis=1)
    for field in fields(look):
        block[field.name] = getattr(look, field.name)
    # Haze at the eye, and its mean from there to the floor: constants of the frame. Below the floor it stays the same.
    density, floor_m, falloff, eye_falloff = look.fog
    above_m = max(y - floor_m, 0.0)
    block["fog"][0] = density * mean_density(eye_falloff * above_m)
    block["fog"][3] = density * np.exp(-falloff * above_m)
    return block


def mean_density(rise: float) -> float:
    """Mean of ``exp(-h)`` over heights from 0 to ``rise``: of haze along any straight line between the two."""
    return float(-np.expm1(-rise) / rise) if rise > 1e-9 else 1.0
