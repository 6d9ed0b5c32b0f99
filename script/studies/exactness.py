"""Whether twins of foreign FMUs are exact: see the command script/fmus, options --twins and --public.

Each FMU makes a recording of itself: its inputs jump, and a disturbance is added to its outputs. A twin is locked to it with
Nelder-Mead and five steps of prediction: once with saved states, once with --plain. Then the FMU repeats the inputs that the
twin has committed, without a search. All three must agree to the bit in each step, or the twin must have reported a difference.
"""
import csv
import hashlib
import itertools
import json
import math
import os
import re
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from foreign import ENDED_BY_LIMIT, component_of, describe, execute, first_error, has_signal
from study import NOT_LOCKED

STEPS, PREDICTION, EVALUATIONS = 120, 5, 40
MOST_CANDIDATES, MOST_ADJUSTED, MOST_DRIVEN, MOST_MATCHED, MOST_COMPARED = 8, 2, 20, 2, 16
LEAST_STEPS, MOST_REPLAYED = 20, 40
CHECK_LIMIT, FMPY_LIMIT = 15, 20  # s
CHECK_STEPS = 10000  # more than `check` makes
STARTUP = 0.3  # s, of twinlock with an FMU
STRAIGHT = Path(__file__).with_name("straight.py")
LEVELS = 0.0, 1.0, 0.4, -0.7, -0.7, 1.3, 0.2, -1.0  # of the inputs, one after the other, in swings

# Flags of a step, see docs/reference/database.md.
ROLLBACK_DIFFERED, NO_ROLLBACK = 64, 128

# What a twin reports if an FMU is not exact; a reset explains only why the FMU alone differs.
REPORTS_DIFFERENCE = re.compile(r"rollback|not exact|not the same|runs free|deterministic|cannot be restored")
REPORTS_RESET = re.compile(r"\breset|\brestart|has failed|fails in step")
METHODS = {"by its memory": "memory", "by replay": "replay", "by its state;": "state, inputs set again", "can save its state": "state",
           "cannot save its state": "none"}
EXACT, REPORTED, SILENT, FAILS = "exact", "reported", "wrong in silence", "does not run"


class Fmu(NamedTuple):
    path: Path
    name: str
    exporter: str


class Options(NamedTuple):
    program: Path
    steps: int
    limit: float  # s, of one command
    swing: float  # factor of the jumps, and of the bounds of adjusted variables
    probe: Callable  # (FMU, step, steps): the rollback method that is exact


class Failure(Exception):
    """A run of an FMU that has failed: why."""


class TooSlow(Failure):
    """A run of an FMU that is not done within --limit, or will not be; args[1]: steps that may be possible."""


# ---- inputs ----

def swing_of(variable, factor):
    """(middle, swing) of an input: within its bounds, else near its start value, `factor` times."""
    low, high, start = variable.low, variable.high, variable.start or 0.0
    if low is not None and high is not None and low < high and high - low < 1e6:
        return (low + high) / 2, 0.3 * (high - low)
    return start, 0.5 * factor * max(1.0, abs(start))


def clamp(variable, value):
    value = value if variable.low is None else max(value, variable.low)
    return value if variable.high is None else min(value, variable.high)


def nominal_of(variable):
    return clamp(variable, variable.start or 0.0)


