"""Measures the proposals of `check --recording` against the true speed: see the command proposals, which builds and starts this."""
import argparse
import csv
import json
import math
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

from motor_bench import FOLDER, read
from study import NOT_LOCKED, PROGRAM, Progress, Trouble, merge, print_figures, run_command

STEP_S = 0.01
AGE_S = 0.005  # of a value when it is sent, on average (config/motor/README.md)
NOISE = 0.3  # rad/s, of the bench
OUTLIERS, NEAREST, FURTHEST = 0.02, 10.0, 40.0  # share, rad/s


# ---- brakes ----

def quiet(_choice, _seconds):
    return lambda time: 0.0


def hand(choice, _seconds):
    parts = [(choice.uniform(0.05, 0.2), choice.uniform(0.1, 0.8), choice.uniform(0.0, 6.0)) for _ in range(4)]
    return lambda time: min(1.0, time) * max(0.0, 0.3 + sum(a * math.sin(2.0 * math.pi * f * time + p) for a, f, p in parts))


def sine(_choice, _seconds):
    return lambda time: 0.25 * (1.0 - math.cos(2.0 * math.pi * 3.0 * max(0.0, time - 0.5)))


def chirp_to(hertz):
    """From 0.2 Hz."""
    def chirp(_choice, seconds):
        def at(time):
            since = max(0.0, time - 0.5)
            return 0.25 * (1.0 - math.cos(2.0 * math.pi * (0.2 * since + (hertz - 0.2) / (2.0 * seconds) * since ** 2)))
        return at
    return chirp


def steps(choice, seconds):
    edges, begin = [], 1.0
    while begin < seconds:
        end = begin + choice.uniform(0.5, 1.5)
        edges.append((begin, end, choice.uniform(0.2, 0.5)))
        begin = end + choice.uniform(0.5, 1.5)
    return lambda time: max((torque for first, last, torque in edges if first <= time < last), default=0.0)


# name: brake, times the noise, outliers, limit of the true MSE in (rad/s)²; None: 1.2 times that of the twin left alone, or a ninth of σ² if that is more
KINDS = {
    "quiet": (quiet, 1.0, False, None),
    "hand": (hand, 1.0, False, 0.08),
    "sine 3 Hz": (sine, 1.0, False, 0.3),
    "chirp": (chirp_to(5.0), 1.0, False, 0.6),
    "steps": (steps, 1.0, False, 0.4),
    "noise x 3": (hand, 3.0, False, 0.5),
    "2 % outliers": (hand, 1.0, True, 0.3),
}


# ---- one recording ----

