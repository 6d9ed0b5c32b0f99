"""Runs plants for days, and counts findings for each true change: see the command plants, which builds and starts this."""
import argparse
import csv
import json
import math
import random
import subprocess
import sys
import tempfile
from pathlib import Path

from faults import DAY, shipped
from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

PROBE = ROOT / "build" / "host" / "tests" / "change_probe"
NEAR = 1200.0  # s: a finding belongs to a true change if its onset is as near as this
FIRST = 1.7e9  # t_start of the first run, s since 1970 UTC
HOUR = 3600.0


def lag(T, step, start):
    return {"fmu": "lag.fmu", "set": {"T": T, "x_start": start, "t_step": step}}


def document(step, parts, twin_parts, commands, hidden, adjust, outputs, horizon):
    """Plant and twin. `commands`: {name: input}; `hidden`: {name: input}, which the twin does not know.
    `outputs`: {signal: (variable, noise, tolerance)}; a tolerance of None: only compared."""
    head = {"twinlock": 1, "name": "plant", "step_s": step, "recording": {"time_column": "time"}}
    inner = parts.pop("connect", [])
    plant = merge(head, {"components": parts, "plant": {name: {} for name in [*(f"{name}_actual" for name in commands), *commands, *hidden]},
                         "connect": [*([f"plant.{name}_actual", to] for name, to in commands.items()),
                                     *([f"plant.{name}", to] for name, to in hidden.items()), *inner],
                         "emulate": {"columns": {**{name: {"from": f"plant.{name}"} for name in commands},
                                                 **{signal: {"from": variable, "noise": noise} for signal, (variable, noise, _) in outputs.items()}}}})
    matched = {variable: {"to": f"plant.{signal}", **({"tolerance": tolerance} if tolerance else {"weight": 0})}
               for signal, (variable, _, tolerance) in outputs.items()}
    twin = merge(head, {"components": twin_parts, "plant": {name: {"stale_s": 5 * step} for name in [*commands, *outputs]},
                        "connect": [*([f"plant.{name}", to] for name, to in commands.items()), *inner],
                        "synchronise": {"adjust": adjust, "match": matched, "horizon": {"prediction": horizon}, "budget": {"evaluations": 8}}})
    return plant, twin


def vessels():
    parts = {"first": lag(60, 1, 1), "second": lag(40, 1, 1), "connect": [["first.y", "second.u"]]}
    twin = {"first": lag(60, 1, 1), "second": lag(41, 1, 1)}
    return document(1, parts, twin, {"q": "first.u"}, {}, {"first.u": {"step": 0.1, "min": 0, "max": 4}}, {"level": ("second.y", 0.01, 0.03)}, 100)


def board(step, heat, sensed, horizon):
    tclab = {"fmu": "tclab.fmu", "set": {"mCp": heat, "t_step": min(step, 1)}}
    twin = merge(tclab, {"set": {"mCp": 1.02 * heat}})
    temperatures = {"T1": ("board.T1", 0.05, 0.5), "T2": ("board.T2", 0.05, 0.5)}
    adjust = {f"board.{name}": {"step": 20, "min": -400, "max": 500} for name in ("Q1", "Q2")}
    known, hidden = ({"Q1": "board.Q1", "Q2": "board.Q2"}, {"Ta": "board.Ta"})
    if sensed:
        known, hidden = {**known, "Ta": "board.Ta"}, {}
    else:
        twin = merge(twin, {"set": {"Ta": 296.8}})
    return document(step, {"board": tclab}, {"board": twin}, known, hidden, adjust, temperatures, horizon)


def pressure():
    parts = {"valve": {"fmu": "second_order.fmu", "set": {"T": 20, "d": 0.8, "K": 2, "x_start": 2, "t_step": 0.5}}}
    twin = merge(parts, {"valve": {"set": {"T": 21, "K": 2.04}}})
    return document(1, parts, twin, {"u": "valve.u"}, {}, {"valve.u": {"step": 0.1, "min": -1, "max": 5}}, {"p": ("valve.y", 0.02, 0.06)}, 40)


