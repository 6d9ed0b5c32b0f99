#!/usr/bin/env python3
"""What it costs that a replay's FMUs are in a process of their own: ratios to the same replay with them in one process.

usage: replay.py [--build FOLDER] [--rows N] [--rounds N]

Builds nothing: script/build does. README.md says what the figures mean.
"""
import argparse
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


def main():
    parser = argparse.ArgumentParser(description="What a process of their own costs a replay's FMUs.")
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "host"), help="default: build/host")
    parser.add_argument("--rows", type=int, default=130000, help="of the recording; default 130000, some 430000 ticks")
    parser.add_argument("--rounds", type=int, default=7, help="pairs of runs; default 7")
    options = parser.parse_args()
    program = os.path.join(options.build, "bin", "twinlock")
    bench = os.path.join(options.build, "tests", "bench", "bench_replay")
    os.environ["TWINLOCK_FMU_PATH"] = os.path.join(options.build, "fmus")
    with tempfile.TemporaryDirectory() as folder:
        motor = os.path.join(folder, "motor")
        shutil.copytree(os.path.join(ROOT, "config", "motor"), motor)
        source = os.path.join(motor, "recording.csv")
        long, short = os.path.join(folder, "long.csv"), os.path.join(folder, "short.csv")
        lengthen(source, long, options.rows)
        lengthen(source, short, 20)
        print(f"{'':8}{'processors':>12}{'time':>8}{'processor time':>16}{'start':>12}")
        for case in CASES:
            config = os.path.join(motor, f"{case}.json")
            with open(config, encoding="utf-8") as file:
                text = file.read()
            with open(config, "w", encoding="utf-8") as file:  # to the end of the recording
                file.write("\n".join(line for line in text.splitlines() if '"duration_s"' not in line))
            for processors in ("0", "0,1"):
                commands = [[program, "replay", config, "--recording"], [bench, config]]
                ratios, _ = compare([*commands[0], long], [*commands[1], long], processors, options.rounds)
                _, start = compare([*commands[0], short], [*commands[1], short], processors, options.rounds)
                print(f"{case:8}{processors:>12}{ratios[0]:8.2f}{ratios[1]:16.2f}{start * 1e3:9.1f} ms", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
