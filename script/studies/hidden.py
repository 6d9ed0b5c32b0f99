"""Compares states without a sensor with the true ones: see the command hidden, which builds and starts this."""
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

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

SLACK = 1.2
ERRORS = (0.0, 0.01, 0.05)


def shipped(system, name):
    return json.loads((ROOT / "config" / system / f"{name}.json").read_text(encoding="utf-8"))


def held(columns, seconds, shortest, longest, draw):
    """Rows of commands that are held for a random time."""
    def rows(choice):
        found, time = [columns], 0.0
        while time < seconds:
            found.append([f"{time:.3f}", *draw(choice)])
            time += choice.uniform(shortest, longest)
        return found
    return rows


def vessels():
    """Two lags in series; only the second one is measured."""
    lags = {"first": {"fmu": "lag.fmu", "set": {"T": 60, "x_start": 1, "t_step": 1}}, "second": {"fmu": "lag.fmu", "set": {"T": 40, "x_start": 1, "t_step": 1}}}
    common = {"twinlock": 1, "name": "two vessels", "step_s": 1, "components": lags,
              "connect": [["plant.q", "first.u"], ["first.y", "second.u"]], "recording": {"time_column": "time"}}
    plant = merge(common, {"plant": {"q": {"unit": "1"}},
                           "emulate": {"columns": {"q": {"from": "plant.q"}, "level": {"from": "second.y", "noise": 0.05}}}})
    lock = merge(common, {"plant": {"q": {"unit": "1"}, "level": {"unit": "1"}},
                          "synchronise": {"adjust": {"first.u": {"step": 0.1, "min": 0, "max": 4}}, "match": {"second.y": {"to": "plant.level", "tolerance": 0.2}}}})
    return plant, lock, held(["time", "q"], 3600, 300, 500, lambda choice: [f"{choice.uniform(0.5, 2.0):.4f}"])


def tclab():
    lock = merge(shipped("tclab", "lock"), {"components": {"board": {"set": {"mCp": 2}}}})
    return shipped("tclab", "plant"), lock, held(["time", "Q1", "Q2"], 3600, 60, 400, lambda choice: [round(choice.uniform(0, 90)), round(choice.uniform(0, 90))])


def motor():
    lock = merge(shipped("motor", "lock"), {"components": {"motor": {"set": {"J": 0.0015}}}})
    return shipped("motor", "plant"), lock, held(["t", "torque"], 60, 0.5, 3.0, lambda choice: [f"{choice.choice((0.0, choice.uniform(0.0, 0.5))):.4f}"])


# name: the plant, its duration in s, {hidden state: the output beside which it is compared}, noise in units of the state, the wrong parameter
PLANTS = {
    "vessels": (vessels, 3600, {"first.y": "second.y"}, 0.05, ("first", "T")),
    "tclab": (tclab, 3600, {"board.H1": "board.T1", "board.H2": "board.T2"}, 0.05, ("board", "mCp")),
    "motor": (motor, 60, {"motor.omega": "motor.omega"}, 0.3, ("motor", "J")),
}