def fan():
    parts = {"motor": {"fmu": "motor.fmu", "set": {"J": 20, "d": 0.5, "omega_start": 20, "T_s": 0.5, "t_step": 0.1}}}
    twin = merge(parts, {"motor": {"set": {"J": 20.5, "M_w": 1}}})
    return document(1, parts, twin, {"I": "motor.I_in"}, {"M": "motor.M_w"}, {"motor.d": {"nominal": 0.5, "step": 0.05, "min": 0, "max": 5}},
                    {"omega": ("motor.omega", 0.1, 0.5)}, 60)


def column():
    parts = {"feed": {"fmu": "second_order.fmu", "set": {"T": 150, "d": 1, "x_start": 1, "t_step": 5}}, "side": lag(400, 10, 1), "top": lag(300, 10, 1)}
    twin = merge(parts, {"feed": {"set": {"T": 155}}, "side": {"set": {"T": 410}}})
    parts["connect"] = [["feed.y", "side.u"]]
    return document(10, parts, twin, {"f": "feed.u", "r": "top.u"}, {}, {"feed.u": {"step": 0.1, "min": 0, "max": 4}, "top.u": {"step": 0.1, "min": 0, "max": 4}},
                    {"flow": ("feed.y", 0.01, 0.03), "level": ("side.y", 0.01, None), "head": ("top.y", 0.01, 0.03)}, 60)


# name: plant; {command: (least, most)}; hidden disturbance: name, mean, swing of a day; sensor that may break, and its offset
PLANTS = {
    "vessels": (vessels, {"q": (0.5, 2.0)}, (), ("level", 0.2)),
    "tclab": (lambda: board(1, 2, False, 30), {"Q1": (20, 70), "Q2": (20, 70)}, ("Ta", 296.8, 2.0), ("T1", 4.0)),
    "oven": (lambda: board(10, 40, True, 60), {"Q1": (20, 70), "Q2": (20, 70)}, ("Ta", 296.8, 4.0), ("T2", 4.0)),
    "pressure": (pressure, {"u": (0.5, 2.0)}, (), ("p", 0.4)),
    "fan": (fan, {"I": (4, 10)}, ("M", 1.0, 0.02), ("omega", 4.0)),
    "column": (column, {"f": (0.5, 2.0), "r": (0.5, 2.0)}, (), ("head", 0.2)),
}


