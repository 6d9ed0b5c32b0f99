"""The cases by which two builds are compared; for script/compare.

A case has a name and calls. Each build makes the calls one after the other, in its own folder. Both read the same input files,
and written files have relative names, so that both print the same paths.
"""
import json
import math
import re
import sqlite3
from collections import namedtuple
from pathlib import Path

import compare_facts as facts
from motor_bench import SCENARIOS, SOLVERS, scenario

CONFIG = Path(__file__).resolve().parent.parent / "config"
VERBS = ("check", "replay", "run", "plant", "show")
TABLES = ("outputs", "adjustments", "steps", "samples", "events")

# args: of the program; out: function that reads facts from its standard output; files: {name: function that reads facts from
# it}; needed: if the call fails, there is nothing to compare.
Call = namedtuple("Call", "args out files needed", defaults=(facts.page, {}, False))

# prepare: None, or a function that fills the folder before the calls; database: its name if the case writes one; brief: not
# shown in all forms.
Case = namedtuple("Case", "name calls prepare database brief", defaults=(None, None, False))

BRIEFLY_SHOWN = ([], ["--json"], ["--csv", "steps"])
SHOWN = ([], ["--events"], ["--run", "1"], ["--since", "5s"], ["--json"], ["--json", "--events"], ["--json", "--since", "5s"],
         *(["--csv", name] for name in TABLES))

# Recordings that are not part of the product, and their configurations.
SHARED = {
    "thesis_motor_1.csv": ("motor/free", "motor/lock", "motor/e", "motor/ahead"), "thesis_motor_2.csv": ("motor/lock", "motor/c"),
    "thesis_transport_slow.csv": ("transport/free", "transport/slow"),
    "thesis_cylinder.csv": ("cylinder/free", "cylinder/lock", "cylinder/hold"),
    "tclab_energy_balance.csv": ("tclab/free", "tclab/lock", "tclab/ambient", "tclab/capacity"),
    "pneu_cylinder_oring257_5bar.csv": ("bench_cylinder/free", "bench_cylinder/lock"),
    "emps_train.csv": ("emps/free", "emps/lock", "emps/ahead"),
}
DAMAGED = ("motor/lock", "motor/ahead", "motor/d", "cylinder/lock", "transport/slow", "tclab/lock", "second_order/with",
           "bench_cylinder/lock")


# ---- variants of configurations ----

def _synchronise(**keys):
    return {"synchronise": keys}


def _horizon(prediction, **keys):
    return _synchronise(horizon={"prediction": prediction, **keys})


def _match(**keys):
    return _synchronise(match={"motor.omega": keys})


# {name: (configuration, JSON merge patch)}
VARIANTS = {
    "hold": ("motor/lock", _horizon(3, measurements="hold")),
    "ahead": ("motor/lock", _horizon(3, measurements="ahead", shape="dynamic")),
    "dynamic": ("tclab/lock", _horizon(12, shape="dynamic")),
    "sbplx": ("motor/lock", _synchronise(algorithm="sbplx")),
    "fallback": ("motor/d", _synchronise(algorithm="bobyqa", fallback="nelder-mead", stagnation=4,
                                         budget={"evaluations": 12})),
    "noise_floor": ("motor/lock", _synchronise(noise_floor=5, free_twin=True)),
    "margin": ("motor/lock", _synchronise(algorithm="nelder-mead", margin=0.6)),
    "outputs": ("motor/d", {"components": {"motor": {"keep": "outputs"}}}),
    "nodes": ("motor/c", _synchronise(algorithm="bobyqa", saving={"nodes": 2})),
    "memory": ("tclab/lock", _synchronise(saving={"memory_mb": 1})),
    "structure": ("motor/d", _synchronise(saving={"structure": False})),
    "sequences": ("motor/d", _synchronise(saving={"sequences": False})),
    "huber": ("motor/lock", _match(huber=1.5, tolerance=0.3)),
    "condition": ("motor/lock", _match(condition={"median": 5, "low_pass_s": 0.03, "gate": 8})),
    "penalty": ("motor/lock", _synchronise(adjust={"motor.d": {"penalty": {"deviation": 0.1, "rate": 0.2}}})),
    "bounds": ("motor/lock", _synchronise(adjust={"motor.d": {"min": -0.01, "max": 0.05}})),
    "two": ("motor/lock", _synchronise(adjust={"drive.P": {"step": 0.1}}, horizon={"prediction": 2},
                                       algorithm="nelder-mead")),
    "delays": ("motor/lock", {"delays": {"input": 0.02, "output": -0.03, "take": "newest"}}),
    "dwell": ("transport/slow", _synchronise(adjust={"belt2.enabled": {"dwell_s": 0.5}})),
    "stroke": ("cylinder/lock", _synchronise(algorithm="bobyqa")),
    "short": ("motor/lock", {"duration_s": 3, "step_s": 0.005}),
    "initial": ("motor/lock", {"plant": {"omega": {"initial": 60, "min": 20, "max": 70}}}),
    "logging": ("motor/free", {"components": {"motor": {"logging": True}}}),
}


