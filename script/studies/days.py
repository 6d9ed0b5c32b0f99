"""A day of the motor bench, minute by minute against the true speed: see the command days, which builds and starts this."""
import argparse
import json
import math
import random
import subprocess
import sys
import tempfile

from minutes import LONGEST, SHORTEST, Plant, figures_of, left_alone, require, show
from study import PROGRAM, Progress, Trouble, merge, print_figures, run_command

SAMPLE_S = 0.02
SOLVERS = ("secant", "nelder-mead", "bobyqa", "sbplx", "l-bfgs")
COMBINATIONS = [(mode, solver) for mode in ("lag", "hold", "ahead") for solver in SOLVERS]
HELD, PART_OF_NOISE = 120, 9  # mean time, s, for which the brake is pulled, or released
STRICT = "lag", "secant"  # its limit is a ninth of the squared noise
TOLERANCE, WIDER = 3.4, 5.0  # times the noise; the wider one for STRICT


def brake(choice, seconds):
    """A brake that is pulled by hand for a while, and released for a while."""
    parts, pulled, began, until = [], False, 0.0, 0.0
    for i in range(round((seconds + 1) / SAMPLE_S)):
        time = i * SAMPLE_S
        if time >= until:
            pulled, began, until = not pulled, time, time + choice.uniform(0.2, 1.8) * HELD
            parts = [(choice.uniform(0.02, 0.15), choice.uniform(0.1, 0.8), choice.uniform(0.0, 6.0)) for _ in range(4)]
        torque = sum(a * math.sin(2 * math.pi * f * time + p) for a, f, p in parts) + 0.2 if pulled else 0.0
        yield f"{time:.2f}", f"{max(0.0, torque) * min(1.0, time - began):.4f}"


def bench(folder, options):
    def edit(plant):
        plant["components"]["motor"]["set"]["J"] = options.inertia
        plant["emulate"]["columns"]["omega"]["noise"] = options.noise
        return plant
    seconds = options.hours * 3600
    return Plant("motor", folder, (("t", "torque"), brake(random.Random(options.seed), seconds)), seconds, options.seed, edit)


def propose(plant):
    """The proposal of `check --recording` for the shipped lock and this plant, as a merge patch."""
    told = subprocess.run([PROGRAM, "check", plant.home / "lock.json", "--recording", plant.recording, "--json"], capture_output=True, check=True).stdout
    return json.loads(told)["proposal"]


def locked(document, combination, noise, proposal):
    """Mode lag as proposed; the other modes wait for no reading, so they have no condition."""
    mode, solver = combination
    document = merge(document, proposal if mode == "lag" else {})
    lock = document["synchronise"]
    lock["free_twin"] = True
    lock["horizon"]["measurements"], lock["algorithm"] = combination
    lock["match"]["motor.omega"]["tolerance"] = noise * (WIDER if combination == STRICT else TOLERANCE)
    if mode != "lag":
        lock["match"]["motor.omega"].pop("condition")
    return document


def measure(options):
    chosen = [combination for combination in COMBINATIONS if options.only in (None, " ".join(combination))]
    if not chosen:
        raise Trouble(f"--only: found \"{options.only}\", expected one of {', '.join(' '.join(combination) for combination in COMBINATIONS)}")
    progress, results = Progress(2 + len(chosen)), {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            progress.say(f"generating {options.hours:g} h")
            plant = bench(folder, options)
            progress.say("left alone")
            told, minutes = plant.replay(left_alone(plant.read("lock")))
            alone = minutes["motor.omega"]
            results["left alone"] = figures_of(told, alone, alone, 0.0)
            proposal = propose(plant)
            for combination in chosen:
                progress.say(" ".join(combination))
                allowed = options.noise ** 2 / (PART_OF_NOISE if combination == STRICT else 1)
                told, minutes = plant.replay(locked(plant.read("lock"), combination, options.noise, proposal))
                results[" ".join(combination)] = figures_of(told, minutes["motor.omega"], alone, allowed)
        finally:
            progress.end()
    return results


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=24)
    parser.add_argument("--noise", type=float, default=0.3)
    parser.add_argument("--inertia", type=float, default=0.05)
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    require("--hours", options.hours, SHORTEST, LONGEST)
    require("--noise", options.noise, 1e-6, 1e3)
    require("--inertia", options.inertia, 1e-6, 1e3)
    results = measure(options)
    print_figures(results, options.json, show)
    return int(any(row["bad"] for row in results.values()))


if __name__ == "__main__":
    sys.exit(run_command("days", main, 65))
