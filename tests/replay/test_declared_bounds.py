#!/usr/bin/env python3
"""Limits that inputs of FMUs declare: a value of the plant beyond them never reaches the model."""
import math
import sqlite3
import zipfile
from contextlib import closing

from twinlock_test import FMUS, expect, expect_line, expect_no_line, main, replay_csv, replay_json, run_well, scratch, write_config

ROWS, BAD = 300, range(100, 130)
INPUT = '<Real unit="1" start="0"/>'


def fmu(declared, types=""):
    """A copy of lag.fmu with this declaration of its input u."""
    path = scratch() / "lag.fmu"
    with zipfile.ZipFile(FMUS / "lag.fmu") as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            content = old.read(entry)
            if entry == "modelDescription.xml":
                text = content.decode()
                expect(INPUT in text, "the description of lag.fmu has changed")
                at = text.index("<DefaultExperiment") if "<DefaultExperiment" in text else text.index("<ModelVariables")
                if types:
                    at = min(at, text.index("<LogCategories>") if "<LogCategories>" in text else at)
                    text = text[:at] + f"<TypeDefinitions>{types}</TypeDefinitions>" + text[at:]
                content = text.replace(INPUT, declared, 1).encode()
            new.writestr(entry, content)
    return str(path)


def real(limits):
    return f'<Real unit="1" start="0" {limits}/>'


def config(declared, value, types="", inputs=1, **signal):
    """A twin with inputs from plant.u. In the rows BAD that signal has `value`, else good values."""
    rows = scratch() / "rows.csv"
    lines = ["time,u,y"]
    for i in range(ROWS):
        good = 10 + 5 * math.sin(i / 30)
        lines.append(f"{i / 100},{value if i in BAD and value is not None else repr(good)},{good!r}")
    rows.write_text("\n".join(lines) + "\n", encoding="utf-8")
    declared = [declared] if isinstance(declared, str) else declared
    names = [f"c{k}" for k in range(len(declared))]
    return write_config({
        "twinlock": 1, "name": "bounds", "step_s": 0.01,
        "components": {name: {"fmu": fmu(one, types)} for name, one in zip(names, declared)},
        "plant": {"u": {"unit": "1", **signal}, "y": {}}, "recording": {"file": str(rows)},
        "connect": [["plant.u", f"{name}.u"] for name in names],
        "compare": {f"{name}.y": {"to": "plant.y"} for name in names}})


def held():
    """The good value before the bad ones, as text."""
    return repr(10 + 5 * math.sin((BAD[0] - 1) / 30))


def expect_as(declared, value, instead, not_good=0, moved=0, **more):
    """The model gets `instead` in place of the value of the rows BAD."""
    found = config(declared, value, **more)
    wanted = replay_csv(config(INPUT, instead))["c0.y"]
    expect(replay_csv(found)["c0.y"] == wanted, f"{declared} {value}: the model did not get {instead}")
    plant = replay_json(found)["plant"]["u"]
    expect((plant["not_good"], plant["moved"]) == (not_good, moved), f"{declared} {value}: {plant}")


def told(path):
    """(standard output, lines of the recorded events) of a replay."""
    database = scratch() / "run.db"
    out = run_well(["replay", path, "--db", database])
    with closing(sqlite3.connect(database)) as rows:
        return out, "\n".join(text for (text,) in rows.execute("SELECT text FROM events"))


def test_beyond_the_limits():
    for value in ("6553.5", "-1", "50.6"):
        expect_as(real('min="0" max="50"'), value, held(), len(BAD))
    _, events = told(config(real('min="0" max="50"'), "6553.5"))
    expect_line(events, "plant.u|6553.5|0|50|declared by the FMU")


def test_noise_at_a_limit():
    expect_as(real('min="0" max="50"'), "50.4", "50", 0, len(BAD))
    expect_as(real('min="0" max="50"'), "-0.4", "0", 0, len(BAD))
    out, events = told(config(real('min="0" max="50"'), "50.4"))
    expect_line(events, "plant.u|0|50|moved")
    expect(events.count("moved") == 1, events)
    expect_line(out, f"plant.u|{len(BAD)} of {ROWS}|moved")


def test_one_limit():
    expect_as(real('max="50"'), "50.4", "50", 0, len(BAD))
    expect_as(real('max="50"'), "51", held(), len(BAD))
    expect_as(real('max="50"'), "-1e6", "-1e6")
    expect_as(real('min="0"'), "-0.009", "0", 0, len(BAD))
    expect_as(real('min="0"'), "-0.02", held(), len(BAD))
    expect_as(real('min="0" nominal="100"'), "-0.9", "0", 0, len(BAD))


def test_inherited_limits():
    types = '<SimpleType name="Pressure"><Real min="0" max="50"/></SimpleType>'
    expect_as('<Real declaredType="Pressure" start="0"/>', "60", held(), len(BAD), types=types)
    expect_as('<Real declaredType="Pressure" max="100" start="0"/>', "60", "60", types=types)


def test_configured_limits():
    """They apply if they are narrower, and have no tolerance."""
    expect_as(real('min="0" max="50"'), "20.01", held(), len(BAD), max=20)
    expect_as(real('min="0" max="50"'), "50.4", "50", 0, len(BAD), max=70)
    expect_as(real('min="0"'), "-0.9", "0", 0, len(BAD), max=100)
    out = run_well(["check", config(real('min="0" max="50"'), None, max=20)])
    expect_line(out, "plant.u|0|50|declared by c0.u")


def test_several_inputs():
    both = [real('min="0" max="50"'), real('min="-10" max="30"')]
    expect_as(both, "40", held(), len(BAD))
    expect_as(both, "30.2", "30", 0, len(BAD))


def test_limits_that_exclude_each_other():
    """Limits that contradict each other are not used, and check reports them."""
    both = [real('min="0" max="5"'), real('min="20" max="30"')]
    expect_as(both, "40", "40")
    expect_line(run_well(["check", config(both, None)]), "plant.u|20|5|not used")
    out = run_well(["check", config(INPUT, None)])
    expect_no_line(out, "declared by")


def test_initial_value():
    limits = real('min="0" max="50"')
    expect_line(run_well(["check", config(limits, None, initial=60)]), "plant.u.initial|60|0|50|c0.u")
    expect_no_line(run_well(["check", config(limits, None, initial=50)]), "plant.u.initial")


def test_one_value():
    """min = max: a rounding error is not a violation."""
    found = replay_json(config(real('min="12" max="12"'), "12.00000000001"))["plant"]["u"]
    expect((found["not_good"], found["moved"]) == (ROWS - len(BAD), len(BAD)), f"{found}")


def test_a_recorded_run():
    """The database is of a twin without the limits. Its values are checked in the replay."""
    database = scratch() / "run.db"
    run_well(["replay", config(INPUT, "6553.5"), "--db", database])
    declared = config(real('min="0" max="50"'), None)
    wanted = replay_csv(config(INPUT, held()))["c0.y"]
    again = scratch() / "again.db"
    expect(replay_csv(declared, "--recording", database, "--db", again)["c0.y"] == wanted, "the values differ")
    with closing(sqlite3.connect(again)) as rows:
        (count,) = rows.execute("SELECT count(*) FROM samples WHERE signal = 0 AND quality = 2").fetchone()
    expect(count == len(BAD), f"{count} samples are out of range")
    expect(replay_csv(declared, "--recording", again)["c0.y"] == wanted, "the second replay differs")


main()
