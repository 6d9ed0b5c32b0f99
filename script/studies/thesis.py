"""The tables of chapter 5 of the dissertation, measured: see the command thesis, which builds and starts this.

A table is a function that returns rows: name, figures of the dissertation (None: none), our figures. measure() returns all
figures as data.
"""
import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import delays
import scenarios
from motor_bench import SCENARIOS, Bench, read
from study import NOT_LOCKED, PROGRAM, ROOT, Progress, Trouble, end_interrupted, print_figures

RECORDINGS = ("thesis_motor_1.csv", "thesis_transport_slow.csv", "thesis_cylinder.csv", "tclab_energy_balance.csv",
              "pneu_cylinder_oring257_5bar.csv", "emps_train.csv")

# Tables 5.11 and 5.15: MSE, MAX.
TRANSPORT = {"free": (15623, 281), "slow": (226, 33)}
CYLINDER = {
    "extended": {"free": (0.092, 1), "lock": (0.014, 1)},
    "airflow": {"free": (0.38, 3.37), "lock": (0.34, 4.16)},
    "airflow from 0.2 s": {"free": (0.172, 1.03), "lock": (0.006, 0.35)},
}
SETTLED_S = 0.2


class Laboratory:
    """The program, the recordings, and a folder for intermediate files."""

    def __init__(self, folder, recordings, phases, progress):
        self.bench = Bench(PROGRAM, folder)
        self.recordings, self.phases, self.progress = recordings, phases, progress
        self.used = []  # names of recordings, of the current table

    def recording(self, name):
        """A recording of that name, or None: then that of the configuration is used."""
        path = self.recordings / name if self.recordings else None
        found = path is not None and path.exists()
        self.used.append(name if found else "our own")
        return path if found else None

    def replay(self, config, recording=None):
        """(summary, {column: values}) of a replay of config/CONFIG.json."""
        self.progress.say(config)
        steps = self.bench.folder / "steps.csv"
        command = [PROGRAM, "replay", ROOT / "config" / f"{config}.json", "--json", "--csv", steps]
        command += ["--recording", recording] if recording is not None else []
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        if done.returncode not in (0, NOT_LOCKED):
            raise Trouble(done.stderr.strip() or f"{config}: exit code {done.returncode} of twinlock")
        with open(steps, encoding="utf-8", newline="") as file:
            names, *rows = csv.reader(file)
        return json.loads(done.stdout), {name: [row[i] for row in rows] for i, name in enumerate(names)}


# ---- motor bench: tables 5.5, 5.6 ----

def motor_recording(laboratory):
    return laboratory.recording("thesis_motor_1.csv") or ROOT / "config" / "motor" / "recording.csv"


def brief(result, letter):
    executions = result["without" if letter in scenarios.WITHOUT_SAVING else "with"]
    return result["mse"], result["max"], executions


def table_5_5(laboratory):
    """{letter: {who: (MSE, MAX, executions)}}"""
    bench, recording = laboratory.bench, motor_recording(laboratory)
    free = bench.measure(read("free"), recording)
    found = {"free": {"thesis": scenarios.THESIS["free"], "free": (free["mse"], free["max"], free["with"])}}
    for letter in SCENARIOS:
        found[letter] = {"thesis": scenarios.THESIS[letter]}
        for solver in ("bobyqa", "secant"):
            laboratory.progress.say(f"5.5 {letter}) {solver}")
            _, result = run_motor(bench, letter, solver, recording, False)
            found[letter][solver] = brief(result, letter)
    return found


def run_motor(bench, letter, solver, recording, is_search):
    result = scenarios.run_one(bench, letter, solver, recording, is_search)
    return result["epsilon"], result


