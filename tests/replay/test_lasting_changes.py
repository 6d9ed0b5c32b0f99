#!/usr/bin/env python3
"""What has changed since when: a replay of some days finds a broken actuator and a wrong sensor, and nothing in a healthy plant."""
import json
import sqlite3
from contextlib import closing

import faults
from twinlock_test import at_most, expect, expect_line, main, run, run_well, scratch

DAYS, SEED = 2.5, 2
AT = (DAYS - 1.4) * faults.DAY
ALLOWED_S = 120  # largest error of an onset that these plants allow: their commands are held for 300 s and more


def measured(plant, fault):
    row = faults.measure(plant, SEED, DAYS, fault, AT)
    print(row["texts"])
    expect(row["watches"], "still learning")
    expect(row["false"] == 0, f"false findings: {row['texts']}")
    return row


def expect_found(plant, fault, variable):
    row = measured(plant, fault)
    expect(row["found"] == 1, f"not one finding: {row['texts']}")
    expect(row["variable"] == variable, row["variable"])
    at_most(abs(row["onset_error_s"]), ALLOWED_S, "error of the onset, s")
    return row


def test_a_healthy_plant():
    measured("vessels", None)


def test_a_weak_pump():
    row = expect_found("vessels", "pump -10 %", "first.u")
    at_most(abs(row["percent"] + 10), 1.5, "error of the size, %")


def test_a_weak_heater():
    row = expect_found("tclab", "heater -20 %", "board.Q1")
    expect(row["causes"] == ["plant"], row["causes"])
    at_most(abs(row["percent"] + 20), 2, "error of the size, %")


def test_a_wrong_sensor():
    row = expect_found("tclab", "T1 +0.5 K", "board.Q1")
    expect("plant.T1" in row["causes"], row["causes"])


def test_sentences():
    """A replay that is too short to learn says so; the table has the sentence of a finding."""
    folder = scratch()
    bench = faults.Bench("tclab", folder, SEED, DAYS, "T1 +0.5 K", AT)
    config = bench._write(faults.merge(bench.lock, {"duration_s": 20000}))
    told = run_well(["replay", config, "--recording", bench.recording])
    expect_line(told, "changes|learning")
    config = bench._write(faults.merge(bench.lock, {"duration_s": bench.length - 1}))
    told = run_well(["replay", config, "--recording", bench.recording, "--db", folder / "run.db"])
    expect_line(told, "board.Q1|since")
    found = json.loads(run_well(["show", folder / "run.db", "--json", "--events"]))
    events = [event for event in found["events"] if event["source"] == "finding"]
    expect(events and events[0]["severity"] == "warning", f"events: {events}")
    expect(any("board.Q1" in event["text"] for event in events), f"events: {events}")
    expect(any("sensor plant.T1" in event["text"] for event in events), f"no cause: {events}")
    ticks = [event["tick"] for event in events]
    expect(ticks == sorted(ticks) and ticks[0] >= AT, f"events: {events}")


def learned_states(database):
    with closing(sqlite3.connect(database)) as opened:
        return opened.execute("SELECT state FROM learned").fetchall()


def test_findings_in_a_database():
    """What a user does with findings; the page begins with them, and a second replay replaces nothing."""
    folder = scratch()
    bench = faults.Bench("tclab", folder, SEED, DAYS, "heater -20 %", AT)
    database, page = folder / "run.db", folder / "page.html"
    config = bench._write(faults.merge(bench.lock, {"duration_s": bench.length - 1}))
    run_well(["replay", config, "--recording", bench.recording, "--db", database])
    told = run_well(["show", database])
    expect_line(told, "1 lasting change is open")
    expect_line(told, "board.Q1|since t =")
    run_well(["show", database, "--report", page])
    html = page.read_text(encoding="utf-8")
    changes = html[html.index('<section id="changes">'):html.index('<section id="figures">')]
    expect("1 lasting change is open" in changes and "board.Q1: correction" in changes and 'class="open" data-time=' in changes, changes)

    for arguments, code in ((["finding", database], 2), (["finding", database, "--acknowledge", "9"], 65), (["finding", page, "--acknowledge", "1"], 65),
                            (["learn", folder / "none.db"], 65), (["learn"], 2),
                            (["finding", database, "--acknowledge", "1", "--note", "x" * 1001], 2),
                            (["finding", database, "--acknowledge", "1", "--note", "\udcff"], 2),
                            (["finding", database, "--acknowledge", "1", "--normal", "1"], 2), (["finding", database, "--normal", "0"], 2),
                            (["finding", database, "--normal", "9"], 65), (["finding", page, "--normal", "1"], 65)):
        expect(run(arguments)[0] == code, f"{arguments}: not {code}")
    with closing(sqlite3.connect(database)) as other:
        other.execute("BEGIN IMMEDIATE")
        expect(run(["learn", database])[0] == 75, "locked, and yet it ended well")
    run_well(["finding", database, "--acknowledge", "1", "--note", "fuse < 5 A"])
    expect_line(run_well(["show", database]), "acknowledged by|fuse < 5 A")
    found = json.loads(run_well(["show", database, "--json"]))["findings"][0]
    expect(found["note"] == "fuse < 5 A" and found["acknowledged_by"] and found["state"] == "open", found)

    run_well(["finding", database, "--normal", "1", "--note", "new heater"])
    found = json.loads(run_well(["show", database, "--json"]))["findings"][0]
    expect(found["state"] == "normal" and found["note"] == "new heater", found)
    expect_line(run_well(["show", database]), "no lasting change")
    expect_line(run(["finding", database, "--normal", "1"])[2], "finding 1|normal already")

    short = bench._write(faults.merge(bench.lock, {"duration_s": 20000}))
    run_well(["replay", short, "--recording", bench.recording, "--db", database])
    expect(learned_states(database) == [("watching",)], "a short replay has replaced what was learnt")
    expect(json.loads(run_well(["show", database, "--json"]))["findings"] == [], "findings of another replay")
    run_well(["learn", database])
    expect_line(run_well(["show", database, "--run", "1"]), "accepted|normal")
    run_well(["replay", short, "--recording", bench.recording, "--db", database])
    expect(learned_states(database) == [("learning",)], "after `learn` a replay stores what it has learnt")


if __name__ == "__main__":
    main()