def _merged(value, change):
    if not isinstance(change, dict):
        return change
    merged = dict(value) if isinstance(value, dict) else {}
    for key, inner in change.items():
        merged[key] = _merged(merged.get(key), inner)
    return merged


def _read(name):
    """A configuration that can be used from any folder."""
    path = CONFIG / f"{name}.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    if "file" in document.get("recording", {}):
        document["recording"]["file"] = str(path.parent / document["recording"]["file"])
    return document


def _write(folder, name, document):
    path = folder / f"{name.replace('/', '-')}.json"
    path.write_text(json.dumps(document, indent=1), encoding="utf-8")
    return path


# ---- recordings ----

def write_damaged(path, source):
    """A copy of a recording with invalid, empty and far too large cells, and with missing rows."""
    head, *rows = source.read_text(encoding="utf-8").splitlines()
    kept = [head]
    for i, row in enumerate(rows):
        part, (time, *cells) = 100 * i / len(rows), row.split(",")
        if 10 <= part < 13 or 60 <= part < 61:
            cells[0] = "x"
        elif 25 <= part < 30:
            cells = [""] * len(cells)
        elif 40 <= part < 43 and i % 3 == 0:
            cells[-1] = "1e9"
        elif 80 <= part < 82:
            cells[-1] = "nan"
        if not 70 <= part < 75:
            kept.append(",".join([time, *cells]))
    path.write_text("\n".join(kept) + "\n", encoding="utf-8")
    return path


