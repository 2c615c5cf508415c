"""What one asks of the ground in the window: a picked point, and the profile between two points.

With the measure tool on, the left button draws a line instead of turning the view. Without a mouse, the point in the
middle of the picture is picked; with the tool on it becomes an end of the line.
"""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from app.flying.controls import Inputs
from app.output.capture import replacing
from app.places.coordinates import Coordinates, Place
from app.places.picking import Profile, Relief, profile_between, relief_at
from app.session.navigation import MIDDLE
from terrain.errors import InputError
from terrain.flight import numbered_path
from terrain.frame import Frame

if TYPE_CHECKING:
    from app.session.session import Session
    from terrain.gpu.lines import Lines

Floats = npt.NDArray[np.float64]
Spot = tuple[float, float]
"""World x and z [m]."""
WINDOW = "survey"
LEAST_TRAVEL = 0.005  # of the picture: a shorter drag is a click
POINT_COLOUR, LINE_COLOUR, HOVER_COLOUR = (1.0, 0.92, 0.35, 1.0), (1.0, 0.55, 0.1, 1.0), (1.0, 1.0, 1.0, 1.0)
PIN_PX, HEAD_PX, LINE_PX = 34.0, 5.0, 2.5
LIFT_PX = 1.5  # the line lies this much above the ground, which the levels of detail move
LINE_STEPS = 512  # segments of the line, at most


class Point(NamedTuple):
    """A picked point: where it is in all systems known, and how the ground lies there."""

    place: Place
    relief: Relief


