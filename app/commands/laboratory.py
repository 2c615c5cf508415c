"""The commands of the laboratory: chart, check and reproduce."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.commands import arguments
from app.commands.progress import progress_bar
from app.opening.terrain import open_terrain
from terrain.errors import InputError

CHART_SIZE_PX, CHART_FRAMES, CHART_TOLERANCES_PX = (1280, 720), 60, [0.5, 1.0, 2.0, 4.0, 8.0]
HOSTILE = "hostile"  # what `check` takes where no terrain is named: the scenes made to break things
FAILED, INTERRUPTED = 1, 130


def chart(args: argparse.Namespace) -> int | None:
    """Measure speed against accuracy over a flight, and chart it."""
    from terrain.flight import demo_flight, read_flight
    from terrain.gpu.context import create_offscreen_gpu
    from terrain.measure.chart import write_chart
    from terrain.measure.report import draw_thumbnails, write_report
    from terrain.measure.results import write_results
    from terrain.measure.sweep import Sweep, plan_runs
    from terrain.renderers.reference import ReferenceRenderer
    from terrain.scene import open_scene
    from terrain.stage import Stage

    names = _algorithms(args.algorithms, leave_out=ReferenceRenderer.name)
    _make_folder(args.out)
    flight = None if args.flight is None else read_flight(args.flight)
    heightfield = open_terrain(args)
    flight = flight or demo_flight(heightfield)
    times_s = [flight.duration_s * i / max(args.frames - 1, 1) for i in range(args.frames)]
    views = [(time_s, flight.camera_at(time_s)) for time_s in times_s]
    stage = Stage(create_offscreen_gpu(), open_scene(heightfield), ReferenceRenderer.name)
    is_whole = True
    try:
        runs = plan_runs(names, args.tolerances)
        sweep = Sweep(stage, runs, views, args.size or CHART_SIZE_PX, flight.name, args.out)
        with progress_bar() as show:
            try:
                for step in sweep.steps():
                    show(step.share, step.doing)
            except KeyboardInterrupt:
                is_whole = False
        results = sweep.results()
        paths = [*write_results(args.out, results)]
        if any("frame_ms" in run and "geometric_error_px" in run for run in results["runs"]):
            paths += write_chart(results, args.out)
        if is_whole:
            drawings = [path for path in paths if path.suffix == ".svg"]
            thumbnails = draw_thumbnails(stage, runs, views[len(views) // 2][1])
            paths.append(write_report(args.out, results, drawings, thumbnails, _command_line()))
    finally:
        stage.release()
    print(_summary(results))
    print(f"Wrote {', '.join(path.name for path in paths)} in {args.out}.")
    if is_whole:
        return None
    print("Interrupted: what was done is kept, and the same command goes on from there.", file=sys.stderr)
    return INTERRUPTED


def check(args: argparse.Namespace) -> int | None:
    """Look for failures: hostile scenes and cameras, every algorithm, one line per case."""
    from terrain.gpu.context import create_offscreen_gpu
    from terrain.measure.cards import replay_command, write_card, write_verdicts
    from terrain.measure.hostile import HOSTILE_SCENES, hostile_scene
    from terrain.measure.results import machine_identity
    from terrain.measure.stability import Verdict
    from terrain.measure.stability import check as check_all
    from terrain.scene import open_scene

    names = _algorithms(args.algorithms)
    _make_folder(args.out)
    terrains = [hostile_scene(n) for n in HOSTILE_SCENES] if args.terrain == HOSTILE else [open_terrain(args)]
    gpu = create_offscreen_gpu()
    machine = machine_identity(gpu)
    verdicts: list[Verdict] = []
    try:
        for verdict, checker in check_all(gpu, [open_scene(terrain) for terrain in terrains], names, args.seed):
            verdicts.append(verdict)
            print(verdict.line, flush=True)
            if verdict.complaints:
                write_card(args.out, verdict, checker)
    finally:  # also when interrupted
        path = write_verdicts(args.out, machine, verdicts)
    failed = [verdict for verdict in verdicts if verdict.outcome == "FAIL"]
    limits = sum(verdict.outcome == "limit" for verdict in verdicts)
    print(f"{len(verdicts)} cases: {len(failed)} failed, {limits} at documented limits. Wrote {path}.")
    for verdict in failed:
        print(f"{verdict.algorithm}  {verdict.scene} / {verdict.case}\n  {replay_command(args.out, verdict)}")
    return FAILED if failed else None


def reproduce(args: argparse.Namespace) -> None:
    """Measure a paper's own tables on this machine, the paper's numbers beside them."""
    from terrain.gpu.context import create_offscreen_gpu
    from terrain.measure.reproduce import format_table
    from terrain.measure.reproduce import reproduce as run

    with progress_bar() as show:
        found, paths = run(args.algorithm, create_offscreen_gpu(), args.out, show)
    for table in found.tables:
        print(f"{format_table(table)}\n")
    for claim in found.claims:
        print(f"{'held' if claim.held else 'NOT HELD'}: {claim.text}. Paper: {claim.paper}; here: {claim.ours}.")
    print(f"Wrote {', '.join(path.name for path in paths)} in {args.out}.")


def chart_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser)
    parser.add_argument("--flight", metavar="FILE", type=Path, help="a *.flight.json (the terrain's own demo flight)")
    parser.add_argument("--algorithms", metavar="A,B", type=arguments.words, help="which (all)")
    parser.add_argument(
        "--tolerances", metavar="PX,PX", type=arguments.positives, default=CHART_TOLERANCES_PX,
        help="allowed geometric errors (0.5,1,2,4,8)",
    )  # fmt: skip
    parser.add_argument(
        "--frames", metavar="N", type=arguments.count, default=CHART_FRAMES, help=f"of the flight ({CHART_FRAMES})"
    )
    parser.add_argument("--size", metavar="WxH", type=arguments.size, help="of the pictures in pixels (1280x720)")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True,
        help="charts, tables and report go there; a sweep that was interrupted there goes on",
    )  # fmt: skip


def check_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser, HOSTILE)
    parser.add_argument("--algorithms", metavar="A,B", type=arguments.words, help="which (all)")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="of the search for the worst camera (0)")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="a card for every failure goes there")


def reproduce_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("algorithm", metavar="ALGORITHM", help="whose paper")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="tables and plots go there")


def _algorithms(names: Sequence[str] | None, leave_out: str | None = None) -> list[str]:
    """The algorithms asked for, all where none is named."""
    from terrain.renderers import RENDERERS

    for name in names or ():
        if name not in RENDERERS:
            raise InputError(f"Expected algorithms of {', '.join(RENDERERS)}, found {name!r}.")
    return [name for name in names or RENDERERS if name != leave_out]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"Expected a folder to write to, found that {folder} cannot be made ({error}).") from None


def _summary(results: dict[str, Any]) -> str:
    """A line per run that is done: cost, error, promise."""
    from terrain.measure.chart import is_promise_kept

    lines = []
    for run in results["runs"]:
        if "frame_ms" in run and "geometric_error_px" in run:
            error, promise = run["geometric_error_px"], "kept" if is_promise_kept(run) else "BROKEN"
            tolerance_px, frame_ms = run["settings"].get("tolerance_px", 0), run["frame_ms"]["p50"]
            lines.append(
                f"{run['algorithm']:16} {tolerance_px:5g} px  {frame_ms:7.1f} ms  p99.9 {error['p999']:6.2f} px"
                f"  max {error['max']:6.2f} px  holes {run['holes_px']}  {promise}"
            )
    return "\n".join(lines)


def _command_line() -> str:
    return shlex.join(["reliefscope", *sys.argv[1:]])
