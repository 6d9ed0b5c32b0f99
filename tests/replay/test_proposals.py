#!/usr/bin/env python3
"""`check --recording`: its findings and proposals. A twin with the proposed settings is near enough to the truth, as in
script/studies/proposals. A running twin warns about a tolerance within the noise."""
import json
import os
import sqlite3
from contextlib import closing

import proposals
from twinlock_test import (BAD_DATA, BAD_USAGE, BUILD, PROGRAM, config_path, edited_config, expect, expect_line, has_line, main, run, run_well,
                           scratch, within)

LOCK, RECORDING = config_path("motor/lock.json"), config_path("motor/recording.csv")
SECONDS = 30


def advice(config, recording, *options):
    return json.loads(run_well(["check", config, "--recording", recording, "--json", *options]))


def test_the_truth():
    """Recordings of each kind, with known noise and true speed."""
    os.environ["TWINLOCK_FMU_PATH"] = str(BUILD / "fmus")
    for kind in proposals.KINDS:
        row = proposals.measure(PROGRAM, kind, 1, SECONDS)
        print(f"    {kind}: noise {row['found']:.3f} (truly {row['noise']:.3f}), true MSE {row['proposed']:.4f} "
              f"(shipped {row['shipped']:.4f}, alone {row['alone']:.4f}) with {row['proposal']}")
        expect(not proposals.misses([row]), f"{kind}: {proposals.misses([row])}")
        expect((row["proposal"]["condition"] or {}).get("gate") is not None if kind == "2 % outliers" else row["outliers"] < 3, f"{kind}: {row}")


def test_for_a_program():
    told = advice(LOCK, RECORDING)
    omega = told["signals"]["omega"]
    within(omega["noise"], 0.3, 0.15, "noise, rad/s")
    expect(omega["readings"] == 440 and omega["bad"] == omega["outliers"] == omega["repeats"] == 0, f"{omega}")
    expect(omega["every_median_s"] < omega["every_95_s"] < omega["every_99_s"] <= omega["every_worst_s"] < 0.0401, f"{omega}")
    expect(not (omega["cut"] or omega["polled"] or omega["switched"] or omega["too_fast"]) and omega["counted_in"] is None, f"{omega}")
    proposal = told["proposal"]
    expect(proposal["plant"] == {"torque": {"between": "last"}, "omega": {"every_s": 0.04}}, f"{proposal}")
    match = proposal["synchronise"]["match"]["motor.omega"]
    expect(match == {"between": "line", "condition": {"gate": None, "median": None, "low_pass_s": 0.02}, "tolerance": 1}, f"{match}")
    reasons = told["reasons"]
    expect(set(reasons) == {"motor.omega", "plant.torque"} and all(reasons["motor.omega"][key] for key in ("between", "condition", "tolerance")), f"{reasons}")
    expect(reasons["motor.omega"]["within_noise"] is False, f"{reasons}")
    run_well(["check", edited_config("motor/lock.json", proposal)])


def test_for_a_person():
    page = run_well(["check", LOCK, "--recording", RECORDING])
    head, brace, snippet = page.partition("\n{")
    expect(max(map(len, head.splitlines()[2:])) <= 80, page)  # the first two lines have paths of any length
    for parts in ("plant.omega|440|0.0323 s", "noise|0.312 rad/s", "match motor.omega|plant.omega", 'between|"line"|0.0161 s', "low_pass_s|0.02",
                  "tolerance|1|3.2|0.312", "input plant.torque", 'between|"last"|0.0308 N.m'):
        expect_line(head, parts)
    expect("warnings" not in head, page)
    run_well(["check", edited_config("motor/lock.json", json.loads(brace + snippet))])


WITHIN_NOISE = "motor.omega|tolerance|0.5|noise|0.312"


def test_a_tolerance_within_the_noise():
    config = edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"tolerance": 0.5}}}})
    page = run_well(["check", config, "--recording", RECORDING])
    expect_line(" ".join(page.partition("\nwarnings\n")[2].split()), f"synchronise.match.{WITHIN_NOISE}")
    told = advice(config, RECORDING)
    expect(told["reasons"]["motor.omega"]["within_noise"] is True, f"{told}")
    expect(0.8 < told["proposal"]["synchronise"]["match"]["motor.omega"]["tolerance"] < 1.1, f"{told}")


