"""The closing table of script/demo: the twin left alone, locked by Nelder-Mead, and locked by twinlock's own solver.

demo_table.py FOLDER, which has --json summaries: live.json of the live run, and of replays of what it recorded free.N.json,
nelder_mead.N.json and own.N.json, each replayed the same way some times.
"""
import json
import sys
from pathlib import Path

HEADING = """
The first two columns are replays of what the live run recorded: the twin left alone, and locked by Nelder-Mead with all
other settings as they were live. The last column is the live run itself, locked by twinlock's own solver, secant; its
time is that of a replay, too.
"""
COLUMNS = ("left alone", "Nelder-Mead", "own solver")


def delta(summary):
    """The mean correction; a dash where there is none."""
    adjust = summary["adjust"].get("motor.d")
    return "-" if adjust is None else f"{adjust['delta_mean']:+.5f}"


def rows(live, free, nelder_mead, own):
    """(what it is, a cell for each column), from the live run and from lists of replays."""
    three = (free[0], nelder_mead[0], live)
    yield "MSE of the speed, (rad/s)²", [f"{one['match']['motor.omega']['mse']:.3f}" for one in three]
    yield "MAX deviation, rad/s", [f"{one['match']['motor.omega']['max']:.2f}" for one in three]
    yield "executions of components (N)", [f"{one['executions']['total']}" for one in three]
    yield "evaluations", [f"{one['evaluations']}" for one in three]
    yield "mean Δu of motor.d, N.m.s/rad", [delta(one) for one in three]
    yield "all of it replayed, ms", [f"{1e3 * min(one['wall_s'] for one in same):.1f}" for same in (free, nelder_mead, own)]
    yield "ticks / skipped", ["-", "-", f"{live['ticks']} / {live['skipped']}"]
    yield "missed deadlines", ["-", "-", f"{live['deadline_misses']}"]


def read(folder, pattern):
    """The summaries in the files of that name."""
    return [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob(pattern)]


def main():
    """Prints the table."""
    folder = Path(sys.argv[1])
    live, = read(folder, "live.json")
    replays = [read(folder, f"{name}.[0-9].json") for name in ("free", "nelder_mead", "own")]
    print(HEADING)
    for name, cells in [("", COLUMNS), *rows(live, *replays)]:
        print(f"{name:32}" + "".join(f"{cell:>14}" for cell in cells))


if __name__ == "__main__":
    main()
