"""Common part of the studies: the program, errors for the user, progress, and exit codes."""
import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "build" / "host" / "bin" / "twinlock"
NOT_LOCKED = 3  # exit code of a complete replay whose twin was never in lock


class Trouble(Exception):
    """An error that the user can correct."""


class Progress:
    """Shows the progress in one line on a terminal; nothing elsewhere. `total` 0: unknown."""

    def __init__(self, total):
        self.on, self.total, self.done = sys.stderr.isatty(), total, 0

    def say(self, text):
        self.done += 1
        self._draw(f"[{self.done}/{self.total}] {text}" if self.total else text)

    def end(self):
        self._draw("")

    def _draw(self, text):
        if self.on:
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def merge(value, change):
    """JSON merge patch (RFC 7396)."""
    if not isinstance(change, dict):
        return change
    merged = dict(value) if isinstance(value, dict) else {}
    for key, inner in change.items():
        if inner is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), inner)
    return merged


def run_command(name, work, code_of_trouble):
    """Returns the exit code of work(). Prints Trouble; removes temporary folders also on SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        return work()
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            sys.stdout = open(os.devnull, "w", encoding="utf-8")
        return 0
    except (Trouble, subprocess.CalledProcessError, OSError) as trouble:
        output = getattr(trouble, "stderr", None)
        print(f"{name}: {output.decode().strip() if output else trouble}", file=sys.stderr)
        return code_of_trouble
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return 130


def end_interrupted():
    """Ends like a program without a handler for SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGINT)


def print_figures(figures, as_json, show):
    """Prints the figures as one JSON object, or with show()."""
    if as_json:
        print(json.dumps(figures, indent=1))
    else:
        show(figures)
