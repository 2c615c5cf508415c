"""Heights packed into the three bytes of a colour.

* ``terrarium``: ``256 R + G + B / 256 - 32768`` [m];
* ``mapbox``: ``0.1 (65536 R + 256 G + B) - 10000`` [m];
* ``grey``: brightness.

**Source** Tilezen terrain tiles, https://github.com/tilezen/joerd/blob/master/docs/formats.md; Mapbox Terrain-RGB v1,
https://docs.mapbox.com/data/tilesets/reference/mapbox-terrain-rgb-v1/.

A picture does not say which it is. A wrong guess gives heights nobody has walked on. And where the high byte steps, the
low byte starts again from the other end: that *carry* makes the picture far rougher than the terrain it hides, and no
photograph has it.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError

Encoding = Literal["terrarium", "mapbox", "grey"]
Channel = npt.NDArray[Any]
Floats32 = npt.NDArray[np.float32]

ENCODINGS: tuple[Encoding, ...] = get_args(Encoding)
_DEEPEST_M, _HIGHEST_M = -11_500.0, 9_200.0
_WINDOW = 512
"""Half the side of the window in which an encoding is looked for."""
_SMOOTHER = 0.5
"""How much smoother than the picture the decoded terrain is; real tiles have 0.03 to 0.08, photographs 0.75 to 1."""
_CARRIED = 0.3
"""Share of the steps in red that come with a carry; smooth tiles have 1, noise 0.13, photographs 0."""


def heights_from_rgb(
    red: Channel, green: Channel, blue: Channel, *, encoding: Encoding | None, name: str, notes: list[str]
) -> tuple[Floats32, npt.NDArray[np.bool_] | None]:
    """Heights [m] and the posts that hold none (black); or grey levels and None.

    Parameters
    ----------
    red, green, blue : ndarray, (rows, cols)
    encoding : {"terrarium", "mapbox", "grey"} or None
        None finds out.
    name : str
        For messages.
    notes : list of str
        What was decided is added.

    Raises
    ------
    InputError
        If it is a picture in colours that pack no heights, or the encoding needs bytes and there are none.
    """
    chosen = encoding or detect(red, green, blue)
    if chosen is None:
        raise InputError(
            f"expected heights, found a picture in colours in {name} that neither terrarium nor mapbox decodes to "
            "terrain; give a height map, or force --encoding terrarium, mapbox or grey"
        )
    if chosen == "grey":
        notes.append("The picture's brightness was taken as height.")
        return _grey(red, green, blue), None
    if red.dtype != np.uint8:
        raise InputError(f"expected 8 bits per colour for {chosen}, found {red.dtype} in {name}; leave --encoding out")
    how = "as asked" if encoding else "the only reading that gives smooth, possible heights"
    notes.append(f"Heights are packed in colours: {chosen} encoding ({how}).")
    return _decode(chosen, red, green, blue), (red | green | blue) == 0


def detect(red: Channel, green: Channel, blue: Channel) -> Encoding | None:
    """What the colours mean, by the plausibility of the heights they would give; None where nothing fits."""
    if np.array_equal(red, green) and np.array_equal(green, blue):
        return "grey"
    if red.dtype != np.uint8:
        return None
    window = tuple(slice(max(0, side // 2 - _WINDOW), side // 2 + _WINDOW) for side in red.shape)
    if (red[window] | green[window] | blue[window]).any():  # a part tells as much as the whole
        red, green, blue = red[window], green[window], blue[window]
    data = (red | green | blue) != 0
    picture = _roughness(_grey(red, green, blue), data)
    fitting: list[tuple[float, Encoding]] = []
    for encoding in ENCODINGS[:2]:
        heights = _decode(encoding, red, green, blue)
        # one post in a thousand may be a fault of the tile
        low, high = np.quantile(heights[data][:: max(1, data.sum() // 100_000)], (0.001, 0.999))
        roughness = _roughness(heights, data)
        packed = roughness < _SMOOTHER * picture or _carried(encoding, red, heights) >= _CARRIED
        if low >= _DEEPEST_M and high <= _HIGHEST_M and packed:
            fitting.append((roughness, encoding))
    return min(fitting)[1] if fitting else None


def _carried(encoding: Encoding, red: Channel, heights: Floats32) -> float:
    """Share of the steps in red that the other bytes make up for; 1 where red never steps."""
    half_unit = 128.0 if encoding == "terrarium" else 3276.8
    steps = carried = 0
    for axis in (0, 1):
        stepping = np.diff(red.astype(np.int16), axis=axis) != 0
        steps += int(stepping.sum())
        carried += int((np.abs(np.diff(heights, axis=axis)[stepping]) < half_unit).sum())
    return carried / steps if steps else 1.0


def _decode(encoding: Encoding, red: Channel, green: Channel, blue: Channel) -> Floats32:
    packed = red.astype(np.float32)  # in place from here: 24 bits are exact, and large tiles are large
    for channel in (green, blue):
        packed *= np.float32(256)
        packed += channel
    packed *= np.float32(1 / 256 if encoding == "terrarium" else 0.1)
    packed -= np.float32(32768 if encoding == "terrarium" else 10000)
    return packed


def _grey(red: Channel, green: Channel, blue: Channel) -> Floats32:
    """Rec. 601 brightness; exact where the three are equal."""
    if np.array_equal(red, green) and np.array_equal(green, blue):
        return red.astype(np.float32)
    brightness = red * np.float32(0.299)
    brightness += green * np.float32(0.587)
    brightness += blue * np.float32(0.114)
    return brightness


def _roughness(grid: Floats32, data: npt.NDArray[np.bool_]) -> float:
    """Mean step between neighbours per standard deviation, among posts with data."""
    deviation = float(grid[data].std(dtype=np.float64))
    if deviation == 0:
        return 0.0
    flat = np.where(data, grid, grid[data].mean(dtype=np.float64).astype(np.float32))
    return float(np.abs(np.diff(flat, axis=0)).mean() + np.abs(np.diff(flat, axis=1)).mean()) / deviation
