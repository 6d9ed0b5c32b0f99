"""Breaks plants, and looks whether the change is found: see the command changes, which builds and starts this."""
import argparse
import csv
import json
import random
import subprocess
import sys
import tempfile
from pathlib import Path

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

DAY = 86400.0


def shipped(system, name):
    return json.loads((ROOT / "config" / system / f"{name}.json").read_text(encoding="utf-8"))


class Commands:
    """Commanded inputs of a day with a quiet night, and what the actuators make of them."""

    def __init__(self, names, held, draw, night):
        self.names, self.held, self.draw, self.night = names, held, draw, night

    def write(self, path, length, day, seed, fault):
        """`fault`: (time, name, factor) of an actuator, or None."""
        choice = random.Random(seed)
        at, broken, factor = fault or (length, None, 1.0)
        with open(path, "w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["time", *self.names, *(f"{name}_actual" for name in self.names)])
            time = 0.0
            while time < length:
                values = self.night if time / day % 1.0 > 0.75 else self.draw(choice)
                until = time + choice.uniform(*self.held)
                for begin in [time, at] if time < at < until else [time]:
                    actual = [value * (factor if name == broken and begin >= at else 1.0) for name, value in zip(self.names, values)]
                    rows.writerow([f"{begin:.3f}", *(f"{value:.5g}" for value in values), *(f"{value:.7g}" for value in actual)])
                time = until


def vessels():
    """Two lags in series; only the second one is measured."""
    lags = {"first": {"fmu": "lag.fmu", "set": {"T": 60, "x_start": 1, "t_step": 1}}, "second": {"fmu": "lag.fmu", "set": {"T": 40, "x_start": 1, "t_step": 1}}}
    common = {"twinlock": 1, "name": "two vessels", "step_s": 1, "components": lags, "recording": {"time_column": "time"}}
    plant = merge(common, {"plant": {"q": {"unit": "1"}, "q_actual": {"unit": "1"}},
                           "connect": [["plant.q_actual", "first.u"], ["first.y", "second.u"]],
                           "emulate": {"columns": {"q": {"from": "plant.q"}, "level": {"from": "second.y", "noise": 0.01}}}})
    lock = merge(common, {"plant": {"q": {"unit": "1"}, "level": {"unit": "1"}}, "connect": [["plant.q", "first.u"], ["first.y", "second.u"]],
                          "synchronise": {"adjust": {"first.u": {"step": 0.1, "min": 0, "max": 4}}, "horizon": {"prediction": 100},
                                          "match": {"second.y": {"to": "plant.level", "tolerance": 0.03}}}})
    return plant, lock, Commands(["q"], (300, 900), lambda choice: [choice.uniform(0.5, 2.0)], [0.5])


def tclab():
    plant = shipped("tclab", "plant")
    plant = merge(plant, {"plant": {"Q1_actual": {"unit": "%"}, "Q2_actual": {"unit": "%"}}})
    plant["connect"] = [["plant.Q1_actual", "board.Q1"], ["plant.Q2_actual", "board.Q2"]]
    lock = merge(shipped("tclab", "lock"), {"components": {"board": {"set": {"mCp": 2}}}})
    draw = lambda choice: [choice.uniform(20, 70), choice.uniform(20, 70)]
    return plant, lock, Commands(["Q1", "Q2"], (600, 2400), draw, [15.0, 10.0])


# name: plant, s of a day, {fault: (actuator, factor) or (sensor, offset)}
PLANTS = {
    "vessels": (vessels, DAY, {"pump -5 %": ("q", 0.95), "pump -10 %": ("q", 0.9), "level +0.05": ("level", 0.05)}),
    "tclab": (tclab, DAY, {"heater -5 %": ("Q1", 0.95), "heater -20 %": ("Q1", 0.8), "sensor +0.5 K": ("T1", 0.5)}),
}


class Bench:
    """One plant, for some days, with one fault or none."""

    def __init__(self, name, folder, seed, days, fault, at):
        make, self.day, faults = PLANTS[name]
        self.folder = Path(folder)
        plant, self.lock, commands = make()
        self.length = days * self.day
        what, size = faults[fault] if fault else (None, 0.0)
        is_actuator = what in commands.names
        commands.write(self.folder / "commands.csv", self.length, self.day, f"{name} {seed}", (at, what, size) if is_actuator else None)
        plant["duration_s"] = self.length
        plant["recording"]["file"] = str(self.folder / "commands.csv")
        self.recording = self.folder / "recording.csv"
        subprocess.run([PROGRAM, "plant", self._write(plant), "--record", self.recording, "--seed", str(seed)], check=True, capture_output=True)
        if fault and not is_actuator:
            self._shift(what, size, at)

    def _write(self, document):
        path = self.folder / "config.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    def _shift(self, column, offset, at):
        shifted = self.folder / "shifted.csv"
        with open(self.recording, encoding="utf-8", newline="") as source, open(shifted, "w", encoding="utf-8", newline="") as target:
            rows, out = csv.reader(source), csv.writer(target)
            names = next(rows)
            index = names.index(column)
            out.writerow(names)
            for row in rows:
                if float(row[0]) >= at:
                    row[index] = repr(float(row[index]) + offset)
                out.writerow(row)
        self.recording = shifted

    def replay(self):
        document = merge(self.lock, {"duration_s": self.length - 1, "detect": {"learn_s": self.day}})
        run = subprocess.run([PROGRAM, "replay", self._write(document), "--recording", self.recording, "--json"], capture_output=True, check=False)
        if run.returncode not in (0, NOT_LOCKED):
            raise Trouble(run.stderr.decode().strip())
        return json.loads(run.stdout)


def measure(name, seed, days, fault, at):
    with tempfile.TemporaryDirectory() as folder:
        told = Bench(name, folder, seed, days, fault, at).replay()
    findings = told["findings"]
    before = [finding for finding in findings if finding["found"] < at]
    after = [finding for finding in findings if finding["found"] >= at]
    first = after[0] if after else None
    return {"plant": name, "fault": fault or "none", "seed": seed, "false": len(before), "found": len(after) if fault else 0,
            "further": len(after) - 1 if fault and after else 0, "false_after": 0 if fault else len(after), "state": told["detection"]["state"],
            "delay": first["found"] - at if fault and first else None, "onset_error": first["onset"] - at if fault and first else None,
            "text": first["text"] if first else "", "texts": [finding["text"] for finding in findings]}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--days", type=float, default=4)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = [name for name in PLANTS if options.only in (None, name)]
    for name in names:
        for fault in (None, *PLANTS[name][2]):
            for seed in range(1, options.seeds + 1):
                row = measure(name, seed, options.days, fault, (options.days - 1.4) * PLANTS[name][1])
                print(json.dumps(row))
                sys.stdout.flush()


if __name__ == "__main__":
    main()
