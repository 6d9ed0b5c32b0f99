#!/usr/bin/env python3
"""What `check --recording` finds in a recording and proposes; that a twin which follows it is as near to the truth as it must be (script/studies/proposals); and
that a tolerance within the noise is told while a twin runs."""
import json
import os
import sqlite3
from contextlib import closing

import proposals
from twinlock_test import (BAD_DATA, BAD_USAGE, BUILD, PROGRAM, config_path, edited_config, expect, main, run, run_well, scratch, within)

LOCK, RECORDING = config_path("motor/lock.json"), config_path("motor/recording.csv")
SECONDS = 30


def advice(config, recording, *options):
    return json.loads(run_well(["check", config, "--recording", recording, "--json", *options]))


def test_the_truth():
    """A recording of each kind, whose true noise and true speed are known."""
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
    head, snippet = page.split("to be put into the configuration\n")
    expect(max(map(len, head.splitlines()[2:])) <= 80, page)  # the first two name files, wherever these are
    for text in ("440 good readings, one each 0.0323 s", "noise: standard deviation 0.3", "match motor.omega \u2194 plant.omega\n    between \"line\":",
                 "condition low_pass_s 0.02:", "tolerance 1: as it is:", "input plant.torque\n    between \"last\":"):
        expect(text in head, f"{text}\n{page}")
    expect("warnings" not in head, page)
    run_well(["check", edited_config("motor/lock.json", json.loads(snippet))])


def test_a_tolerance_within_the_noise():
    config = edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"tolerance": 0.5}}}})
    page = " ".join(run_well(["check", config, "--recording", RECORDING]).split())
    expect("warnings synchronise.match.motor.omega: its tolerance, 0.5, is below three times the noise of its readings, 0.3" in page, page)
    told = advice(config, RECORDING)
    expect(told["reasons"]["motor.omega"]["within_noise"] is True, f"{told}")
    expect(0.8 < told["proposal"]["synchronise"]["match"]["motor.omega"]["tolerance"] < 1.1, f"{told}")


def events(config):
    """Those about the noise that a replay records, with the steps' flags and outcomes untouched."""
    database = scratch() / "run.db"
    run_well(["replay", config, "--recording", RECORDING, "--db", database])
    with closing(sqlite3.connect(database)) as opened:
        return list(opened.execute("SELECT tick, text FROM events WHERE text LIKE '%three times the noise%'"))


def test_it_is_told_while_it_runs():
    """Once; by the readings as they came, though what is matched is smoother; and not of the configuration as it is."""
    found = events(edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"tolerance": 0.5}}}}))
    expect(len(found) == 1 and 0 < found[0][0] < 1000, f"{found}")
    expect(found[0][1].startswith("motor.omega: its tolerance, 0.5, is below three times the noise of its readings, 0.3"), f"{found}")
    expect(events(LOCK) == [], "the noise of the shipped recording is above a third of the shipped tolerance")


def test_a_run_that_was_recorded():
    """Of a database the readings as they came, one a tick; whether the run looked them up as the configuration does, or not."""
    database = scratch() / "run.db"
    run_well(["replay", LOCK, "--recording", RECORDING, "--db", database])
    csv = advice(LOCK, RECORDING)["signals"]["omega"]
    for config in (LOCK, config_path("motor/a.json")):
        told = advice(config, database, "--run", "1")["signals"]["omega"]
        expect(told["outliers"] == 0 and csv["readings"] - 10 < told["readings"] <= csv["readings"], f"{told}")
        within(told["noise"], csv["noise"], 0.02, "noise, rad/s")


def test_where_nothing_is_synchronised():
    told = advice(config_path("motor/free.json"), RECORDING)
    expect(told["proposal"]["compare"] == {"motor.omega": {"between": "line"}} and "synchronise" not in told["proposal"], f"{told}")


def test_epsilon_stays():
    """Of a match that has no tolerance, none is proposed, but told."""
    told = advice(config_path("motor/c.json"), RECORDING)
    expect("tolerance" not in told["proposal"]["synchronise"]["match"]["motor.omega"], f"{told}")
    expect("the root of epsilon" in told["reasons"]["motor.omega"]["tolerance"], f"{told}")


def test_booleans_and_strokes():
    page = run_well(["check", config_path("cylinder/lock.json"), "--recording", config_path("cylinder/recording.csv")])
    expect("between off and on there is nothing" in " ".join(page.split()) and "blur the instant of the event" in " ".join(page.split()), page)


def refused(code, text, *arguments):
    found, out, err = run(["check", LOCK, *arguments])
    expect(found == code and out == "" and text in err, f"{arguments}: {found}\n{out}{err}")


def test_what_it_refuses():
    folder = scratch()
    refused(BAD_USAGE, "--json needs --recording", "--json")
    refused(BAD_USAGE, "--run needs --recording", "--run", "1")
    refused(BAD_USAGE, "remove --run", "--recording", RECORDING, "--run", "1")
    refused(BAD_DATA, "cannot be opened", "--recording", folder / "none.csv")
    refused(BAD_DATA, "no regular file", "--recording", "/dev/null")
    lacking, short, empty = (folder / name for name in ("lacking.csv", "short.csv", "empty.csv"))
    lacking.write_text("t,omega\n0,1\n1,2\n", encoding="utf-8")
    refused(BAD_DATA, "M_brake", "--recording", lacking)
    short.write_text("t,omega,M_brake\n" + "".join(f"{0.03 * i:.2f},{60 + i % 3},0\n" for i in range(71)), encoding="utf-8")
    refused(BAD_DATA, "plant.omega has 71 good readings, at least 72 are needed", "--recording", short)
    empty.write_text("t,omega,M_brake\n" + "".join(f"{i / 30:.3f},,0\n" for i in range(500)), encoding="utf-8")
    refused(BAD_DATA, "plant.omega has 0 good readings", "--recording", empty)
    broken = folder / "broken.csv"
    broken.write_text("t,omega,M_brake\n0,1,2\n0,1,2\n", encoding="utf-8")
    refused(BAD_DATA, "broken.csv, line 3", "--recording", broken)


if __name__ == "__main__":
    main()