def table_5_6(laboratory):
    """{letter: {solver: {"thesis", "ours": (without, with), "mse"}}}, the fewest executions at an MSE of 1.5."""
    bench, recording = laboratory.bench, motor_recording(laboratory)
    found = {}
    for letter in "bcde":
        found[letter] = {}
        for solver in ("bobyqa", "l-bfgs", "secant"):
            laboratory.progress.say(f"5.6 {letter}) {solver}")
            epsilon, result = run_motor(bench, letter, solver, recording, True)
            found[letter][solver] = {
                "thesis": scenarios.THESIS_RATIOS.get(solver, {}).get(letter), "epsilon": epsilon, "mse": result["mse"],
                "ours": (result["ratio_without"], result["ratio_with"])}
    return found


def print_5_5(found):
    print(f"{'':40}{'dissertation':^23}{'BOBYQA':^23}{'secant':^23}")
    print(f"{'':40}" + f"{'MSE':>8}{'MAX':>7}{'N_ges':>8}" * 3)
    for letter, columns in found.items():
        name = "not synchronised" if letter == "free" else f"{letter}) {read(letter)['name'].split(': ')[1]}"
        cells = [columns["thesis"], *([columns["free"]] if letter == "free" else
                                     [columns["bobyqa"], columns["secant"]])]
        print(f"{name:40}" + "".join(f"{mse:8.2f}{largest:7.2f}{count:8d}" for mse, largest, count in cells))
    print("""The recording of the dissertation was not published. Ours is the same model with J = 0.0015, noise of 0.3 rad/s, and
a brake with which the free run has about the same MSE. The secant solver corrects no more than needed; it could
follow the noise more closely. BOBYQA has the tolerance with the fewest executions at an MSE of 1.5; with a smaller
tolerance it follows as closely as the dissertation, with more executions.""")


def print_5_6(found):
    print(f"{'':12}{'dissertation':^20}{'ours':^20}")
    print(f"{'':12}" + f"{'without':>10}{'with':>10}" * 2 + f"{'MSE':>9}{'epsilon':>9}")
    for letter, solvers in found.items():
        print(f"{letter}) {read(letter)['name'].split(': ')[1]}")
        for solver, one in solvers.items():
            thesis = f"{one['thesis'][0]:10.2f}{one['thesis'][1]:10.2f}" if one["thesis"] else 20 * " "
            print(f"   {solver:9}{thesis}{one['ours'][0]:10.2f}{one['ours'][1]:10.4f}{one['mse']:9.2f}{one['epsilon']:9g}")
    print("""N_ges relative to 4203, the smallest possible number, at an MSE of at most 1.5. Ours evaluates a guess before it
searches, and a search ends within tolerance; both save evaluations in both columns. BOBYQA and L-BFGS are NLopt's.""")


# ---- transport system: table 5.11, figure 5.18 ----

def match_of(summary, variable):
    found = summary["match"][variable]["mse"], summary["match"][variable]["max"]
    if None in found:
        raise Trouble(f"{variable}: the recording has too few samples to compare")
    return found


def table_5_11(laboratory):
    recording = laboratory.recording("thesis_transport_slow.csv")
    found = {}
    for name in ("free", "slow"):
        summary, steps = laboratory.replay(f"transport/{name}", recording)
        found[name] = {"thesis": TRANSPORT[name], "ours": match_of(summary, "product.x"),
                       "most_evaluations": max(map(int, steps["evaluations"]))}
    summary, _ = laboratory.replay("transport/fast")
    found["fast"] = {"thesis": None, "ours": match_of(summary, "product.x")}
    return found


def two(pair, digits):
    return 2 * f"{'':10}" if pair is None else "".join(f"{value:10.{digits}f}" for value in pair)


def print_pairs(rows, digits, unit):
    print(f"{'':44}{'dissertation':^20}{'ours':^20}")
    print(f"{'':44}" + f"{'MSE':>10}{'MAX':>10}" * 2)
    for text, thesis, ours in rows:
        print(f"{text:44}{two(thesis, digits)}{two(ours, digits)}  {unit}")