class Diary:
    """What happens to a plant: products, restarts, outages, and one fault or none."""

    def __init__(self, plant, seed, days):
        self.choice = random.Random(f"{plant} {seed}")
        commands = PLANTS[plant][1]
        self.days, self.seed, self.commands = days, seed, commands
        self.new_from = math.floor(days / 4) + 1 + self.choice.uniform(0.3, 0.6)  # day
        sizes = self.choice.sample([-0.10, -0.06, -0.03, 0.03, 0.06, 0.10], 2)
        sizes = [size * self.choice.uniform(0.7, 1.0) for size in sizes]
        self.products = {name: self._product(size) for name, size in zip("ABC", [0.0, *sizes])}
        fault_day = math.floor(days * 0.7) + self.choice.uniform(0.35, 0.7)  # by day
        self.fault = {0: None, 1: (fault_day * DAY, "actuator"), 2: (fault_day * DAY, "sensor")}[seed % 3]
        self.shifts = list(self._plan_shifts())
        self.stops = list(self._plan(0.6, 0.3, 120, 7200))
        self.outages = list(self._plan(0.5, 1.2, 60, 10800))
        self.restarts = [begin for begin, _ in self._plan(0.5, 1.1, 0, 1)]

    def _product(self, size):
        """Range of each command, its gain in the plant, and how long a command is held."""
        ranges = {}
        for name, (least, most) in self.commands.items():
            middle, half = self.choice.uniform(0.3, 0.7), self.choice.uniform(0.1, 0.3)
            ranges[name] = (least + (most - least) * (middle - half), least + (most - least) * (middle + half), 1.0 + size)
        return ranges, self.choice.uniform(300, 1800)

    def _plan_shifts(self):
        """Begin, s, and product: from 6 to 22 o'clock; N is the night."""
        count = 0
        for day in range(math.ceil(self.days)):
            yield day * DAY, "N"
            time = day * DAY + 6 * HOUR
            while time < day * DAY + 22 * HOUR:
                first_day = "AB"[count % 2]  # both products are there while learning
                yield time, first_day if day == 0 else self.choice.choice("ABC" if time >= self.new_from * DAY else "AB")
                count += 1
                time += self.choice.uniform(2, 5) * HOUR
            yield day * DAY + 22 * HOUR, "N"

    def _plan(self, rate, first_day, shortest, longest):
        """Events at random instants, `rate` a day: begin and end, s."""
        time = first_day * DAY
        while (time := time + (0.2 + self.choice.expovariate(rate)) * DAY) < (self.days - 0.1) * DAY:
            length = math.exp(self.choice.uniform(math.log(shortest + 1), math.log(longest + 1)))
            yield time, time + length

    def changes(self):
        """True changes: name, and the instants at which it begins, ends or recurs."""
        found = {}
        if self.fault:
            found["fault"] = [self.fault[0]]
        for (_, before), (begin, product) in zip(self.shifts, self.shifts[1:]):
            if before != product and "C" in (before, product):
                found.setdefault("product", []).append(begin)
        return found

    def instants(self):
        """Rows of the commands: instant, product."""
        ends = [begin for begin, _ in self.shifts[1:]] + [self.days * DAY]
        for (begin, product), end in zip(self.shifts, ends):
            while begin < end:
                yield begin, product
                begin += self.products[product][1] * self.choice.uniform(0.5, 1.5) if product in self.products else 0.25 * HOUR

    def write(self, path, disturbance):
        """Commands, and what the actuators make of them."""
        names = list(self.commands)
        known = disturbance and disturbance[0]
        marks = {time for stop in self.stops for time in stop} | ({self.fault[0]} if self.fault else set())
        rows = sorted([*self.instants(), *((time, None) for time in marks)], key=lambda row: row[0])
        values, gains = {}, {}
        with open(path, "w", encoding="utf-8", newline="") as file:
            out = csv.writer(file)
            out.writerow(["time", *names, *(f"{name}_actual" for name in names), *([known, f"{known}_actual"] if known else [])])
            for time, product in rows:
                if product == "N":
                    values, gains = {name: least + 0.1 * (most - least) for name, (least, most) in self.commands.items()}, dict.fromkeys(names, 1.0)
                elif product:
                    ranges = self.products[product][0]
                    values = {name: self.choice.uniform(*ranges[name][:2]) for name in names}
                    gains = {name: ranges[name][2] for name in names}
                is_off = any(begin <= time < end for begin, end in self.stops)
                breaks = self.fault and self.fault[1] == "actuator" and time >= self.fault[0]
                factor = {name: gains[name] * (0.85 if breaks and name == names[0] else 1.0) for name in names}
                given = {name: 0.0 if is_off else values[name] for name in names}
                swing = [disturbance[1] + disturbance[2] * math.sin(2 * math.pi * time / DAY)] * 2 if known else []
                out.writerow([f"{time:.3f}", *(f"{given[name]:.5g}" for name in names), *(f"{given[name] * factor[name]:.7g}" for name in names), *swing])


