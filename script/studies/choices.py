"""Measures each setting of a lock against the true speed: see the command choices, which builds and starts this."""
import argparse
import csv
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

from brakes import make_recording
from lock_picture import ALONE, GRID, INK, LEFT, LOCKED, PLANT, RIGHT, WIDTH, Panel
from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

LOCK = ROOT / "config" / "motor" / "lock.json"
STEP_S, SETTLED_S = 0.01, 0.2
SHOWN_S, SHOWN_FROM_S = 0.4, 5.7  # of the picture: the brake is let go


def adjusted(**variables):
    return {"adjust": {name.replace("__", "."): tuning for name, tuning in variables.items()}}


def of_match(**keys):
    return {"match": {"motor.omega": keys}}


def by(solver, edits):
    return {**edits, "algorithm": solver}


def of_friction(**keys):
    return {"adjust": {"motor.d": keys}}


BOTH = ("secant", "nelder-mead")
BY_LAST = {"between": "last", "condition": None}
BY_LINE = {"between": "line", "condition": None}
TABLES = {
    "adjust": {"friction motor.d": {}, "current motor.I_in": adjusted(motor__d=None, motor__I_in={"step": 1.0}),
               "torque motor.M_w": adjusted(motor__d=None, motor__M_w={"step": 0.1}),
               "d and I_in": adjusted(motor__I_in={"step": 1.0})},
    "horizon": {f"{solver}, {shape} {steps}": by(solver, {"horizon": {"prediction": steps, "shape": shape}})
                for solver in BOTH for shape in ("static", "dynamic") for steps in (1, 2, 3, 5, 8)},
    "tolerance": {f"{solver}, {tolerance:g} rad/s": by(solver, of_match(tolerance=tolerance)) for solver in BOTH for tolerance in (0.3, 0.6, 1, 2, 3)},
    "step": {f"{solver}, {step:g}": by(solver, of_friction(step=step)) for solver in BOTH for step in (0.001, 0.01, 0.12, 0.5, 2)},
    "penalty": {f"{solver}, {kind} {weight:g}": by(solver, of_friction(penalty={kind: weight}))
                for solver in BOTH for kind in ("rate", "deviation") for weight in (0.01, 0.1, 1, 10)},
    "between": {"the last message": of_match(**BY_LAST), "the line": of_match(**BY_LINE), "the line, low-pass of 20 ms": {},
                "the line, low-pass of 60 ms": of_match(condition={"low_pass_s": 0.06})},
}


class Bench:
    """Recordings of the bench with different seeds, and the true speed, which is the same for all."""

    def __init__(self, folder, seeds):
        self.folder = Path(folder)
        self.recordings = [make_recording(PROGRAM, self.folder, seed) for seed in range(1, seeds + 1)]
        rows = self._rows(make_recording(PROGRAM, self.folder, 0, exact=True))
        self.true = {round(float(row["t"]) / STEP_S): float(row["omega"]) for row in rows}

    @staticmethod
    def _rows(path):
        with open(path, encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def replay(self, edits, recording):
        """(JSON object of the replay, rows of the steps)."""
        document = json.loads(LOCK.read_text(encoding="utf-8"))
        document["recording"]["file"] = str(recording)
        document["synchronise"] = merge(document["synchronise"], edits)
        config, steps = self.folder / "config.json", self.folder / "steps.csv"
        config.write_text(json.dumps(document), encoding="utf-8")
        done = subprocess.run([PROGRAM, "replay", config, "--json", "--csv", steps], capture_output=True, check=False)
        if done.returncode not in (0, NOT_LOCKED):
            raise Trouble(done.stderr.decode().strip())
        return json.loads(done.stdout), self._rows(steps)

    def readings(self, recording):
        return [(float(row["t"]), float(row["omega"])) for row in self._rows(recording) if row["omega"]]

    def true_mse(self, rows):
        settled = [row for row in rows if float(row["time"]) > SETTLED_S and round(float(row["time"]) / STEP_S) in self.true]
        return sum((float(row["motor.omega simulated"]) - self.true[round(float(row["time"]) / STEP_S)]) ** 2 for row in settled) / len(settled)

    def measure(self, edits):
        """Means over the recordings."""
        found = []
        for recording in self.recordings:
            told, rows = self.replay(edits, recording)
            found.append((self.true_mse(rows), told["match"]["motor.omega"]["mse"], told["executions"]["total"] / (3 * told["steps"])))
        return dict(zip(("true", "told", "executions"), (sum(each) / len(found) for each in zip(*found))))


def measure(options):
    if options.only not in (None, *TABLES):
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(TABLES)}")
    tables = {name: table for name, table in TABLES.items() if options.only in (None, name)}
    progress = Progress(1 + sum(map(len, tables.values())))
    with tempfile.TemporaryDirectory() as folder:
        try:
            progress.say("generating")
            bench, results = Bench(folder, options.seeds), {}
            for name, table in tables.items():
                results[name] = {}
                for choice, edits in table.items():
                    progress.say(f"{name}: {choice}")
                    results[name][choice] = bench.measure(edits)
        finally:
            progress.end()
    return results


