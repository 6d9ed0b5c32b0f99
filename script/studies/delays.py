"""Table 5.17 of the dissertation, measured: see the command delays, which builds and starts this."""
import argparse
import json
import math
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

from study import NOT_LOCKED, PROGRAM, ROOT, end_interrupted, print_figures

FOLDER = ROOT / "config" / "second_order"

# Table 5.16, ns.
MS = 10**6
BUS, PLANT, ACQUISITION, DEAD = 8 * MS, MS // 10, 4 * MS, 4 * MS
T, D, K, COMMAND = 0.125, 0.225, 1.0, 1000 * MS
BEGIN, END = 950 * MS, 2000 * MS

# The configurations, and the figures of the dissertation: MSE, MAX.
CONFIGURATIONS = {
    "without": ("without compensation", (0.00147, 0.18)),
    "with": ("with compensation", (0.00027, 0.18)),
    "plain": ("without delays in the file", None),
    "newest": ("with, newest value", None),
    "both": ("with, inputs as well", None),
}


# ---- the plant's chain ----

def response(seconds):
    """The step response of eq. 5.6."""
    if seconds <= 0:
        return 0.0
    omega, damped = 1 / T, math.sqrt(1 - D * D) / T
    decay = math.exp(-D * omega * seconds)
    return K * (1 - decay * (math.cos(damped * seconds) + D * omega / damped * math.sin(damped * seconds)))


def first_from(instant, period, phase):
    """The first instant of a cycle at or after one."""
    return instant + (phase - instant) % period


def last_before(instant, period, phase):
    """The last instant of a cycle at or before one."""
    return instant - (instant - phase) % period


def make_chain(chance, noise=0.0, commands=(COMMAND,), end=END, later=(END, 0)):
    """Returns (rows, delay). rows: {stamp (ns): [u, y]}, None if there is no value; commands that switch u on and off, after the
    acquisition, and the response of the plant, after the bus. delay: by how much the twin's y is later than y by its stamps (ns).
    Each clock has its own phase; commands are whole multiples of all periods apart. `later`: (instant, ns); from that instant on
    the stamps of y are later by so much."""
    bus, plant, acquisition = (chance.randrange(period) for period in (BUS, PLANT, ACQUISITION))
    rows = {}
    for cycle in range(first_from(BEGIN, ACQUISITION, acquisition), end, ACQUISITION):
        rows[cycle + DEAD] = [float(sum(cycle >= command for command in commands) % 2), None]
    began = [first_from(command, PLANT, plant) for command in commands]
    for cycle in range(first_from(min(rows), BUS, bus), end, BUS):
        at = last_before(cycle, PLANT, plant)
        y = sum((-1) ** i * response((at - instant) / 1e9) for i, instant in enumerate(began))
        stamp = cycle + (later[1] if cycle >= later[0] else 0)
        rows.setdefault(stamp, [None, None])[1] = y + chance.gauss(0, noise)
    seen = first_from(commands[0], ACQUISITION, acquisition) + DEAD
    return rows, seen + DEAD - began[0]


def make_rows(chance, noise=0.0):
    return make_chain(chance, noise)[0]


def write_recording(path, rows):
    def cell(value):
        return "" if value is None else repr(value)

    lines = [f"{stamp // 10**9}.{stamp % 10**9:09d},{cell(u)},{cell(y)}" for stamp, (u, y) in sorted(rows.items())]
    path.write_text("time,u,y\n" + "\n".join(lines) + "\n", encoding="utf-8")


# ---- the twin ----

def replay(program, config, recording):
    """The match in the output of `replay --json`."""
    environment = {**os.environ, "TWINLOCK_FMU_PATH": str(program.parent.parent / "fmus")}
    done = subprocess.run([program, "replay", config, "--recording", recording, "--json"], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, check=False, env=environment)
    if done.returncode not in (0, NOT_LOCKED):
        sys.exit(f"delays: twinlock replay {config}: exit code {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)["match"]["sensor.y"]


def measure(program, phases, seed, names=tuple(CONFIGURATIONS), tell=lambda done: None):
    """For each configuration the MSE and MAX of every phase."""
    results = {name: [] for name in names}
    with tempfile.TemporaryDirectory(prefix="twinlock-delays-") as folder:
        recording = Path(folder) / "recording.csv"
        for phase in range(phases):
            tell(phase)
            write_recording(recording, make_rows(random.Random(f"{seed}/{phase}")))
            for name in names:
                told = replay(program, FOLDER / f"{name}.json", recording)
                results[name].append((told["mse"], told["max"]))
    return results


def mean(values):
    return sum(values) / len(values)


def figures(results):
    """{name: {"mse", "max"}}, means over the phases; and the factor by which compensation lowers the MSE: of the means, and the
    mean over the phases."""
    found = {name: {"mse": mean([mse for mse, _ in rows]), "max": mean([largest for _, largest in rows])}
             for name, rows in results.items()}
    pairs = list(zip(results["without"], results["with"]))
    found["factor"] = found["without"]["mse"] / found["with"]["mse"]
    found["mean_factor"] = mean([before[0] / after[0] for before, after in pairs])
    return found


def print_table(found, phases):
    print(f"Means over {phases} clock phases      MSE       MAX   dissertation: MSE  MAX")
    for name, (text, thesis) in CONFIGURATIONS.items():
        one = found[name]
        said = f"{thesis[0]:18.5f} {thesis[1]:.2f}" if thesis else ""
        print(f"  {text:25} {one['mse']:9.5f} {one['max']:9.4f}{said}")
    print(f"  factor of the means       {found['factor']:9.2f}                      5.44")
    print(f"  mean of the factors       {found['mean_factor']:9.2f}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--phases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.write:
        try:
            write_recording(options.write, make_rows(random.Random(f"{options.seed}/0"), options.noise))
        except OSError as trouble:
            sys.exit(f"delays: {trouble}")
        return
    try:
        found = figures(measure(PROGRAM, options.phases, options.seed))
    except KeyboardInterrupt:
        end_interrupted()
    print_figures(found, options.json, lambda figures: print_table(figures, options.phases))


if __name__ == "__main__":
    main()
