#!/usr/bin/env python3
"""Boolean and Integer signals in the recording, connections, cache, objective, database and its replay.

The twin is a message path (process → event_to_cyclic). Its Boolean input is adjusted until its held state equals the plant's."""
import filecmp
import json
import sqlite3
from contextlib import closing

from twinlock_test import edited_config, expect, expect_line, has_line, main, read_config, read_table, replay_json, run_well, scratch, write_config

STEP_S = 0.05
TICKS = 81
U, HELD, COUNT = "process.enabled1", "event_to_cyclic.enabled1", "process.messages"


def told(tick):
    """The command: on from tick 20 to 60."""
    return 20 <= tick < 60


def shown(tick):
    """The state of the plant: it is on 10 ticks later, with an interruption."""
    return 30 <= tick < 62 and not 40 <= tick < 45


def messages(tick):
    """The plant's count of changes of its state."""
    return sum(shown(t) != shown(t - 1) for t in range(tick + 1))


def configuration():
    """The path of a configuration, with its recording in the same folder."""
    folder = scratch()
    rows = [f"{tick * STEP_S:.2f},{told(tick):d},{shown(tick):d},{messages(tick)}" for tick in range(TICKS)]
    (folder / "plant.csv").write_text("time,told,shown,messages\n" + "\n".join(rows) + "\n")
    return write_config({
        "twinlock": 1,
        "name": "message path",
        "step_s": STEP_S,
        "components": {
            "process": {"fmu": "process.fmu", "set": {"enabled2": False}},
            "event_to_cyclic": {"fmu": "event_to_cyclic.fmu", "set": {"valid2": False, "value2": False}},
        },
        "plant": {"told": {"type": "boolean"}, "shown": {"type": "boolean"}, "messages": {"type": "integer"}},
        "recording": {"file": "plant.csv"},
        "connect": [["plant.told", U], ["process.valid1", "event_to_cyclic.valid1"],
                    ["process.value1", "event_to_cyclic.value1"], [COUNT, "event_to_cyclic.messages"]],
        "synchronise": {
            "adjust": {U: {}},
            "match": {HELD: {"to": "plant.shown", "tolerance": 0.5},
                      COUNT: {"to": "plant.messages", "weight": 0},
                      "event_to_cyclic.missed": {"to": "plant.messages", "weight": 0}},
        },
    }, folder)