def jumping_value(variable, number, tick, steps, scale, factor):
    """The value of input `number`: a new level every eighth of the recording, each input at another time."""
    level = scale * LEVELS[(tick * len(LEVELS) // max(steps, 1) + number) % len(LEVELS)]
    if variable.kind == "boolean":
        return float(level > 0 if scale else variable.start or 0)
    middle, swing = swing_of(variable, factor)
    if not scale:
        middle = nominal_of(variable)
    value = clamp(variable, middle + swing * level)
    return float(round(value)) if variable.kind == "integer" else value


class Signals:
    """The variables of an FMU that its runs use. `inputs`: those that a recording moves, in the order of its columns."""

    def __init__(self, description):
        reals = [given for given in description.inputs if given.kind == "real"]
        self.candidates = (reals or [given for given in description.tunable if given.kind == "real"])[:MOST_CANDIDATES]
        self.are_parameters = not reals
        others = [given for given in description.inputs if has_signal(given) and given not in self.candidates]
        self.inputs = ([] if self.are_parameters else self.candidates) + others[:MOST_DRIVEN]
        self.without = [given for given in description.inputs if given not in self.inputs]
        self.outputs = sorted(description.results, key=lambda result: result.kind != "real")[:MOST_COMPARED]
        self.columns = [f"fmu.{output.name} simulated" for output in self.outputs]
        self.description, self.steps = description, 0

    def number(self, variable):
        return self.inputs.index(variable)


# ---- configurations ----

def stop_of(signals):
    """The same for all runs of an FMU, because its values may depend on it."""
    return signals.description.start + (signals.steps + 2 * PREDICTION) * signals.description.step


def initial_of(variable):
    value = nominal_of(variable)
    return bool(value) if variable.kind == "boolean" else int(value) if variable.kind == "integer" else value


def base_of(fmu, signals, driven):
    """A configuration in which the recording moves the inputs `driven`."""
    plant = {f"u{signals.number(given)}": {"type": given.kind, "initial": initial_of(given)} for given in driven}
    return {"twinlock": 1, "name": "exactness", "step_s": signals.description.step, "start_s": signals.description.start,
            "stop_s": stop_of(signals), "components": {"fmu": component_of(fmu.path, signals.description, signals.without)},
            "plant": {**plant, **{kind: {"type": kind} for kind in sorted({output.kind for output in signals.outputs})}},
            "connect": [[f"plant.u{signals.number(given)}", f"fmu.{given.name}"] for given in driven]}


def free_configuration(fmu, signals, parameters=()):
    """The FMU alone, all its inputs from the recording; `parameters`: pairs of a name and a value."""
    document = base_of(fmu, signals, signals.inputs)
    if parameters:
        document["components"]["fmu"].setdefault("set", {}).update(parameters)
    return {**document, "compare": {f"fmu.{output.name}": {"to": f"plant.{output.kind}"} for output in signals.outputs}}


def bounds_of(variable, factor):
    middle, swing = swing_of(variable, factor)
    return {"min": clamp(variable, middle - 4 * swing), "max": clamp(variable, middle + 4 * swing)}


def twin_configuration(fmu, signals, adjusted, matched, factor):
    document = base_of(fmu, signals, [given for given in signals.inputs if given not in adjusted])
    document["plant"].update({f"y{i}": {"type": output.kind} for i, (output, *_) in enumerate(matched)})
    names = {output.name for output, *_ in matched}
    match = {f"fmu.{output.name}": {"to": f"plant.y{i}", "tolerance": 1e-3 * spread} for i, (output, _, spread) in enumerate(matched)}
    match.update({f"fmu.{output.name}": {"to": f"plant.{output.kind}", "weight": 0} for output in signals.outputs if output.name not in names})
    adjust = {f"fmu.{given.name}": {"step": swing_of(given, factor)[1], "nominal": nominal_of(given), **bounds_of(given, factor)} for given in adjusted}
    document["synchronise"] = {"algorithm": "nelder-mead", "adjust": adjust, "match": match, "noise_floor": 0,
                               "horizon": {"prediction": PREDICTION}, "budget": {"evaluations": EVALUATIONS}}
    return document


def write_recording(path, signals, columns):
    """A recording of {column: values}."""
    lines = [",".join(["time", *columns])]
    for tick, values in enumerate(zip(*columns.values())):
        lines.append(",".join([repr(round(tick * signals.description.step, 9)), *map(repr, values)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


# ---- runs ----

class Run(NamedTuple):
    """A replay that is complete: its rows, its summary, and what it has reported."""
    rows: list
    summary: dict
    warnings: list
    flags: int
    seconds: float


def read_database(path):
    """(warnings, flags of all steps)."""
    try:
        with closing(sqlite3.connect(path)) as database:
            events = database.execute("SELECT text FROM events JOIN severities ON code = severity WHERE name IN ('warning', 'error')").fetchall()
            flags = database.execute("SELECT DISTINCT flags FROM steps WHERE flags IS NOT NULL").fetchall()
    except sqlite3.Error as error:
        raise Failure(f"database: {error}") from error
    found = 0
    for (value,) in flags:
        found |= value
    return [text for (text,) in events], found


def replay(name, document, options, folder, more=()):
    """Replays name.csv with a configuration; raises Failure."""
    (folder / f"{name}.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    label = "-".join([name, *(option.strip("-") for option in more)])
    table, log = folder / f"{label}.table", folder / f"{label}.log"
    begin = time.monotonic()
    code, out = execute([options.program, "replay", f"{name}.json", "--recording", f"{name}.csv", "--json", "--csv", table.name,
                         "--db", f"{label}.db", *more], options.limit, folder, log)
    seconds = time.monotonic() - begin
    err = log.read_text(encoding="utf-8", errors="replace")
    if code == ENDED_BY_LIMIT:
        raise TooSlow("not done within --limit", 0)
    if code not in (0, NOT_LOCKED):
        raise Failure(f"exit code {code}: {first_error(code, err)}")
    warnings, flags = read_database(folder / f"{label}.db")
    warnings += [line.partition("warning: ")[2] for line in err.splitlines() if line.startswith("twinlock: warning: ")]
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return Run(rows, json.loads(out), warnings, flags, seconds)


def numbers_of(cells):
    """Numbers, or None if one is missing or not finite."""
    try:
        numbers = list(map(float, cells))
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None


def record_itself(fmu, signals, options, folder):
    """({column: values} of its inputs, its run); gentler jumps if it fails. Raises Failure."""
    failure = None
    for scale in 1.0, 0.05, 0.0:
        columns = {f"u{i}": [jumping_value(given, i, tick, signals.steps, scale, options.swing) for tick in range(signals.steps + 1)]
                   for i, given in enumerate(signals.inputs)}
        columns.update({output.kind: [0.0] * (signals.steps + 1) for output in signals.outputs})
        write_recording(folder / "own.csv", signals, columns)
        try:
            return columns, replay("own", free_configuration(fmu, signals), options, folder)
        except TooSlow:
            raise
        except Failure as found:
            failure = failure or found
    raise failure


def run_without(fmu, signals, columns, candidate, options, folder):
    """Its run with one candidate at rest, or one parameter at another value; None if that fails."""
    if signals.are_parameters:
        parameters, columns = [(candidate.name, clamp(candidate, nominal_of(candidate) + 0.2 * swing_of(candidate, 1.0)[1]))], dict(columns)
    else:
        parameters, columns = (), {**columns, f"u{signals.number(candidate)}": [nominal_of(candidate)] * (signals.steps + 1)}
    write_recording(folder / "rest.csv", signals, columns)
    try:
        return replay("rest", free_configuration(fmu, signals, parameters), options, folder)
    except Failure:
        return None


def response_of(moved, rest):
    """{output: (largest relative difference, values, spread)} of outputs that are numbers in each step."""
    found = {}
    for column in moved.rows[0] if moved.rows else ():
        if not column.endswith(" simulated"):
            continue
        values, still = (numbers_of(row[column] for row in run.rows) for run in (moved, rest))
        if values is None or still is None or max(map(abs, values)) > 1e100:
            continue
        spread = max(values) - min(values)
        size = spread if spread > 1e-9 * max(map(abs, values)) else max(1.0, abs(values[0]))
        found[column] = max(abs(a - b) for a, b in zip(values, still)) / size, values, size
    return found


def choose_variables(fmu, signals, columns, own, options, folder):
    """(adjusted variables, [(output, its values, its spread)] to match): those with the largest responses."""
    responses = []
    for candidate in signals.candidates:
        rest = run_without(fmu, signals, columns, candidate, options, folder)
        if rest is not None:
            responses.append((candidate, response_of(own, rest)))
    responses.sort(key=lambda entry: -max([response for response, *_ in entry[1].values()], default=0.0))
    best = {}
    for _, found in responses[:MOST_ADJUSTED]:
        for column, (response, values, size) in found.items():
            best[column] = max(best.get(column, (0.0,))[0], response), values, size
    by_column = dict(zip(signals.columns, signals.outputs))
    ranked = sorted(best.items(), key=lambda entry: -entry[1][0])[:MOST_MATCHED]
    return [candidate for candidate, _ in responses[:MOST_ADJUSTED]], [(by_column[column], values, size) for column, (_, values, size) in ranked]


def disturb(kind, values, spread):
    """A measurement: the values with a ripple and jumps, so that the search is never done."""
    count = len(values)
    if kind != "real":
        return [float(round(value) if tick % 7 < 5 else round(values[0])) for tick, value in enumerate(values)]
    return [value + spread * (0.02 * math.sin(0.9 * tick) + 0.05 * LEVELS[(3 + tick * 12 // max(count, 1)) % len(LEVELS)])
            for tick, value in enumerate(values)]


def check(document, options, folder):
    """(rollback method, warnings) as `check` reports them."""
    document = {**document, "stop_s": document["start_s"] + CHECK_STEPS * document["step_s"]}
    (folder / "check.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    code, out = execute([options.program, "check", "check.json"], min(options.limit, CHECK_LIMIT), folder, folder / "check.log")
    text = " ".join(out.split())
    method = next((method for phrase, method in METHODS.items() if phrase in text.partition("connections")[0]), "?")
    err = (folder / "check.log").read_text(encoding="utf-8", errors="replace")
    warnings = [line for line in err.splitlines() if line.startswith("twinlock: ") and not line.startswith("twinlock: notice")]
    warnings += ["check: not deterministic"] if "not deterministic" in text else []
    return method, warnings + ([f"check: exit code {code}"] if code not in (0, NOT_LOCKED) else [])


# ---- comparison ----

def count_differences(first, second, columns):
    """Steps in which one of the columns differs, and steps that only one run has."""
    differing = sum(any(one[column] != other[column] for column in columns) for one, other in zip(first.rows, second.rows))
    return differing + abs(len(first.rows) - len(second.rows))


def reports_of(runs, warnings, pattern):
    """What twins have reported about differences."""
    found = [warning for warning in warnings + [warning for run in runs for warning in run.warnings] if pattern.search(warning)]
    for run in runs:
        found += ["flag: rollback differed"] if run.flags & ROLLBACK_DIFFERED else []
        found += ["flag: no rollback"] if run.flags & NO_ROLLBACK else []
        found += [f"verified: {run.summary['verified']['differed']} differed"] if run.summary.get("verified", {}).get("differed") else []
    return sorted(set(found))


def lead_straight(fmu, signals, columns, adjusted, twin, options, folder):
    """Steps in which the FMU, led by FMPy with the inputs that the twin has committed, differs; a text if FMPy cannot lead it.
    A connected input has its first value in initialisation, an adjusted one its nominal."""
    driven = {given.name: columns[f"u{i}"] for i, given in enumerate(signals.inputs) if given not in adjusted}
    applied = {given.name: [float(row[f"fmu.{given.name} applied"]) for row in twin.rows] for given in adjusted}
    initial = {name: values[0] for name, values in driven.items()}
    if not signals.are_parameters:
        initial.update({given.name: nominal_of(given) for given in adjusted})
    component = component_of(fmu.path, signals.description, signals.without)
    case = {"step_ns": round(signals.description.step * 1e9), "start_s": signals.description.start, "stop_s": stop_of(signals),
            "set": component.get("set", {}), "initial": initial, "inputs": {**driven, **applied},
            "outputs": [output.name for output in signals.outputs], "steps": len(twin.rows)}
    (folder / "straight.json").write_text(json.dumps(case), encoding="utf-8")
    log = folder / "straight.log"
    code, out = execute([sys.executable, STRAIGHT, fmu.path, "straight.json"], options.limit, folder, log)
    if code:
        return "not done within --limit" if code == ENDED_BY_LIMIT else last_line(code, log)
    rows = json.loads(out.rstrip().rpartition("\n")[2])
    return sum(any(not same_number(row[column], value) for column, value in zip(signals.columns, values))
               for row, values in zip(twin.rows, rows))


def same_number(cell, value):
    number = float(cell) if cell else math.nan
    return number == value or not math.isfinite(value) and not math.isfinite(number)


def verdict_of(differ, is_reported):
    is_exact = not any(isinstance(count, int) and count for count in differ.values())
    return EXACT if is_exact else REPORTED if is_reported else SILENT


def judge_twin(fmu, signals, columns, adjusted, matched, options, folder):
    """Class and figures of an FMU with adjusted inputs or parameters."""
    measured = {f"y{i}": [0.0] + disturb(output.kind, values, spread) for i, (output, values, spread) in enumerate(matched)}
    driven = {f"u{i}": columns[f"u{i}"] for i, given in enumerate(signals.inputs) if given not in adjusted}
    rest = {output.kind: columns[output.kind] for output in signals.outputs}
    write_recording(folder / "twin.csv", signals, {**driven, **rest, **measured})
    document = twin_configuration(fmu, signals, adjusted, matched, options.swing)
    method, warnings = check(document, options, folder)
    if method == "replay" and signals.steps > MOST_REPLAYED:
        raise TooSlow(method, MOST_REPLAYED)
    saved = replay("twin", document, options, folder)
    plain = replay("twin", document, options, folder, ["--plain"])
    if not saved.rows:
        raise Failure("no step was committed")
    applied = [f"fmu.{given.name} applied" for given in adjusted]
    differ = {"plain": count_differences(saved, plain, signals.columns + applied),
              "straight": lead_straight(fmu, signals, columns, adjusted, saved, options, folder)}
    reports = reports_of([saved, plain], warnings, REPORTS_DIFFERENCE)
    resets = reports_of([saved], [], REPORTS_RESET)
    is_reported = bool(reports) or not differ["plain"] and bool(resets)
    return {"class": verdict_of(differ, is_reported), "method": method, "steps": len(saved.rows), "differ": differ,
            "reports": (reports or resets)[:4], "evaluations": saved.summary.get("evaluations", 0),
            "values": len({tuple(row[column] for column in applied) for row in saved.rows}),
            "adjusted": [given.name for given in adjusted], "matched": [output.name for output, *_ in matched]}


def judge_free(fmu, signals, columns, own, options, folder):
    """Class and figures of an FMU without a variable to adjust: it must repeat its own run, and be rolled back by rollback_probe."""
    again = replay("own", free_configuration(fmu, signals), options, folder, ["--plain"])
    _, warnings = check(free_configuration(fmu, signals), options, folder)
    differ = {"plain": count_differences(own, again, signals.columns),
              "straight": lead_straight(fmu, signals, columns, [], own, options, folder)}
    reports = reports_of([own, again], warnings, REPORTS_DIFFERENCE)
    return {"class": verdict_of(differ, bool(reports)), "method": options.probe(fmu.path, signals.description.step, signals.steps),
            "steps": len(own.rows), "differ": differ, "reports": reports[:4], "evaluations": 0, "values": 0, "adjusted": [], "matched": []}


def judge_run(fmu, signals, options, folder):
    columns, own = record_itself(fmu, signals, options, folder)
    work = max(0.0, own.seconds - STARTUP) * PREDICTION * EVALUATIONS
    if work > options.limit / 2 and signals.steps > LEAST_STEPS:
        raise TooSlow("too slow", int(signals.steps * options.limit / 2 / work))
    adjusted, matched = choose_variables(fmu, signals, columns, own, options, folder)
    if not adjusted or not matched:
        return judge_free(fmu, signals, columns, own, options, folder)
    return judge_twin(fmu, signals, columns, adjusted, matched, options, folder)


def judge_fmu(fmu, options, folder):
    """Makes fewer steps if the FMU is slow."""
    description = describe(fmu.path)
    if description is None:
        raise Failure("no FMU that can be read")
    signals = Signals(description)
    if not signals.outputs:
        raise Failure("no output or local variable")
    signals.steps = max(1, int(min(options.steps, description.most_steps)))
    while True:
        try:
            return judge_run(fmu, signals, options, folder)
        except TooSlow as slow:
            if signals.steps <= LEAST_STEPS:
                raise
            signals.steps = max(LEAST_STEPS, slow.args[1] or signals.steps // 4)


def ask_fmpy(fmu, options, folder):
    """What FMPy says of an FMU that does not run."""
    script = ("import sys, fmpy; d = fmpy.read_model_description(sys.argv[1], validate=False); "
              "fmpy.simulate_fmu(sys.argv[1], validate=False, fmi_type='CoSimulation', stop_time=20 * float(sys.argv[2]), "
              "output_interval=float(sys.argv[2])); print('runs')")
    description = describe(fmu.path)
    step = description.step if description else 0.01
    code, out = execute([sys.executable, "-c", script, fmu.path, repr(step)], min(options.limit, FMPY_LIMIT), folder, folder / "fmpy.log")
    if code == 0 and out.strip().endswith("runs"):
        return "runs"
    return "not done within --limit" if code == ENDED_BY_LIMIT else last_line(code, folder / "fmpy.log")


def last_line(code, log):
    """The end of a Python traceback."""
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"ended by signal {-code}" if code < 0 else (lines or ["?"])[-1][:160]


def judge(fmu, options):
    """The result of one FMU."""
    result = {"fmu": fmu.name, "exporter": fmu.exporter}
    with tempfile.TemporaryDirectory(prefix="twinlock-exactness-") as name:
        folder = Path(name)
        try:
            return {**result, **judge_fmu(fmu, options, folder)}
        except (Failure, ValueError, KeyError) as failure:
            why = failure.args[0] if isinstance(failure, Failure) else f"{type(failure).__name__}: {failure}"
            return {**result, "class": FAILS, "why": why.replace(str(folder), "").replace(str(fmu.path), fmu.name), "fmpy": ask_fmpy(fmu, options, folder)}


# ---- all of them ----

def key_of(fmu, options):
    """Changes with everything that a result depends on."""
    digest = hashlib.sha256()
    for file in fmu.path, options.program, Path(__file__):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    digest.update(repr((fmu.name, options.steps, options.limit, options.swing)).encode())
    return digest.hexdigest()


def judge_or_recall(fmu, options, results):
    """The result of an earlier campaign, if the same."""
    kept = results / f"{key_of(fmu, options)}.json" if results else None
    if kept is not None and kept.is_file():
        return json.loads(kept.read_text(encoding="utf-8"))
    result = judge(fmu, options)
    if kept is not None:
        results.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(".part")
        part.write_text(json.dumps(result), encoding="utf-8")
        part.replace(kept)
    return result


def judge_all(fmus, options, jobs, results):
    """The figures of all FMUs; `results`: a folder with results of an interrupted campaign, or None."""
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # numpy for FMUs of PythonFMU
    done = itertools.count(1)

    def judge_one(fmu):
        result = judge_or_recall(fmu, options, results)
        print(f"fmus: [{next(done)}/{len(fmus)}] {fmu.name}: {result['class']}", file=sys.stderr, flush=True)
        return result

    with ThreadPoolExecutor(jobs) as pool:
        found = list(pool.map(judge_one, fmus))
    return {"fmus": found, "classes": dict(Counter(result["class"] for result in found)),
            "methods": dict(Counter(result["method"] for result in found if "method" in result)),
            "searched": sum(result.get("values", 0) > 1 for result in found),
            "steps": sum(result.get("steps", 0) for result in found)}


def is_sound(figures):
    return not figures["classes"].get(SILENT)


def print_table(figures):
    columns = "FMU", "exporter", "rolled back by", "steps", "evaluations", "values of u", "≠ plain", "≠ FMPy", "result"
    print(" | ".join(columns))
    print(" | ".join(["---"] * len(columns)))
    for result in figures["fmus"]:
        start = f"{result['fmu']} | {result['exporter'].strip()}"
        if result["class"] == FAILS:
            fmpy = f"; FMPy: {result['fmpy']}" if result.get("fmpy") else ""
            print(f"{start} | - | 0 | 0 | 0 | - | - | {FAILS}: {result['why']}{fmpy}")
            continue
        reports = f": {'; '.join(result['reports'])}" if result["class"] != EXACT and result["reports"] else ""
        print(f"{start} | {result['method']} | {result['steps']} | {result['evaluations']} | {result['values']} | "
              f"{result['differ']['plain']} | {result['differ']['straight']} | {result['class']}{reports}")
    classes = figures["classes"]
    print(f"\n{len(figures['fmus'])} FMUs: " + ", ".join(f"{classes.get(name, 0)} {name}" for name in (EXACT, REPORTED, SILENT, FAILS)))
    if figures.get("not_fetched"):
        print(f"{figures['not_fetched']} could not be fetched")
    print("rolled back by " + ", ".join(f"{method}: {count}" for method, count in sorted(figures["methods"].items())))
    print(f"{figures['searched']} were searched; {figures['steps']} steps compared")
