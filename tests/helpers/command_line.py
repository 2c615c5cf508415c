"""The command line, as a person types it."""

from __future__ import annotations

from app.__main__ import main


def run(*words):
    """Exit status of one command, also where argparse leaves by itself."""
    try:
        return main([str(word) for word in words])
    except SystemExit as left:
        return left.code
