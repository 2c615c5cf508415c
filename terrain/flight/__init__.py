"""Flights: keyframes and splines, the flight file, recording, and tours made for any terrain."""

from terrain.flight.file import numbered_path, read_flight, write_flight
from terrain.flight.pace import PACES, Pace, flight_time, played_times
from terrain.flight.path import Flight, Keyframe, make_flight
from terrain.flight.recorder import FlightRecorder
from terrain.flight.tour import demo_flight, orbit_flight

__all__ = [
    "PACES",
    "Flight",
    "FlightRecorder",
    "Keyframe",
    "Pace",
    "demo_flight",
    "flight_time",
    "make_flight",
    "numbered_path",
    "orbit_flight",
    "played_times",
    "read_flight",
    "write_flight",
]
