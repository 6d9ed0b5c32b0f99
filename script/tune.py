"""twinlock-tune: searches settings of a configuration on recordings; `twinlock tune` starts it. See HELP.

Each candidate replays every recording. Released twins (master/sync/released_twin.h) show whether its states were right. All
candidates are compared with the same readings, those without a filter, and with releases of the same duration: a filter must
not look better because its own output is the reference.
"""
import argparse
import concurrent.futures
import copy
import hashlib
import json
import math
import os
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import textwrap
import threading
from pathlib import Path

HELP = """\
usage: twinlock tune CONFIG [options]

Searches tolerance, horizon, pairing, conditioning, evaluations and adjusted
variables with recordings, from CONFIG and what `twinlock check` proposes.
Prints the candidates that no other one beats in released error, executions
and quietness, and recommends one. After Ctrl-C, the same command continues.

  twinlock tune tank.json --recording monday.csv --output tuned.json

options:
  --recording FILE  a recording as for `replay`; may be repeated; default: that
                    of CONFIG
  --output FILE     write the recommended configuration into this new file
  --variables LIST  more variables that may be adjusted: tank.area,pump.gain
  --also LIST       also search: step, algorithm or step,algorithm
  --executions N    most executions per step of the recommended one; default: as
                    many as CONFIG needs
  --trials N        candidates; default: 200

less common options:
  --seed N          seed of the search; default: 1
  --jobs N          replays at the same time (or -j N); default: all cores
  --limit S         a replay that takes S seconds has failed; default: 600
  --results FILE    all results, to continue; default: NAME.tune.jsonl
  --plot FILE       SVG or PNG, needs matplotlib; default: NAME.tune.svg
  --help            this text
"""
BAD_USAGE, NOT_LOCKED, BAD_DATA, FMU_FAILED, TRY_AGAIN = 2, 3, 65, 70, 75
BATCH = 8  # candidates that are asked for together, with any number of jobs: the search is the same
EQUAL = 1.02  # released errors within this factor are equally good: firmware/monitor/horizon_choice.h
CLOSE = 2  # locked errors within this factor are equally good: a closer one may follow noise
COVERED = 0.8  # share of the compared steps that a candidate must have
ROWS = 12  # of the table
GENERATED = 10  # share of the start value that is a first step, 1 / GENERATED
OBJECTIVES = ("released error", "executions", "quietness")


class Refused(Exception):
    """A message for the user, and the exit code."""

    def __init__(self, text, code=BAD_DATA):
        super().__init__(text)
        self.code = code


def say(text, kind="notice"):
    print(f"twinlock: {kind}: {text}", file=sys.stderr, flush=True)


# ---- command line ----

class Parser(argparse.ArgumentParser):
    def format_help(self):
        return HELP

    def error(self, message):
        raise Refused(f"tune: {message}; see `twinlock tune --help`", BAD_USAGE)


def number(least, most):
    def read(text):
        if not re.fullmatch(r"\d{1,9}", text) or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text}: expected a number from {least} to {most}")
        return int(text)
    return read


def positive(text):
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: expected a number above 0")
    return value


