"""Flights: keyframes and splines, the flight file, recording, and tours made for any terrain."""

from terrain.flight.file import numbered_path, read_flight, write_flight
from terrain.flight.path import Flight, Keyframe, make_flight
from terrain.flight.recorder import FlightRecorder
from terrain.flight.tour import demo_flight, orbit_flight

__all__ = [
    "Flight",
    "FlightRecorder",
    "Keyframe",
    "demo_flight",
    "make_flight",
    "numbered_path",
    "orbit_flight",
    "read_flight",
    "write_flight",
]
