"""Many recordings of the motor bench, and the worst figures on them: script/studies/scenarios --campaign."""
import csv

import brakes
from motor_bench import exact_or_off, is_sound, with_solver, yes_or_no
from study import Progress

# Configuration and solver of each kind.
KINDS = {
    "secant": ("lock", "secant"),
    "secant, ahead": ("ahead", "secant"),
    "nelder-mead": ("lock", "nelder-mead"),
    "bobyqa": ("lock", "bobyqa"),
    "secant, 2 dynamic": ("e", "secant"),
    "secant, 5 dynamic": ("d", "secant"),
    "secant, 5 static": ("c", "secant"),
}

# (ratio, MSE) that a kind must not exceed: on the bench's own brake, and on others.
OWN_LIMITS = {
    "secant": (1.01, 0.05), "secant, ahead": (1.01, 0.25), "nelder-mead": (1.08, 0.30), "bobyqa": (1.08, 0.30),
    "secant, 2 dynamic": (1.06, 1.5), "secant, 5 dynamic": (1.45, 1.5), "secant, 5 static": (1.15, 1.5),
}
OTHER_LIMITS = {
    "secant": (1.01, 0.05), "secant, ahead": (1.01, 0.50), "nelder-mead": (1.12, 0.36), "bobyqa": (1.12, 0.36),
}


def limits_of(shape, kind):
    """(ratio, MSE), or None if there is no limit."""
    return (OWN_LIMITS if shape == "own" else OTHER_LIMITS).get(kind)


def unrest(recording):
    """The MSE of the newest measurement against that of the next instant: a twin in mode ahead, which uses the newest measurement,
    cannot have a smaller one."""
    with open(recording, encoding="utf-8", newline="") as file:
        rows = [(float(row["t"]), float(row["omega"])) for row in csv.DictReader(file)]
    held, newest = [], 0
    for i in range(1402):
        while newest + 1 < len(rows) and rows[newest + 1][0] <= rows[0][0] + 0.01 * i + 1e-9:
            newest += 1
        held.append(rows[newest][1])
    return sum((after - before) ** 2 for before, after in zip(held, held[1:])) / 1400


# ---- all runs ----

def measure_all(bench, recording):
    """{kind: figures} on one recording."""
    results = {}
    for kind, (name, solver) in KINDS.items():
        results[kind] = bench.measure(with_solver(name, solver), recording)
    results["secant, ahead"]["unrest"] = unrest(recording)
    return results


def run(bench, seeds, force, brake):
    """{shape: {kind: [figures by seed]}} for the own brake and the shapes of brakes.py, those `force` times as strong; or for
    the brake in a file alone."""
    shapes = ("given",) if brake is not None else ("own", *brakes.SHAPES)
    progress, results = Progress(len(shapes) * seeds), {}
    try:
        for shape in shapes:
            results[shape] = {kind: [] for kind in KINDS}
            for seed in range(1, seeds + 1):
                progress.say(f"{shape} brake, seed {seed}")
                recording = brakes.make_recording(bench.program, bench.folder, seed, shape, brake, force)
                for kind, found in measure_all(bench, recording).items():
                    results[shape][kind].append(found)
                recording.unlink()
    finally:
        progress.end()
    return results


def are_sound(results):
    return all(is_sound(run) for kinds in results.values() for runs in kinds.values() for run in runs)


# ---- the table ----

LAYOUT = "{:<7}{:<18}{:>7}{:>5}{:>8}{:>8}{:>5}{:>7}{:>6}{:>7}  {}"
NOTE = """limits: of the ratio and the MSE. unrest: above the limit only because the plant moves so
much from one instant to the next; a twin in mode ahead, with the newest measurement, cannot follow."""

# A twin in mode ahead has the unrest of the plant as its error, and at most this part of it in addition.
OWN_PART = 0.2


def worst(runs, figure):
    """(the largest, its seed, the mean)."""
    values = [run[figure] for run in runs]
    return max(values), values.index(max(values)) + 1, sum(values) / len(values)


def is_excused(run, ratio):
    """True if only the plant makes its MSE so large."""
    return run["ratio_with"] <= ratio and run["mse"] <= (1.0 + OWN_PART) * run.get("unrest", 0.0)


def remark(shape, kind, runs):
    """Compares the worst run with the limits."""
    limits = limits_of(shape, kind)
    if limits is None:
        return ""
    missed = [run for run in runs if run["ratio_with"] > limits[0] or run["mse"] > limits[1]]
    verdict = "met"
    if missed and all(is_excused(run, limits[0]) for run in missed):
        verdict = "unrest"
    elif missed:
        verdict = f"{len(missed)} MISSED"
    return f"{limits[0]:.2f} {limits[1]:.2f} {verdict}"


def show(shape, kind, runs):
    ratio, ratio_seed, ratio_mean = worst(runs, "ratio_with")
    mse, mse_seed, mse_mean = worst(runs, "mse")
    off = max((run["off"] for run in runs), key=abs)
    print(LAYOUT.format(shape, kind, f"{ratio:.4f}", f"#{ratio_seed}", f"{ratio_mean:.4f}", f"{mse:.3f}", f"#{mse_seed}",
                        f"{mse_mean:.3f}", yes_or_no(all(run["same"] for run in runs)), exact_or_off(off),
                        remark(shape, kind, runs)).rstrip())


def print_table(results):
    """One line for each brake and kind."""
    print(LAYOUT.format("", "", "ratio", "", "", "MSE", "", "", "same", "", "").rstrip())
    print(LAYOUT.format("brake", "solver, T_P", "worst", "seed", "mean", "worst", "seed", "mean", "bits", "ledger",
                        "limits"))
    for shape, kinds in results.items():
        for kind, runs in kinds.items():
            show(shape, kind, runs)
    print(NOTE)