def events(config):
    """The events about noise that a replay records."""
    database = scratch() / "run.db"
    run_well(["replay", config, "--recording", RECORDING, "--db", database])
    with closing(sqlite3.connect(database)) as opened:
        return list(opened.execute("SELECT tick, text FROM events WHERE text LIKE '%noise%'"))


def test_a_running_twin_warns():
    """There is one warning, about the raw readings, although the matched ones are smoother. The shipped configuration has none."""
    found = events(edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"tolerance": 0.5}}}}))
    expect(len(found) == 1 and 0 < found[0][0] < 1000, f"{found}")
    expect_line(found[0][1], "motor.omega|tolerance|0.5|noise")
    expect(events(LOCK) == [], "a warning about the shipped configuration")


def test_a_database_as_recording():
    """The raw readings of a database are analysed, one per tick, also if the run had other settings than the configuration."""
    database = scratch() / "run.db"
    run_well(["replay", LOCK, "--recording", RECORDING, "--db", database])
    csv = advice(LOCK, RECORDING)["signals"]["omega"]
    for config in (LOCK, config_path("motor/a.json")):
        told = advice(config, database, "--run", "1")["signals"]["omega"]
        expect(told["outliers"] == 0 and csv["readings"] - 10 < told["readings"] <= csv["readings"], f"{told}")
        within(told["noise"], csv["noise"], 0.02, "noise, rad/s")


def test_a_free_running_twin():
    told = advice(config_path("motor/free.json"), RECORDING)
    expect(told["proposal"]["compare"] == {"motor.omega": {"between": "line"}} and "synchronise" not in told["proposal"], f"{told}")


def test_epsilon_stays():
    """With epsilon, no tolerance is proposed, and the reason names epsilon."""
    told = advice(config_path("motor/c.json"), RECORDING)
    expect("tolerance" not in told["proposal"]["synchronise"]["match"]["motor.omega"], f"{told}")
    expect_line(told["reasons"]["motor.omega"]["tolerance"], "epsilon")


def test_booleans_and_strokes():
    page = run_well(["check", config_path("cylinder/lock.json"), "--recording", config_path("cylinder/recording.csv")])
    extended = page.partition("match cylinder.extend_signal")[2].partition("match cylinder.airflow")[0]
    expect_line(" ".join(extended.split()), '"last"|Real|condition none|horizon.event')


def refused(code, parts, *arguments):
    found, out, err = run(["check", LOCK, *arguments])
    expect(found == code and out == "" and has_line(err, parts), f"{arguments}: {found}, wanted {parts}\n{out}{err}")


def test_wrong_options_and_recordings():
    folder = scratch()
    refused(BAD_USAGE, "--run|--recording", "--run", "1")
    refused(BAD_USAGE, f"{RECORDING}|run 1|--run", "--recording", RECORDING, "--run", "1")
    refused(BAD_DATA, "none.csv|No such file", "--recording", folder / "none.csv")
    refused(BAD_DATA, "/dev/null|recording", "--recording", "/dev/null")
    lacking, short, empty = (folder / name for name in ("lacking.csv", "short.csv", "empty.csv"))
    lacking.write_text("t,omega\n0,1\n1,2\n", encoding="utf-8")
    refused(BAD_DATA, "lacking.csv|line 1|\"M_brake\"", "--recording", lacking)
    short.write_text("t,omega,M_brake\n" + "".join(f"{0.03 * i:.2f},{60 + i % 3},0\n" for i in range(71)), encoding="utf-8")
    refused(BAD_DATA, "short.csv|plant.omega|71|72", "--recording", short)
    empty.write_text("t,omega,M_brake\n" + "".join(f"{i / 30:.3f},,0\n" for i in range(500)), encoding="utf-8")
    refused(BAD_DATA, "empty.csv|plant.omega|0|72", "--recording", empty)
    broken = folder / "broken.csv"
    broken.write_text("t,omega,M_brake\n1,1,2\n0,1,2\n", encoding="utf-8")
    refused(BAD_DATA, "broken.csv|line 3|0.000000000 s", "--recording", broken)


if __name__ == "__main__":
    main()
