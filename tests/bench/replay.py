#!/usr/bin/env python3
"""What it costs that a replay's FMUs are in a process of their own: ratios to the same replay with them in one process.

usage: replay.py [--build FOLDER] [--rows N] [--rounds N] [--costs]

Builds nothing: script/build does. README.md says what the figures mean.
"""
import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
CASES = ("free", "lock")
STEP_S, FMUS = 0.01, 2
INNER_STEPS = 10, 40, 130, 440  # in a step of each FMU; 10 are what they have without being told


def lengthen(source, target, rows):
    """The recording again and again, its times going on."""
    with open(source, encoding="utf-8") as file:
        head, *body = file.read().splitlines()
    pairs = [row.split(",", 1) for row in body]
    span = 2 * float(pairs[-1][0]) - float(pairs[-2][0]) - float(pairs[0][0])
    with open(target, "w", encoding="utf-8") as file:
        file.write(head + "\n")
        for i in range(rows):
            moment, values = pairs[i % len(pairs)]
            file.write(f"{float(moment) + i // len(pairs) * span:.6f},{values}\n")


def run(command, processors):
    """(seconds, seconds on processors) of a command and all its processes."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(["taskset", "-c", processors, *command], check=True, stdout=subprocess.DEVNULL)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begun
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare(one, other, processors, rounds):
    """Medians of the ratios of pairs, and of the differences in seconds, wall and processors'."""
    pairs = [(run(one, processors), run(other, processors)) for _ in range(rounds)]
    ratios = [statistics.median(a[i] / b[i] for a, b in pairs) for i in range(2)]
    return ratios, statistics.median(a[0] - b[0] for a, b in pairs)


def until_the_end(config, inner_steps=None):
    """Goes on to the end of the recording, with FMUs that make so many inner steps."""
    with open(config, encoding="utf-8") as file:
        document = json.load(file)
    document.pop("duration_s", None)
    for component in document["components"].values() if inner_steps else ():
        component["set"]["t_step"] = STEP_S / inner_steps
    with open(config, "w", encoding="utf-8") as file:
        json.dump(document, file)


def used_by(command, recordings, rounds):
    """Seconds on a processor for the second recording beyond the first, which is the start: the least of both, since others use the machine, too."""
    short, long = (min(run([*command, recording], "0")[1] for _ in range(rounds)) for recording in recordings)
    return long - short


def print_costs(motor, commands_of, options):
    """On one processor, by what a step of an FMU takes."""
    config, recordings = os.path.join(motor, "free.json"), [os.path.join(motor, name) for name in ("short.csv", "long.csv")]
    print(f"{'inner steps':>12}{'an FMU step':>14}{'processor time':>16}")
    for inner_steps in INNER_STEPS:
        rows = options.rows * 2 * INNER_STEPS[0] // (INNER_STEPS[0] + inner_steps)
        for path, count in zip(recordings, (20, rows)):
            lengthen(os.path.join(motor, "recording.csv"), path, count)
        until_the_end(config, inner_steps)
        program, bench = commands_of(config)
        apart, together = (used_by(command, recordings, options.rounds) for command in (program, bench))
        steps = int(subprocess.run([*bench, recordings[1]], check=True, capture_output=True, text=True).stdout.split()[0])
        print(f"{inner_steps:12}{together / steps / FMUS * 1e6:11.2f} us{apart / together:16.3f}", flush=True)


def print_cases(motor, commands_of, options):
    long, short = os.path.join(motor, "long.csv"), os.path.join(motor, "short.csv")
    lengthen(os.path.join(motor, "recording.csv"), long, options.rows)
    lengthen(os.path.join(motor, "recording.csv"), short, 20)
    print(f"{'':8}{'processors':>12}{'time':>8}{'processor time':>16}{'start':>12}")
    for case in CASES:
        config = os.path.join(motor, f"{case}.json")
        until_the_end(config)
        for processors in ("0", "0,1"):
            program, bench = commands_of(config)
            ratios, _ = compare([*program, long], [*bench, long], processors, options.rounds)
            _, start = compare([*program, short], [*bench, short], processors, options.rounds)
            print(f"{case:8}{processors:>12}{ratios[0]:8.2f}{ratios[1]:16.2f}{start * 1e3:9.1f} ms", flush=True)


def main():
    parser = argparse.ArgumentParser(description="What a process of their own costs a replay's FMUs.")
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "host"), help="default: build/host")
    parser.add_argument("--rows", type=int, default=130000, help="of the recording; default 130000, some 430000 ticks")
    parser.add_argument("--rounds", type=int, default=7, help="pairs of runs; default 7")
    parser.add_argument("--costs", action="store_true", help="on one processor, with FMUs that take more and more time")
    options = parser.parse_args()
    program = os.path.join(options.build, "bin", "twinlock")
    bench = os.path.join(options.build, "tests", "bench", "bench_replay")
    os.environ["TWINLOCK_FMU_PATH"] = os.path.join(options.build, "fmus")
    with tempfile.TemporaryDirectory() as folder:
        motor = os.path.join(folder, "motor")
        shutil.copytree(os.path.join(ROOT, "config", "motor"), motor)
        show = print_costs if options.costs else print_cases
        show(motor, lambda config: ([program, "replay", config, "--recording"], [bench, config]), options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
