"""``reliefscope render``: pictures, frames, films and positions, off screen."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.commands import arguments
from app.commands.progress import told_progress
from app.opening.drawing import open_library, open_stage, read_drawing
from app.opening.flight import read_flight_for
from app.opening.terrain import open_terrain
from terrain.errors import InputError

DEFAULT_SIZE_PX = (1280, 720)


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
    with told_progress():
        heightfield = open_terrain(args)
    cameras, times_s = _render_cameras(args, heightfield, is_single)
    gpu = create_offscreen_gpu()
    library = open_library(drawing, heightfield)
    with told_progress():
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
        for message in stage.drape.trees.take_messages():
            print(message, file=sys.stderr)
    finally:
        stage.release()
        library.close()


def render_options(parser: argparse.ArgumentParser) -> None:
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
    arguments.add_settings_help(parser)


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
    given = read_flight_for(args, heightfield)
    flight = demo_flight(heightfield) if given is None else given.relocated(heightfield)
    times = [args.at or 0.0] if is_single else flight_times(flight.duration_s, args.frames, args.fps)
    return [flight.camera_at(flight_time(flight, args.pace, time_s)) for time_s in times], times
