"""Disturbs the Tennessee Eastman plant, and looks when the change is found, beside PCA: see the command tennessee, which starts this."""
import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

CONFIG = ROOT / "config" / "tennessee"
HOUR, AFTER_H, QUIET_H = 3600, 3, 42
TRAINING_H, MEAN_S, IN_A_ROW = 50, 60, 6  # of PCA; six in a row: Russell, Chiang, Braatz (2000)
TWINS = {"right": {}, "wrong": {"reaction_factor": 1.02, "outflow_factor": 0.97, "reactor_UA_factor": 0.97, "condenser_UA_factor": 0.97}}
SENSORS = {"reactor_T": (9, 0.5), "reactor_p": (7, 5), "reactor_level": (8, 2), "separator_level": (12, 3), "reactor_cooling_outlet_T": (21, 0.5)}
FAULTS = {"none": {}, **{f"IDV{i}": {f"IDV{i}": 1} for i in range(1, 21)},
          **{sensor: {"faulty_sensor": number, "fault_offset": offset} for sensor, (number, offset) in SENSORS.items()}}


def shipped(name):
    return json.loads((CONFIG / f"{name}.json").read_text(encoding="utf-8"))


def call(arguments, codes):
    done = subprocess.run([PROGRAM, *arguments], capture_output=True, check=False)
    if done.returncode not in codes:
        raise Trouble(done.stderr.decode().strip())
    return done.stdout


def play(folder, fault, seed, at, end):
    """Plays the plant with one fault from `at` to `end` (s); returns its recording."""
    plant = merge(shipped("plant"), {"duration_s": end, "recording": {"file": "schedule.csv"}, "components": {"process": {"set": {"seed": seed}}}})
    normal = {name: int(name == "fault_gain") for name in plant["plant"]}
    with open(folder / "schedule.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time", *normal])
        rows.writerow([0, *normal.values()])
        rows.writerows([time, *{**normal, **FAULTS[fault]}.values()] for time in (at, end))
    (folder / "plant.json").write_text(json.dumps(plant), encoding="utf-8")
    call(["plant", folder / "plant.json", "--record", folder / "recording.csv"], (0,))
    return folder / "recording.csv"


def replay(folder, recording, twin, learn):
    lock = merge(shipped("lock"), {"components": {"process": {"set": TWINS[twin]}}, "detect": {"learn_s": learn}})
    (folder / "lock.json").write_text(json.dumps(lock), encoding="utf-8")
    return json.loads(call(["replay", folder / "lock.json", "--recording", recording, "--json"], (0, NOT_LOCKED)))