def read_options(words):
    parser = Parser(allow_abbrev=False)
    parser.add_argument("config", metavar="CONFIG", type=Path)
    parser.add_argument("--recording", action="append", default=[])
    for name in ("output", "results", "plot"):
        parser.add_argument(f"--{name}", type=Path)
    for name in ("variables", "also"):
        parser.add_argument(f"--{name}", type=lambda text: text.split(","), default=[])
    for name, default, least, most in (("trials", 200, 1, 100000), ("seed", 1, 0, 999999),
                                       ("limit", 600, 1, 86400)):
        parser.add_argument(f"--{name}", type=number(least, most), default=default)
    parser.add_argument("--executions", type=positive)
    parser.add_argument("-j", "--jobs", type=number(1, 256), default=os.cpu_count() or 1)
    options = parser.parse_args(words)
    if not set(options.also) <= {"step", "algorithm"}:
        parser.error(f"--also: {','.join(options.also)}: expected step, algorithm, or both with a comma")
    if options.output and options.output.exists():
        raise Refused(f"{options.output}: exists; remove it, or give --output another file", BAD_USAGE)
    if options.plot and options.plot.suffix.lower() not in (".svg", ".png"):
        parser.error(f"--plot: {options.plot}: expected a name that ends with .svg or .png")
    for path in (options.output, options.results, options.plot):
        if path and not path.parent.is_dir():
            raise Refused(f"{path}: the folder {path.parent} is missing; make it, or give another one", BAD_USAGE)
    options.results = options.results or Path(f"{options.config.stem}.tune.jsonl")
    return options


# ---- configurations ----

def merge(value, change):
    """JSON merge patch (RFC 7396)."""
    if not isinstance(change, dict):
        return change
    merged = dict(value) if isinstance(value, dict) else {}
    for key, inner in change.items():
        if inner is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), inner)
    return merged


