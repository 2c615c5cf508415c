"""Differences between two pictures: PSNR, and the perceptual difference FLIP where its library is installed.

**Source**: P. Andersson et al., *FLIP: a difference evaluator for alternating images*, HPG 2020 (package
``flip-evaluator``).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]


def psnr_db(reference: Picture, test: Picture) -> float | None:
    """Peak signal-to-noise ratio of two (height, width, 3) uint8 pictures; None where they are equal."""
    squared = np.square(reference.astype(np.float32) - test.astype(np.float32)).mean(dtype=np.float64)
    return 10.0 * math.log10(255.0**2 / squared) if squared else None


def flip_mean(reference: Picture, test: Picture) -> float | None:
    """Mean FLIP of two (height, width, 3) uint8 pictures, 0 where they look the same; None without the library."""
    try:
        import flip_evaluator
    except ImportError:
        return None
    # Floats in 0..1: the library accepts uint8 and gives a wrong answer.
    pictures = [np.ascontiguousarray(p, np.float32) / np.float32(255) for p in (reference, test)]
    _, mean, _ = flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)
    return float(mean)
