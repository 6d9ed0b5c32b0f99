"""A day of the motor bench, minute by minute against the true speed: see the command days, which builds and starts this."""
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

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, print_figures, run_command

MOTOR = ROOT / "config" / "motor"
STEP_S, SAMPLE_S, MINUTE = 0.01, 0.02, 6000  # ticks
SOLVERS = ("secant", "nelder-mead", "bobyqa", "sbplx", "l-bfgs")
WAYS = [(mode, solver) for mode in ("lag", "hold", "ahead") for solver in SOLVERS]
HELD, SLACK, PART_OF_NOISE = 120, 1.2, 9  # s that a hand stays, or is away


class Day:
    """What is generated, in a folder: what was measured of the plant, and its true speed of each tick in a file."""

    def __init__(self, folder, options):
        self.folder, self.seconds = Path(folder), options.hours * 3600
        self.noise, self.recording = options.noise, self.folder / "recording.csv"
        self._write_brake(random.Random(options.seed))
        plant = self._read("plant")
        plant["duration_s"] = self.seconds
        plant["recording"]["file"] = str(self.folder / "brake.csv")
        plant["components"]["motor"]["set"]["J"] = options.inertia
        columns = plant["emulate"]["columns"]
        columns["omega"]["noise"] = options.noise
        self._make(plant, self.recording, options.seed)
        for column in columns.values():
            column.pop("noise")
        plant["emulate"].pop("message_s")
        self._make(plant, self.folder / "true.csv", options.seed)

    @staticmethod
    def _read(name):
        return json.loads((MOTOR / f"{name}.json").read_text(encoding="utf-8"))

    def _write(self, document):
        path = self.folder / "config.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    def _make(self, plant, path, seed):
        subprocess.run([PROGRAM, "plant", self._write(plant), "--record", path, "--seed", str(seed)], check=True, capture_output=True)

    def _write_brake(self, choice):
        parts, pulled, until = [], False, 0.0
        with open(self.folder / "brake.csv", "w", encoding="utf-8") as file:
            file.write("t,torque\n")
            for i in range(round((self.seconds + 1) / SAMPLE_S)):
                time = i * SAMPLE_S
                if time >= until:
                    pulled, until = not pulled, time + choice.uniform(0.2, 1.8) * HELD
                    parts = [(choice.uniform(0.02, 0.15), choice.uniform(0.1, 0.8), choice.uniform(0.0, 6.0)) for _ in range(4)]
                    begun = time
                torque = sum(a * math.sin(2 * math.pi * f * time + p) for a, f, p in parts) + 0.2 if pulled else 0.0
                file.write(f"{time:.2f},{max(0.0, torque) * min(1.0, time - begun):.4f}\n")

    def replay(self, edit):
        """(what --json tells, [MSE against the true speed of each minute])."""
        document = self._read("lock")
        document["duration_s"] = self.seconds - 1
        document["recording"]["file"] = str(self.recording)
        edit(document)
        read, write = os.pipe()
        with subprocess.Popen([PROGRAM, "replay", self._write(document), "--json", "--csv", f"/dev/fd/{write}"], pass_fds=(write,),
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
            os.close(write)
            minutes = self._minutes(read)
            told, said = run.communicate()
        if run.returncode not in (0, NOT_LOCKED):
            raise Trouble(said.decode().strip())
        return json.loads(told), minutes

    def _minutes(self, read):
        """Both files tick by tick: a day of them is more than memory should hold."""
        minutes, squares, count = [], 0.0, 0
        with open(read, encoding="utf-8", newline="") as steps, open(self.folder / "true.csv", encoding="utf-8", newline="") as true:
            there, speeds = csv.reader(steps), csv.reader(true)
            column, truly = next(there).index("motor.omega"), next(speeds).index("omega")
            next(speeds)  # of t = 0, where no step ends
            for row, speed in zip(there, speeds):
                squares, count = squares + (float(row[column]) - float(speed[truly])) ** 2, count + 1
                if count == MINUTE:
                    minutes.append(squares / MINUTE)
                    squares, count = 0.0, 0
        return minutes


def left_alone(document):
    document["compare"] = {"motor.omega": {"to": "plant.omega"}}
    document.pop("synchronise")


def locked(mode, solver, noise):
    def edit(document):
        lock = document["synchronise"]
        lock["horizon"]["measurements"], lock["algorithm"] = mode, solver
        lock["match"]["motor.omega"]["tolerance"] = 3.4 * noise
        lock["free_twin"] = mode != "ahead"
        if mode != "lag":
            lock["match"]["motor.omega"].pop("condition")
    return edit


def figures_of(told, minutes, alone, allowed):
    """`allowed`: what a minute may have, whatever the one left alone has."""
    limits = [max(SLACK * other, allowed) for other in alone]
    over = [minute / limit for minute, limit in zip(minutes, limits)]
    return {"mean": sum(minutes) / len(minutes), "worst": max(minutes), "bad": sum(part > 1 for part in over), "worst_of_limit": max(over),
            "minutes": len(minutes), "executions": told["executions"]["total"] / (3 * told["steps"]),
            "rested": told.get("free_twin", {}).get("rested_steps", 0) / told["steps"]}


def measure(options):
    ways = [way for way in WAYS if options.only in (None, " ".join(way))]
    if not ways:
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(' '.join(way) for way in WAYS)}")
    progress, results = Progress(2 + len(ways)), {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            progress.say(f"generating {options.hours:g} h")
            day = Day(folder, options)
            progress.say("left alone")
            told, alone = day.replay(left_alone)
            results["left alone"] = figures_of(told, alone, alone, 0.0)
            for mode, solver in ways:
                progress.say(f"{mode} {solver}")
                allowed = options.noise ** 2 / (PART_OF_NOISE if (mode, solver) == ("lag", "secant") else 1)
                results[f"{mode} {solver}"] = figures_of(*day.replay(locked(mode, solver, options.noise)), alone, allowed)
        finally:
            progress.end()
    return results


def show(results):
    print(f"{'':18}{'true MSE':>10}{'worst minute':>14}{'of its limit':>14}{'bad minutes':>16}{'executions':>12}{'rests':>8}")
    for name, row in results.items():
        bad = f"{row['bad']} of {row['minutes']}"
        print(f"{name:18}{row['mean']:10.4f}{row['worst']:14.4f}{row['worst_of_limit']:14.2f}{bad:>16}{row['executions']:12.4f}{100 * row['rested']:6.0f} %")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=24)
    parser.add_argument("--noise", type=float, default=0.3)
    parser.add_argument("--inertia", type=float, default=0.05)
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results = measure(options)
    print_figures(results, options.json, show)
    return int(any(row["bad"] for row in results.values()))


if __name__ == "__main__":
    sys.exit(run_command("days", main, 65))
