"""Reads files in children of its own, one at a time, and prints one JSON line for each: a crash costs one child."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time

LIMIT_S = 20


def outcome(path: str) -> str:
    """ "terrain", the line of an InputError, or the traceback of anything else."""
    from terrain.errors import InputError
    from terrain.files.sources import read_heightfield

    try:
        heightfield = read_heightfield(path)
    except InputError as error:
        return f"line: {error}"
    except BaseException as error:
        return f"traceback: {error!r}"
    return f"terrain: {heightfield.cols} x {heightfield.rows}, {heightfield.height_range_m}"


def main() -> None:
    import rasterio  # noqa: F401  (once, before the children)

    import terrain.files.sources  # noqa: F401

    for path in sys.argv[1:]:
        result, errors = os.memfd_create("result"), os.memfd_create("errors")
        start = time.perf_counter()
        child = os.fork()
        if child == 0:
            signal.alarm(LIMIT_S)
            resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
            os.dup2(errors, 1)
            os.dup2(errors, 2)
            os.write(result, outcome(path).encode(errors="replace"))
            sys.stdout.flush()
            os._exit(0)
        _, status, usage = os.wait4(child, 0)
        report = {
            "path": path,
            "outcome": os.pread(result, 10_000, 0).decode() or f"killed: wait status {status}",
            "printed": os.pread(errors, 10_000, 0).decode(errors="replace"),
            "seconds": round(time.perf_counter() - start, 2),
            "peak_mib": usage.ru_maxrss >> 10,
        }
        os.close(result)
        os.close(errors)
        print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
