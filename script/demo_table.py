"""The closing table of script/demo: the twin left alone against the twin locked, from two --json summaries."""
import json
import sys


def column(summary):
    """The table's cells for one summary."""
    match = summary["match"]["motor.omega"]
    adjust = summary["adjust"].get("motor.d")
    return [
        f"{match['mse']:.3f}",
        f"{match['max']:.2f}",
        f"{summary['executions']['total']}",
        f"{summary['evaluations']}",
        "-" if adjust is None else f"{adjust['delta_mean']:+.5f}",
        "-" if summary["ticks"] == 0 else f"{summary['ticks']} / {summary['skipped']}",
        "-" if summary["ticks"] == 0 else f"{summary['deadline_misses']}",
    ]


def main():
    """Prints the table."""
    free, locked = (json.load(open(path, encoding="utf-8")) for path in sys.argv[1:3])
    names = [
        "MSE of the speed, (rad/s)²",
        "MAX deviation, rad/s",
        "executions of components",
        "evaluations",
        "mean Δu of motor.d, N.m.s/rad",
        "ticks / skipped",
        "missed deadlines",
    ]
    print()
    print(f"{'':32}{'left alone':>14}{'locked':>14}")
    for name, one, other in zip(names, column(free), column(locked)):
        print(f"{name:32}{one:>14}{other:>14}")


if __name__ == "__main__":
    main()