def show(results):
    for name, table in results.items():
        print(f"{name:30}{'true MSE':>10}{'reported':>10}{'executions':>12}")
        for choice, row in table.items():
            print(f"  {choice:28}{row['true']:10.4f}{row['told']:10.4f}{row['executions']:12.3f}")


# ---- pictures ----

def svg(height, parts):
    body = "\n".join(parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12" fill="{INK}">\n'
            f'<rect width="{WIDTH}" height="{height}" fill="white"/>\n{body}\n</svg>\n')


def draw_between(bench):
    """Some tenths of a second: the true speed, readings, and the twin with the last message and with the line."""
    recording = bench.recordings[0]
    shown = [(k * STEP_S - SHOWN_FROM_S, speed) for k, speed in sorted(bench.true.items()) if 0 <= k * STEP_S - SHOWN_FROM_S <= SHOWN_S]
    speeds = [speed for _, speed in shown]
    low, high = math.floor(min(speeds) - 0.5), math.ceil(max(speeds) + 0.5)
    panel = Panel(44, 260, low, high, SHOWN_S)
    panel.axes(range(low, high + 1, max(1, (high - low) // 5)), f"motor speed, rad/s, over {SHOWN_S:g} s", False)
    panel.legend([("true", PLANT), ("by the last message", ALONE), ("on the line, low-pass", LOCKED)])
    panel.line(*zip(*shown), PLANT, 4)
    for edits, colour in ((of_match(**BY_LAST), ALONE), ({}, LOCKED)):
        rows = [(float(row["time"]) - SHOWN_FROM_S, float(row["motor.omega simulated"])) for row in bench.replay(edits, recording)[1]]
        panel.line(*zip(*[row for row in rows if 0 <= row[0] <= SHOWN_S]), colour, 1.8)
    for time, value in bench.readings(recording):
        if 0 <= time - SHOWN_FROM_S <= SHOWN_S and low <= value <= high:
            panel.parts.append(f'<circle cx="{panel.x(time - SHOWN_FROM_S):.1f}" cy="{panel.y(value):.1f}" r="3.2" fill="white" stroke="{INK}"/>')
    panel.parts.append(f'<text x="{WIDTH - RIGHT}" y="324" text-anchor="end">circles: readings, at their arrival</text>')
    return svg(336, panel.parts)


def draw_bars(results):
    """True MSE and executions of each horizon, one line for each."""
    rows, parts, y = [(name, row) for name, row in results["horizon"].items() if "8" not in name], [], 34
    most = max(row["true"] for _, row in rows)
    scale, column = 300 / most, LEFT + 130
    parts.append(f'<text x="{column}" y="20" font-weight="600">true MSE, (rad/s)², and executions over those of a twin left alone</text>')
    for name, row in rows:
        colour = LOCKED if name.startswith("secant") else ALONE
        parts.append(f'<text x="{column - 8}" y="{y + 10}" text-anchor="end">{name}</text>')
        parts.append(f'<rect x="{column}" y="{y}" width="{row["true"] * scale:.1f}" height="12" fill="{colour}"/>')
        parts.append(f'<text x="{column + row["true"] * scale + 6:.1f}" y="{y + 10}">{row["true"]:.3f}; {row["executions"]:.2f} times</text>')
        y += 19
    parts.insert(0, f'<line x1="{column}" x2="{column}" y1="28" y2="{y}" stroke="{GRID}"/>')
    return svg(y + 10, parts)


def draw(folder):
    with tempfile.TemporaryDirectory() as scratch:
        (Path(folder) / "between.svg").write_text(draw_between(Bench(scratch, 1)), encoding="utf-8")
    results = measure(argparse.Namespace(only="horizon", seeds=4))
    (Path(folder) / "horizon.svg").write_text(draw_bars(results), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=4, choices=range(1, 1001), metavar="N")
    parser.add_argument("--only")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--pictures")
    options = parser.parse_args()
    if options.pictures is not None:
        draw(options.pictures)
        return 0
    print_figures(measure(options), options.json, show)
    return 0


if __name__ == "__main__":
    sys.exit(run_command("choices", main, 65))
