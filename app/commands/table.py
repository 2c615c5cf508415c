"""The commands, one function each. A new command: one function, one for its options, one line in the table."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from app.commands import arguments, laboratory
from app.opening.drawing import open_library, open_stage, read_drawing
from app.opening.terrain import open_terrain, open_tour
from terrain.errors import InputError
from terrain.heightfield import Heightfield

DEFAULT_SCENE = "alps"
DEFAULT_SIZE_PX = (1280, 720)
TOUR_FRAMES, TOUR_SIZE_PX, TOUR_FPS = 96, (960, 540), 24


class Command(NamedTuple):
    """What a command does, and what it takes. The first line of ``run``'s docstring is its help."""

    run: Callable[[argparse.Namespace], int | None]
    add_options: Callable[[argparse.ArgumentParser], None]


def view(args: argparse.Namespace) -> None:
    """Fly over a terrain in a window; without a display, film its demo flight instead."""
    from concurrent.futures import ThreadPoolExecutor

    from app.viewer.window import Window, WindowError

    drawing = read_drawing(args)
    with ThreadPoolExecutor(1) as pool:
        terrain = pool.submit(_open_ahead, args)  # while the window is made
        try:
            window = Window(args.size or DEFAULT_SIZE_PX)
        except WindowError as reason:
            print(f"{reason} Filming the demo flight off screen instead.", flush=True)
            _film_tour(terrain.result(), drawing, _read_flight(args, terrain.result()), args.size or TOUR_SIZE_PX)
            return
        with window:
            window.run(terrain.result(), drawing, _read_flight(args, terrain.result()), args, args.dev)


def _open_ahead(args: argparse.Namespace) -> Heightfield:
    """The terrain a command names; what takes long to find about it is in the cache afterwards."""
    from terrain.pyramid import load_pyramid

    heightfield = open_terrain(args)
    load_pyramid(heightfield)
    open_tour(heightfield)
    return heightfield


def render(args: argparse.Namespace) -> None:
    """Draw pictures off screen: a PNG, a folder of PNGs, an MP4 film, or world positions."""
    from app.output.capture import open_sink, refuse_codec, refuse_existing, refuse_output, save_array
    from app.output.rendering import draw_pictures, save_picture, write_pictures
    from terrain.gpu.context import create_offscreen_gpu

    size_px = args.size or DEFAULT_SIZE_PX
    is_single = (
        args.eye is not None or args.at is not None or (args.out is not None and args.out.suffix.lower() == ".png")
    )
    _check_render(args, is_single)
    drawing = read_drawing(args)
    drawing = replace(drawing, settings=drawing.settings.unhurried())
    if args.out is not None:
        refuse_output(args.out, args.overwrite)
        if args.out.suffix.lower() == ".mp4":
            refuse_codec(args.codec)
    if args.positions is not None:
        refuse_existing(args.positions, args.overwrite)
    with laboratory.told_progress():
        heightfield = open_terrain(args)
    cameras, times_s = _render_cameras(args, heightfield, is_single)
    gpu = create_offscreen_gpu()
    library = open_library(drawing, heightfield)
    with laboratory.told_progress():
        stage = open_stage(gpu, heightfield, drawing, library)
    for note in library.notes:
        print(note)
    try:
        if args.out is not None:
            if is_single:
                save_picture(stage, cameras[0], size_px, drawing.view, times_s[0], args.out, args.overwrite)
            else:
                with open_sink(args.out, size_px, args.fps, args.overwrite, args.codec) as sink:
                    animates = args.layer_time is None
                    pictures = draw_pictures(stage, cameras, times_s, size_px, drawing.view, animates)
                    write_pictures(pictures, len(cameras), [sink], "Rendering")
            stats = stage.renderer.stats
            print(
                f"Wrote {args.out}: {len(cameras)} picture{'s' * (len(cameras) > 1)} of {size_px[0]}x{size_px[1]}, "
                f"{heightfield.name}, {drawing.algorithm}, {stats.triangles:,} triangles in the last."
            )
        if args.positions is not None:
            save_array(args.positions, stage.positions(cameras[0], size_px), args.overwrite)
            print(f"Wrote {args.positions}: world positions [m] of {size_px[0]}x{size_px[1]} pixels.")
        for message in stage.trees.take_messages():
            print(message, file=sys.stderr)
    finally:
        stage.release()
        library.close()


def info(args: argparse.Namespace) -> None:
    """Tell what a terrain is, and what was decided while reading it."""
    from terrain.describe import describe, describe_text

    heightfield = open_terrain(args)
    print(json.dumps(describe(heightfield), indent=2) if args.json else describe_text(heightfield))


def make(args: argparse.Namespace) -> None:
    """Write an embedded scene as GeoTIFF."""
    from app.output.capture import refuse_existing
    from terrain.geotiff import write_geotiff
    from terrain.synthetic import SCENES, make_scene

    if args.name not in SCENES:
        raise InputError(f"Expected a scene of {', '.join(SCENES)}, found {args.name!r}.")
    refuse_existing(args.out, args.overwrite)
    heightfield = make_scene(args.name, args.size, args.seed)
    write_geotiff(heightfield, args.out)
    print(f"Wrote {args.out}: {args.name}, {heightfield.cols} x {heightfield.rows} posts, seed {args.seed}.")


def _view_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser, DEFAULT_SCENE)
    arguments.add_drawing_options(parser)
    parser.add_argument("--dev", action="store_true", help="reload shaders that change on disk; errors are shown")
    _list_settings(parser)