def csv_file(config, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", path, *options])
    return path


def expect_same(one, other, what):
    expect(filecmp.cmp(one, other, False), f"{what}: the values differ")


def select(path, sql):
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        return database.execute(sql).fetchall()


# ---- the twin ----

def test_it_follows():
    """The twin has the state of the plant in each step but the first."""
    rows = read_table(csv_file(configuration()))
    y, y_hat, u, nominal = rows[HELD], rows["plant.shown"], rows[U], rows[f"{U} nominal"]
    expect(len(y) == TICKS - 2, f"{len(y)} steps")
    expect(y[1:] == y_hat[1:], f"held {y}\nshown {y_hat}")
    expect(set(u) == set(nominal) == {0.0, 1.0}, f"u is one of {set(u)}, nominal one of {set(nominal)}")
    expect(nominal == [float(told(i)) for i in range(len(u))], "nominal differs from the command")
    expect(u == [float(shown(i + 2)) for i in range(len(u))], "u differs from the state two ticks later")
    expect(max(rows["evaluations"]) <= 2, f"{max(rows['evaluations'])} evaluations in a step")


def test_integers():
    """Counts pass a connection and stay whole numbers."""
    rows = read_table(csv_file(configuration()))
    expect(rows["event_to_cyclic.missed"] == [0.0] * (TICKS - 2), "messages were missed")
    counted = rows[COUNT]
    expect(counted == [float(messages(i + 2)) for i in range(len(counted))], f"counted {counted}")
    expect(rows["plant.messages"] == [float(messages(i + 1)) for i in range(len(counted))], "the plant's count")


def test_integers_of_the_plant():
    """With the plant's own count, the number of missed messages is the difference to that count."""
    config = configuration()
    connect = [pair for pair in read_config(config)["connect"] if pair[0] != COUNT]
    config = edited_config(config, {"connect": connect + [["plant.messages", "event_to_cyclic.messages"]]})
    missed = read_table(csv_file(config))["event_to_cyclic.missed"]
    expect(missed == [float(messages(i) - messages(i + 1)) for i in range(TICKS - 2)], f"missed {missed}")
    expect(set(missed) == {0.0, -1.0}, f"missed {set(missed)}")


def test_metrics():
    result = replay_json(configuration())
    expect(result["match"][HELD]["max"] <= 1 and result["match"][HELD]["unit"] == "", f"{result['match'][HELD]}")
    expect(result["match"][HELD]["mse"] == 0, f"{result['match'][HELD]}")
    expect(result["adjust"][U]["first"] in (0, 1) and result["adjust"][U]["last"] in (0, 1), f"{result['adjust']}")
    components = result["ledger"]["components"].values()
    expect(all(entry["predicted"] >= entry["executions"] and entry["saved"] > 0 for entry in components), f"{components}")


def test_bad_values():
    """A Boolean is 0 or 1, an Integer is whole. Other values are bad, and the last good value is used."""
    config = configuration()
    path = config.parent / "plant.csv"
    wanted = read_table(csv_file(config))
    lines = path.read_text().splitlines()
    expect(lines[36] == f"{35 * STEP_S:.2f},1,1,{messages(35)}", lines[36])
    for cells in ("2,0.5,0.5", "-1,1.5,1e10", "x,truth,nan"):
        path.write_text("\n".join([*lines[:36], f"{35 * STEP_S:.2f},{cells}", *lines[37:]]) + "\n")
        database = scratch() / "run.db"
        found = read_table(csv_file(config, "--db", database))
        expect(found[U] == wanted[U] and found[HELD] == wanted[HELD], f"{cells}: the twin follows a bad value")
        bad = select(database, "SELECT value, quality FROM v_samples WHERE tick = 35 ORDER BY name")
        expect(all(quality in ("out of range", "not a number") for _, quality in bad) and len(bad) == 3, f"{cells}: {bad}")


# ---- saved and recorded ----

def test_saving_changes_nothing():
    config = configuration()
    expect_same(csv_file(config), csv_file(config, "--plain"), "--plain")
    saved, plain = (replay_json(config, *options)["executions"]["total"] for options in ((), ("--plain",)))
    expect(saved < 0.6 * plain, f"{saved} executions of {plain}")


def test_database_and_back():
    config, database = configuration(), scratch() / "run.db"
    rows = csv_file(config, "--db", database)
    expect_same(rows, csv_file(config, "--recording", database), "replay of the database")
    types = dict(select(database, "SELECT DISTINCT name, type FROM signals"))
    wanted = {"plant.told": "Boolean", "plant.shown": "Boolean", "plant.messages": "Integer", HELD: "Boolean",
              COUNT: "Integer", "event_to_cyclic.missed": "Integer", U: "Boolean"}
    expect({name.replace("plant.", ""): kind for name, kind in types.items()} ==
           {name.replace("plant.", ""): kind for name, kind in wanted.items()}, f"types: {types}")
    values = {value for value, in select(database, "SELECT DISTINCT applied FROM adjustments UNION SELECT nominal FROM adjustments")}
    expect(values == {0, 1}, f"u and nominal in the database: {values}")


def test_show():
    config, database = configuration(), scratch() / "run.db"
    rows = read_table(csv_file(config, "--db", database))
    page = run_well(["show", database])
    expect_line(page, U)
    expect_line(page, "0 off|1 on")
    expect(all(line == line.rstrip() for line in page.splitlines() if U in line), f"blanks at the end of lines:\n{page}")
    shown_json = json.loads(run_well(["show", database, "--json"]))
    expect(shown_json["adjust"][U]["min"] == 0 and shown_json["adjust"][U]["max"] == 1, f"{shown_json['adjust']}")
    samples = scratch() / "samples.csv"
    samples.write_text(run_well(["show", database, "--csv", "samples"]))
    again = csv_file(config, "--recording", samples)
    expect(read_table(again)[U] == rows[U] and read_table(again)[HELD] == rows[HELD], "replay of show --csv samples")


def test_tables():
    config = configuration()
    table = run_well(["replay", config, "--verbose"])
    on = read_table(csv_file(config))[U]
    expect_line(table, f"{U}|on|{100 * sum(on) / len(on):.1f} %|last off|nominal")
    expect_line(table, f"{HELD}|MSE 0")
    out = run_well(["check", config])
    expect_line(out, f"adjust|{U}|off or on")
    last = out.splitlines()[-1]
    expect(has_line(last, "no problem found") and "warning" not in last and "0.2 s" not in out, out)
    resting = edited_config(config, {"synchronise": {"adjust": {U: {"dwell_s": 0.2}}}})
    expect_line(run_well(["check", resting]), f"adjust|{U}|off or on|0.2 s")


main()
