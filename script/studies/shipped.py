"""Measures the motor bench as shipped against its true speed: see the command shipped, which builds and starts this."""
import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

from proposals import ALONE, NOISE, Recording, chirp_to, hand, quiet, sine, steps
from study import PROGRAM, Progress, print_figures, run_command

# as proposals.KINDS; None: 1.2 times the true MSE of the twin left alone, or a ninth of \u03c3\u00b2 if that is more
KINDS = {
    "quiet": (quiet, 1.0, False, None),
    "sine 3 Hz": (sine, 1.0, False, 0.2),
    "chirp 8.6 Hz": (chirp_to(8.6), 1.0, False, 0.4),
    "steps": (steps, 1.0, False, 0.3),
    "2 % outliers": (hand, 1.0, True, 0.1),
    "noise x 3": (hand, 3.0, False, 0.35),
}


def measure(program, kind, seed, options):
    with tempfile.TemporaryDirectory(prefix="twinlock-shipped-") as folder:
        recording = Recording(program, Path(folder), kind, seed, options.seconds, KINDS)
        true, told = recording.replay(options.patch)
        goal = KINDS[kind][3] or max(1.2 * recording.true_mse(ALONE), NOISE ** 2 / 9.0)
        return {"true": true, "told": told["mse_readings"], "goal": goal, "injected": recording.outliers, "rejected": told.get("rejected", 0)}


# ---- the table ----

def mean_of(rows, name):
    return sum(row[name] for row in rows) / len(rows)


def misses(rows):
    return mean_of(rows, "true") > mean_of(rows, "goal")


def print_table(results):
    layout = "{:<14}{:>6}{:>10}{:>10}{:>10}{:>8}{:>10}{:>10}  {}"
    print(layout.format("MSE, (rad/s)\u00b2", "seeds", "true", "worst", "told", "goal", "outliers", "rejected", "").rstrip())
    for kind, rows in results.items():
        print(layout.format(kind, len(rows), f"{mean_of(rows, 'true'):.4f}", f"{max(row['true'] for row in rows):.4f}",
                            f"{mean_of(rows, 'told'):.4f}", f"{mean_of(rows, 'goal'):.3f}", sum(row["injected"] for row in rows),
                            sum(row["rejected"] for row in rows), "MISSED" if misses(rows) else "").rstrip())
    print("true: against the speed of the plant without noise, mean and largest of all seeds; told: against the readings.")


# ---- command line ----

def parse(arguments):
    parser = argparse.ArgumentParser(prog="script/studies/shipped", usage="script/studies/shipped [options]; see --help",
                                     add_help=False, allow_abbrev=False)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=int, default=30)
    parser.add_argument("--only", default=",".join(KINDS))
    parser.add_argument("--patch", type=json.loads, default={})
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    options.kinds = options.only.split(",")
    if any(kind not in KINDS for kind in options.kinds):
        parser.error(f"--only {options.only}: expected some of {','.join(KINDS)}")
    if not 1 <= options.seeds <= 1000 or not 5 <= options.seconds <= 3600 or not isinstance(options.patch, dict):
        parser.error("expected 1 to 1000 seeds, 5 to 3600 seconds, and a JSON object as patch")
    return options


def work(options):
    program, progress = os.environ.get("TWINLOCK", PROGRAM), Progress(len(options.kinds) * options.seeds)
    results = {kind: [] for kind in options.kinds}
    try:
        for kind, rows in results.items():
            for seed in range(1, options.seeds + 1):
                progress.say(f"{kind}, seed {seed}")
                rows.append(measure(program, kind, seed, options))
    finally:
        progress.end()
    print_figures(results, options.json, print_table)
    return 1 if any(misses(rows) for rows in results.values()) else 0


def main():
    options = parse(sys.argv[1:])
    return run_command("shipped", lambda: work(options), 65)


if __name__ == "__main__":
    sys.exit(main())
