#!/usr/bin/env python3
"""Start and end of the time of FMUs: by the configuration, the descriptions and an earlier run."""
import csv
import json
import re
import sqlite3
import zipfile
from contextlib import closing

from twinlock_test import FMUS, SOURCE, edited_config, expect, expect_line, main, replay_csv, run, run_well, scratch

MOTOR, LATE = "motor.omega", 64800
DECLARED = 'startTime="0" stopTime="10"'


def described(name, experiment):
    """The path of a copy of an FMU of ours with another DefaultExperiment; "": none."""
    path = scratch() / f"{name}.fmu"
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            content = old.read(entry)
            if entry == "modelDescription.xml":
                text = re.sub("<DefaultExperiment[^>]*>", experiment and f"<DefaultExperiment {experiment}/>", content.decode())
                content = text.encode()
            new.writestr(entry, content)
    return str(path)


def late_rows():
    """The recording of the motor bench, with times that begin at LATE."""
    path = scratch() / "late.csv"
    with open(SOURCE / "config" / "motor" / "recording.csv", encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    column = head.index("t")
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([head, *([*row[:column], repr(float(row[column]) + LATE), *row[column + 1:]] for row in rows)])
    return str(path)


def bench(name, late=True, experiment="", others="", **edits):
    """The motor bench, whose brake torque an FMU reads from rows by its own time."""
    reader = {"fmu": described("csv", experiment), "set": {
        "file": late_rows() if late else str(SOURCE / "config" / "motor" / "recording.csv"), "time_column": "t", "column1": "M_brake"}}
    components = {"brake": reader, **{part: {"fmu": described(part, others)} for part in ("motor", "drive")}}
    return edited_config(f"motor/{name}.json", {
        "components": components, "plant": {"torque": None},
        "connect": [["brake.y1", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"]], **edits})


def by_zero(name):
    return replay_csv(bench(name, late=False))[MOTOR]


def recorded(database):
    with closing(sqlite3.connect(database)) as rows:
        return rows.execute("SELECT start_s, stop_s FROM runs ORDER BY run DESC LIMIT 1").fetchone()


def test_declared_start():
    expect(replay_csv(bench("free", experiment=f'startTime="{LATE}"'))[MOTOR] == by_zero("free"), "the speed differs")


def test_configured_start():
    for name in ("free", "lock"):
        found = replay_csv(bench(name, experiment=DECLARED, start_s=LATE))[MOTOR]
        expect(found == by_zero(name), f"{name}: the speed differs")
    early = replay_csv(bench("free", experiment=DECLARED))[MOTOR]
    expect(early != by_zero("free"), "the start is not used")


def test_negative_start():
    expect(replay_csv(bench("free", late=False, start_s=-2))[MOTOR] != by_zero("free"), "the start is not used")


def test_fmus_that_differ():
    edits = {"components": {"motor": {"fmu": described("motor", DECLARED)}}}
    config = json.loads(bench("free", experiment=f'startTime="{LATE}"').read_text())
    config["components"]["motor"].update(edits["components"]["motor"])
    path = scratch() / "config.json"
    for start, code in ((None, 65), (LATE, 0)):
        path.write_text(json.dumps({**config, **({} if start is None else {"start_s": start})}), encoding="utf-8")
        found, _, err = run(["replay", path])
        expect(found == code, f"exit code {found}\n{err}")
        if code != 0:
            expect_line(err, 'error|components.|64800|0|DefaultExperiment|"start_s"')


def test_a_replay_begins_as_its_run():
    """The database knows the start, even if the description has changed since."""
    database = scratch() / "run.db"
    config = bench("lock", experiment=f'startTime="{LATE}"')
    first = replay_csv(config, "--db", database)[MOTOR]
    start, stop = recorded(database)
    expect(start == LATE and LATE + 14 < stop < LATE + 15, f"recorded: {start} … {stop}")
    document = json.loads(config.read_text())
    with zipfile.ZipFile(document["components"]["brake"]["fmu"]) as archive:
        expect(f'startTime="{LATE}"' in archive.read("modelDescription.xml").decode(), "not described")
    other = scratch() / "config.json"
    document["components"]["brake"]["fmu"] = described("csv", 'startTime="7"')
    other.write_text(json.dumps(document), encoding="utf-8")
    again = scratch() / "again.db"
    found = replay_csv(other, "--recording", database, "--db", again)[MOTOR]
    expect(found == first[:len(found)] and found, "the replay differs")
    expect(recorded(again) == (start, stop), f"recorded: {recorded(again)}")
    shown = json.loads(run_well(["show", database, "--json"]))
    expect([(one["start_s"], one["stop_s"]) for one in shown["runs"]] == [(start, stop)], f"{shown['runs']}")


def test_an_fmu_that_ends_itself():
    """Our FMUs reject a step beyond the stop time that they are given."""
    for edits, experiment, parts in (
            ({"stop_s": 3}, "", 'error|drive|ended itself|3 s|raise "stop_s"'),
            ({"stop_s": 3}, 'startTime="0" stopTime="3"', 'error|drive|ended itself|3 s|DefaultExperiment|"duration_s"')):
        code, _, err = run(["replay", bench("free", late=False, others=experiment, **edits)])
        expect(code == 70, f"exit code {code}\n{err}")
        expect_line(err, parts)


def test_stop_before_the_start():
    for edits, experiment in (({"start_s": 10, "stop_s": 10}, ""), ({"stop_s": 10}, f'startTime="{LATE}"')):
        code, _, err = run(["replay", bench("free", experiment=experiment, **edits)])
        expect(code == 65, f"exit code {code}\n{err}")
        expect_line(err, "error|stop_s|10")


def test_check_names_the_time():
    out = run_well(["check", bench("free", experiment=f'startTime="{LATE}"')])
    expect_line(out, "start|64800 s|DefaultExperiment")
    out = run_well(["check", bench("free", start_s=LATE, stop_s=2 * LATE)])
    expect_line(out, "start|64800 s|start_s")
    expect_line(out, "stop|129600 s|stop_s")


main()
