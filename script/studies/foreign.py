"""Runs FMUs of others with one or two builds of twinlock: see the command foreign, which builds and starts this."""
import argparse
import contextlib
import csv
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections import namedtuple
from pathlib import Path
from xml.etree import ElementTree

from study import NOT_LOCKED, PROGRAM, Progress, Trouble, print_figures, run_command

# Step if the FMU has none (s), and limits of a configuration.
STEP, LEAST_STEP, LONGEST_STEP = 0.01, 1e-5, 3600.0
MOST_SIGNALS, MOST_COMPARED = 60, 16

# Part of the FMU's own time that is run, because it may end before.
OWN_PART = 0.8

# Modes in which an FMU is run, from the most demanding one.
LOCKED, COMPARED, ALONE = "locked", "compared", "alone"

REFUSED = re.compile(r"(?:asked for|system call) (\w+) (?:denied )?in (\w+)")  # of older builds, too
ENDED_BY_LIMIT = 124

Variable = namedtuple("Variable", "name kind start low high")
Description = namedtuple("Description", "inputs results step most_steps python tunable start")
Program = namedtuple("Program", "path options")


# ---- the description of an FMU ----

def number_of(text):
    """A number or a boolean as a finite number, or None."""
    try:
        number = float({"true": "1", "false": "0"}.get(text, text))
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def read_variable(element):
    kind = element[0]
    low, high = number_of(kind.get("min")), number_of(kind.get("max"))
    return Variable(element.get("name"), kind.tag.lower(), number_of(kind.get("start")), low, high)


def read_steps(root):
    """(its own step, or a hundredth of its own time, in whole nanoseconds; largest number of steps)."""
    experiment = root.find("DefaultExperiment")
    found = {} if experiment is None else experiment.attrib
    time = (number_of(found.get("stopTime")) or 0.0) - (number_of(found.get("startTime")) or 0.0)
    step = number_of(found.get("stepSize")) or time / 100
    step = round(min(max(step, LEAST_STEP), LONGEST_STEP) if step > 0 else STEP, 9)
    return step, int(OWN_PART * time / step) if time > step else math.inf


def has_signal(variable):
    return variable.kind in ("real", "integer", "boolean")


def describe(fmu):
    """Description of an FMU, or None if it cannot be read. Its results are its outputs, or else its local variables."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
            python = "resources/slavemodule.txt" in archive.namelist()
    except (zipfile.BadZipFile, KeyError, ElementTree.ParseError, OSError):
        return None
    by_causality = {"input": [], "output": [], "local": []}
    tunable, experiment = [], root.find("DefaultExperiment")
    start = 0.0 if experiment is None else number_of(experiment.get("startTime")) or 0.0
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        if len(element):
            by_causality.setdefault(element.get("causality", "local"), []).append(read_variable(element))
        if len(element) and (element.get("causality"), element.get("variability")) == ("parameter", "tunable"):
            tunable.append(read_variable(element))
    results = list(filter(has_signal, by_causality["output"])) or list(filter(has_signal, by_causality["local"]))
    return Description(by_causality["input"], results, *read_steps(root), python, tunable, start)


# ---- configuration and recording ----

def value_at(variable, tick, steps):
    """The plant's value of a variable: a sine near the start value and not 0, within the bounds."""
    swing = 1 + 0.5 * math.sin(2 * math.pi * tick / max(steps / 3, 1))
    start = variable.start or 0.0
    if variable.kind == "boolean":
        return float(swing > 1)
    if variable.kind == "integer":
        value = start + round(swing)
    else:
        value = start + 0.01 * max(1.0, abs(start)) * swing
    value = value if variable.low is None else max(value, variable.low)
    return value if variable.high is None else min(value, variable.high)


def constant_of(variable):
    """The value of an input without a signal."""
    if variable.kind == "string":
        return ""
    return False if variable.kind == "boolean" else int(variable.start or 0)


