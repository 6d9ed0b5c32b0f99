"""Compares the other plants of config/ with their true outputs for hours: see the command systems, which builds and starts this."""
import argparse
import random
import sys
import tempfile

from minutes import LONGEST, SHORTEST, Plant, figures_of, left_alone, require, show
from study import Progress, Trouble, print_figures, run_command

PART_OF_NOISE = 9  # of secant in mode lag


def switched(names, shortest, longest, first):
    """A switch that changes often; each value holds until the next row."""
    def commands(choice, seconds):
        rows, time, on = [(0, first)], 0.0, first
        while time < seconds:
            time += choice.uniform(shortest, longest)
            on = 1 - on
            rows.append((f"{time:.3f}", on))
        return names, rows
    return commands


def heaters(choice, seconds):
    rows, time = [(0, 0, 0)], 0.0
    while time < seconds:
        time += choice.uniform(30, 300)
        rows.append((f"{time:.1f}", round(choice.uniform(0, 100)), round(choice.uniform(0, 100))))
    return ("time", "Q1", "Q2"), rows


# name: its commands, and {matched output: standard deviation of its noise}
SYSTEMS = {
    "bench_cylinder": (switched(("time", "dir_out"), 1.5, 6.0, 1), {"cylinder.F": 0.04}),
    "cylinder": (switched(("t", "move_out"), 2.2, 5.0, 0), {"cylinder.extend_signal": 0.0}),
    "tclab": (heaters, {"board.T1": 0.05, "board.T2": 0.05}),
}


def allowed_of(document, noise):
    lock = document["synchronise"]
    strict = (lock["algorithm"], lock["horizon"]["measurements"]) == ("secant", "lag")
    return noise ** 2 / (PART_OF_NOISE if strict else 1)


def measure_one(name, options, progress):
    commands, noises = SYSTEMS[name]
    results, seconds = {}, round(options.hours * 3600)
    with tempfile.TemporaryDirectory() as folder:
        progress.say(f"{name}: generating {options.hours:g} h")
        plant = Plant(name, folder, commands(random.Random(options.seed), seconds), seconds, options.seed)
        progress.say(f"{name}: left alone")
        told, alone = plant.replay(left_alone(plant.read("lock")))
        for variable in noises:
            results[f"{variable} left alone"] = figures_of(told, alone[variable], alone[variable], 0.0)
        progress.say(f"{name}: locked")
        told, minutes = plant.replay(plant.read("lock"))
        for variable, noise in noises.items():
            results[f"{variable} locked"] = figures_of(told, minutes[variable], alone[variable], allowed_of(plant.read("lock"), noise))
    return results


def measure(options):
    names = [name for name in SYSTEMS if options.only in (None, name)]
    if not names:
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(SYSTEMS)}")
    progress, results = Progress(3 * len(names)), {}
    try:
        for name in names:
            results |= measure_one(name, options, progress)
    finally:
        progress.end()
    return results


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=6)
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    require("--hours", options.hours, SHORTEST, LONGEST)
    results = measure(options)
    print_figures(results, options.json, show)
    return int(any(row["bad"] for row in results.values()))


if __name__ == "__main__":
    sys.exit(run_command("systems", main, 65))
