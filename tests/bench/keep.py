#!/usr/bin/env python3
"""Whether "keep": "auto" chooses well: processor time of a step with auto, as a part of the better of "states" and "none".

usage: keep.py [--build FOLDER] [--part N/M] [--rounds R]

Run script/build first. Components in a chain: 5 costs of a step, 4 sizes of a state, 4 K, 4 T_P, 2 solvers, 2 shapes. The three
settings alternate, and the least time of each counts. The last line has the share of cases within 1.05, and the worst case.
"""
import argparse
import itertools
import json
import math
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORKS = (0, 50, 500, 5000, 50000)  # operations of a step, about 2 ns each
SIZES = (1, 16, 1024, 2048)  # KiB
KEEPS = ("states", "none", "auto")
GRID = list(itertools.product(WORKS, SIZES, (1, 2, 4, 8), (1, 2, 5, 20), ("secant", "nelder-mead"), ("static", "dynamic")))


def write_case(folder, build, case, keep):
    work, size, count, prediction, solver, shape = case
    fmu = str(build / "tests" / "bench" / f"sized_{size}.fmu")
    document = {"twinlock": 1, "name": "keep", "step_s": 0.01,
                "components": {f"c{i}": {"fmu": fmu, "keep": keep, "set": {"work": work}} for i in range(count)},
                "plant": {"m": {"csv": {"column": "m"}}}, "connect": [[f"c{i}.y", f"c{i + 1}.u"] for i in range(count - 1)],
                "synchronise": {"adjust": {"c0.u": {"nominal": 0, "step": 0.1, "min": -1e6, "max": 1e6}},
                                "match": {f"c{count - 1}.y": {"to": "plant.m", "tolerance": 1e-6}},
                                "horizon": {"prediction": max(prediction, count), "shape": shape},
                                "algorithm": solver, "budget": {"evaluations": 20}}}
    path = folder / f"{keep}.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def write_recording(folder, steps):
    path = folder / f"{steps}.csv"
    path.write_text("time,m\n" + "".join(f"{i * 0.01:.2f},{math.sin(i * 0.1)}\n" for i in range(steps + 1)), encoding="utf-8")
    return path


def measure(folder, build, case, rounds):
    """Processor time of a step in µs, by keep. A first run chooses the number of steps, so that a run takes about 0.1 s."""
    paths = {keep: write_case(folder, build, case, keep) for keep in KEEPS}

    def run(keep, steps):
        command = [str(build / "tests" / "bench" / "bench_replay"), str(paths[keep]), str(write_recording(folder, steps))]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[1]) / 1000
    steps = int(min(5000, max(20, 1e5 / max(run(keep, 20) for keep in KEEPS))))
    found = {keep: [] for keep in KEEPS}
    for _ in range(rounds):
        for keep in KEEPS:
            found[keep].append(run(keep, steps))
    return {keep: min(times) for keep, times in found.items()}


def main():
    parser = argparse.ArgumentParser(description="The choice of \"keep\": \"auto\" against both others.")
    parser.add_argument("--build", default=str(ROOT / "build" / "host"), help="default: build/host")
    parser.add_argument("--part", default="0/1", help="every M-th case, from number N on; default: all")
    parser.add_argument("--rounds", type=int, default=2, help="default 2")
    options = parser.parse_args()
    build = Path(options.build).resolve()
    first, stride = map(int, options.part.split("/"))
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        for case in GRID[first::stride]:
            found = measure(Path(name), build, case, options.rounds)
            ratios.append(found["auto"] / min(found["states"], found["none"]))
            times = "  ".join(f"{keep} {found[keep]:9.2f}" for keep in KEEPS)
            print(f"work {case[0]:5} KiB {case[1]:4} K {case[2]} T_P {case[3]:2} {case[4]:11} {case[5]:7}  {times} us  auto {ratios[-1]:.2f}", flush=True)
    good = sum(ratio <= 1.05 for ratio in ratios)
    print(f"{len(ratios)} cases: {100 * good / len(ratios):.1f} % within 1.05, worst {max(ratios):.2f}")


main()