def print_5_11(found):
    print_pairs([("not synchronised", found["free"]["thesis"], found["free"]["ours"]),
                 ("synchronised by belt 2's `enabled`", found["slow"]["thesis"], found["slow"]["ours"]),
                 ("faster belt, by the product's velocity", None, found["fast"]["ours"])], 2, "mm², mm")
    print(f"""At most {found['slow']['most_evaluations']} evaluations a step. The recording of the real plant was not published; ours is the model with a product that is
stuck until 5 s and then moves at 30 mm/s. Nearly all of the remaining error is the start: the twin begins 15 mm ahead,
cannot move back, and waits. The faster belt (figure 5.18) has no figures in the dissertation; its recording is always ours.""")


# ---- cylinder: table 5.15 ----

def errors(steps, simulated, measured, since):
    return [float(y) - float(y_hat) for time, y, y_hat in zip(steps["time"], steps[simulated], steps[measured])
            if float(time) >= since]


def metrics(differences):
    return sum(d * d for d in differences) / max(1, len(differences) - 1), max(map(abs, differences), default=0.0)


def cylinder_figures(laboratory, name, recording):
    summary, steps = laboratory.replay(f"cylinder/{name}", recording)
    air = ("cylinder.airflow simulated", "plant.airflow measured")
    opened = next((float(t) for t, on in zip(steps["time"], steps["plant.airflow measured"]) if abs(float(on)) > 1.0), 0.0)
    figures = {"extended": match_of(summary, "cylinder.extend_signal"), "airflow": metrics(errors(steps, *air, 0.0)),
               "airflow from 0.2 s": metrics(errors(steps, *air, opened + SETTLED_S))}
    throttle = summary["adjust"].get("cylinder.throttle_extend", {}).get("last")
    return figures, throttle, summary


def table_5_15(laboratory):
    recording = laboratory.recording("thesis_cylinder.csv")
    found = {}
    for name in ("free", "lock", "hold"):
        figures, throttle, summary = cylinder_figures(laboratory, name, recording)
        found[name] = {"ours": figures, "throttle": throttle, "evaluations": summary["evaluations"],
                       "thesis": {what: CYLINDER[what].get(name) for what in CYLINDER}}
    return found


def print_5_15(found):
    words = {"free": "not synchronised", "lock": "synchronised", "hold": "synchronised, mode hold"}
    units = {"extended": "", "airflow": "(l/s)², l/s", "airflow from 0.2 s": "(l/s)², l/s"}
    for what, unit in units.items():
        print(f"{what}")
        print_pairs([(f"   {words[name]}", one["thesis"][what], one["ours"][what]) for name, one in found.items()], 4, unit)
    print(f"""Throttle found: {found['lock']['throttle']:.4g} (dissertation 0.023, the plant's is 0.023), by {found['lock']['evaluations']} evaluations, T_F = 16. Committed steps do
not change: while the first search waits for its window, the signal is wrong for 8 steps; in mode hold it does not wait. The
recording of the real plant was not published; ours is a model of the cylinder and the beam, without the oscillations of the
chambers in the dissertation. Most of the airflow's error is that of the first stroke, before the first search. From 0.2 s:
after the valve has opened for the first time.""")


# ---- synchronisation of time: table 5.17 ----

def table_5_17(laboratory):
    found = delays.figures(delays.measure(PROGRAM, laboratory.phases, 1, tell=lambda done: laboratory.progress.say(
        f"5.17 phase {done + 1} of {laboratory.phases}")))
    found["phases"] = laboratory.phases
    return found


def print_5_17(found):
    delays.print_table(found, found["phases"])
    print("""The dissertation has one clock phase, which it does not give; its MAX is that of the first sample after the step, which
depends most on the phase.""")


# ---- other plants ----

# Configuration, name of the recording, and whether there is a model in its place.
OTHERS = {
    "TCLab, by the heat of both heaters": ("tclab/lock", "tclab_energy_balance.csv", True),
    "TCLab, by its heat capacity": ("tclab/capacity", "tclab_energy_balance.csv", True),
    "TCLab, by the temperature of the surroundings": ("tclab/ambient", "tclab_energy_balance.csv", True),
    "cylinder on a bench, by its friction": ("bench_cylinder/lock", "pneu_cylinder_oring257_5bar.csv", True),
    "EMPS, by the force": ("emps/lock", "emps_train.csv", False),
}