def write_carriage(path):
    """A recording for config/emps, which has none: a carriage of 91.3 kg that is pushed to and fro."""
    rows = ["time,force,position,velocity_est"]
    for i in range(3001):
        t = i / 1000
        force = 300 * math.sin(2 * t) + 91.3 * 0.8 * math.cos(4 * t)
        rows.append(f"{t:.3f},{force!r},{0.05 * (1 - math.cos(4 * t))!r},{0.2 * math.sin(4 * t)!r}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


# ---- cases ----

def _replays(config, recording, quick):
    """The calls that replay a configuration."""
    given = [config, *(["--recording", recording] if recording else [])]
    steps = {"steps.csv": facts.table}
    if quick:
        return [Call(["replay", *given, "--json", "--csv", "steps.csv", "--db", "run.db"], facts.document, steps, True)]
    return [
        Call(["replay", *given, "--json", "--csv", "steps.csv", "--db", "run.db", "--report", "replay.html"], facts.document,
             {**steps, "replay.html": facts.report}, True),
        Call(["replay", *given, "--plain", "--csv", "plain.csv", "--db", "run.db"], facts.page, {"plain.csv": facts.table}),
        Call(["replay", config, "--recording", "run.db", "--run", "1", "--csv", "-"], facts.table),
    ]


def _plants(config):
    return [Call(["plant", config, "--record", f"plant-{seed}.csv", "--seed", seed], facts.words,
                 {f"plant-{seed}.csv": facts.table}, True) for seed in ("1", "2")]


def _replay_case(name, config, recording, quick, emulates=False):
    """A case. Also checks its configuration, unless another case has the same one."""
    kind = name.split("/")[0]
    checks = [] if quick or kind in ("damaged", "shared") else [Call(["check", config, "--variables"], facts.checked)]
    calls = [*checks, *_replays(config, recording, quick), *(_plants(config) if emulates else [])]
    return Case(name, calls, database="run.db", brief=kind in ("scenario", "variant", "damaged", "shared"))


def _configured(inputs, quick):
    """All of config/: replayed if there is a recording, else checked."""
    carriage = write_carriage(inputs / "carriage.csv")
    for path in sorted(CONFIG.glob("*/*.json")):
        if path.parent.name == "schema":
            continue
        name, document = f"{path.parent.name}/{path.stem}", json.loads(path.read_text(encoding="utf-8"))
        recording = carriage if path.parent.name == "emps" else None
        if recording or "file" in document.get("recording", {}):
            yield _replay_case(name, path, recording, quick, "emulate" in document)
        else:
            yield Case(name, [Call(["check", path], facts.checked, {}, True), Call(["replay", path])])


def _made(inputs, quick):
    """Scenarios, variants, and damaged recordings."""
    for letter in SCENARIOS:
        for solver in SOLVERS:
            name = f"scenario/{letter}-{solver}"
            yield _replay_case(name, _write(inputs, name, scenario(letter, solver)), None, quick)
    for name, (base, change) in VARIANTS.items():
        name = f"variant/{name}"
        yield _replay_case(name, _write(inputs, name, _merged(_read(base), change)), None, quick)
    for base in DAMAGED:
        recording = write_damaged(inputs / f"{base.replace('/', '-')}.csv", Path(_read(base)["recording"]["file"]))
        yield _replay_case(f"damaged/{base}", CONFIG / f"{base}.json", recording, quick)


def _shared(folder, quick):
    for recording, names in SHARED.items() if folder else ():
        if (folder / recording).is_file():
            for name in names:
                yield _replay_case(f"shared/{Path(recording).stem}/{name}", CONFIG / f"{name}.json", folder / recording, quick)


def _help():
    asked = [[], ["--help"], ["-h"], ["help"], ["--version"], *([verb, option] for verb in VERBS for option in ("--help", "-h")),
             *(["help", verb] for verb in VERBS)]
    return Case("help", [Call(args, facts.words) for args in asked])


# ---- invalid input ----

def _prepare(folder):
    """Writes invalid files, and some valid ones."""
    good = json.dumps(_read("motor/lock"), indent=1)
    documents = {
        "lock": good, "empty": "", "array": "[]", "cut": good[:len(good) // 2], "comma": good.replace('"name"', ', "name"', 1),
        "twice": good.replace('"step_s"', '"name"', 1), "deep": "[" * 1000, "tail": good + "x", "huge": good + " " * 262144,
        "mark": "\ufeff" + good, "nul": good.replace("1", "\0", 1), "number": good.replace("0.01", "1e999", 1),
    }
    edits = {
        "unknown": {"nome": 1}, "type": {"step_s": "x"}, "range": {"step_s": -1}, "version": {"twinlock": 2},
        "many": {"step_s": -1, "duration_s": "x", "nome": 3, "plant": {"torque": {"min": 5, "max": 1}}},
        "fmu": {"components": {"drive": {"fmu": "nowhere.fmu"}}}, "set": {"components": {"drive": {"set": {"reff": 1}}}},
        "refused": {"components": {"drive": {"set": {"t_step": -1}}}},
        "unit": {"plant": {"torque": {"unit": "m"}}}, "integer": {"plant": {"torque": {"type": "integer"}}},
        "variable": _synchronise(match={"motor.nothing": {"to": "plant.omega", "tolerance": 1}}),
        "signal": _match(to="plant.nothing"), "solver": _synchronise(algorithm="newton"), "bounds": _horizon(0),
        "distance": _synchronise(horizon={"prediction": 1}, adjust={"drive.P": {"step": 1}}),
        "fixed": _synchronise(adjust={"motor.J": {"step": 1}}), "both": {"compare": {"motor.omega": {"to": "plant.omega"}}},
        "source": {"plant": {"omega": {"can": {"source": "none", "id": 1, "start": 0, "length": 8}}}},
        "open": {"connect": [["plant.omega", "drive.y"]]}, "recording": {"recording": {"file": "absent.csv"}},
    }
    documents.update({name: json.dumps(_merged(_read("motor/lock"), edit), indent=1) for name, edit in edits.items()})
    for name, text in documents.items():
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    (folder / "bytes.json").write_bytes(bytes(range(256)))
    tables = {"empty": "", "head": "t,omega,M_brake\n", "column": "t,omega\n0,1\n", "time": "time,omega,M_brake\n0,1,2\n",
              "back": "t,omega,M_brake\n0,1,2\n1,1,2\n0.5,1,2\n", "cells": "t,omega,M_brake\n0,1\n",
              "noon": "t,omega,M_brake\nnoon,1,2\n", "doubled": "t,omega,omega,M_brake\n0,1,2,3\n",
              "one": "t,omega,M_brake\n0,62.9,0\n", "long": "t,omega,M_brake\n0," + "1" * 100000 + ",2\n"}
    for name, text in tables.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    (folder / "notes.db").write_text("dear diary\n" * 100, encoding="utf-8")
    (folder / "cut.db").write_bytes(b"SQLite format 3\0" + bytes(8000))
    connection = sqlite3.connect(folder / "other.db")
    connection.execute("CREATE TABLE mine (x)")
    connection.commit()
    connection.close()
    (folder / "folder").mkdir()
    (folder / "link.csv").symlink_to("one.csv")
    (folder / "dangling.db").symlink_to("absent")


CONFIGS = ("empty", "array", "cut", "comma", "twice", "deep", "tail", "huge", "mark", "nul", "number", "bytes", "unknown", "type",
           "range", "version", "many", "fmu", "set", "refused", "unit", "integer", "variable", "signal", "solver", "bounds",
           "distance", "fixed", "both", "source", "open", "recording")
RECORDINGS = ("empty", "head", "column", "time", "back", "cells", "noon", "doubled", "one", "long")

READERS = {"check": facts.checked, "replay": facts.page}  # of input that is accepted

USAGE = (
    "nonsense", "--nonsense", "Replay lock.json", *VERBS, *(f"{verb} --nonsense lock.json" for verb in VERBS),
    *(f"{verb} absent" for verb in VERBS), *(f"{verb} folder" for verb in VERBS), "check lock.json lock.json",
    "check lock.json --call-limit", "check lock.json --call-limit 0", "check lock.json --call-limit x", "check --variables",
    "replay lock.json --recording", "replay lock.json --json=yes", "replay lock.json --recording absent.csv",
    "replay lock.json --recording folder", "replay lock.json --recording one.csv --run 1", "replay lock.json --run x",
    "replay lock.json --csv", "replay lock.json --csv folder", "replay lock.json --csv absent/x.csv",
    "replay lock.json --csv /dev/full", "replay lock.json --csv lock.json", "replay lock.json --recording one.csv --csv link.csv",
    "replay lock.json --db", "replay lock.json --db folder", "replay lock.json --db absent/x.db", "replay lock.json --db notes.db",
    "replay lock.json --db other.db", "replay lock.json --db dangling.db", "replay lock.json --recording notes.db",
    "replay lock.json --recording cut.db", "replay lock.json --recording other.db", "replay lock.json --report",
    "replay lock.json --report folder", "replay lock.json --report absent/x.html", "replay lock.json --report lock.json",
    "replay lock.json --csv - --json", "replay lock.json --csv x --report x",
    "run lock.json", "run lock.json --duration 0", "run lock.json --duration x", "run lock.json --duration 1e300",
    "run lock.json --db notes.db", "run lock.json --watchdog", "run lock.json --watchdog-timeout x", "run lock.json --state x",
    "plant lock.json", "plant lock.json --seed x", "plant lock.json --seed -1", "plant lock.json --seed 1.5",
    "plant lock.json --fifo a --record b", "plant lock.json --record lock.json", "plant lock.json --record absent/x.csv",
    "plant lock.json --for absent.json", "plant lock.json --for empty.json", "plant lock.json --recording absent.csv",
    "show notes.db", "show cut.db", "show other.db", "show dangling.db", "show lock.json", "show --json",
    "show other.db --csv everything", "show other.db --csv", "show other.db --run", "show other.db --run x",
    "show other.db --since x", "show other.db --since", "show other.db other.db",
)


def _refused():
    configs = [[verb, f"{name}.json"] for name in CONFIGS for verb in ("check", "replay", "run", "plant")]
    recordings = [["replay", "lock.json", "--recording", f"{name}.csv"] for name in RECORDINGS]
    recordings += [["plant", "lock.json", "--recording", f"{name}.csv", "--record", f"{name}-plant.csv"] for name in RECORDINGS]
    usage = [text.split() for text in USAGE] + [["replay", "lock.json", "--db", ""], ["check", ""], [""]]
    for name, group in (("configurations", configs), ("recordings", recordings), ("usage", usage)):
        yield Case(f"refused/{name}", [Call(args, READERS.get(args[0], facts.words)) for args in group], _prepare)
    known = [["show", "run.db", *args.split()] for args in ("--run 9", "--run 0", "--since 2026-11-21", "--csv x", "--since 9x")]
    known += [["replay", "lock.json", "--recording", "run.db", "--run", run] for run in ("9", "0", "x")]
    record = Call(["replay", "lock.json", "--db", "run.db"], needed=True)
    yield Case("refused/databases", [record, *(Call(args, facts.words) for args in known)], _prepare)


def shown(name, is_brief):
    """The calls that show a database in all forms, or in the usual ones, and as a report."""
    outs = {"--json": facts.document, "--csv": facts.table}
    forms = BRIEFLY_SHOWN if is_brief else SHOWN
    calls = [Call(["show", name, *form], outs.get(form[0] if form else "", facts.page)) for form in forms]
    return [*calls, Call(["show", name, "--report", "show.html"], facts.words, {"show.html": facts.report})]


def all_cases(inputs, recordings, quick, only):
    """The cases whose names match. Their input files are written into the folder `inputs`."""
    cases = [*_configured(inputs, quick), *_made(inputs, quick), *_shared(recordings, quick)]
    if not quick:
        cases += [_help(), *_refused()]
    return [case for case in cases if re.search(only, case.name)]