class Bench:
    """One plant and its recordings, in a folder."""

    def __init__(self, name, seed, days, folder):
        make, _, disturbance, self.sensor = PLANTS[name]
        self.folder, self.diary = Path(folder), Diary(name, seed, days)
        plant, self.twin = make()
        self.length = days * DAY
        self.diary.write(self.folder / "commands.csv", disturbance)
        plant = merge(plant, {"duration_s": self.length, "recording": {"file": "commands.csv"}})
        subprocess.run([PROGRAM, "plant", self._write("plant.json", plant), "--record", self.folder / "recording.csv", "--seed", str(seed)],
                       check=True, capture_output=True)
        self.begins = [0.0, *self.diary.restarts]

    def _write(self, name, content):
        path = self.folder / name
        path.write_text(json.dumps(content), encoding="utf-8")
        return path

    def _split(self):
        """One recording for each run, without the outages, and with the broken sensor."""
        fault, diary = self.diary.fault, self.diary
        ends = [*self.begins[1:], math.inf]
        with open(self.folder / "recording.csv", encoding="utf-8", newline="") as source:
            rows = csv.reader(source)
            names = next(rows)
            broken = names.index(self.sensor[0])
            row = next(rows, None)
            for i, (begin, end) in enumerate(zip(self.begins, ends)):
                with open(self.folder / f"part{i}.csv", "w", encoding="utf-8", newline="") as target:
                    out = csv.writer(target)
                    out.writerow(names)
                    while row and (time := float(row[0])) < end:
                        if not any(first <= time < last for first, last in diary.outages):
                            if fault and fault[1] == "sensor" and time >= fault[0]:
                                row[broken] = f"{float(row[broken]) + self.sensor[1]:.6f}"
                            out.writerow([f"{time - begin:.3f}", *row[1:]])
                        row = next(rows, None)

    def replay(self):
        """Replays all runs into one database."""
        self._split()
        database = self.folder / "runs.db"
        twin = merge(self.twin, {"detect": {"learn_s": DAY}, "record": {"file": "runs.db", "max_mb": 100000}})
        path = self._write("twin.json", twin)
        for i in range(len(self.begins)):
            run = subprocess.run([PROGRAM, "replay", path, "--recording", self.folder / f"part{i}.csv", "--db", database], capture_output=True, check=False)
            if run.returncode not in (0, NOT_LOCKED):
                raise Trouble(run.stderr.decode().strip())

    def detect(self):
        """Reports of the detector; times in s since the first start."""
        told = subprocess.run([PROBE, self.folder / "twin.json", self.folder / "runs.db", *(f"{FIRST + begin:.3f}" for begin in self.begins)],
                              capture_output=True, check=True).stdout.decode().splitlines()
        if "learning" in told or "damaged" in told:
            raise Trouble(f"{self.folder.name}: {told[-1]}")
        rows = [line.split("\t") for line in told]
        return [{"turn": int(row[0]), "at": float(row[1]) - FIRST, "finding": int(row[2]), "onset": float(row[3]) - FIRST,
                 "size": float(row[4]), "percent": float(row[5]), "text": row[6]} for row in rows]


def judge(name, diary, reports):
    """Counts the findings that belong to each true change, and those that belong to none."""
    changes = diary.changes()
    counts, false = dict.fromkeys(changes, 0), []
    fault = diary.fault[0] if diary.fault else math.inf
    known = set()  # one line for each number, also if it returns
    for report in reports:
        if report["turn"] == 0 and report["finding"] not in known:
            known.add(report["finding"])
            is_product = any(abs(report["onset"] - at) <= NEAR for at in changes.get("product", []))
            if report["onset"] >= fault - NEAR and not (is_product and counts["fault"] > 0):
                counts["fault"] += 1
            elif is_product:
                counts["product"] += 1
            else:
                false.append(report["text"])
    return {"plant": name, "seed": diary.seed, "changes": len(changes), "findings": sum(counts.values()) + len(false), "false": len(false),
            "repeated": sum(max(count - 1, 0) for count in counts.values()), "missed": int(counts.get("fault") == 0),
            "unseen_product": int(counts.get("product") == 0), "false_texts": false}


def measure(name, seed, days):
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(name, seed, days, folder)
        bench.replay()
        return judge(name, bench.diary, bench.detect())


def show(rows):
    keys = ("changes", "findings", "false", "repeated", "missed", "unseen_product")
    print(f"{'plant':9} {'seed':>4}", *(f"{key:>14}" for key in keys))
    for row in rows:
        print(f"{row['plant']:9} {row['seed']:4}", *(f"{row[key]:14}" for key in keys), "; ".join(row["false_texts"]))
    print(f"{'all':9} {len(rows):4}", *(f"{sum(row[key] for row in rows):14}" for key in keys))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--from", type=int, default=1, dest="first")
    parser.add_argument("--days", type=float, default=10)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.only not in (None, *PLANTS) or options.seeds < 1 or options.days < 3:
        raise Trouble(f"--only is one of {', '.join(PLANTS)}; --seeds is at least 1, --days at least 3")
    cases = [(name, seed) for seed in range(options.first, options.first + options.seeds) for name in PLANTS if options.only in (None, name)]
    progress, rows = Progress(len(cases)), []
    for name, seed in cases:
        progress.say(f"{name}, seed {seed}")
        rows.append(measure(name, seed, options.days))
    progress.end()
    print_figures(rows, options.json, show)
    return int(any(row["false"] or row["repeated"] or row["missed"] for row in rows))


if __name__ == "__main__":
    sys.exit(run_command("plants", main, 65))