def matches_of(config):
    document = json.loads((ROOT / "config" / f"{config}.json").read_text(encoding="utf-8"))
    return document["synchronise"]["match"]


def table_others(laboratory):
    """{plant: {"recording", output: (free MSE, locked MSE, unit)}}"""
    found = {}
    for plant, (config, name, has_stand_in) in OTHERS.items():
        recording = laboratory.recording(name)
        if recording is None and not has_stand_in:
            continue
        free, _ = laboratory.replay(f"{config.split('/')[0]}/free", recording)
        locked, _ = laboratory.replay(config, recording)
        weights = {output: one.get("weight", 1) for output, one in matches_of(config).items()}
        outputs = {output: (free["match"][output]["mse"], one["mse"], one["unit"])
                   for output, one in locked["match"].items() if weights[output] > 0}
        found[plant] = {"recording": name if recording else "stand-in", "outputs": outputs}
    return found


def print_others(found):
    print(f"{'':63}{'free MSE':>14}{'locked MSE':>14}")
    for plant, one in found.items():
        print(f"{plant}: {one['recording']}")
        for output, (free, locked, unit) in one["outputs"].items():
            print(f"   {output:60}{free:14.4g}{locked:14.4g}  ({unit})²")
    print("""Stand-ins are models of these plants, played by twinlock plant. With --recordings: measurements of the plants.""")


# ---- all ----

TABLES = {
    "5.5": ("Motor bench, ten scenarios: MSE (rad/s)², MAX rad/s, executions", table_5_5, print_5_5),
    "5.6": ("Motor bench, executions at equal quality", table_5_6, print_5_6),
    "5.11": ("Transport system", table_5_11, print_5_11),
    "5.15": ("Cylinder", table_5_15, print_5_15),
    "5.17": ("Synchronisation of time", table_5_17, print_5_17),
    "others": ("Plants of others, free against locked", table_others, print_others),
}


def parse(arguments):
    parser = argparse.ArgumentParser(prog="script/studies/thesis", usage="script/studies/thesis [options]; see --help",
                                     add_help=False, allow_abbrev=False)
    parser.add_argument("--only", default=",".join(TABLES))
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--phases", type=int, default=400)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    options.only = options.only.split(",")
    unknown = [name for name in options.only if name not in TABLES]
    if unknown:
        parser.error(f"--only {','.join(unknown)}: expected some of {', '.join(TABLES)}")
    if not 1 <= options.phases <= 100000:
        parser.error(f"--phases {options.phases}: expected 1 to 100000")
    return options


def measure(names, laboratory):
    """{table: its figures}; laboratory.sources has the used recordings of each table"""
    found, laboratory.sources = {}, {}
    for name in names:
        laboratory.used = []
        found[name] = TABLES[name][1](laboratory)
        laboratory.sources[name] = sorted(set(laboratory.used))
    return found


def show(found, sources):
    for name, figures in found.items():
        title, _, tell = TABLES[name]
        print(f"\n{'Table ' + name if name[0].isdigit() else 'Beyond the dissertation'}: {title}")
        print("\u2500" * 109)
        tell(figures)
        if sources.get(name):
            print(f"Recordings: {', '.join(sources[name])}.")


def check_recordings(folder):
    if folder is not None and not any((folder / name).exists() for name in RECORDINGS):
        raise Trouble(f"{folder} has none of {', '.join(RECORDINGS)}")


def main():
    options = parse(sys.argv[1:])
    progress = Progress(0)
    try:
        with tempfile.TemporaryDirectory(prefix="twinlock-thesis-") as folder:
            check_recordings(options.recordings)
            laboratory = Laboratory(folder, options.recordings, options.phases, progress)
            found = measure(options.only, laboratory)
    except Trouble as trouble:
        progress.end()
        sys.exit(f"thesis: {trouble}")
    except KeyboardInterrupt:
        progress.end()
        end_interrupted()
    progress.end()
    print_figures(found, options.json, lambda figures: show(figures, laboratory.sources))


if __name__ == "__main__":
    main()