def adjust_and_match(adjusted, matched):
    """`synchronise`: one variable, one result."""
    step = 0.01 * max(1.0, abs(adjusted.start or 0.0))
    nominal = {} if adjusted.start is not None else {"nominal": 0}
    return {"adjust": {f"fmu.{adjusted.name}": {"step": step, **nominal}},
            "match": {f"fmu.{matched.name}": {"to": "plant.y", "tolerance": 0.001}}}


def compare(results):
    """`compare`: the first result, and others of its type."""
    alike = [result for result in results if result.kind == results[0].kind]
    return {f"fmu.{result.name}": {"to": "plant.y"} for result in alike[:MOST_COMPARED]}


def component_of(fmu, description, without_signal):
    """The component, with constants and libraries. It keeps states, so that its executions are always the same."""
    constants = {given.name: constant_of(given) for given in without_signal}
    libraries = [sysconfig.get_config_var("INSTSONAME")] if description.python else []
    return {"fmu": str(fmu), "keep": "states", **({"set": constants} if constants else {}), **({"libraries": libraries} if libraries else {})}


def configure(fmu, description, mode):
    """(configuration, {column: variable}), or None if the FMU does not fit this mode."""
    adjusted = next((given for given in description.inputs if given.kind == "real"), None) if mode == LOCKED else None
    if mode == LOCKED and adjusted is None or mode != ALONE and not description.results:
        return None
    driven = [given for given in description.inputs if has_signal(given) and given is not adjusted][:MOST_SIGNALS]
    columns = {f"u{i}": variable for i, variable in enumerate(driven)}
    columns["y"] = description.results[0] if description.results else Variable("y", "real", 0.0, None, None)
    without_signal = [given for given in description.inputs if given not in driven and given is not adjusted]
    configuration = {
        "twinlock": 1, "name": fmu.stem, "step_s": description.step,
        "components": {"fmu": component_of(fmu, description, without_signal)},
        "plant": {column: {"type": variable.kind} for column, variable in columns.items()},
        "recording": {"file": "recording.csv"},
        "connect": [[f"plant.{column}", f"fmu.{columns[column].name}"] for column in columns if column != "y"],
    }
    if mode == COMPARED:
        configuration["compare"] = compare(description.results)
    if mode == LOCKED:
        configuration["synchronise"] = adjust_and_match(adjusted, columns["y"])
    return configuration, columns


def write_case(folder, configuration, columns, steps):
    (folder / "case.json").write_text(json.dumps(configuration, indent=1), encoding="utf-8")
    lines = [",".join(["time", *columns])]
    for tick in range(steps + 1):
        cells = [repr(value_at(variable, tick, steps)) for variable in columns.values()]
        lines.append(",".join([repr(round(tick * configuration["step_s"], 9)), *cells]))
    (folder / "recording.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


# ---- running it ----

def execute(command, limit, folder, log):
    """(exit code, standard output); ENDED_BY_LIMIT if it took too long. Standard error is written into `log`. Both are files,
    because processes that an FMU has started may keep them open; these processes are killed."""
    with tempfile.TemporaryFile() as out, log.open("wb") as err:
        with subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                              start_new_session=True) as process:
            try:
                code = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = ENDED_BY_LIMIT
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
        out.seek(0)
        return code, out.read().decode(errors="replace")


def first_error(code, err):
    """The reason for which a command failed, in one line."""
    if code == ENDED_BY_LIMIT:
        return "not done within --limit"
    lines = [line for line in err.splitlines() if line.strip()]
    errors = [line for line in lines if "error:" in line] or lines
    reason = errors[0].split("error:")[-1].strip() if errors else ""
    return f"ended by signal {-code}" if code < 0 else reason or f"exit code {code}"


def without_times(document):
    """The JSON object of `replay` without values that depend on the speed of the machine."""
    try:
        found = json.loads(document)
    except ValueError:
        return document
    found.pop("wall_s", None)
    return found


