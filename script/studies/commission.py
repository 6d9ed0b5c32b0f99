"""Commissions twins of plants with one parameter off: see the command commission, which builds and starts this."""
import argparse
import csv
import json
import os
import random
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mean

from study import NOT_LOCKED, PROGRAM, Progress, Trouble, merge, print_figures, run_command

OFF, TRIALS, MOST, WANTED = 3.0, 24, 60, 100.0


@dataclass
class Plant:
    fmu: str  # of the twin
    step_s: float
    seconds: float  # of each recording
    commands: list  # signals from outside
    draw: Callable  # of a random choice: (time until the next commands, the commands)
    connect: list
    measured: dict  # signal: (variable, noise)
    parameters: dict  # those that are off, with the value that the FMU has
    limits: dict  # what an engineer knows of an input: min and max of `adjust`
    others: dict = field(default_factory=dict)  # further components of the plant
    constants: dict = field(default_factory=dict)  # inputs of the FMU without a signal, as they start

    def write_commands(self, path, seed):
        choice, at = random.Random(f"{self.fmu} {seed}"), 0.0
        with open(path, "w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["time", *self.commands])
            while at < self.seconds + self.step_s:
                hold, values = self.draw(choice)
                rows.writerow([f"{at:.3f}", *(f"{value:.4g}" for value in values)])
                at += hold

    def limits_of(self, variable):
        """A parameter is between a tenth and ten times what was assumed."""
        start = self.parameters.get(variable.partition(".")[2], 0.0)
        return self.limits.get(variable, (start / 10, start * 10))

    def document(self, parameter, noisy):
        """The plant for `twinlock plant`; without noise its outputs are the true ones."""
        columns = {name: {"from": variable, **({"noise": noise} if noisy and noise else {})} for name, (variable, noise) in self.measured.items()}
        return {"twinlock": 1, "name": f"{self.fmu}, {parameter} off", "step_s": self.step_s, "duration_s": self.seconds,
                "components": {self.fmu: {"fmu": f"{self.fmu}.fmu", "set": {**self.constants, parameter: OFF * self.parameters[parameter]}}, **self.others},
                "plant": {name: {} for name in self.commands}, "recording": {"file": "commands.csv", "time_column": "time"},
                "connect": self.connect, "emulate": {"columns": columns}}


PLANTS = {
    # Its drive is part of the plant; the inverter shows the demanded current.
    "motor": Plant("motor", 0.01, 60, ["torque"], lambda choice: (choice.uniform(0.5, 3.0), [choice.choice((0.0, choice.uniform(0.0, 1.3)))]),
                   [["plant.torque", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"]],
                   {"M_w": ("plant.torque", 0.0), "I_in": ("drive.u_R", 0.001), "omega": ("motor.omega", 0.3)},
                   {"d": 0.0031, "J": 0.0015, "R_r": 2, "Psi_ref": 0.5}, {"motor.I_in": (-40, 40), "motor.M_w": (-20, 20)},
                   others={"drive": {"fmu": "drive.fmu", "set": {"ref": 10}}}),
    "tank": Plant("tank", 0.1, 600, ["pump"], lambda choice: (choice.uniform(5, 30), [choice.uniform(30, 70)]),
                  [["plant.pump", "tank.pump"]], {"pump": ("plant.pump", 0.0), "level": ("tank.level", 0.001)},
                  {"pump_flow": 1e-6, "outlet": 2.5e-5, "area": 2e-3}, {"tank.pump": (0, 100)}),
    "tclab": Plant("tclab", 1, 1800, ["Q1", "Q2"], lambda choice: (choice.uniform(60, 300), [choice.uniform(0, 60), choice.uniform(0, 60)]),
                   [["plant.Q1", "tclab.Q1"], ["plant.Q2", "tclab.Q2"]],
                   {"Q1": ("plant.Q1", 0.0), "Q2": ("plant.Q2", 0.0), "T1": ("tclab.T1", 0.05), "T2": ("tclab.T2", 0.05)},
                   {"mCp": 2, "U": 5.117, "alpha1": 6.388e-3, "alpha2": 3.264e-3, "U_s": 4.414, "tau": 16.33},
                   {"tclab.Q1": (0, 100), "tclab.Q2": (0, 100), "tclab.Ta": (273, 323)}, constants={"Ta": 296.8}),
}


def free_port():
    with closing(socket.socket()) as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Site:
    """Folder of a plant and its twin. Counts the time of the commands that an engineer would type."""

    def __init__(self, plant, parameter, folder, seed, verbose):
        self.plant, self.parameter, self.folder, self.seed, self.verbose = plant, parameter, Path(folder), seed, verbose
        self.minutes, self.commands = 0.0, []

    def write(self, name, document):
        path = self.folder / name
        path.write_text(json.dumps(document, indent=1), encoding="utf-8")
        return name

    def run(self, *args, codes=(0,)):
        done = subprocess.run([PROGRAM, *map(str, args)], cwd=self.folder, capture_output=True, text=True, check=False)
        if done.returncode not in codes:
            raise Trouble(f"twinlock {' '.join(map(str, args))}: ended with {done.returncode}\n{done.stderr.strip()[-2000:]}")
        return done.stdout

    def type(self, *args, codes=(0,)):
        """A command of the commissioning."""
        began = time.monotonic()
        out = self.run(*args, codes=codes)
        self.minutes += (time.monotonic() - began) / 60
        self.commands.append("twinlock " + " ".join(map(str, args)))
        if self.verbose:
            print(f"$ {self.commands[-1]}\n{out}", file=sys.stderr)
        return out

    def record(self, name, seed, noisy=True):
        self.plant.write_commands(self.folder / "commands.csv", f"{self.seed} {seed}")
        self.write("plant.json", self.plant.document(self.parameter, noisy))
        self.run("plant", "plant.json", "--record", name, "--seed", seed)

    @contextmanager
    def device(self):
        with open(self.folder / "plant.log", "w+", encoding="utf-8") as log, \
                subprocess.Popen([PROGRAM, "plant", "plant.json", "--for", "twin.json"], cwd=self.folder, stderr=log) as served:
            try:
                until = time.monotonic() + 60
                while "by Modbus TCP" not in (self.folder / "plant.log").read_text(encoding="utf-8"):
                    if served.poll() is not None or time.monotonic() > until:
                        raise Trouble("the plant is not served: " + (self.folder / "plant.log").read_text(encoding="utf-8"))
                    time.sleep(0.05)
                yield
            finally:
                served.kill()

    def fill_in(self, name):
        """Fills in what an engineer knows: addresses are as `init` has written them, inputs without a signal keep their start value, and
        what is adjusted has the limits of its plant. Returns the places."""
        document = json.loads((self.folder / name).read_text(encoding="utf-8"))
        places = sorted(document.pop("fill_in", {}))
        for place in places:
            variable = place.removeprefix("synchronise.adjust.")
            if variable != place:
                least, most = self.plant.limits_of(variable)
                document["synchronise"]["adjust"][variable].update(min=least, max=most)
        self.write(name, document)
        return places

    def replay(self, document):
        """{signal: (MSE at the readings, true MSE)} of another recording."""
        self.write("judged.json", document)
        self.run("replay", "judged.json", "--recording", "tuesday.csv", "--csv", "steps.csv", codes=(0, NOT_LOCKED))
        with open(self.folder / "steps.csv", encoding="utf-8", newline="") as steps:
            found = list(csv.DictReader(steps))
        errors = {}
        part = document.get("synchronise", {}).get("match") or document["compare"]
        for variable, match in part.items():
            signal = match["to"].removeprefix("plant.")
            errors[signal] = [mean_square({self.step_of(row): float(row[f"{variable} simulated"]) for row in found}, self.read(name, signal)) for name in ("tuesday.csv", "true.csv")]
        return errors

    def step_of(self, row):
        return round(float(row["time"]) / self.plant.step_s)

    def read(self, name, column):
        with open(self.folder / name, encoding="utf-8", newline="") as file:
            return {self.step_of(row): float(row[column]) for row in csv.DictReader(file)}

    def commission(self):
        self.record("monday.csv", 1)
        page = self.type("init", f"{self.plant.fmu}.fmu", "--recording", "monday.csv", "--step", self.plant.step_s, "--modbus",
                  f"127.0.0.1:{free_port()}", "--output", "twin.json")
        filled = self.fill_in("twin.json")
        given = json.loads((self.folder / "twin.json").read_text(encoding="utf-8"))
        with self.device():
            self.type("probe", "twin.json", "--duration", max(2, 4 * self.plant.step_s))
        more = [name for name in re.findall(r"^  (\S+) by \S+ moves (?!no )", page, re.M) if name not in given["synchronise"]["adjust"]]
        self.type("tune", "twin.json", "--recording", "monday.csv", "--variables", ",".join(more), "--executions", MOST, "--trials", TRIALS,
                  "--seed", self.seed, "--output", "tuned.json")
        return filled + self.fill_in("tuned.json")

    def judge(self):
        self.record("true.csv", 2, noisy=False)
        self.record("tuesday.csv", 2)
        document = json.loads((self.folder / "tuned.json").read_text(encoding="utf-8"))
        document.pop("record", None)
        alone = merge(document, {"compare": {variable: {"to": match["to"]} for variable, match in document["synchronise"]["match"].items()}})
        alone.pop("synchronise")
        alone["components"][self.plant.fmu]["set"] = {**self.plant.constants, **alone["components"][self.plant.fmu].get("set", {})}
        return list(document["synchronise"]["adjust"]), self.replay(document), self.replay(alone)


def mean_square(simulated, wanted):
    return mean((value - wanted[step]) ** 2 for step, value in simulated.items() if step in wanted)


def total(errors, which):
    """All matched signals of a plant have one unit."""
    return sum(one[which] for one in errors.values())


def measure(plant, parameter, seed, verbose):
    with tempfile.TemporaryDirectory() as folder:
        site = Site(plant, parameter, folder, seed, verbose)
        filled = site.commission()
        adjusted, locked, alone = site.judge()
    ratio = [total(alone, which) / total(locked, which) for which in (0, 1)]
    noise = sum(plant.measured[signal][1] ** 2 for signal in alone)
    return {"commands": site.commands, "filled_in": filled, "minutes": site.minutes, "adjusted": adjusted, "locked": locked, "alone": alone,
            "ratio_readings": ratio[0], "ratio_true": ratio[1], "possible": total(alone, 0) >= WANTED * noise, "reached": min(ratio) >= WANTED}


def show(results):
    print(f"{'':18}{'adjusted':34}{'min':>5}{'MSE of readings':>24}{'ratio':>9}{'true MSE':>24}{'ratio':>9}")
    for name, row in results.items():
        print(f"{name:18}{' '.join(row['adjusted']):34}{row['minutes']:5.1f}", end="")
        for which, ratio in ((0, "ratio_readings"), (1, "ratio_true")):
            print(f"{total(row['alone'], which):12.3g} -> {total(row['locked'], which):<8.3g}{row[ratio]:9.3g}", end="")
        print("" if row["reached"] else "  TOO LITTLE" if row["possible"] else "  (within the noise)")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    cases = [(name, parameter) for name, plant in PLANTS.items() for parameter in plant.parameters if options.only in (None, name, f"{name}.{parameter}")]
    if not cases:
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(PLANTS)}, or as motor.J")
    os.environ["TWINLOCK_FMU_PATH"] = str(Path(PROGRAM).parent.parent / "fmus")
    progress, results = Progress(len(cases)), {}
    try:
        for name, parameter in cases:
            progress.say(f"{name}.{parameter}")
            results[f"{name}.{parameter}"] = measure(PLANTS[name], parameter, options.seed, options.verbose)
    finally:
        progress.end()
    print_figures(results, options.json, show)
    return int(not all(row["reached"] for row in results.values() if row["possible"]))


if __name__ == "__main__":
    sys.exit(run_command("commission", main, 65))
