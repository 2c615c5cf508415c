"""What the window shows, and everything a key or a widget can do to it.

One frame: `advance` moves the camera, `draw` brings the picture up to date. Nothing is drawn again while nothing
changes; after a change the picture is kept alive for `SETTLE_S`, so that animated transitions come to their end.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.flying.controls import Inputs, Motion
from app.flying.flight_lines import FlightLines
from app.opening.browser import Browser
from app.opening.drawing import Drawing, open_library, open_stage, without_waiting
from app.opening.flight import open_tour
from app.output.capture import save_png
from app.places.framing import frame_terrain, ground_m
from app.session.algorithms import Algorithms
from app.session.comparison import Comparison
from app.session.dialogs import Dialogs
from app.session.export import Exporter
from app.session.flights import Flights
from app.session.jobs import FAILURES, Jobs
from app.session.laboratory import Laboratory
from app.session.layers import Layers
from app.session.layout import Layout
from app.session.loader import Loader
from app.session.navigation import Navigation
from app.session.places import Places
from app.session.preferences import PreferenceFile
from app.session.survey import Survey
from terrain.camera import Camera
from terrain.errors import InputError, as_sentence
from terrain.flight import Flight, numbered_path
from terrain.frame import FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.programs import ShaderError
from terrain.gpu.targets import Target, create_target
from terrain.heightfield import Heightfield
from terrain.scene import Scene
from terrain.stage import Stage
from terrain.views import VIEWS

SETTLE_S = 1.5
MESSAGE_S = 8.0
GRAPH_FRAMES = 240
BAKE_BUDGET_MS = 6.0  # of a frame, for light that is baked anew while the sun moves


class Session:
    """One terrain being looked at.

    Parameters
    ----------
    gpu : Gpu
    heightfield : Heightfield
        With true heights; ``drawing`` says how they are exaggerated.
    drawing : Drawing
        Algorithm, settings, look, view, layers.
    flight : Flight, optional
        What replay plays at first; the terrain's demo flight where there is none.
    folder : Path
        Where pictures and flights are saved, under new names.
    preferences : PreferenceFile, optional
        What the person chose in earlier runs; where there is none, the defaults, and nothing is kept.
    """

    def __init__(
        self, gpu: Gpu, heightfield: Heightfield, drawing: Drawing, flight: Flight | None = None, folder: Path = Path(),
        preferences: PreferenceFile | None = None,
    ) -> None:  # fmt: skip
        self.gpu, self.folder = gpu, folder
        self.preferences = PreferenceFile() if preferences is None else preferences
        drawing = replace(drawing, settings=without_waiting(drawing.settings))
        library = open_library(drawing, heightfield)
        self._set_stage(open_stage(gpu, heightfield, drawing, library))
        self.view: Any = drawing.view
        self.algorithms = Algorithms(self, drawing)
        flight = open_tour(heightfield) if flight is None else flight.relocated(heightfield)
        self.layers = Layers(self, library, drawing.layers)
        self.flights = Flights(self, flight, self.preferences.folder)
        self.camera: Camera = flight.camera_at(0.0)
        self.motion = Motion()
        self.navigation, self.survey = Navigation(self), Survey(self)
        self.places = Places(self, heightfield, self.preferences.folder)
        self.stats = FrameStats()
        self.frame_ms: deque[float] = deque(maxlen=GRAPH_FRAMES)
        self.picture: Target | None = None
        self.clock_s = 0.0
        self.jobs = Jobs()
        self.layout = Layout(self)
        self.comparison = Comparison()
        self.laboratory = Laboratory(self)
        self.exporter = Exporter(self)
        self.dialogs = Dialogs(self)
        self.loader = Loader()
        self.browser = Browser(folder)
        self._flight_lines = FlightLines()
        self.is_leaving = False
        self._message, self._message_until_s = "", 0.0
        self._changed_s = 0.0
        self.say(f"{heightfield.name}: {heightfield.cols} x {heightfield.rows} posts. H lists the keys.")
        if self.places.bookmarks.problem:
            self.say(self.places.bookmarks.problem)
        self.flights.recover()

    @property
    def heightfield(self) -> Heightfield:
        return self.stage.scene.heightfield

    @property
    def algorithm(self) -> str:
        return self.stage.renderer.name

    @property
    def settings(self) -> Any:
        return self.stage.renderer.settings

    @property
    def message(self) -> str:
        """What the status line says; empty after a while."""
        return self._message if self.clock_s < self._message_until_s else ""

    @property
    def is_still(self) -> bool:
        """Whether the picture stays as it is until somebody does something."""
        busy = self.flights.recorder is not None or self.flights.is_playing or self.navigation.is_moving
        busy = busy or self.stage.is_loading
        return not busy and self.motion.at_rest and self.clock_s - self._changed_s > SETTLE_S

    @property
    def is_asleep(self) -> bool:
        """Whether nothing at all is to be done until somebody does something."""
        return self.is_still and not (self.laboratory.wants_work or self.jobs)

    @property
    def height_above_ground_m(self) -> float:
        x, y, z = self.camera.position_m
        return y - ground_m(self.heightfield, x, z)

    def say(self, text: str) -> None:
        """Show a line for a while."""
        self._message, self._message_until_s = as_sentence(text), self.clock_s + MESSAGE_S

    def touch(self) -> None:
        """Something changed: the picture must be drawn again."""
        self._changed_s = self.clock_s

    # One frame

    def advance(self, inputs: Inputs, dt_s: float) -> None:
        """Let ``dt_s`` seconds pass: fly with the hands, or along the replayed flight."""
        self.clock_s += dt_s
        before = self.camera
        inputs = self.survey.take(inputs)
        self.flights.advance(inputs, dt_s)
        if not self.flights.is_playing:
            self.navigation.advance(inputs, dt_s)
        self.flights.record()
        self.layers.advance(inputs.pointer, dt_s)
        if self.camera != before:
            self.touch()

    def look_from(self, camera: Camera) -> None:
        """Take a place of its own choice, at rest."""
        self.navigation.hand_over()
        self.camera = camera
        self.touch()

    def draw(self, size_px: tuple[int, int]) -> Target | None:
        """The picture at this size, drawn again where something changed; None for a window without area."""
        if min(size_px) < 1:
            return None
        if self.picture is None or self.picture.size_px != size_px:
            outgrown, self.picture = self.picture, create_target(self.gpu, size_px)
            if outgrown is not None:
                outgrown.release()
            self.touch()
        self.jobs.work()
        if not self.is_still:
            self._draw_frame(size_px)
        self.laboratory.work()
        self.exporter.work()
        return self.picture

    def _draw_frame(self, size_px: tuple[int, int]) -> None:
        assert self.picture is not None
        frame = self.stage.frame(self.camera, size_px, self.clock_s)
        begin = time.perf_counter()
        try:
            self.stats = self.stage.draw(frame, self.picture, self.view)
        except ShaderError as error:  # only where shaders are being changed (--dev)
            self.say(str(error))
            return
        if self.layout.is_open("timeline"):
            self._flight_lines.draw(self.stage, frame, self.flights.flight, self.flights.timeline.selected)
        self.survey.draw(frame, self.stage.lines)
        for message in self.stage.drape.trees.take_messages():
            self.say(message)
        if self.gpu.is_software:
            self.gpu.ctx.finish()  # a software rasteriser's time is only known when it has finished
        self.frame_ms.append(1e3 * (time.perf_counter() - begin))
        self.stats.frame_ms = self.stats.gpu_ms or self.frame_ms[-1]  # what a time budget goes by
        try:
            self.comparison.draw(self.stage, frame, self.picture, self.view)
        except FAILURES as error:
            self.comparison.mode = "off"
            self.algorithms.refuse(self.comparison.algorithm, error)

    # What keys and widgets do

    def change_look(self, look: Any) -> None:
        self.stage.set_look(look)
        self.touch()

    def choose_view(self, view: Any) -> None:
        self.view = view
        self.touch()
        self.say(f"{VIEWS[view].title}: {VIEWS[view].help}")

    def exaggerate(self, factor: float) -> None:
        """Multiply the heights; the eye keeps its height above the ground."""
        before = self.height_above_ground_m
        old, size_px = self.stage, None if self.picture is None else self.picture.size_px
        frozen = old.frozen is not None
        scene = old.scene.exaggerated(factor)
        look, algorithm, settings = old.look, self.algorithm, self.settings
        self.laboratory.close()
        self.laboratory = Laboratory(self)  # what was measured holds no longer
        self.comparison.release()
        self.algorithms.tuned = {}
        old.release()
        self._set_stage(self._make_stage(scene, algorithm, settings, look))
        x, _, z = self.camera.position_m
        self.camera = replace(self.camera, position_m=(x, ground_m(self.heightfield, x, z) + before, z))
        if frozen and size_px is not None:
            self.stage.freeze(self.stage.frame(self.camera, size_px, self.clock_s))
        self.touch()

    def _set_stage(self, stage: Stage) -> None:
        """Draw on a stage from now on."""
        self.stage = stage
        stage.bake_budget_ms = BAKE_BUDGET_MS
        stage.draws_legends = False  # the window has its own

    def _make_stage(self, scene: Scene, algorithm: str, settings: Any, look: Any) -> Stage:
        stage = Stage(self.gpu, scene, algorithm, settings, look)
        self.layers.show_on(stage)
        return stage

    @contextmanager
    def twin_stage(self) -> Iterator[Stage]:
        """A stage of its own that draws the same, in full detail, whatever is changed here meanwhile."""
        twin = self._make_stage(self.stage.scene, self.algorithm, self.settings.unhurried(), self.stage.look)
        twin.draws_legends = False  # as in the window
        try:
            yield twin
        finally:
            twin.release()

    def toggle_freeze(self) -> None:
        """Keep what is drawn as chosen from here, or let it follow the eye again."""
        if self.stage.frozen is not None:
            self.stage.thaw()
            self.say("The selection follows the eye again.")
        elif self.picture is not None:
            self.stage.freeze(self.stage.frame(self.camera, self.picture.size_px, self.clock_s))
        self.touch()

    def frame_all(self) -> None:
        """Look at the whole terrain."""
        self.flights.pause()
        width, height = self.picture.size_px if self.picture is not None else (16, 9)
        self.look_from(frame_terrain(self.heightfield, width / height, self.camera.fov_deg))

    def take_screenshot(self) -> None:
        """Save the picture, without the panel, under a new name."""
        if self.picture is None:
            return
        picture = self.comparison.compose(self.picture)
        path = numbered_path(self.folder / f"{self.heightfield.name}.png")
        self._save(lambda: save_png(path, picture), f"Saved the picture as {path}.")

    def reload_shaders(self) -> None:
        """Compile anew what changed on disk; a broken shader keeps its old program, and the window says why."""
        programs = self.gpu.programs
        before = programs.generation, len(programs.errors)
        programs.reload_changed()
        if (programs.generation, len(programs.errors)) != before:
            self.touch()

    def compare(self, mode: Any) -> None:
        """Show B beside A, the difference of the two, or A alone."""
        self.comparison.mode = mode
        self.touch()

    def choose_other(self, algorithm: str, settings: Any = None) -> None:
        """What A is compared with."""
        self.comparison.choose(algorithm, settings)
        self.touch()

    def swap_sides(self) -> None:
        """A becomes B and B becomes A."""
        a, b = (self.algorithm, self.settings), (self.comparison.algorithm, self.comparison.settings)
        if self.algorithms.use(*b):
            self.choose_other(*a)

    def escape(self) -> None:
        """Close the help, or stop what runs."""
        if self.layout.shows_help:
            self.layout.shows_help = False
        elif self.flights.is_playing:
            self.flights.pause("Paused; P plays on.")
        elif not self.jobs.stop_newest():
            self.survey.dismiss()

    def leave(self) -> None:
        """Ask the window to close; edits that are not saved are asked about first."""
        self.dialogs.unless_unsaved("leave", self._leave)

    def _leave(self) -> None:
        self.is_leaving = True

    def take_over(self, old: Session, same_place: bool) -> None:
        """Go on as another session was set; with ``same_place`` also where it was, with its flight."""
        self.layout.shows_windows, self.browser = old.layout.shows_windows, old.browser
        self.flights.take_over(old.flights, same_place)
        self.navigation.take_over(old.navigation)
        if same_place:
            self.survey.take_over(old.survey)
            self.places.bookmarks.take_over(old.places.bookmarks)
            self.camera, self.motion = old.camera, old.motion
            self.say(f"{self.heightfield.name} has changed on disk and was read again.")

    def _save(self, write: Any, done: str) -> None:
        try:
            write()
        except (InputError, OSError) as error:
            self.say(str(error))
        else:
            self.say(done)

    def close(self) -> None:
        """Save an unfinished recording and release the GPU's memory."""
        self.flights.close()
        self.exporter.close()
        self.laboratory.close()
        self.comparison.release()
        if self.picture is not None:
            self.picture.release()
        self.stage.release()
        self.layers.close()