def run_program(program, limit, folder, label):
    """The outcome of one case with one program: {runs, why, codes, refused, csv, json}."""
    codes, refused, told, table = {}, set(), {}, folder / f"{label}.csv"
    why = ""
    for name, command in {"check": ["check", "case.json"],
                          "replay": ["replay", "case.json", "--json", "--csv", table.name]}.items():
        log = folder / f"{label}.{name}.log"
        code, told[name] = execute([program.path, *command, *program.options], limit, folder, log)
        err = log.read_text(encoding="utf-8", errors="replace")
        codes[name] = code
        refused.update(" in ".join(found) for found in REFUSED.findall(err))
        why = why or (f"{name}: {first_error(code, err)}" if code not in (0, NOT_LOCKED) else "")
        if code == ENDED_BY_LIMIT:
            break
    return {"runs": not why, "why": why.replace(str(folder), ""), "codes": codes, "refused": sorted(refused),
            "csv": table.read_bytes() if table.is_file() else b"", "json": without_times(told.get("replay", ""))}


def run_mode(fmu, description, mode, programs, options, folder):
    """{label: outcome} of an FMU in one mode, or None if it does not fit this mode."""
    case = configure(fmu, description, mode)
    if case is None:
        return None
    write_case(folder, *case, min(options.steps, description.most_steps))
    return {label: run_program(program, options.limit, folder, label) for label, program in programs.items()}


def run_fmu(fmu, programs, options, folder):
    """The outcome of an FMU in the first mode in which a program runs it; else in the last."""
    description = describe(fmu)
    if description is None:
        return {"fmu": fmu.name, "mode": None, "why_not_locked": "",
                "outcomes": {label: unreadable() for label in programs}}
    mode, outcomes, not_locked = None, None, ""
    for tried in (LOCKED, COMPARED, ALONE):
        found = run_mode(fmu, description, tried, programs, options, folder)
        if found is None:
            continue
        mode, outcomes = tried, found
        first = next(iter(found.values()))
        if any(outcome["runs"] or ENDED_BY_LIMIT in outcome["codes"].values() for outcome in found.values()):
            break
        not_locked = not_locked or (first["why"] if tried == LOCKED else "")
    return {"fmu": fmu.name, "mode": mode, "why_not_locked": not_locked, "outcomes": outcomes}


def unreadable():
    return {"runs": False, "why": "no FMU that can be read", "codes": {}, "refused": [], "csv": b"", "json": ""}


# ---- all of them ----

def unsteady_columns(first, second):
    """Columns that differ each time an FMU runs, for example a measured time."""
    tables = [list(csv.DictReader(io.StringIO(outcome["csv"].decode()))) for outcome in (first, second)]
    return {column for rows in zip(*tables) for column in rows[0] if rows[0][column] != rows[1][column]}


def steady_part(outcome, unsteady):
    """The table without those columns; if there are none, the bytes, and the JSON object, too."""
    if not unsteady:
        return outcome["csv"], outcome["json"]
    return [{column: cell for column, cell in row.items() if column not in unsteady}
            for row in csv.DictReader(io.StringIO(outcome["csv"].decode()))]


def common_keys(one, other):
    """Two JSON values; of objects only the common keys, because one program may write more keys than the other."""
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return one, other
    pairs = {key: common_keys(one[key], other[key]) for key in one.keys() & other.keys()}
    return {key: pair[0] for key, pair in pairs.items()}, {key: pair[1] for key, pair in pairs.items()}


def same_bits(before, now, unsteady=frozenset()):
    told = common_keys(before["json"], now["json"])
    before, now = {**before, "json": told[0]}, {**now, "json": told[1]}
    return steady_part(before, unsteady) == steady_part(now, unsteady)


def compare_bits(found, programs, options, folder):
    """(True if both are the same, unsteady columns); (None, ...) unless two programs run it. If they differ, the first program runs
    once more, to find unsteady columns."""
    outcomes = found["outcomes"]
    if len(outcomes) < 2 or not all(outcome["runs"] for outcome in outcomes.values()):
        return None, []
    before, now = outcomes.values()
    if same_bits(before, now):
        return True, []
    again = run_program(programs["before"], options.limit, folder, "again")
    unsteady = unsteady_columns(before, again) if again["runs"] else set()
    return same_bits(before, now, unsteady), sorted(unsteady)


