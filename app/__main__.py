"""``reliefscope``, and ``python -m app``: reads the command line and calls the command."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from app.commands.arguments import OneLineParser, join_negative_values
from app.commands.table import COMMANDS, DEFAULT_COMMAND
from terrain import __version__
from terrain.errors import InputError, as_sentence

BAD_INPUT, INTERRUPTED = 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        Exit status: 0 done, 1 a check failed, 2 bad input (one line on stderr), 130 interrupted.
    """
    words = join_negative_values(sys.argv[1:] if argv is None else argv)
    if not words or words[0] not in (*COMMANDS, "-h", "--help", "--version"):
        words = [DEFAULT_COMMAND, *words]
    args = _parser(words[0]).parse_args(words)
    try:
        return COMMANDS[args.command].run(args) or 0
    except InputError as error:
        print(f"reliefscope: {as_sentence(error)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("reliefscope: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parser(wanted: str) -> OneLineParser:
    parser = OneLineParser(
        prog="reliefscope",
        description="A terrain viewer and laboratory. Without a command: view.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"reliefscope {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, command in COMMANDS.items():
        summary = (command.run.__doc__ or "").strip().splitlines()[0]
        sub = commands.add_parser(name, help=summary, description=summary, allow_abbrev=False)
        if name == wanted:  # the others' options need not be built
            command.add_options(sub)
    return parser


if __name__ == "__main__":
    sys.exit(main())
