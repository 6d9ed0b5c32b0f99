#!/usr/bin/env python3
"""What it costs to save an FMU, to lead it back, and to step after that, by each rung: for states of several sizes, and for the cylinder's whole lock.

usage: rollback.py [--build FOLDER] [--pages N]

Run script/build first. Builds only the FMU (tests/fmu/sized), with the machine's compiler. README.md says what the figures mean.
"""
import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
SIZES = {"1 kB": 1000, "16 kB": 16000, "1 MB": 1000000, "50 MB": 50000000}
WAYS = ("state", "memory")


def lock_table():
    """The shipped lock of the cylinder, each of its FMUs by that rung."""
    from twinlock_test import NOT_LOCKED, edited_config, read_config, run_well  # pylint: disable=import-outside-toplevel
    name = "cylinder/lock.json"
    print("\n| the cylinder's lock, each FMU by | time of the replay over the plant's |\n| --- | --- |")
    for way in WAYS:
        config = edited_config(name, {"components": {component: {"rollback": way} for component in read_config(name)["components"]}})
        told = json.loads(run_well(["replay", config, "--json"], wells=(0, NOT_LOCKED)))
        print(f"| {way} | {told['wall_s'] / (told['steps'] * read_config(name)['step_s']):.3f} |")


def main():
    parser = argparse.ArgumentParser(description="What saving, restoring and the step after it cost, by each rung.")
    parser.add_argument("--build", default=str(ROOT / "build" / "host"), help="default: build/host")
    parser.add_argument("--pages", type=int, default=2, help="that a step writes; default 2")
    options = parser.parse_args()
    probe = Path(options.build) / "tests" / "fmu" / "rollback_probe"
    os.environ.update(TL_SOURCE=str(ROOT), TL_BUILD=options.build, TWINLOCK=str(Path(options.build) / "bin" / "twinlock"))
    import sized_fmu  # pylint: disable=import-outside-toplevel
    print("| state | by | save, µs | restore, µs | step after it, µs |\n| --- | --- | --- | --- | --- |")
    for name, size in SIZES.items():
        fmu = sized_fmu.make(size, options.pages)
        for way in WAYS:
            done = subprocess.run([str(probe), str(fmu), way, "0.01", "130"], capture_output=True, text=True, check=True)
            found = json.loads(done.stdout)
            if found["way"] != way or found["differs"] is not None or found["error"] is not None:
                print(f"| {name} | {way} | not here: {found['error'] or found['way']} | | |")
                continue
            print(f"| {name} | {way} | {found['save_us']:.3g} | {found['restore_us']:.3g} | {found['step_us']:.3g} |")
    lock_table()


main()