class Recording:
    """A recording of the bench, its true speed, and the true noise of its readings: of the sensor and of the stamps."""

    def __init__(self, program, folder, kind, seed, seconds, kinds=None):
        shape, self.times, has_outliers, _ = (kinds or KINDS)[kind]
        self.program, self.folder, self.seconds = program, folder, seconds
        self._write_brake(shape(random.Random(f"{kind} {seed}"), seconds))
        self.path = self._play("recording.csv", seed, False)
        self.truth = {round(time / STEP_S): speed for time, speed in self._rows(self._play("truth.csv", seed, True))}
        self.outliers = 0
        if has_outliers:
            self._add_outliers(random.Random(seed))
        off = [speed - self._true_at(time - AGE_S) for time, speed in self._rows(self.path) if time > 0.2]
        usual = [value for value in off if abs(value) < 0.7 * NEAREST]
        self.noise = math.sqrt(sum(value ** 2 for value in usual) / len(usual))

    def _write_brake(self, torque):
        rows = (f"{i * STEP_S:.2f},{torque(i * STEP_S):.5f}\n" for i in range(round((self.seconds + 1) / STEP_S)))
        (self.folder / "brake.csv").write_text("t,torque\n" + "".join(rows), encoding="utf-8")

    def _play(self, name, seed, exact):
        document = read("plant")
        document.update(duration_s=self.seconds, recording={"file": "brake.csv", "time_column": "t"})
        for column in document["emulate"]["columns"].values():
            column["noise"] *= self.times
        if exact:
            document["emulate"] = {"columns": {name: {"from": column["from"]} for name, column in document["emulate"]["columns"].items()}}
        config, made = self.folder / "plant.json", self.folder / name
        config.write_text(json.dumps(document), encoding="utf-8")
        subprocess.run([self.program, "plant", config, "--record", made, "--seed", str(seed)], check=True, capture_output=True)
        return made

    @staticmethod
    def _rows(path):
        with open(path, encoding="utf-8", newline="") as file:
            return [(float(row["t"]), float(row["omega"])) for row in csv.DictReader(file)]

    def _true_at(self, time):
        step = min(max(math.floor(time / STEP_S), 0), max(self.truth) - 1)
        share = time / STEP_S - step
        return self.truth[step] + share * (self.truth[step + 1] - self.truth[step])

    def _add_outliers(self, choice):
        with open(self.path, encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        column = head.index("omega")
        for row in rows:
            if choice.random() < OUTLIERS:
                self.outliers += 1
                row[column] = repr(float(row[column]) + choice.choice((-1.0, 1.0)) * choice.uniform(NEAREST, FURTHEST))
        with open(self.path, "w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])

    # ---- check and replay ----

    def _run(self, good_codes, *arguments):
        done = subprocess.run(list(map(str, (self.program, *arguments))), capture_output=True, text=True, check=False)
        if done.returncode not in good_codes:
            raise Trouble(done.stderr.strip() or f"{self.program}: exit code {done.returncode}")
        return done.stdout

    def advice(self):
        return json.loads(self._run((0,), "check", FOLDER / "lock.json", "--recording", self.path, "--json"))

    def true_mse(self, change):
        return self.replay(change)[0]

    def replay(self, change):
        """(true MSE, figures of the match) with config/motor/lock.json and a merge patch."""
        config, table = self.folder / "twin.json", self.folder / "steps.csv"
        document = merge(read("lock"), {"duration_s": None, **change})
        config.write_text(json.dumps(document), encoding="utf-8")
        told = json.loads(self._run((0, NOT_LOCKED), "replay", config, "--recording", self.path, "--json", "--csv", table))
        with open(table, encoding="utf-8", newline="") as file:
            squares = [(float(row["motor.omega simulated"]) - self.truth[round(float(row["time"]) / STEP_S)]) ** 2
                       for row in csv.DictReader(file) if round(float(row["time"]) / STEP_S) in self.truth]
        return sum(squares) / len(squares), told["match"]["motor.omega"]


ALONE = {"synchronise": None, "compare": {"motor.omega": {"to": "plant.omega"}}}


def measure(program, kind, seed, seconds):
    with tempfile.TemporaryDirectory(prefix="twinlock-proposals-") as folder:
        recording = Recording(program, Path(folder), kind, seed, seconds)
        told = recording.advice()
        omega, alone = told["signals"]["omega"], recording.true_mse(ALONE)
        limit = KINDS[kind][3] or max(1.2 * alone, NOISE ** 2 / 9.0)
        return {"noise": recording.noise, "found": omega["noise"], "too_fast": omega["too_fast"], "outliers": omega["outliers"],
                "proposal": told["proposal"]["synchronise"]["match"]["motor.omega"], "input": told["proposal"]["plant"]["torque"]["between"],
                "shipped": recording.true_mse({}), "proposed": recording.true_mse(told["proposal"]), "alone": alone, "limit": limit}


# ---- the table ----

def misses(rows):
    """The limits that one kind misses: the mean of the errors, and each estimated noise."""
    mean = sum(row["proposed"] for row in rows) / len(rows)
    limit = sum(row["limit"] for row in rows) / len(rows)
    return [f"true MSE {mean:.3f}, at most {limit:.3f}"] * (mean > limit) + [
        f"noise {row['found']:.3f}, true {row['noise']:.3f}" for row in rows
        if not row["too_fast"] and abs(row["found"] / row["noise"] - 1.0) > 0.15]


def condition_of(proposal):
    condition = {key: value for key, value in (proposal["condition"] or {}).items() if value is not None}
    return ", ".join(f"{key} {value:g}" for key, value in condition.items()) or "none"


def print_table(results):
    layout = "{:<14}{:>7}{:>7} {:>9}{:>9}{:>9}{:>8}  {}"
    print(layout.format("true MSE", "noise", "found", "shipped", "proposed", "alone", "limit", "condition; tolerance"))
    for kind, rows in results.items():
        for row in rows:
            print(layout.format(kind, f"{row['noise']:.3f}", "too fast" if row["too_fast"] else f"{row['found'] / row['noise']:.2f}",
                                *(f"{row[name]:.4f}" for name in ("shipped", "proposed", "alone")), f"{row['limit']:.3f}",
                                f"{condition_of(row['proposal'])}; {row['proposal'].get('tolerance', 0):g}"))
        for miss in misses(rows):
            print(f"  MISSED: {miss}")
    print("noise: of sensor and stamps, rad/s; found: the estimate relative to it. Errors in (rad/s)\u00b2.")


# ---- command line ----

def parse(arguments):
    parser = argparse.ArgumentParser(prog="script/studies/proposals", usage="script/studies/proposals [options]; see --help",
                                     add_help=False, allow_abbrev=False)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=int, default=30)
    parser.add_argument("--only", default=",".join(KINDS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    options.kinds = options.only.split(",")
    unknown = [kind for kind in options.kinds if kind not in KINDS]
    if unknown:
        parser.error(f"--only {options.only}: expected some of {','.join(KINDS)}")
    if not 1 <= options.seeds <= 1000 or not 5 <= options.seconds <= 3600:
        parser.error("expected 1 to 1000 seeds and 5 to 3600 seconds")
    return options


def work(options):
    program, progress = os.environ.get("TWINLOCK", PROGRAM), Progress(len(options.kinds) * options.seeds)
    results = {}
    try:
        for kind in options.kinds:
            results[kind] = []
            for seed in range(1, options.seeds + 1):
                progress.say(f"{kind}, seed {seed}")
                results[kind].append(measure(program, kind, seed, options.seconds))
    finally:
        progress.end()
    print_figures(results, options.json, print_table)
    return 1 if any(misses(rows) for rows in results.values()) else 0


def main():
    options = parse(sys.argv[1:])
    return run_command("proposals", lambda: work(options), 65)


if __name__ == "__main__":
    sys.exit(main())