def read_config(path):
    """The configuration, whose types find_starts() has checked."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise Refused(f"{path}: {error}") from None
    synchronise = document.get("synchronise", {})
    if not synchronise.get("adjust") or not synchronise.get("match"):
        raise Refused(f"{path}: synchronise.adjust or match is missing: only a twin that is corrected can be tuned")
    if "event" in synchronise.get("horizon", {}):
        raise Refused(f"{path}: synchronise.horizon.event: released twins, which tune needs, do not run with it")
    return document


def moved(document, folder, target):
    """The configuration for another folder: paths that are relative to `folder` become absolute."""
    if folder.resolve() == target.resolve():
        return document
    document = copy.deepcopy(document)
    document.pop("$schema", None)

    def absolute(holder, key):
        if isinstance(holder.get(key), str) and (folder / holder[key]).exists():
            holder[key] = str((folder / holder[key]).resolve())
    for component in document["components"].values():
        absolute(component, "fmu")
        for key in ("libraries", "read"):
            if key in component:
                component[key] = [str((folder / name).resolve()) for name in component[key]]
    for holder in (document.get("recording", {}), *(source.get("csv", {}) for source in document.get("sources", {}).values())):
        absolute(holder, "file")
    return document


def rounded(value):
    return float(f"{value:.3g}")


def settings_of(base, extras, starts, values):
    """The configuration with the values that the search chose. `extras`: variables of --variables; `starts`: start values."""
    document = copy.deepcopy(base)
    sync = document["synchronise"]
    for match in sync["match"].values():
        if match.get("weight", 1) == 0:
            continue
        if "tolerance" in match:
            match["tolerance"] = rounded(match["tolerance"] * values["tolerance"])
        match["between"] = values["between"]
        condition = match.pop("condition", {})
        signal_ = document["plant"].get(match["to"].removeprefix("plant."), {})
        unit_s = condition.get("low_pass_s") or signal_.get("every_s") or document["step_s"]
        condition.update(median=values["median"], low_pass_s=rounded(unit_s * values["low_pass"]))
        condition = {key: value for key, value in condition.items()
                     if not (key == "median" and value == 1 or key == "low_pass_s" and value == 0)}
        if condition:
            match["condition"] = condition
    sync.setdefault("horizon", {}).update(prediction=values["prediction"], measurements=values["measurements"])
    sync.setdefault("budget", {})["evaluations"] = values["evaluations"]
    if "algorithm" in values:
        sync["algorithm"] = values["algorithm"]
        if sync.get("fallback") == values["algorithm"]:
            del sync["fallback"]
    candidates = {**sync["adjust"], **extras}
    chosen = [name for name in candidates if values.get(f"adjust {name}", True)] or list(candidates)[:1]
    sync["adjust"] = {name: adjusted(document, name, candidates[name], values.get("step", 1)) for name in chosen}
    for name in set(sync["adjust"]) ^ set(candidates):
        left_alone(document, name, candidates[name], starts.get(name))
    for name in set(extras) & set(chosen):
        document.setdefault("fill_in", {})[f"synchronise.adjust.{name}"] = "min and max that the plant can have"
    return document


def adjusted(document, name, entry, factor):
    """An entry of `adjust`. A constant in `set` becomes the nominal value, since a variable cannot have both."""
    component, _, variable = name.partition(".")
    constants = document["components"][component].get("set", {})
    entry = {**entry, "step": rounded(entry["step"] * factor)} if "step" in entry else dict(entry)
    if variable in constants:
        entry["nominal"] = constants.pop(variable)
    return entry


def left_alone(document, name, entry, start):
    """A variable of CONFIG that is not adjusted keeps its nominal value, unless it is connected."""
    component, _, variable = name.partition(".")
    value = entry.get("nominal", start)
    is_connected = any(name == target for _, target in document.get("connect", []))
    if not is_connected and isinstance(value, (int, float)) and not isinstance(value, bool):
        document["components"][component].setdefault("set", {}).setdefault(variable, value)


def has_line(document, match):
    """True if readings can be interpolated: that takes the longest time between two."""
    return "every_s" in document["plant"].get(match["to"].removeprefix("plant."), {})


def free_config(document, starts):
    """The twin left alone, compared with readings without a filter."""
    document = copy.deepcopy(document)
    sync = document.pop("synchronise")
    for name, entry in sync["adjust"].items():
        left_alone(document, name, entry, starts.get(name))
    for name, match in sync["match"].items():
        between = "line" if has_line(document, match) else "last"
        document.setdefault("compare", {})[name] = {"to": match["to"], "between": between}
    return document


# ---- replays ----

class Worker:
    """Starts the program; ends all of it that runs when the search ends. Any thread may run()."""

    def __init__(self, folder, limit_s):
        self.folder, self.limit_s = Path(folder), limit_s
        self.program = Path(__file__).parent / "twinlock"
        self.lock, self.running, self.ends, self.count = threading.Lock(), set(), False, 0

    def end(self):
        with self.lock:
            self.ends = True
            for process in self.running:
                process.terminate()

    def name(self):
        with self.lock:
            self.count += 1
            return self.folder / f"{self.count}"

    def run(self, *words):
        """(exit code, stdout, stderr); the code is None after the limit."""
        with self.lock:
            if self.ends:
                raise concurrent.futures.CancelledError
            process = subprocess.Popen([self.program, *map(str, words)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                       stderr=subprocess.PIPE, encoding="utf-8", errors="replace", start_new_session=True,
                                       env={**os.environ, "TMPDIR": str(self.folder)})  # removed with it, also after a kill
            self.running.add(process)
        try:
            out, err = process.communicate(timeout=self.limit_s)
            code = process.returncode
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
            code = None
        with self.lock:
            self.running.discard(process)
            if self.ends:
                raise concurrent.futures.CancelledError
        return code, out, err

    def replay(self, document, recording):
        """(summary, path of its database), or (None, why not). One that dies is repeated once."""
        name = self.name()
        config, database = name.with_suffix(".json"), name.with_suffix(".db")
        config.write_text(json.dumps(document), encoding="utf-8")
        for _ in range(2):
            for path in self.folder.glob(f"{name.name}.db*"):
                path.unlink()
            code, out, err = self.run("replay", config, "--json", "--db", database, *recording)
            if code in (None, 0, NOT_LOCKED, BAD_USAGE, BAD_DATA):
                break
        config.unlink()
        if code in (0, NOT_LOCKED):
            return json.loads(out), database
        reason = f"took {self.limit_s} s" if code is None else (err.strip().splitlines() or [f"ended with {code}"])[-1]
        return None, reason.removeprefix("twinlock: error: ")


def query(database, text):
    connection = sqlite3.connect(database)
    try:
        return connection.execute(text).fetchall()
    finally:
        connection.close()


OUTPUTS = ("SELECT n.name, o.step, o.{}, o.measured, q.name FROM outputs o "
           "JOIN signals n ON n.run = o.run AND n.kind = 'match' AND n.signal = o.signal "
           "JOIN qualities q ON q.code = o.quality ORDER BY o.step")
CORRECTIONS = ("SELECT n.name, a.correction FROM adjustments a JOIN signals n ON n.run = a.run AND n.kind = 'adjust' "
               "AND n.signal = a.signal WHERE a.correction IS NOT NULL ORDER BY a.step")


class Reference:
    """The readings of a recording at each step, and the mean square error of the twin that is left alone."""

    def __init__(self, worker, document, starts, recording, first_step):
        self.recording = recording
        summary, database = worker.replay(free_config(document, starts), recording)
        if summary is None:
            raise Refused(f"the twin without corrections: {database}")
        self.measured, squares = {}, {}
        matched = {name for name, match in document["synchronise"]["match"].items() if match.get("weight", 1) > 0}
        for name, step, simulated, measured, quality in query(database, OUTPUTS.format("simulated")):
            if name in matched and step >= first_step and quality == "good" and None not in (simulated, measured):
                self.measured[name, step] = measured
                squares.setdefault(name, []).append((simulated - measured) ** 2)
        database.unlink()
        self.free = {name: sum(values) / len(values) for name, values in squares.items()}
        if not self.measured or min(self.free.values()) <= 0:
            raise Refused("the recording is too short, or the twin without corrections has no error at all")

    def error(self, database, column):
        """Mean square error of `column` (simulated or released) / that of the twin left alone; None if too few steps have one."""
        squares, found = {name: [] for name in self.free}, 0
        for name, step, value, _, _ in query(database, OUTPUTS.format(column)):
            if value is not None and (name, step) in self.measured:
                squares[name].append((value - self.measured[name, step]) ** 2)
                found += 1
        if found < COVERED * len(self.measured) or not all(squares.values()):
            return None
        return sum(sum(values) / len(values) / self.free[name] for name, values in squares.items()) / len(squares)


def quietness(database, units):
    """Root mean square change of the corrections from step to step, in first steps of the start configuration."""
    before, squares = {}, []
    for name, correction in query(database, CORRECTIONS):
        squares.append(((correction - before.get(name, correction)) / units[name]) ** 2)
        before[name] = correction
    return math.sqrt(sum(squares) / max(1, len(squares)))


class Trial:
    """Figures of candidates over all recordings."""

    def __init__(self, worker, references, units):
        self.worker, self.references, self.units = worker, references, units

    def of(self, document):
        """{"values": [released error, executions, quietness], "locked": error of the locked twin, "worst_s"}, or {"values": None, "why"}."""
        rows = []
        for reference in self.references:
            summary, database = self.worker.replay(document, reference.recording)
            if summary is None:
                return {"values": None, "why": database}
            released, locked = reference.error(database, "released"), reference.error(database, "simulated")
            most = query(database, "SELECT max(evaluations) FROM steps")[0][0]
            quiet = quietness(database, self.units)
            database.unlink()
            if not summary["steps"] or not summary["lock"]["percent"]:
                return {"values": None, "why": "never in lock"}
            if released is None or locked is None:
                return {"values": None, "why": f"too few released steps: {summary['released']['state']}"}
            rows.append((released, locked, summary["executions"]["total"] / summary["steps"], quiet,
                         most * summary["wall_s"] / max(1, summary["evaluations"])))
        released, locked, executions, quiet, worst = zip(*rows)
        count = len(rows)
        return {"values": [math.sqrt(sum(released) / count), sum(executions) / count, sum(quiet) / count],
                "locked": math.sqrt(sum(locked) / count), "worst_s": max(worst)}


# ---- start ----

def check(worker, config, *words):
    """What `twinlock check` prints."""
    code, out, err = worker.run("check", config, *words)
    if code != 0:
        raise Refused(err.strip() or f"check of {config} took more than {worker.limit_s} s", code or TRY_AGAIN)
    return out


def find_starts(worker, config):
    """Start values of the Real inputs and tunable parameters. Refuses an invalid configuration."""
    out = check(worker, config, "--variables")
    component, starts = None, {}
    for line in out.splitlines():
        section = re.match(r"variables of (\S+) ", line)
        entry = re.match(r"  (\S+) +Real .*(?:input|tunable +parameter) +([-+.\de]+)(?: |$)", line)
        component = section[1] if section else component
        if entry and component:
            starts[f"{component}.{entry[1]}"] = float(entry[2])
    return starts


def find_extras(starts, document, wanted):
    """Entries of `adjust` for variables of --variables: a tenth of the start value is the first step."""
    unknown = [name for name in wanted if name not in starts]
    if unknown:
        raise Refused(f"--variables: {unknown[0]}: expected a Real input or tunable parameter with a start value; "
                      "`twinlock check CONFIG --variables` lists them", BAD_USAGE)
    extras = {}
    for name in wanted:
        component, _, variable = name.partition(".")
        value = document["components"][component].get("set", {}).get(variable, starts[name])
        extras[name] = {"step": rounded(abs(value) / GENERATED) or 1.0}
    return {name: entry for name, entry in extras.items() if name not in document["synchronise"]["adjust"]}


def ranges(base, extras, most_prediction, also):
    """(what the search may choose, what it begins with)."""
    from optuna.distributions import CategoricalDistribution as Choice
    from optuna.distributions import FloatDistribution as Float
    from optuna.distributions import IntDistribution as Int
    sync = base["synchronise"]
    horizon, match = sync.get("horizon", {}), next(iter(sync["match"].values()))
    has_lines = all(has_line(base, each) for each in sync["match"].values())
    prediction = min(most_prediction, horizon.get("prediction", 1))
    condition = match.get("condition", {})
    space = {
        "tolerance": (Float(0.5, 4, log=True), 1.0),
        "prediction": (Int(1, max(1, min(most_prediction, max(20, 4 * prediction))), log=True), prediction),
        "measurements": (Choice(["lag", "hold", "ahead"]), horizon.get("measurements", "lag")),
        "between": (Choice(["last", "line"] if has_lines else ["last"]), match.get("between", "last")),
        "low_pass": (Choice([0.0, 0.5, 1.0, 2.0, 4.0]), 1.0 if "low_pass_s" in condition else 0.0),
        "median": (Choice([1, 3, 5]), min(5, condition.get("median", 1))),
        "evaluations": (Int(4, 240, log=True), max(4, min(240, sync.get("budget", {}).get("evaluations", 60)))),
    }
    if "step" in also:
        space["step"] = (Float(0.1, 10, log=True), 1.0)
    if "algorithm" in also:
        space["algorithm"] = (Choice(["secant", "nelder-mead", "bobyqa", "sbplx"]), "secant")
    candidates = [*sync["adjust"], *extras]
    if len(candidates) > 1:
        space.update({f"adjust {name}": (Choice([True, False]), name not in extras) for name in candidates})
    return {name: pair[0] for name, pair in space.items()}, {name: pair[1] for name, pair in space.items()}


# ---- results ----

class Results:
    """JSON lines: what was searched and check's proposal, then a line for each candidate. An incomplete last line is removed
    if the others are of this search."""

    def __init__(self, path, key):
        self.path, self.tune, self.found, self.start = path, key, {}, None
        data = path.read_bytes() if path.exists() else b""
        if not data:
            return
        whole = data[:data.rfind(b"\n") + 1]
        try:
            first, *rows = [json.loads(line) for line in whole.splitlines()]
            is_other = first["tune"] != key
            self.start = {name: first[name] for name in ("proposal", "release_s")}
            self.found = {self.key(row["settings"]): row for row in rows}
        except (ValueError, KeyError, TypeError):
            is_other = True
        if is_other:
            raise Refused(f"{path}: has results of another search; remove it, or give --results another file", BAD_USAGE)
        os.truncate(path, len(whole))

    def begin(self, start):
        """Stores the proposal of check, which depends on the time that steps take, so that a continued search has the same."""
        if not self.start:
            self.start = start
            self.append({"tune": self.tune, **start})

    @staticmethod
    def key(settings):
        return json.dumps(settings, sort_keys=True)

    def append(self, row):
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    def add(self, number, settings, figures):
        row = {"number": number, "settings": settings, **figures}
        self.found[self.key(settings)] = row
        self.append(row)


def pareto(rows):
    """The rows that no other one beats in all objectives; equal ones once, sorted by the released error."""
    kept, seen = [], set()
    for row in rows:
        values = tuple(row["values"])
        if values not in seen and not any(other["values"] != row["values"] and
                                          all(a <= b for a, b in zip(other["values"], values)) for other in rows):
            kept.append(row)
            seen.add(values)
    return sorted(kept, key=lambda row: row["values"])


def recommended(rows, budget_s, most, given):
    """Of those within the budgets (time of a step, executions) whose released errors are as good as the least one, and whose locked twin
    is as close to the readings: the fewest executions. A correction that jumps more than that of CONFIG follows noise: such a row is taken
    only if there is no other."""
    fitting = [row for row in rows if row["worst_s"] <= budget_s and row["values"][1] <= most]
    least = min((row["values"][0] for row in fitting), default=None)
    equal = [row for row in fitting if row["values"][0] <= EQUAL * least]
    close = [row for row in equal if row["locked"] <= CLOSE * min(other["locked"] for other in equal)]
    quiet = [row for row in close if given["values"] and row["values"][2] <= given["values"][2]]
    return min(quiet or close, key=lambda row: row["values"][1:], default=None)


# ---- search ----

class Search:
    """Asks Optuna for batches. It repeats the whole search from its start, but results that are stored are not replayed
    again: a continued search is the same as one that was not interrupted."""

    def __init__(self, space, start, options, results, measure):
        import optuna
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.optuna, self.space, self.options, self.results, self.measure = optuna, space, options, results, measure
        self.study = optuna.create_study(directions=["minimize"] * len(OBJECTIVES))
        self.study.enqueue_trial(start)

    def run(self, pool, progress):
        for first in range(0, self.options.trials, BATCH):
            count = min(BATCH, self.options.trials - first)
            self.study.sampler = self.optuna.samplers.TPESampler(seed=self.options.seed * 100000 + first)
            trials = [self.study.ask(self.space) for _ in range(BATCH)][:count]
            wanted = {Results.key(trial.params): trial for trial in reversed(trials)}
            futures = {pool.submit(self.measure, trial.params): trial for key, trial in reversed(wanted.items())
                       if key not in self.results.found}
            for future in concurrent.futures.as_completed(futures):
                trial = futures[future]
                self.results.add(trial.number, trial.params, future.result())
                progress()
            for trial in trials:
                values = self.results.found[Results.key(trial.params)]["values"]
                state = self.optuna.trial.TrialState
                self.study.tell(trial, values, state=state.COMPLETE if values else state.FAIL)


# ---- report ----

def words_of(settings):
    """The settings of a candidate as text."""
    words = [f"tolerance × {settings['tolerance']:.3g}", f"T_P {settings['prediction']}", settings["measurements"],
             settings["between"], f"low-pass × {settings['low_pass']:g}", f"median {settings['median']}",
             f"{settings['evaluations']} evaluations"]
    if "step" in settings:
        words.append(f"step × {settings['step']:.3g}")
    words += [settings[key] for key in ("algorithm",) if key in settings]
    return ", ".join(words + [name.removeprefix("adjust ") for name, on in settings.items() if name.startswith("adjust ") and on])


def print_table(given, rows, best):
    print("     released error  executions  quietness  worst step\n"
          "          of 1 free    per step      steps          ms")
    if not given["values"]:
        print(f"  given: {given['why']}")
    for row in [given, *rows] if given["values"] else rows:
        name, (released, executions, quiet) = row.get("number", "given"), row["values"]
        print(f"{'*' if row is best else ' '} {name:>5} {released:11.4g} {executions:11.4g} {quiet:10.3g} "
              f"{1000 * row['worst_s']:11.3g}")
        if "settings" in row:
            print(textwrap.fill(words_of(row["settings"]), 78, initial_indent=" " * 8, subsequent_indent=" " * 8))


def report(given, results, budget_s, options):
    """Prints the Pareto table; the recommended row, or None."""
    good = [row for row in results.found.values() if row["values"]]
    most = options.executions or (given["values"][1] if given["values"] else math.inf)
    best = recommended(good, budget_s, most, given)
    rows = pareto(good)
    shown = rows[:ROWS] + ([best] if best and best not in rows[:ROWS] else [])
    print_table(given, shown, best)
    print(f"{len(results.found)} candidates, {len(results.found) - len(good)} failed, {len(rows)} not beaten by another; "
          f"all in\n{options.results}")
    limits = f"{most:.4g} executions and {1000 * budget_s:.3g} ms a step"
    print(f"* recommended: least released error within {limits}" if best else f"none recommended: no candidate is within {limits}")
    return best


def draw(options, results, best):
    good = [row for row in results.found.values() if row["values"]]
    if not good:
        return
    try:
        from matplotlib.figure import Figure
    except ImportError:
        if options.plot:
            say(f"{options.plot}: not drawn: matplotlib is missing; install python3-matplotlib")
        return
    axes = Figure().subplots()
    for some, marker, label in ((good, ".", "all"), (pareto(good), "o", "not beaten"),
                                ([best] if best else [], "*", "recommended")):
        axes.scatter([row["values"][1] for row in some], [row["values"][0] for row in some], marker=marker, label=label)
    axes.set(xlabel="executions per step", ylabel="released error, of 1 free", xscale="log")
    axes.legend()
    path = options.plot or Path(f"{options.config.stem}.tune.svg")
    axes.figure.savefig(path)
    print(f"plot: {path}")


def show_progress(results, trials):
    """A line that is overwritten on a terminal; otherwise a line for each batch."""
    done, terminal = len(results.found), sys.stderr.isatty()
    least = min((row["values"][0] for row in results.found.values() if row["values"]), default=math.nan)
    if terminal or done % BATCH == 0:
        text = f"tune: {done} of at most {trials} candidates, least released error {least:.4g}"
        print(f"\r{text}" if terminal else text, end="" if terminal else "\n", file=sys.stderr, flush=True)


def write_output(path, document, config):
    with path.open("x", encoding="utf-8") as file:
        file.write(json.dumps(moved(document, config.parent, path.parent), indent=2, ensure_ascii=False) + "\n")
    print(f"{path}: written\nnext: twinlock check {path}")


def find_recordings(options, document):
    if options.recording:
        return [("--recording", str(Path(name).resolve())) for name in options.recording]
    own = document.get("recording", {}).get("file")
    if not own:
        raise Refused(f"{options.config}: no recording; give --recording", BAD_USAGE)
    return [("--recording", str((options.config.parent / own).resolve()))]


def content_of(path):
    """The bytes of a file, or of all files of a folder that belong to the recording."""
    files = sorted(file for file in path.iterdir() if file.is_file() and file.name[0] != ".") if path.is_dir() else [path]
    return b"".join(file.read_bytes() for file in files)


def key_of(options, document, recordings):
    """What a search depends on: two with the same key have the same candidates, if check's proposal is the same."""
    contents = ["2", document, sorted(options.variables), sorted(options.also), options.seed,
                [hashlib.sha256(content_of(Path(path))).hexdigest() for _, path in recordings]]
    return hashlib.sha256(json.dumps(contents, sort_keys=True).encode()).hexdigest()


