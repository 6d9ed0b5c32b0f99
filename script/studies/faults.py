"""Breaks plants, and looks whether the change is found: see the command faults, which builds and starts this."""
import argparse
import csv
import json
import random
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

DAY = 86400.0
AFTER_DAYS, LEAST_DAYS = 1.4, 2.5  # a fault lasts this long; a day of learning before it


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
    return plant, lock, Commands(["Q1", "Q2"], (600, 2400), lambda choice: [choice.uniform(20, 70), choice.uniform(20, 70)], [15.0, 10.0])


ACTUATORS = ("q", "Q1", "Q2")
# name: plant, s of a day, {fault: (actuator, factor) or (sensor, offset)}
PLANTS = {
    "vessels": (vessels, DAY, {"pump -5 %": ("q", 0.95), "pump -10 %": ("q", 0.9), "level +0.05": ("level", 0.05)}),
    "tclab": (tclab, DAY, {"heater -5 %": ("Q1", 0.95), "heater -20 %": ("Q1", 0.8), "T1 +0.5 K": ("T1", 0.5), "T2 -0.5 K": ("T2", -0.5)}),
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
    """One replay; `at`: s, when the plant breaks. `false`: findings that no fault explains."""
    with tempfile.TemporaryDirectory() as folder:
        told = Bench(name, folder, seed, days, fault, at).replay()
    after = [finding for finding in told["findings"] if fault and finding["found"] >= at]
    first = after[0] if after else {"found": at, "onset": at, "percent": None, "variable": "", "causes": []}
    broken = PLANTS[name][2][fault][0] if fault else None
    truth = {"input", "plant" if broken in ACTUATORS else f"plant.{broken}"}
    return {"plant": name, "fault": fault or "none", "seed": seed, "watches": told["detection"]["state"] == "watching",
            "false": len(told["findings"]) - len(after), "found": len(after), "delay_s": first["found"] - at, "onset_error_s": first["onset"] - at,
            "variable": first["variable"], "causes": first["causes"],
            "cause_is_wrong": bool(first["causes"]) and not truth & set(first["causes"]), "percent": first["percent"], "texts": [finding["text"] for finding in told["findings"]]}


def is_right(row):
    return row["watches"] and row["false"] == 0 and not row["cause_is_wrong"] and (row["fault"] == "none" or row["found"] >= 1)


def show(rows):
    print(f"{'plant':8} {'fault':14} {'seed':>4} {'found':>5} {'false':>5} {'after s':>8} {'onset s':>8}  sentence")
    for row in rows:
        times = f"{row['delay_s']:8.0f} {row['onset_error_s']:+8.0f}" if row["found"] else f"{'-':>8} {'-':>8}"
        print(f"{row['plant']:8} {row['fault']:14} {row['seed']:4} {row['found']:5} {row['false']:5} {times}  {'; '.join(row['texts'])}")
    found = [row for row in rows if row["found"]]
    faults = [row for row in rows if row["fault"] != "none"]
    if found:
        print(f"{len(found)} of {len(faults)} found, {sum(row['false'] for row in rows)} false; median after {median(row['delay_s'] for row in found):.0f} s, "
              f"median onset error {median(abs(row['onset_error_s']) for row in found):.0f} s, one finding only: {sum(row['found'] == 1 for row in found)}, "
              f"cause told: {sum(bool(row['causes']) for row in found)}, wrong: {sum(row['cause_is_wrong'] for row in found)}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--days", type=float, default=4)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.only not in (None, *PLANTS) or options.seeds < 1 or options.days < LEAST_DAYS:
        raise Trouble(f"--only is one of {', '.join(PLANTS)}; --seeds is at least 1, --days at least {LEAST_DAYS}")
    cases = [(name, seed, fault) for name in PLANTS if options.only in (None, name)
             for fault in (None, *PLANTS[name][2]) for seed in range(1, options.seeds + 1)]
    progress = Progress(len(cases))
    rows = []
    for name, seed, fault in cases:
        progress.say(f"{name}, {fault or 'no fault'}, seed {seed}")
        rows.append(measure(name, seed, options.days, fault, (options.days - AFTER_DAYS) * PLANTS[name][1]))
    progress.end()
    print_figures(rows, options.json, show)
    return 0 if all(is_right(row) for row in rows) else 1


if __name__ == "__main__":
    sys.exit(run_command("faults", main, 65))