def load_means(recording):
    """Times and means of all columns."""
    rows = np.loadtxt(recording, delimiter=",", skiprows=1)
    rows = rows[:len(rows) // MEAN_S * MEAN_S].reshape(-1, MEAN_S, rows.shape[1])
    return rows[:, -1, 0], rows[:, :, 1:].mean(axis=1)


class Pca:
    """Principal components whose variance exceeds that of noise, and the limits that 1 % of a quiet recording exceeds."""

    def __init__(self, recording):
        time, values = load_means(recording)
        values = values[time > HOUR]
        self.mean, self.deviation = values.mean(axis=0), values.std(axis=0)
        variances, directions = np.linalg.eigh(np.cov((values - self.mean) / self.deviation, rowvar=False))
        kept = variances > (1 + (values.shape[1] / len(values))**0.5)**2
        self.variances, self.directions = variances[kept], directions[:, kept]
        self.limits = {name: np.quantile(value, 0.99) for name, value in self.statistics(values).items()}

    def statistics(self, values):
        scaled = (values - self.mean) / self.deviation
        scores = scaled @ self.directions
        return {"T2": (scores**2 / self.variances).sum(axis=1), "SPE": ((scaled - scores @ self.directions.T)**2).sum(axis=1)}

    def measure(self, recording, learn, at):
        time, values = load_means(recording)
        for name, value in self.statistics(values).items():
            alarm = np.convolve(value > self.limits[name], np.ones(IN_A_ROW))[:len(time)] > IN_A_ROW - 0.5
            rises = time[alarm & ~np.append(False, alarm[:-1])]
            after = rises[rises >= at]
            yield name, int(((rises >= learn) & (rises < at)).sum()), [float(rise - at) for rise in after]


def is_right_or_open(fault, causes):
    """True if the cause is not known yet, or the set of causes holds the true one."""
    return not causes or (f"plant.{fault}" in causes if fault in SENSORS else bool({"plant", "input"} & set(causes)))


def measure(fault, seed, twins, learn, pca):
    """A row for each twin and each statistic. A finding has the time of its step, which uses later readings: the horizon and the
    filters see them."""
    at = learn + HOUR
    synchronise = shipped("lock")["synchronise"]
    seen = synchronise["horizon"]["prediction"] + max(one.get("condition", {}).get("low_pass_s", 0) for one in synchronise["match"].values())
    end = at + (QUIET_H if fault == "none" else AFTER_H) * HOUR
    row = {"fault": fault, "seed": seed, "quiet_h": ((end if fault == "none" else at) - learn) / HOUR}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = play(folder, fault, 100 * list(FAULTS).index(fault) + seed, at, end)
        for statistic, false, delays in pca.measure(recording, learn, end if fault == "none" else at):
            yield {**row, "by": statistic, "found": len(delays), "false": false, "delay_s": delays[0] if delays else None}
        for twin in twins:
            result = replay(folder, recording, twin, learn)
            after = [finding for finding in result["findings"] if fault != "none" and finding["found"] + seen >= at]
            first = after[0] if after else None
            yield {**row, "by": twin, "lock_percent": result["lock"]["percent"], "found": len(after),
                   "false": len(result["findings"]) - len(after), "delay_s": first and first["found"] + seen - at,
                   "onset_error_s": first and first["onset"] - at, "variable": first and first["variable"],
                   "causes": first["causes"] if first else [], "texts": [finding["text"] for finding in result["findings"]]}


def show_row(row):
    delay = f"{row['delay_s']:8.0f}" if row["found"] else f"{'-':>8}"
    onset = f"{row['onset_error_s']:+8.0f}" if row["found"] and row["by"] in TWINS else f"{'-':>8}"
    sentence = f"{row['texts'][row['false']]}; {', '.join(row['causes'])}" if row["found"] and row["by"] in TWINS else ""
    print(f"{row['fault']:24} {row['seed']:4} {row['by']:5} {row['false']:5} {row['found']:5} {delay} {onset}  {sentence}", flush=True)


def show_summary(rows):
    for by in (*TWINS, "T2", "SPE"):
        mine = [row for row in rows if row["by"] == by]
        for kind, faults in (("disturbances", [fault for fault in FAULTS if fault.startswith("IDV")]), ("sensors", SENSORS)):
            disturbed = [row for row in mine if row["fault"] in faults]
            found = [row for row in disturbed if row["found"]]
            if found:
                causes = [is_right_or_open(row["fault"], row["causes"]) for row in found if by in TWINS]
                print(f"{by:5} {kind:12}: {len(found)} of {len(disturbed)} found, median after {median(row['delay_s'] for row in found):.0f} s"
                      + (f", cause right or open {sum(causes)} of {len(causes)}" if causes else ""))
        if mine:
            print(f"{by:5} quiet       : {sum(row['false'] for row in mine)} false in {sum(row['quiet_h'] for row in mine):.0f} h")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--twin")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--learn", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.only not in (None, *FAULTS) or options.twin not in (None, *TWINS) or options.seeds < 1 or options.learn < 1:
        raise Trouble(f"--only is one of {', '.join(FAULTS)}; --twin is right or wrong; --seeds and --learn are at least 1")
    faults = [options.only] if options.only else list(FAULTS)
    progress = Progress(len(faults) * options.seeds)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        pca = Pca(play(Path(folder), "none", 99, HOUR, TRAINING_H * HOUR))
    if not options.json:
        print(f"{'fault':24} {'seed':>4} {'by':5} {'false':>5} {'found':>5} {'after s':>8} {'onset s':>8}  sentence; causes")
    for fault, seed in ((fault, seed) for fault in faults for seed in range(1, options.seeds + 1)):
        progress.say(f"{fault}, seed {seed}")
        for row in measure(fault, seed, [options.twin] if options.twin else list(TWINS), options.learn * HOUR, pca):
            rows.append(row)
            if not options.json:
                show_row(row)
    progress.end()
    print_figures(rows, options.json, show_summary)
    return 1 if any(row["false"] for row in rows if row["by"] in TWINS) else 0


if __name__ == "__main__":
    sys.exit(run_command("tennessee", main, 65))
