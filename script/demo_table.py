"""The closing table of script/demo: the twin left alone, locked by Nelder-Mead, and locked by twinlock's own solver.

demo_table.py FREE NELDER_MEAD LIVE: --json summaries of two replays of what the live run recorded, and of the live run. The table
has no times: a replay of this bench takes some ms, which depend more on the machine than on the solver.
"""
import json
import sys
from pathlib import Path

HEADING = """
The first two columns are replays of what the live run recorded: the twin left alone, and locked by the solver
Nelder-Mead with all other settings of the live run. The last column is the live run, locked by twinlock's own solver.
"""
COLUMNS = ("left alone", "Nelder-Mead", "own solver")


def correction(summary):
    """The mean correction; a dash if there is none."""
    adjust = summary["adjust"].get("motor.d")
    return "-" if adjust is None else f"{adjust['correction_mean']:+.5f}"


def rows(free, nelder_mead, live):
    """(what it is, a cell for each column)"""
    three = (free, nelder_mead, live)
    yield "MSE of the speed, (rad/s)²", [f"{one['match']['motor.omega']['mse']:.3f}" for one in three]
    yield "MAX deviation, rad/s", [f"{one['match']['motor.omega']['max']:.2f}" for one in three]
    yield "executions of components (N)", [f"{one['executions']['total']}" for one in three]
    yield "evaluations", [f"{one['evaluations']}" for one in three]
    yield "mean Δu of motor.d, N.m.s/rad", [correction(one) for one in three]
    yield "ticks / skipped", ["-", "-", f"{live['ticks']} / {live['skipped']}"]
    yield "missed deadlines", ["-", "-", f"{live['deadline_misses']}"]


def main():
    """Prints the table."""
    summaries = [json.loads(Path(path).read_text(encoding="utf-8")) for path in sys.argv[1:4]]
    print(HEADING)
    for name, cells in [("", COLUMNS), *rows(*summaries)]:
        print(f"{name:32}" + "".join(f"{cell:>14}" for cell in cells))


if __name__ == "__main__":
    main()
