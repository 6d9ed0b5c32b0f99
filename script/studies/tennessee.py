"""Disturbs the Tennessee Eastman plant, and looks when the change is found: see the command tennessee, which builds and starts this."""
import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, merge, print_figures, run_command

CONFIG = ROOT / "config" / "tennessee"
HOUR, AFTER_H = 3600, 4
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


def measure(fault, seed, twins, learn):
    """A row for each twin. A finding has the time of its step, which uses later readings: the horizon and the filters see them."""
    at = learn * 5 // 4
    synchronise = shipped("lock")["synchronise"]
    seen = synchronise["horizon"]["prediction"] + max(one.get("condition", {}).get("low_pass_s", 0) for one in synchronise["match"].values())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = play(folder, fault, seed, at, at + AFTER_H * HOUR)
        for twin in twins:
            result = replay(folder, recording, twin, learn)
            after = [finding for finding in result["findings"] if fault != "none" and finding["found"] + seen >= at]
            first = after[0] if after else None
            yield {"fault": fault, "seed": seed, "twin": twin, "lock_percent": result["lock"]["percent"], "found": len(after),
                   "false": len(result["findings"]) - len(after), "delay_s": first and first["found"] + seen - at,
                   "onset_error_s": first and first["onset"] - at, "variable": first and first["variable"],
                   "causes": first["causes"] if first else [], "texts": [finding["text"] for finding in result["findings"]]}


def show_row(row):
    times = f"{row['delay_s']:8.0f} {row['onset_error_s']:+8.0f}" if row["found"] else f"{'-':>8} {'-':>8}"
    sentence = row["texts"][row["false"]] if row["found"] else ""
    print(f"{row['fault']:24} {row['seed']:4} {row['twin']:5} {row['lock_percent']:6.1f} {row['false']:5} {row['found']:5} {times}  "
          f"{sentence}; {', '.join(row['causes'])}", flush=True)


def show_summary(rows):
    for twin in TWINS:
        disturbed = [row for row in rows if row["twin"] == twin and row["fault"] != "none"]
        found = [row for row in disturbed if row["found"]]
        if found:
            print(f"{twin} twin: {len(found)} of {len(disturbed)} found, {sum(row['false'] for row in rows if row['twin'] == twin)} false, "
                  f"median after {median(row['delay_s'] for row in found):.0f} s")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only")
    parser.add_argument("--twin")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--learn", type=int, default=4)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.only not in (None, *FAULTS) or options.twin not in (None, *TWINS) or options.seeds < 1 or options.learn < 1:
        raise Trouble(f"--only is one of {', '.join(FAULTS)}; --twin is right or wrong; --seeds and --learn are at least 1")
    faults = [options.only] if options.only else list(FAULTS)
    progress = Progress(len(faults) * options.seeds)
    rows = []
    if not options.json:
        print(f"{'fault':24} {'seed':>4} {'twin':5} {'lock %':>6} {'false':>5} {'found':>5} {'after s':>8} {'onset s':>8}  sentence; causes")
    for fault, seed in ((fault, seed) for fault in faults for seed in range(1, options.seeds + 1)):
        progress.say(f"{fault}, seed {seed}")
        for row in measure(fault, seed, [options.twin] if options.twin else list(TWINS), options.learn * HOUR):
            rows.append(row)
            if not options.json:
                show_row(row)
    progress.end()
    print_figures(rows, options.json, show_summary)
    return 1 if any(row["false"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(run_command("tennessee", main, 65))
