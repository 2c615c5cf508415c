"""A terrain for papers whose own is unknown."""

from __future__ import annotations

import numpy as np

from terrain.heightfield import Heightfield


def benchmark_terrain(posts: int, seed: int = 1) -> Heightfield:
    """Fractal mountains: ``posts`` x ``posts`` posts 30 m apart, the same shapes at every size."""
    random = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(posts)[:, None], np.fft.rfftfreq(posts)) * posts
    amplitude = np.where(frequency > 0, np.maximum(frequency, 1.5), np.inf) ** -1.9
    phase = np.exp(2j * np.pi * random.random(frequency.shape))
    heights = np.fft.irfft2(amplitude * phase, (posts, posts))
    heights *= 0.05 * 30.0 * posts / (2.0 * heights.std())
    return Heightfield(np.ascontiguousarray(heights, np.float32), (30.0, 30.0), name=f"fractal {posts}")