def finish(found, programs, options, folder):
    """The report of an FMU: not the results themselves, but whether they are the same."""
    same, unsteady = compare_bits(found, programs, options, folder)
    outcomes = {label: {key: outcome[key] for key in ("runs", "why", "codes", "refused")}
                for label, outcome in found["outcomes"].items()}
    return {**found, "outcomes": outcomes, "same_bits": same, "unsteady": unsteady}


def run_all(fmus, programs, options, top):
    progress, results = Progress(len(fmus)), []
    try:
        for fmu in fmus:
            progress.say(fmu.name)
            folder = top / fmu.stem
            folder.mkdir(parents=True, exist_ok=True)
            results.append(finish(run_fmu(fmu, programs, options, folder), programs, options, folder))
    finally:
        progress.end()
    return results


def is_kept(result):
    """True if it runs now with the same bits, or did not run before."""
    outcomes = result["outcomes"]
    return "before" not in outcomes or not outcomes["before"]["runs"] or result["same_bits"] is True


# ---- the table ----

def yes_or_no(flag):
    return "-" if flag is None else "yes" if flag else "no"


def print_table(figures):
    compared = "before" in figures["programs"]
    width = max([len(result["fmu"]) for result in figures["fmus"]] + [3])
    layout = f"{{:<{width}}}  {{:<9}}" + ("{:<7}" if compared else "") + "{:<5}{:<5}{}"
    heads = ["before", "now"] if compared else ["runs"]
    print(layout.format("FMU", "", *heads, "bits", "denied calls; why it does not run"))
    for result in figures["fmus"]:
        outcomes = result["outcomes"]
        flags = [yes_or_no(outcome["runs"]) for outcome in outcomes.values()]
        now = outcomes["now"]
        unsteady = [f"unsteady: {', '.join(result['unsteady'])}"] if result["unsteady"] else []
        note = "; ".join(now["refused"] + unsteady + ([now["why"]] if now["why"] else []))
        print(layout.format(result["fmu"], result["mode"] or "-", *flags, yes_or_no(result["same_bits"]), note).rstrip())
    for label in figures["programs"]:
        ran = sum(result["outcomes"][label]["runs"] for result in figures["fmus"])
        print(f"{label}: {ran} of {len(figures['fmus'])} run")
    if compared:
        print(f"kept: {sum(map(is_kept, figures['fmus']))} of {len(figures['fmus'])} run as before or did not run before")


# ---- the command ----

def read_arguments():
    parser = argparse.ArgumentParser(prog="script/studies/foreign")
    parser.add_argument("--fmus", type=Path, required=True)
    parser.add_argument("--program", type=Path, default=PROGRAM)
    parser.add_argument("--options", default="")
    parser.add_argument("--before", type=Path)
    parser.add_argument("--before-options")
    parser.add_argument("--only", default="")
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def programs_of(options):
    programs = {}
    if options.before or options.before_options is not None:
        programs["before"] = Program(options.before or options.program, (options.before_options or "").split())
    programs["now"] = Program(options.program, options.options.split())
    return programs


def work():
    options = read_arguments()
    fmus = sorted(fmu for fmu in options.fmus.glob("*.fmu") if options.only in fmu.name)
    if not fmus:
        raise Trouble(f"{options.fmus} has no FMU with {options.only!r} in its name (expected *.fmu)")
    programs = programs_of(options)
    with tempfile.TemporaryDirectory(prefix="twinlock-foreign-") as scratch:
        results = run_all(fmus, programs, options, options.keep or Path(scratch))
    told = {label: [str(program.path), *program.options] for label, program in programs.items()}
    print_figures({"programs": told, "fmus": results}, options.json, print_table)
    return 0 if all(map(is_kept, results)) else 1


if __name__ == "__main__":
    sys.exit(run_command("script/studies/foreign", work, 65))