class Bench:
    """A plant with one recording with noise, and its true states."""

    def __init__(self, name, folder, seed):
        make, self.seconds, self.hidden, _, _ = PLANTS[name]
        self.folder = Path(folder)
        plant, self.lock, commands = make()
        with open(self.folder / "commands.csv", "w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(commands(random.Random(f"{name} {seed}")))
        plant["duration_s"] = self.seconds
        plant["recording"]["file"] = str(self.folder / "commands.csv")
        self.recording = self._record(plant, "recording.csv", seed)
        plant["emulate"] = {"columns": {state: {"from": state} for state in self.hidden}}
        self.true = self._record(plant, "true.csv", seed)

    def write(self, document):
        path = self.folder / "config.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    def _record(self, plant, name, seed):
        subprocess.run([PROGRAM, "plant", self.write(plant), "--record", self.folder / name, "--seed", str(seed)], check=True, capture_output=True)
        return self.folder / name

    def propose(self, document):
        told = subprocess.run([PROGRAM, "check", self.write(document), "--recording", self.recording, "--json"], capture_output=True, check=True).stdout
        return json.loads(told)

    def error(self, document):
        """Root mean square error of the hidden states, after a fifth of the time."""
        part = document.get("synchronise", {}).get("match") or document["compare"]
        for state, beside in self.hidden.items():
            part.setdefault(state, {"to": part[beside]["to"], **({"weight": 0} if "synchronise" in document else {})})
        document = merge(document, {"duration_s": self.seconds - 1})
        run = subprocess.run([PROGRAM, "replay", self.write(document), "--recording", self.recording, "--csv", self.folder / "steps.csv"],
                             capture_output=True, check=False)
        if run.returncode not in (0, NOT_LOCKED):
            raise Trouble(run.stderr.decode().strip())
        with open(self.folder / "steps.csv", encoding="utf-8", newline="") as steps, open(self.true, encoding="utf-8", newline="") as true:
            found, truth = list(csv.reader(steps)), list(csv.reader(true))
        squares, count = 0.0, 0
        for state in self.hidden:
            column, true_column = found[0].index(f"{state} simulated"), truth[0].index(state)
            for row, values in list(zip(found[1:], truth[2:]))[len(found) // 5:]:  # t = 0 is not the end of a step
                squares += (float(row[column]) - float(values[true_column])) ** 2
                count += 1
        return math.sqrt(squares / count)


def measure_one(bench, document, noise):
    told = bench.propose(document)
    chosen = told["proposal"]["synchronise"].get("horizon", {}).get("prediction")
    tried = {}
    for trial in told["horizons"]["trials"]:
        rests = trial["free_twin"]
        patch = merge(told["proposal"], {"synchronise": {"horizon": {"prediction": trial["prediction"]}, "free_twin": rests}})
        tried[f"{trial['prediction']}{' rests' if rests else ''}"] = bench.error(merge(document, patch))
    alone = merge(document, {"compare": {variable: {"to": match["to"]} for variable, match in document["synchronise"]["match"].items()}})
    alone.pop("synchronise")
    proposed, best, left_alone = bench.error(merge(document, told["proposal"])), min(tried.values()), bench.error(alone)
    return {"alone": left_alone, "tried": tried, "chosen": chosen, "proposed": proposed, "best": best,
            "bad": proposed > max(SLACK * min(best, left_alone), noise)}


def show(results):
    for name, row in results.items():
        tried = ", ".join(f"{value:.3g} ({key})" for key, value in row["tried"].items())
        print(f"{name}: proposed T_P {row['chosen']}: {row['proposed']:.3g}{' TOO MUCH' if row['bad'] else ''}; left alone {row['alone']:.3g}\n    {tried}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = [name for name in PLANTS if options.only in (None, name)]
    if not names:
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(PLANTS)}")
    os.environ["TWINLOCK_FMU_PATH"] = str(Path(PROGRAM).parent.parent / "fmus")
    progress, results = Progress(len(names) * len(ERRORS)), {}
    try:
        for name in names:
            with tempfile.TemporaryDirectory() as folder:
                bench = Bench(name, folder, options.seed)
                component, parameter = PLANTS[name][4]
                for error in ERRORS:
                    progress.say(f"{name}, {parameter} {error:.0%} off")
                    right = bench.lock["components"][component]["set"][parameter]
                    document = merge(bench.lock, {"components": {component: {"set": {parameter: right * (1.0 + error)}}}})
                    results[f"{name}, {parameter} {error:.0%} off"] = measure_one(bench, document, PLANTS[name][3])
    finally:
        progress.end()
    print_figures(results, options.json, show)
    return int(any(row["bad"] for row in results.values()))


if __name__ == "__main__":
    sys.exit(run_command("hidden", main, 65))