class Survey:
    """What has been picked and measured.

    Attributes
    ----------
    spot_m : tuple of 2 float, or None
        The picked point, world x and z.
    ends_m : list of tuple of 2 float
        Of the line, world x and z: none, one or two.
    profile : Profile or None
        Between two ends.
    is_measuring : bool
        Whether the measure tool is on.
    hover_m : float or None
        The distance along the profile that is being pointed at.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.spot_m: Spot | None = None
        self.ends_m: list[Spot] = []
        self.profile: Profile | None = None
        self.is_measuring = False
        self.hover_m: float | None = None
        self._press: tuple[float, float] | None = None  # where a drag of the tool began

    @property
    def coordinates(self) -> Coordinates:
        return self._session.places.coordinates

    @property
    def point(self) -> Point | None:
        """What is known about the picked point."""
        if self.spot_m is None:
            return None
        diagonal = self._session.stage.renderer.diagonal
        return Point(self.coordinates.place(*self.spot_m), relief_at(self._session.heightfield, *self.spot_m, diagonal))

    def take_over(self, old: Survey) -> None:
        """Ask about the same places of a terrain that has changed."""
        width, depth = self._session.heightfield.extent_m

        def is_inside(spot: Spot) -> bool:
            return 0.0 <= spot[0] <= width and 0.0 <= spot[1] <= depth

        self.spot_m = old.spot_m if old.spot_m is not None and is_inside(old.spot_m) else None
        if old.profile is not None and all(map(is_inside, old.ends_m)):
            self.ends_m = old.ends_m
            self._measure()

    # One frame

    def take(self, inputs: Inputs) -> Inputs:
        """Pick and measure as the mouse asks; what is left of the inputs for the camera."""
        if not self.is_measuring:
            if inputs.clicked and inputs.pointer is not None:
                self.pick(inputs.pointer)
            return inputs
        if inputs.double_clicked:  # the first click has marked an end that is not meant
            self.forget_line()
            self._press = inputs.pointer
            return inputs
        if inputs.button != "left" or inputs.pointer is None:
            self._press = None
            return inputs
        if self._press is None:
            self._press = inputs.pointer
            self.mark_end(inputs.pointer)
        elif math.dist(self._press, inputs.pointer) > LEAST_TRAVEL:
            self._move_end(inputs.pointer)
        return replace(inputs, button=None, look_px=(0.0, 0.0))

    def pick(self, pointer: tuple[float, float] = MIDDLE) -> None:
        """Pick the point below a place in the picture and show it, or none where there is no ground."""
        self.pick_at(self._spot_under(pointer))
        if self.spot_m is not None:
            self._session.layout.show(WINDOW)

    def pick_at(self, spot_m: Spot | None) -> None:
        """Pick a place of the terrain, or none."""
        self.spot_m = spot_m
        self._session.touch()

    def mark_end(self, pointer: tuple[float, float] = MIDDLE) -> None:
        """Let the line end at the point below a place in the picture, or begin a new line there."""
        spot = self._spot_under(pointer)
        if spot is None:
            self._session.say("There is no ground there.")
            return
        self.ends_m = [*self.ends_m, spot] if len(self.ends_m) == 1 else [spot]
        self._measure()

    def _move_end(self, pointer: tuple[float, float]) -> None:
        """Let the end that is being dragged follow the mouse, over ground."""
        spot = self._spot_under(pointer)
        if spot is not None and self.ends_m:
            self.ends_m = [self.ends_m[0], spot]
            self._measure()

    def _spot_under(self, pointer: tuple[float, float]) -> Spot | None:
        point = self._session.navigation.point_under(pointer)
        return None if point is None else (float(point[0]), float(point[2]))

    def _measure(self) -> None:
        self.profile = self.hover_m = None
        if len(self.ends_m) == 2 and self.ends_m[0] != self.ends_m[1]:
            diagonal = self._session.stage.renderer.diagonal
            first, second = (np.array(end) for end in self.ends_m)
            self.profile = profile_between(self._session.heightfield, first, second, diagonal)
            self._session.layout.show(WINDOW)
        self._session.touch()

    # What keys and widgets do

    def pick_middle(self) -> None:
        """Pick the point in the middle of the picture; with the tool on, mark an end of the line there."""
        if self.is_measuring:
            self.mark_end()
            return
        self.pick()
        if self.spot_m is None:
            self._session.say("There is no ground in the middle of the picture.")

    def toggle_measuring(self) -> None:
        """Take up the measure tool, or put it away; the line stays."""
        self.is_measuring, self._press = not self.is_measuring, None
        self._session.say(
            "Measuring: drag from one point to another, or mark ends with I; M puts the tool away."
            if self.is_measuring else "Dragging turns the view again."
        )  # fmt: skip

    def fly_to_point(self) -> None:
        """Fly to the picked point, or to the one in the middle of the picture."""
        session = self._session
        if self.spot_m is None:
            session.navigation.fly_to_point(session.navigation.point_under())
            return
        x, z = self.spot_m
        session.navigation.fly_to_point(np.array([x, float(session.heightfield.heights_at(x, z)), z]))

    def hover(self, distance_m: float | None) -> None:
        """Show where a distance of the profile lies."""
        if distance_m != self.hover_m:
            self.hover_m = distance_m
            self._session.touch()

    def forget_line(self) -> None:
        """Take the measured line away."""
        self.ends_m, self.profile, self.hover_m = [], None, None
        self._session.touch()

    def dismiss(self) -> bool:
        """Take away the last of tool, line and point; whether there was one."""
        if self.is_measuring:
            self.toggle_measuring()
        elif self.ends_m:
            self.forget_line()
        elif self.spot_m is not None:
            self.pick_at(None)
        else:
            return False
        return True

    def save_profile(self, folder: Path) -> None:
        """Save the profile as CSV under a new name."""
        if self.profile is None:
            return
        path = numbered_path(folder / f"{self._session.heightfield.name}-profile.csv")
        try:
            write_profile(self.profile, self.coordinates, path)
        except InputError as error:
            self._session.say(str(error))
        else:
            self._session.say(f"Saved the profile as {path}.")

    # In the picture

    def draw(self, frame: Frame, lines: Lines) -> None:
        """Pins and the measured line, over the picture just drawn."""
        if self.profile is not None:
            lines.draw(frame, self._line_segments(frame, self.profile), LINE_COLOUR, LINE_PX)
        for spot in self.ends_m:
            lines.draw(frame, self._pin(frame, spot), LINE_COLOUR, LINE_PX)
        if self.spot_m is not None:
            lines.draw(frame, self._pin(frame, self.spot_m), POINT_COLOUR, LINE_PX)
        if self.profile is not None and self.hover_m is not None:
            lines.draw(frame, self._pin(frame, self.profile.place_at(self.hover_m)), HOVER_COLOUR, LINE_PX)

    def _line_segments(self, frame: Frame, profile: Profile) -> Floats:
        """Segments (n, 2, 3) along the ground, none across gaps."""
        chosen = np.unique(np.linspace(0, profile.distance_m.size - 1, LINE_STEPS + 1).astype(np.int64))
        chosen = np.union1d(chosen, np.flatnonzero(np.isnan(profile.height_m)))
        y = profile.height_m[chosen] * self._session.heightfield.exaggeration
        points = np.column_stack([profile.x_m[chosen], y, profile.z_m[chosen]])
        points[:, 1] += LIFT_PX * np.linalg.norm(points - frame.eye_m, axis=1) / frame.pixels_per_radian
        segments = np.stack([points[:-1], points[1:]], axis=1)
        return segments[np.isfinite(segments).all(axis=(1, 2))]

    def _pin(self, frame: Frame, spot: Spot) -> Floats:
        """Segments (n, 2, 3) of a needle on the ground with a diamond for a head, of one size in the picture."""
        x, z = spot
        foot = np.array([x, float(self._session.heightfield.heights_at(x, z)), z])
        metres_per_px = float(np.linalg.norm(foot - frame.eye_m)) / frame.pixels_per_radian
        right = frame.camera.view_from_eye()[0] * HEAD_PX * metres_per_px
        up = np.array([0.0, metres_per_px, 0.0])
        neck = foot + (PIN_PX - 2.0 * HEAD_PX) * up
        middle, top = neck + HEAD_PX * up, foot + PIN_PX * up
        corners = [neck, middle + right, top, middle - right]
        return np.array([[foot, neck], *zip(corners, [*corners[1:], corners[0]], strict=True)])


def write_profile(profile: Profile, coordinates: Coordinates, path: Path) -> None:
    """Write a profile as CSV, one row a point, with all coordinates that are known; heights are empty in gaps.

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """
    columns: dict[str, tuple[Floats, str]] = {
        "distance_m": (profile.distance_m, "%.3f"),
        "height_m": (profile.height_m, "%.3f"),
        "east_m": (profile.x_m, "%.3f"),
        "south_m": (profile.z_m, "%.3f"),
    }
    if (map_xy := coordinates.to_map(profile.x_m, profile.z_m)) is not None:
        form = "%.8f" if coordinates.is_geographic else "%.3f"
        columns |= {"map_x": (map_xy[0], form), "map_y": (map_xy[1], form)}
        if (latlon := coordinates.to_latlon(*map_xy)) is not None:
            columns |= {"latitude_deg": (latlon[0], "%.8f"), "longitude_deg": (latlon[1], "%.8f")}
    texts = [["" if math.isnan(v) else form % v for v in values.tolist()] for values, form in columns.values()]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))
