#!/usr/bin/env python3
"""Limits of a correction: a replay finds when the correction of a weak pump leaves them, and when it is within them again."""
import json

from twinlock_test import SOURCE, at_most, edited_config, expect, expect_line, main, run, run_well, scratch

VESSELS = SOURCE / "config" / "vessels"
BREAKS, MENDED = 120, 270  # s
WEAK = 0.2  # part of the flow that is missing


def weak_plant(folder):
    """The plant of config/vessels whose pump is weak meanwhile; q is 1."""
    rows = [(0, 1), (BREAKS, 1 - WEAK), (MENDED, 1), (420, 1)]
    (folder / "weak.csv").write_text("time,q,q_actual\n" + "".join(f"{at},1,{flow}\n" for at, flow in rows), encoding="utf-8")
    run_well(["plant", VESSELS / "plant.json", "--recording", folder / "weak.csv", "--record", folder / "played.csv"])
    return folder / "played.csv"


def test_a_weak_pump():
    folder = scratch()
    recording = weak_plant(folder)
    config = edited_config(VESSELS / "live.json", {"detect": {"learn_s": 86400, "alarm": {"first.u": {"below": -0.1, "for_s": 20}}}})
    told = json.loads(run_well(["replay", config, "--recording", recording, "--db", folder / "run.db", "--json"]))
    expect(told["detection"]["state"] == "learning", f"{told['detection']}")
    expect(len(told["findings"]) == 1, f"{told['findings']}")
    finding = told["findings"][0]
    expect([finding[key] for key in ("kind", "variable", "subject", "unit", "state")] == ["limit", "first.u", "correction", "", "gone"],
           f"{finding}")
    at_most(abs(finding["onset"] - BREAKS), 3, "error of the onset, s")
    at_most(finding["found"] - BREAKS, 21, "time until it was found, s")
    at_most(abs(finding["gone"] - MENDED), 21, "error of the end, s")
    at_most(abs(finding["size"] + WEAK), 0.03, "error of the size")
    expect_line(finding["text"], "pump|first.u|limits")
    shown = json.loads(run_well(["show", folder / "run.db", "--json", "--events"]))
    expect(shown["findings"][0]["kind"] == "limit" and shown["findings"][0]["onset"] == finding["onset"], f"{shown['findings']}")
    expect([event["severity"] for event in shown["events"] if event["source"] == "finding"][:1] in ([], ["warning"]), f"{shown['events']}")
    expect_line(run_well(["show", folder / "run.db"]), "first.u|limits")


def test_within_the_limits():
    folder = scratch()
    recording = weak_plant(folder)
    config = edited_config(VESSELS / "live.json", {"detect": {"learn_s": 86400, "alarm": {"first.u": {"below": -0.3, "above": 0.3}}}})
    told = json.loads(run_well(["replay", config, "--recording", recording, "--json"]))
    expect(told["findings"] == [], f"{told['findings']}")


def test_a_wrong_name():
    config = edited_config(VESSELS / "live.json", {"detect": {"alarm": {"second.u": {"above": 1}}}})
    code, _, err = run(["check", config])
    expect(code == 65, f"{code}\n{err}")
    expect_line(err, "detect.alarm.second.u|not adjusted")


if __name__ == "__main__":
    main()