def ask_check(worker, config, recording, step_s):
    said = json.loads(check(worker, config, "--json", *recording))
    return {"proposal": said["proposal"], "release_s": said["horizons"].get("release_s") or 40 * step_s}


def prepare(worker, options):
    """(CONFIG, the same for the worker's folder, with check's proposals, entries of --variables, start values, references,
    first steps, first step that is compared, results)."""
    config = options.config
    starts = find_starts(worker, config)
    document = read_config(config)
    recordings = find_recordings(options, document)
    results = Results(options.results, key_of(options, document, recordings))
    extras = find_extras(starts, document, options.variables)
    given = moved(document, config.parent, worker.folder)
    given.pop("record", None)
    start = results.start or ask_check(worker, config, recordings[0], given["step_s"])
    first_step = round(start["release_s"] / given["step_s"] / 2)
    given["synchronise"]["release_s"] = start["release_s"]
    base = merge(given, start["proposal"])
    references = [Reference(worker, base, starts, recording, first_step) for recording in recordings]
    units = {name: entry.get("step", 1) for name, entry in {**given["synchronise"]["adjust"], **extras}.items()}
    results.begin(start)
    return document, given, base, extras, starts, references, units, first_step, results


def tune(worker, options):
    document, given, base, extras, starts, references, units, first_step, results = prepare(worker, options)
    space, start = ranges(base, extras, first_step, options.also)
    trial = Trial(worker, references, units)
    budget_s = given["synchronise"].get("budget", {}).get("time_s", 0.6 * given["step_s"])
    given_figures = trial.of(given)
    search = Search(space, start, options, results, lambda values: trial.of(settings_of(base, extras, starts, values)))
    is_complete = False
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        try:
            search.run(pool, lambda: show_progress(results, options.trials))
            is_complete = True
        except KeyboardInterrupt:
            worker.end()
            pool.shutdown(cancel_futures=True)
            say("interrupted; the same command continues")
    best = report(given_figures, results, budget_s, options)
    if is_complete and best and options.output:
        chosen = settings_of(merge(document, results.start["proposal"]), extras, starts, best["settings"])
        write_output(options.output, chosen, options.config)
    draw(options, results, best)
    return 0 if is_complete and best else TRY_AGAIN if not is_complete else NOT_LOCKED


def interrupt(*_):
    raise KeyboardInterrupt


def main():
    try:
        options = read_options(sys.argv[2:] if sys.argv[1:2] == ["tune"] else sys.argv[1:])
        try:
            import optuna  # noqa: F401  not before --help
        except ImportError:
            raise Refused("tune: Optuna is missing; install python3-optuna, or start script/bootstrap in a clone", FMU_FAILED) from None
        signal.signal(signal.SIGTERM, interrupt)
        signal.signal(signal.SIGINT, interrupt)
        with tempfile.TemporaryDirectory(prefix="twinlock-tune-") as folder:
            worker = Worker(folder, options.limit)
            try:
                return tune(worker, options)
            finally:
                worker.end()
    except KeyboardInterrupt:
        say("interrupted; the same command continues")
        return TRY_AGAIN
    except OSError as error:
        say(f"{error.filename or error}: {error.strerror}", "error")
        return BAD_DATA
    except Refused as refused:
        text = str(refused)
        print(text if text.startswith("twinlock: ") else f"twinlock: error: {text}", file=sys.stderr)
        return refused.code


if __name__ == "__main__":
    sys.exit(main())
