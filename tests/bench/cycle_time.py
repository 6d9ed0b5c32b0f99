#!/usr/bin/env python3
"""What a cycle costs on a small box, on paper: instructions counted on x86 and on ARMv7, and from them the time on a Cortex-A8.

usage: cycle_time.py [--build FOLDER] [--arm FOLDER]

Replays the motor bench for two lengths and takes the difference, so that start and end drop out: on x86 under callgrind, and the
ARM program under qemu-arm with a plugin that counts floating-point operations apart (count_arm.c). Builds nothing: script/build and
script/build armhf do. board/wago-pfc200/README.md says what follows from the table.
"""
import argparse
import collections
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
DURATIONS = 4.0, 12.0  # s of the plant
STEP = 0.01
BUDGET = 40  # evaluations that config/motor allows a step

# A Cortex-A8 at 600 MHz. Operations on doubles are ARM's figures for its VFPLite, at their longest (Technical Reference Manual,
# section 16.7; normal numbers); the rest is an assumption: two cycles an instruction, and twenty for a status that is waited for.
HERTZ = 600e6
CYCLES = {"ordinary": 2, "add": 10, "multiply": 17, "accumulate": 26, "divide": 65, "other": 10, "status": 20}

Case = collections.namedtuple("Case", "name config changes recorded")
CASES = (
    Case("free run", "free.json", {}, False),
    Case("locked by secant", "lock.json", {}, False),
    Case("locked by Nelder-Mead", "lock.json", {"algorithm": "nelder-mead"}, False),
    Case("locked by secant, recorded", "lock.json", {}, True),
)


def write_config(case, duration, folder):
    source = ROOT / "config" / "motor"
    document = json.loads((source / case.config).read_text(encoding="utf-8"))
    document["duration_s"] = duration
    document["recording"]["file"] = str(source / document["recording"]["file"])
    document.get("synchronise", {}).update(case.changes)
    path = Path(folder) / "config.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def run(before, build, case, duration, folder):
    """(stderr, what --json told) of one replay."""
    database = ["--db", Path(folder) / "run.db"] if case.recorded else []
    command = [*before, build / "bin" / "twinlock", "replay", write_config(case, duration, folder), "--json", *database]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False,
                          env={**os.environ, "TWINLOCK_FMU_PATH": str(build / "fmus")})
    if done.returncode != 0:
        sys.exit(f"cycle_time.py: {' '.join(map(str, command))} ended with {done.returncode}\n{done.stderr}")
    return done.stderr, json.loads(done.stdout)


def count_x86(build, case, duration):
    with tempfile.TemporaryDirectory() as folder:
        said, told = run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/profile"], build, case, duration, folder)
        return {"instructions": int(re.search(r"Collected : (\d+)", said)[1])}, told


def count_arm(build, plugin, case, duration):
    with tempfile.TemporaryDirectory() as folder:
        said, told = run(["qemu-arm", "-cpu", "cortex-a8", "-plugin", plugin, "-L", ROOT / ".deps" / "sysroot" / "armhf"], build, case,
                         duration, folder)
        words = re.search(r"^instructions .*$", said, re.M)[0].split()
        return dict(zip(words[::2], map(int, words[1::2]))), told


def per_step(count, case):
    """Counts of one step on average, and its evaluations."""
    (less, told_less), (more, told_more) = (count(case, duration) for duration in DURATIONS)
    steps = told_more["steps"] - told_less["steps"]
    counts = {name: (more[name] - less[name]) / steps for name in more}
    return counts, (told_more["evaluations"] - told_less["evaluations"]) / steps


def cycles(counts):
    apart = sum(counts[name] for name in CYCLES if name != "ordinary")
    return CYCLES["ordinary"] * (counts["instructions"] - apart) + sum(
        CYCLES[name] * counts[name] for name in CYCLES if name != "ordinary")


def build_plugin(folder):
    plugin = Path(folder) / "count_arm.so"
    subprocess.run(["gcc", "-std=c99", "-O2", "-shared", "-fPIC", HERE / "count_arm.c", "-o", plugin], check=True)
    return plugin


def measure(arguments, plugin):
    """{name: (x86, arm, evaluations)}"""
    found = {}
    for case in CASES:
        x86, evaluations = per_step(lambda case, duration: count_x86(arguments.build, case, duration), case)
        arm, _ = per_step(lambda case, duration: count_arm(arguments.arm, plugin, case, duration), case)
        found[case.name] = x86, arm, evaluations
    return found


def microseconds(counts):
    return cycles(counts) / HERTZ * 1e6


def scaled(free, searched, evaluations):
    """A step that evaluates as often as it may: the search's part, that many times."""
    return {name: free[name] + (searched[name] - free[name]) / evaluations * BUDGET for name in free}


def print_table(found):
    print(f"{'per step, motor bench, 3 components':<36}{'evaluations':>12}{'x86':>10}{'ARMv7':>10}{'ratio':>7}{'doubles':>9}"
          f"{'cycles':>10}{'at 600 MHz':>12}")
    rows = [(name, *figures) for name, figures in found.items()]
    free = found["free run"]
    for name in ("locked by secant", "locked by Nelder-Mead"):
        x86, arm, evaluations = found[name]
        worst = [scaled(base, counts, evaluations) for base, counts in zip(free, (x86, arm))]
        rows.append((f"{name}, {BUDGET} evaluations", *worst, BUDGET))
    for name, x86, arm, evaluations in rows:
        doubles = sum(arm[kind] for kind in CYCLES if kind not in ("ordinary", "status"))
        print(f"{name:<36}{evaluations:12.2f}{x86['instructions']:10.0f}{arm['instructions']:10.0f}"
              f"{arm['instructions'] / x86['instructions']:7.2f}{doubles:9.0f}{cycles(arm):10.0f}{microseconds(arm):9.0f} us")


def main():
    parser = argparse.ArgumentParser(description="What a cycle costs on a small box, on paper.")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "host", help="the build folder for this machine")
    parser.add_argument("--arm", type=Path, default=ROOT / "build" / "armhf", help="the build folder for ARMv7")
    arguments = parser.parse_args()
    for build, how in ((arguments.build, "script/build"), (arguments.arm, "script/build armhf")):
        if not (build / "bin" / "twinlock").exists():
            sys.exit(f"cycle_time.py: there is no {build}/bin/twinlock: run {how} first")
    for tool in ("valgrind", "qemu-arm", "gcc"):
        if shutil.which(tool) is None:
            sys.exit(f"cycle_time.py: there is no {tool}: install it (qemu-arm is in Debian's qemu-user)")
    with tempfile.TemporaryDirectory() as folder:
        print_table(measure(arguments, build_plugin(folder)))


main()
