"""From what was typed to a flight: a flight file, a track, or the terrain's demo flight."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import Flight, Keyframe, demo_flight, make_flight, read_flight, tour
from terrain.heightfield import Heightfield


def read_flight_for(args: argparse.Namespace, heightfield: Heightfield) -> Flight | None:
    """The flight a command names, from a flight file or a track; None where it names none."""
    from terrain.flight.track_files import TRACK_SUFFIXES

    if args.flight is not None and args.flight.suffix.lower() in TRACK_SUFFIXES:
        from terrain.flight.tracks import read_track

        return read_track(args.flight, heightfield, args.above_ground, args.duration)
    if args.above_ground is not None or args.duration is not None:
        raise InputError(f"--above-ground and --duration go with --flight and a track: {', '.join(TRACK_SUFFIXES)}.")
    if args.flight is None:
        return None
    return read_flight(args.flight)


def open_tour(heightfield: Heightfield) -> Flight:
    """The terrain's demo flight, from the cache where it was found before: a start takes 0.3 s less.

    The key holds the source code that finds it, so that no other version's tour is ever flown.
    """
    from terrain.cache import load_arrays, store_arrays

    source = hashlib.sha256(Path(tour.__file__).read_bytes()).hexdigest()[:16]
    kept = load_arrays("tours", f"{heightfield.sha256}-{source}")
    if kept is not None:
        keys = [Keyframe(t_s, Camera((x, y, z), *view)) for t_s, x, y, z, *view in kept["keyframes"].tolist()]
        return make_flight(keys, str(kept["name"]), heightfield)
    flight = demo_flight(heightfield)
    cameras = [(key.t_s, key.camera) for key in flight.keyframes]
    rows = [(t_s, *c.position_m, c.yaw_deg, c.pitch_deg, c.roll_deg, c.fov_deg) for t_s, c in cameras]
    arrays = {"keyframes": np.array(rows, np.float64), "name": np.array(flight.name)}
    store_arrays("tours", f"{heightfield.sha256}-{source}", arrays)
    return flight
