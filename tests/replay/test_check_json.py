#!/usr/bin/env python3
"""`check --json`: the facts of the page as one object, also if there are problems."""
import json
import re

from hostile_fmu import config as hostile_config
from hostile_fmu import make
from twinlock_test import BAD_DATA, SOURCE, edited_config, expect, main, run, run_well, scratch

FMU_FAILED = 70
LOCK = SOURCE / "config/motor/lock.json"


def checked(path, code=0):
    ended, out, _ = run(["check", path, "--json"])
    expect(ended == code, f"ended with {ended}, wanted {code}")
    said = json.loads(out)
    expect(said["configuration"] == str(path), said["configuration"])
    expect((code == 0) == ("components" in said) and (code == 0) == (said["problems"] == []), f"{said}")
    return said


def line_of(path, text):
    return next(number for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if text in line)


def test_the_facts_are_those_of_the_page():
    said = checked(LOCK)
    page = run_well(["check", LOCK])
    expect(said["warnings"] == [] and said["determinism"] == "same" and said["determinism_text"] == "", f"{said}")
    expect(list(said["components"]) == ["drive", "motor"], f"{said['components']}")
    for name, component in said["components"].items():
        expect(re.search(rf"  {name} .*\n? *(rolled back by its {component['rollback']}|can save its state)", page), f"{name}: {component}")
        expect(component["keep"] in ("states", "none") and 0 < component["execution_s"] < 1, f"{component}")
    expect(said["connections"] == [["plant.torque", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"]],
           f"{said['connections']}")
    distance, prediction, unknowns = map(int, re.search(r"T_D = (\d+), T_P = (\d+), static: (\d+)", page).groups())
    lead = int(re.search(r"at tick i \+ (\d+)", page)[1])
    expect(said["horizon"] == {"distance": distance, "prediction": prediction, "unknowns": unknowns, "lead": lead},
           f"{said['horizon']}")
    reaction = said["reactions"]["motor.d"]
    moved = re.search(r"which moves (\S+) by (\S+) rad/s within T_P,\n +by (\S+) within (\S+) s, half of it in (\S+) s", page)
    expect(reaction["output"] == moved[1] and f"{reaction['within_prediction']:.3g}" == moved[2], f"{reaction}")
    worst = int(re.search(r"worst step +(\d+) executions", page)[1])
    cost = said["cost"]
    expect((cost["step_executions"], cost["worst_executions"], cost["budget_s"]) == (3, worst, 0.006), f"{cost}")
    expect(0 < cost["step_s"] and 0 < cost["worst_s"] and cost["memory_bytes"] > 1024, f"{cost}")


def test_a_free_run_has_no_search():
    said = checked(SOURCE / "config/motor/free.json")
    expect(said["reactions"] == {} and said["horizon"]["unknowns"] == 0, f"{said}")
    expect(said["cost"]["worst_s"] is None and said["cost"]["budget_s"] is None, f"{said['cost']}")


def test_warnings():
    path = edited_config("vessels/live.json", {"synchronise": {"horizon": {"prediction": 2}}})
    warning, = checked(path)["warnings"]
    expect(warning["place"] == "synchronise.adjust.first.u" and warning["line"] >= 1, f"{warning}")
    expect("whole tolerance" in warning["text"] and not warning["text"].startswith(warning["place"]), f"{warning}")


def problems_of(text, code=BAD_DATA):
    path = scratch() / "own.json"
    path.write_text(text, encoding="utf-8")
    return path, checked(path, code)["problems"]


def test_problems_of_the_text():
    text = LOCK.read_text(encoding="utf-8")
    path, problems = problems_of(text.replace('"step_s": 0.01', '"step_s": 0').replace('"plant.omega"', '"plant.omg"'))
    found = {problem["place"]: problem for problem in problems}
    expect(set(found) == {"step_s", "synchronise.match.motor.omega.to"}, f"{found}")
    for place, part in (("step_s", '"step_s"'), ("synchronise.match.motor.omega.to", '"plant.omg"')):
        expect(found[place]["line"] == line_of(path, part), f"{found[place]}")
    expect(found["step_s"]["text"].startswith("found 0 "), f"{found['step_s']}")


def test_problems_that_are_at_no_key():
    _, problems = problems_of('{"twinlock": 1,\n , }')
    expect([(problem["place"], problem["line"]) for problem in problems] == [(None, 2)], f"{problems}")
    path = scratch() / "missing.json"
    problems = checked(path, BAD_DATA)["problems"]
    expect([(problem["place"], problem["line"]) for problem in problems] == [(None, None)], f"{problems}")


def test_problems_of_the_fmus():
    document = {"twinlock": 1, "name": "x", "step_s": 0.01, "components": {"motor": {"fmu": "motor.fmu", "set": {"none": 1}}},
                "plant": {"torque": {}}, "connect": [["plant.torque", "motor.M_w"]]}
    path, problems = problems_of(json.dumps(document, indent=1))
    found = {problem["place"]: problem for problem in problems}
    expect({"components.motor.set.none", "components.motor"} <= set(found), f"{problems}")
    expect(found["components.motor.set.none"]["line"] == line_of(path, '"none"'), f"{found}")


def test_an_fmu_that_crashes():
    fmu = make("end", AT="fmi2DoStep", HOW="abort();")
    said = checked(hostile_config(fmu), FMU_FAILED)
    expect(any("crashed" in problem["text"] for problem in said["problems"]), f"{said}")


def test_a_recording_has_its_own_object():
    said = json.loads(run_well(["check", LOCK, "--recording", SOURCE / "config/motor/recording.csv", "--json"]))
    expect("proposal" in said and "problems" not in said, f"{list(said)}")


main()
