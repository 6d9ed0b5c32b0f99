#!/usr/bin/env python3
"""Runs the benchmark and prints one table: times, and beside them the instructions that callgrind counts.

usage: bench.py [--build FOLDER] [--times] [--fmpy]

Builds nothing: script/build does. README.md says what the figures mean.
"""
import argparse
import collections
import concurrent.futures
import os
import re
import subprocess
import sys
import tempfile
import venv

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
BUDGET = 20
SMALL_BUDGET = 2
STEPS = {"free": (1000, 3000), "locked": (128, 384), "chain": (64, 64)}  # two runs a case: what they have in common goes
INSIDE = {"floor": ("bench_floor_free", "bench_floor_locked"), "twin": ("bench_twin_run",)}
ALLOCATORS = {"malloc", "calloc", "realloc"}

Count = collections.namedtuple("Count", "instructions allocations evaluations executions")


def read_profile(path):
    """(instructions, calls of an allocator) in a file of callgrind's, where a name is given once: "(12) malloc"."""
    names, called, allocations, total = {}, "", 0, 0
    with open(path, encoding="utf-8") as file:
        for line in file:
            name = re.match(r"c?fn=\((\d+)\)(?: (.*))?", line)
            if name:
                names.setdefault(name[1], name[2])
                called = names[name[1]]
            elif line.startswith("calls=") and called in ALLOCATORS:
                allocations += int(line[6:].split()[0])
            elif line.startswith(("totals:", "summary:")):
                total = int(line.split()[1])
    return total, allocations


def count(program, case, side, steps, budget):
    with tempfile.TemporaryDirectory() as folder:
        profile = os.path.join(folder, "profile")
        inside = [f"--toggle-collect={name}" for name in INSIDE[side]]
        done = subprocess.run(
            ["valgrind", "--quiet", "--tool=callgrind", f"--callgrind-out-file={profile}", *inside, program,
             os.path.dirname(program), "--count", case, side, str(steps), str(budget)],
            stdout=subprocess.PIPE, text=True, check=True)
        words = done.stdout.split()
        return Count(*read_profile(profile), int(words[1]), int(words[3])) if words else None


def difference(job):
    """What the longer run has more of; None for a case the master cannot do."""
    program, case, side = job
    kind = case.split("/")[0]
    budgets = (SMALL_BUDGET, BUDGET) if kind == "chain" else (BUDGET, BUDGET)
    counts = [count(program, case, side, steps, budget) for steps, budget in zip(STEPS[kind], budgets)]
    return None if None in counts else Count(*(more - less for less, more in zip(*counts)))


def count_all(program):
    """{case: (floor, twin)}; a chain has no floor. Van der Pol chains would take long and say nothing new."""
    cases = subprocess.run([program, os.path.dirname(program), "--cases"], stdout=subprocess.PIPE, text=True,
                           check=True).stdout.split()
    jobs = [(program, case, side) for case in cases for side in ("floor", "twin")
            if not case.startswith("chain/van_der_pol") and (side, case[:5]) != ("floor", "chain")]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        counted = dict(zip(jobs, pool.map(difference, jobs)))
    return {case: (counted.get((program, case, "floor")), counted.get((program, case, "twin"))) for case in cases}


def describe(case, floor, twin):
    """The counts of one case, as they stand beside its times."""
    kind, _, variant = case.split("/")
    if twin is None:
        return ""
    if kind == "chain":
        return f"{twin.instructions / twin.executions:9.1f} instructions each"
    steps = STEPS[kind][1] - STEPS[kind][0]
    divisor = steps * int(variant) if kind == "free" else steps
    f, t = floor.instructions / divisor, twin.instructions / divisor
    if kind == "free":
        return f"{f:9.1f} {t:9.1f} instructions, {t - f:.1f} beyond the floor"
    return f"{f:9.0f} {t:9.0f} instructions, ratio {t / f:.2f}, {twin.allocations / steps:g} allocations"


def print_fmpy(program, lines):
    """The same by FMPy and SciPy, in an environment of its own."""
    folder = os.path.join(ROOT, "build", "bench-venv")
    python = os.path.join(folder, "bin", "python")
    if not os.path.exists(os.path.join(folder, ".complete")):
        venv.create(folder, clear=True, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "fmpy", "scipy"], check=True)
        with open(os.path.join(folder, ".complete"), "w", encoding="utf-8"):
            pass
    for model in ("lag", "van_der_pol"):
        fmu = os.path.join(os.path.dirname(program), model + ".fmu")
        output = subprocess.run([python, os.path.join(HERE, "bench_fmpy.py"), fmu], stdout=subprocess.PIPE, text=True,
                                check=True).stdout
        free, locked = map(float, output.split())
        print(f"FMPy {model}: {free:.0f} ns per free component step")
        print(f"FMPy + SciPy {model}: {locked / 1000:.0f} us per synchronised step", end="")
        for line in lines:
            words = line.split()
            if words and words[0].startswith(f"locked/{model}/") and re.match(r"[\d.]+$", words[1]):
                print(f"; {words[0].split('/')[2]} {locked / float(words[3]):.0f} times faster", end="")
        print()


def main():
    parser = argparse.ArgumentParser(description="What the twin costs beyond the FMUs' own work.")
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "host"), help="the build folder")
    parser.add_argument("--times", action="store_true", help="no instruction counts")
    parser.add_argument("--fmpy", action="store_true", help="also FMPy and SciPy; installs them into build/bench-venv")
    arguments = parser.parse_args()
    program = os.path.join(os.path.abspath(arguments.build), "tests", "bench", "bench")
    if not os.access(program, os.X_OK):
        sys.exit(f"bench.py: there is no {program}: run script/build first")
    lines = subprocess.run([program, os.path.dirname(program)], stdout=subprocess.PIPE, text=True,
                           check=True).stdout.splitlines()
    counts = {} if arguments.times else count_all(program)
    for line in lines:
        case = line.split(" ")[0]
        print(f"{line:<80} {describe(case, *counts[case])}".rstrip() if case in counts else line)
    if arguments.fmpy:
        print_fmpy(program, lines)


if __name__ == "__main__":
    main()
