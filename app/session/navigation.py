"""How one moves in the window: fly, orbit or walk, with or without the ground in the way, and passages to other views.

Keeps what must outlive a frame: the point grasped by the mouse, a zoom not yet finished, a passage under way. The
motions themselves are pure functions in `app.flying.controls` and `app.flying.cameras`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from app.flying import cameras
from app.flying.cameras import EYE_HEIGHT_M, NEARER_PER_NOTCH, ZOOM_RESPONSE_PER_S, IsFree, Mode, Passage, sight_line
from app.flying.controls import Inputs, move, speed_m_s
from app.places.framing import clearance_above, ground_m, least_clearance_m
from app.places.picking import first_hit
from terrain.camera import Camera

if TYPE_CHECKING:
    from app.session.session import Session

Floats = npt.NDArray[np.float64]
MODES: dict[Mode, str] = {
    "fly": "Flying: drag looks around, the wheel changes the speed.",
    "orbit": "Orbiting: drag turns about the point under the mouse, right drag moves it, the wheel zooms to it.",
    "walk": "Walking at eye height: drag looks around, the wheel changes the pace.",
}
MIDDLE = (0.5, 0.5)
ZOOM_REST = 1e-3  # of a notch: what is left of a zoom that counts as done


class Navigation:
    """The way one moves.

    Attributes
    ----------
    mode : {"fly", "orbit", "walk"}
    collides : bool
        Whether the ground stops the eye.
    passage : Passage or None
        On the way to another view.
    has_gamepad : bool
        Whether one is connected.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.mode: Mode = "fly"
        self.collides, self.has_gamepad = True, False
        self.passage: Passage | None = None
        self._passed_s = 0.0
        self._grasped_m: Floats | None = None  # what the mouse holds on to
        self._pivot_m: Floats | None = None  # what the keys turn about
        self._zoom_m: Floats | None = None
        self._nearer = 0.0

    @property
    def is_moving(self) -> bool:
        """Whether the camera moves on without anybody doing anything."""
        return self.passage is not None or self._nearer != 0.0

    @property
    def eye_height_m(self) -> float:
        """Of somebody who walks, stretched as the terrain is."""
        return EYE_HEIGHT_M * self._session.heightfield.exaggeration

    @property
    def speed_m_s(self) -> float:
        """How fast one moves with a key held."""
        session = self._session
        if self.mode == "walk":
            return cameras.WALK_REACH_M * session.motion.speed_factor
        least = least_clearance_m(session.heightfield)
        return speed_m_s(session.height_above_ground_m, least, session.motion.speed_factor)

    @property
    def aspect(self) -> float:
        picture = self._session.picture
        return 16 / 9 if picture is None else picture.size_px[0] / picture.size_px[1]

    def point_under(self, pointer: tuple[float, float] = MIDDLE) -> Floats | None:
        """The ground below a place in the picture, given as shares from its left and top; None where there is none."""
        session = self._session
        line = sight_line(session.camera, pointer, self.aspect)
        return first_hit(session.heightfield, session.camera.eye_m, line, session.stage.renderer.diagonal)

    def take_over(self, old: Navigation) -> None:
        """Move on as over another terrain; walkers do not know where to stand, and fly."""
        self.mode, self.collides = "fly" if old.mode == "walk" else old.mode, old.collides

    # One frame

    def advance(self, inputs: Inputs, dt_s: float) -> None:
        """Move the session's camera as the hands ask, or further on its way."""
        if inputs.double_clicked and inputs.pointer is not None:
            self.fly_to_point(self.point_under(inputs.pointer))
        elif self.passage is not None and (inputs.moves or inputs.wheel or not inputs.focused):
            self.passage = None
        pace = self._session.motion.speed_factor
        if self.passage is not None:
            self._pass_on(dt_s)
        elif self.mode == "orbit":
            self._orbit(inputs, dt_s)
        elif self.mode == "walk":
            self._walk(inputs, dt_s)
        else:
            self._fly(inputs, dt_s)
        if self._session.motion.speed_factor != pace:
            self._session.say(f"Speed {self.speed_m_s:,.1f} m/s here.")

    def _pass_on(self, dt_s: float) -> None:
        assert self.passage is not None
        self._passed_s += dt_s
        camera = self.passage.camera_at(self._passed_s)
        if self._passed_s >= self.passage.duration_s:
            self.passage = None
        self._session.camera = self._lifted(camera)

    def _fly(self, inputs: Inputs, dt_s: float) -> None:
        session = self._session
        terrain = session.heightfield
        clearance, least = clearance_above(terrain), least_clearance_m(terrain)
        session.camera, session.motion = move(
            session.camera, session.motion, inputs, dt_s, clearance, least, self.collides
        )

    def _walk(self, inputs: Inputs, dt_s: float) -> None:
        session, terrain = self._session, self._session.heightfield
        session.camera, session.motion = cameras.walk(
            session.camera, session.motion, inputs, dt_s, lambda x, z: ground_m(terrain, x, z), self.eye_height_m,
            terrain.extent_m,
        )  # fmt: skip

    def _orbit(self, inputs: Inputs, dt_s: float) -> None:
        session = self._session
        if not inputs.focused:
            self.rest()
            return
        if inputs.button is None:
            self._grasped_m = None
        elif inputs.pointer is not None:
            self._orbit_with_mouse(inputs)
        if inputs.wheel:
            self._zoom_m = self._point_or_beyond(inputs.pointer or MIDDLE)  # a gamepad has no pointer
            self._nearer += inputs.wheel * NEARER_PER_NOTCH
        if self._nearer != 0.0:
            self._zoom_on(dt_s)
        if inputs.pushes or not session.motion.at_rest:
            if self._pivot_m is None:
                self._pivot_m = self._point_or_beyond(MIDDLE)
            session.camera, session.motion, self._pivot_m = cameras.orbit_with_keys(
                session.camera, session.motion, inputs, dt_s, self._pivot_m, self._nearest_m, self._is_free
            )
        else:
            self._pivot_m = None

    def _orbit_with_mouse(self, inputs: Inputs) -> None:
        """The left button turns about what it grasped, the others pull it along."""
        session = self._session
        assert inputs.pointer is not None
        if self._grasped_m is None:
            session.camera = self._lifted(session.camera)
            self._grasped_m = self._point_or_beyond(inputs.pointer)
        elif inputs.button == "left":
            session.camera = cameras.orbit(session.camera, self._grasped_m, inputs.look_px, self._is_free)
        else:
            session.camera = cameras.pan(session.camera, self._grasped_m, inputs.pointer, self.aspect, self._is_free)

    def _zoom_on(self, dt_s: float) -> None:
        """A part of the zoom that is left: softly, and as far in the end at any frame rate."""
        assert self._zoom_m is not None
        part = self._nearer * (1.0 - math.exp(-ZOOM_RESPONSE_PER_S * dt_s))
        self._nearer -= part
        if abs(self._nearer) < ZOOM_REST * NEARER_PER_NOTCH:
            part, self._nearer = part + self._nearer, 0.0
        self._session.camera = cameras.zoom(self._session.camera, self._zoom_m, part, self._nearest_m, self._is_free)

    @property
    def _nearest_m(self) -> float:
        """How near one zooms to a point."""
        return 2.0 * least_clearance_m(self._session.heightfield)

    @property
    def _is_free(self) -> IsFree:
        if not self.collides:
            return lambda camera: True
        terrain = self._session.heightfield
        return cameras.free_above(clearance_above(terrain), least_clearance_m(terrain))

    def _lifted(self, camera: Camera) -> Camera:
        if not self.collides and self.mode != "walk":
            return camera
        terrain = self._session.heightfield
        least = self.eye_height_m if self.mode == "walk" else least_clearance_m(terrain)
        return cameras.lifted(camera, clearance_above(terrain), least)

    def _point_or_beyond(self, pointer: tuple[float, float]) -> Floats:
        """The ground below a place in the picture; over the sky, a point as far away as the terrain's middle."""
        found = self.point_under(pointer)
        if found is not None:
            return found
        session = self._session
        (width, depth), (low, high) = session.heightfield.extent_m, session.heightfield.height_range_m
        eye = session.camera.eye_m
        distance = float(np.linalg.norm([width / 2, (low + high) / 2, depth / 2] - eye))
        return eye + distance * sight_line(session.camera, pointer, self.aspect)

    # What keys and widgets do

    def choose_mode(self, mode: Mode) -> None:
        """Fly, orbit, or go down to the ground and walk."""
        if mode == self.mode:
            return
        self.rest()
        self.mode = mode
        self._session.flights.pause()
        if mode == "walk":
            self._land()
        else:
            self._session.camera = self._lifted(self._session.camera)
        self._session.touch()
        self._session.say(MODES[mode])

    def next_mode(self) -> None:
        """From flying to orbiting to walking, and round again."""
        names = list(MODES)
        self.choose_mode(names[(names.index(self.mode) + 1) % len(names)])

    def _land(self) -> None:
        """Go down to the ground: below the eye, or on the rim nearest to it."""
        session, terrain = self._session, self._session.heightfield
        (width, depth), (x, _, z) = terrain.extent_m, session.camera.position_m
        x, z = min(max(x, 0.0), width), min(max(z, 0.0), depth)
        position = (x, ground_m(terrain, x, z) + self.eye_height_m, z)
        self._begin(replace(session.camera, position_m=position, pitch_deg=0.0, roll_deg=0.0))

    def toggle_collision(self) -> None:
        """Let the ground stop the eye, or let it through."""
        self.collides = not self.collides
        session = self._session
        session.camera = self._lifted(session.camera)
        session.touch()
        session.say("The ground stops you." if self.collides else "The ground lets you through.")

    def fly_to_point(self, point_m: Floats | None) -> None:
        """Pass softly to a view of a point; walkers go to the point itself."""
        session = self._session
        if point_m is None:
            session.say("There is no ground there.")
            return
        if self.mode == "walk":
            x, y, z = point_m
            goal = replace(session.camera, position_m=(float(x), float(y) + self.eye_height_m, float(z)))
        else:
            terrain = session.heightfield
            goal = cameras.approach(session.camera, point_m, clearance_above(terrain), least_clearance_m(terrain))
        self._begin(goal)

    def fly_to(self, goal: Camera) -> None:
        """Pass softly to a view; whoever walked, flies."""
        if self.mode == "walk":
            self.mode = "fly"
        self._begin(goal)

    def _begin(self, goal: Camera) -> None:
        session = self._session
        session.flights.pause()
        self.rest()
        terrain = session.heightfield
        least = least_clearance_m(terrain) if self.mode != "walk" else self.eye_height_m
        low = -math.inf if not self.collides and self.mode != "walk" else least
        self.passage = cameras.plan_passage(session.camera, goal, clearance_above(terrain), low)
        self._passed_s = 0.0
        session.touch()

    def rest(self) -> None:
        """Stop all motion here."""
        session = self._session
        session.motion = replace(session.motion, velocity=(0.0, 0.0, 0.0))
        self.passage = self._grasped_m = self._pivot_m = self._zoom_m = None
        self._nearer = 0.0

    def hand_over(self) -> None:
        """Stop all motion, and walking too: something else puts the camera where it belongs."""
        self.rest()
        if self.mode == "walk":
            self.mode = "fly"