def _render_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser)
    arguments.add_drawing_options(parser)
    camera = parser.add_argument_group("which pictures")
    camera.add_argument(
        "--eye", metavar="X,Y,Z", type=arguments.triple, help="one picture from here: east, up, south [m]"
    )
    camera.add_argument("--yaw", metavar="DEG", type=arguments.number, help="clockwise from north (0)")
    camera.add_argument("--pitch", metavar="DEG", type=arguments.number, help="positive up (-10)")
    camera.add_argument("--roll", metavar="DEG", type=arguments.number, help="positive clockwise (0)")
    camera.add_argument("--fov", metavar="DEG", type=arguments.field_of_view, help="vertical field of view (60)")
    camera.add_argument("--frames", metavar="N", type=arguments.count, help="N pictures spread over the flight")
    camera.add_argument("--at", metavar="T", type=arguments.number, help="one picture, T seconds into the flight")
    camera.add_argument(
        "--fps", metavar="N", type=arguments.count, default=30, help="pictures per second of a film (30)"
    )
    camera.add_argument(
        "--pace", choices=("timed", "constant", "eased"), default="timed",
        help="fly as the keyframes are timed, at constant speed, or with a soft start and end (timed)",
    )  # fmt: skip
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="PNG|DIR|MP4", type=Path, help="where to; what exists is not overwritten")
    output.add_argument(
        "--positions", metavar="NPY", type=Path, help="world positions (height, width, 3), NaN where sky"
    )
    output.add_argument("--codec", choices=("h264", "av1"), default="h264", help="of a film (h264)")
    output.add_argument("--overwrite", action="store_true", help="replace what exists")
    _list_settings(parser)


def _info_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser)
    parser.add_argument("--json", action="store_true", help="for programs")


def _make_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name", metavar="NAME", help="alps, city, plain, snake, flat, ramp, cone, step, needle or waves"
    )
    parser.add_argument("--size", metavar="N", type=arguments.count, default=1025, help="posts per side (1025)")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="another seed, another terrain (0)")
    parser.add_argument("--out", metavar="FILE.tif", type=Path, required=True, help="what exists is not overwritten")
    parser.add_argument("--overwrite", action="store_true", help="replace what exists")


COMMANDS: dict[str, Command] = {
    "view": Command(view, _view_options),
    "render": Command(render, _render_options),
    "chart": Command(laboratory.chart, laboratory.chart_options),
    "check": Command(laboratory.check, laboratory.check_options),
    "reproduce": Command(laboratory.reproduce, laboratory.reproduce_options),
    "info": Command(info, _info_options),
    "make": Command(make, _make_options),
}
DEFAULT_COMMAND = "view"


def _list_settings(parser: argparse.ArgumentParser) -> None:
    """Give ``--help`` the settings of every algorithm and of the look; nothing is imported before it is asked for."""

    def epilog() -> str:
        from app.opening.settings import settings_table
        from terrain.renderers import RENDERERS
        from terrain.textures.look import LookSettings

        tables = [
            settings_table(kind.Settings(), f"--set for {name} ({kind.title})") for name, kind in RENDERERS.items()
        ]
        return "\n\n".join([*tables, settings_table(LookSettings(), "--set for the look")])

    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    show = parser.format_help
    parser.format_help = lambda: f"{show()}\n{epilog()}\n"  # type: ignore[method-assign]


def _read_flight(args: argparse.Namespace, heightfield: Any) -> Any:
    """The flight a command names, from a flight file or a track; None where it names none."""
    from terrain.flight.track_files import TRACK_SUFFIXES

    if args.flight is not None and args.flight.suffix.lower() in TRACK_SUFFIXES:
        from terrain.flight.tracks import read_track

        return read_track(args.flight, heightfield, args.above_ground, args.duration)
    if args.above_ground is not None or args.duration is not None:
        raise InputError(f"--above-ground and --duration go with --flight and a track: {', '.join(TRACK_SUFFIXES)}.")
    if args.flight is None:
        return None
    from terrain.flight import read_flight

    return read_flight(args.flight)


def _check_render(args: argparse.Namespace, is_single: bool) -> None:
    """Refuse options that contradict each other."""
    if args.out is None and args.positions is None:
        raise InputError("Expected somewhere to write to: add --out PNG, folder or MP4, or --positions NPY.")
    if args.eye is not None and (args.flight is not None or args.frames is not None or args.at is not None):
        raise InputError("--eye asks for one picture from one place: leave out --flight, --frames and --at.")
    if args.eye is None and any(v is not None for v in (args.yaw, args.pitch, args.roll, args.fov)):
        raise InputError("--yaw, --pitch, --roll and --fov go with --eye X,Y,Z.")
    if args.at is not None and args.frames is not None:
        raise InputError("--at asks for one picture, --frames for several: choose one of them.")
    if is_single and args.frames is not None and args.frames > 1:
        raise InputError(f"{args.out} holds one picture: name a folder or an .mp4 for --frames {args.frames}.")
    if args.positions is not None and not is_single:
        raise InputError("--positions writes the positions of one picture: add --at T or --eye X,Y,Z.")


def _render_cameras(args: argparse.Namespace, heightfield: Any, is_single: bool) -> tuple[list[Any], list[float]]:
    """The cameras of a render command and their times [s]."""
    from app.output.rendering import flight_times
    from terrain.camera import Camera
    from terrain.flight import demo_flight, flight_time

    if args.eye is not None:
        pitch = -10.0 if args.pitch is None else args.pitch
        return [Camera(args.eye, args.yaw or 0.0, pitch, args.roll or 0.0, args.fov or 60.0)], [0.0]
    given = _read_flight(args, heightfield)
    flight = demo_flight(heightfield) if given is None else given.relocated(heightfield)
    times = [args.at or 0.0] if is_single else flight_times(flight.duration_s, args.frames, args.fps)
    return [flight.camera_at(flight_time(flight, args.pace, time_s)) for time_s in times], times


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
