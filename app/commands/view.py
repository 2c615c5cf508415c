"""``reliefscope view``: the window, or where there is no display a film of the flight."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from app.commands import arguments
from app.opening.drawing import open_library, open_stage, read_drawing
from app.opening.flight import open_tour, read_flight_for
from app.opening.terrain import open_terrain
from terrain.heightfield import Heightfield

DEFAULT_SCENE = "alps"
TOUR_FRAMES, TOUR_SIZE_PX, TOUR_FPS = 96, (960, 540), 24


def view(args: argparse.Namespace) -> None:
    """Fly over a terrain in a window; without a display, film its demo flight instead."""
    from concurrent.futures import ThreadPoolExecutor

    from app.viewer.window import Window, WindowError

    drawing = read_drawing(args)
    with ThreadPoolExecutor(1) as pool:
        terrain = pool.submit(_open_ahead, args)  # while the window is made
        try:
            window = Window(args.size)
        except WindowError as reason:
            print(f"{reason} Filming the demo flight off screen instead.", flush=True)
            _film_tour(terrain.result(), drawing, read_flight_for(args, terrain.result()), args.size or TOUR_SIZE_PX)
            return
        with window:
            window.run(terrain.result(), drawing, read_flight_for(args, terrain.result()), args, args.dev)


def _open_ahead(args: argparse.Namespace) -> Heightfield:
    """The terrain a command names; what takes long to find about it is in the cache afterwards."""
    from terrain.pyramid import load_pyramid

    heightfield = open_terrain(args)
    load_pyramid(heightfield)
    open_tour(heightfield)
    return heightfield


def view_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser, DEFAULT_SCENE)
    arguments.add_drawing_options(parser)
    parser.add_argument("--dev", action="store_true", help="reload shaders that change on disk; errors are shown")
    arguments.add_settings_help(parser)


def _film_tour(heightfield: Any, drawing: Any, flight: Any, size_px: tuple[int, int]) -> None:
    """What ``view`` does without a display: frames and a film of the flight in a new folder."""
    from app.output.capture import Film, FrameFolder
    from app.output.rendering import draw_pictures, flight_times, write_pictures
    from terrain.flight import demo_flight, numbered_path
    from terrain.gpu.context import create_offscreen_gpu

    gpu = create_offscreen_gpu()
    flight = demo_flight(heightfield) if flight is None else flight.relocated(heightfield)
    times_s = flight_times(flight.duration_s, TOUR_FRAMES, TOUR_FPS)
    library = open_library(drawing, heightfield)
    stage = open_stage(gpu, heightfield, drawing, library)
    folder = numbered_path(Path(f"{heightfield.name}-tour"))
    try:
        with FrameFolder(folder) as frames, Film(folder / "flight.mp4", size_px, TOUR_FPS) as film:
            cameras = [flight.camera_at(time_s) for time_s in times_s]
            pictures = draw_pictures(stage, cameras, times_s, size_px, drawing.view, animates=True)
            write_pictures(pictures, len(times_s), [frames, film], "Filming")
    finally:
        stage.release()
        library.close()
    print(
        f"Wrote {folder / 'flight.mp4'} and {len(times_s)} frames beside it ({heightfield.name}, "
        f"{drawing.algorithm}, {size_px[0]}x{size_px[1]})."
    )
