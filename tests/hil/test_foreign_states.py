#!/usr/bin/env python3
"""FMUs whose saved states crash another process that loads them, or continue differently there.

A supervisor with a state folder tests this before the run. Without one, the first restart fails,
and the supervisor then remembers it.
"""
import json
import os
import signal
import time

import hostile_fmu
import keeper_fmu
from live_test import Device, Program, member, number, query, wait_until
from supervised import Supervised, end_orderly
from twinlock_test import at_least, at_most, expect, expect_line, expect_no_line, has_line, main, scratch, write_config

STEPS = 150  # of a run, before it is killed
LOADED = "loaded a checkpoint|inputs"  # parts of the event of a twin whose predecessor crashed with its checkpoint
OWN = """SELECT count(*)
         FROM steps s LEFT JOIN beginnings b USING (run)
         WHERE run = ? AND outcome <> 9 AND step >= coalesce(resumed_tick, 0)"""


def make_config(device, fmu=None):
    database = scratch() / "twin.db"
    path = write_config({
        "twinlock": 1, "name": "foreign", "step_s": 0.01,
        "components": {"lag": {"fmu": str(fmu or hostile_fmu.make("foreign_state"))}},
        "sources": {"device": {"modbus_tcp": {"host": "127.0.0.1", "port": device.port, "period_s": 0.005}}},
        "plant": {"y": {"modbus": {"source": "device", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}},
        "synchronise": {"adjust": {"lag.u": {"step": 0.1, "nominal": 1, "min": -20, "max": 20}},
                        "match": {"lag.y": {"to": "plant.y", "tolerance": 0.01}}},
        "record": {"file": str(database), "commit_s": 0.1}})
    return path, database


def wait_for_steps(live, database, run):
    wait_until(lambda: database.exists() and number(database, OWN, run) >= STEPS, f"run {run}", live.log)


def beginnings(database):
    return query(database, "SELECT run, resumed_from FROM beginnings ORDER BY run")


def texts(database, parts=""):
    """The texts of all events that have these parts (see has_line())."""
    return [text for text, in query(database, "SELECT text FROM events") if has_line(text, parts)]


def kill_the_twin(live, database, run):
    """Waits until run `run` + 1 has enough steps. Returns how many starts that took."""
    before = live.account()["starts"]
    child = live.child()
    os.kill(child, signal.SIGKILL)
    wait_for_steps(live, database, run + 1)
    return live.account()["starts"] - before


def remembered(state):
    return json.loads((state / "states.json").read_text(encoding="utf-8"))


def remember(state, why):
    """Changes the saved finding about the same FMUs."""
    kept = {**remembered(state), "why": why}
    (state / "states.json").write_text(json.dumps(kept), encoding="utf-8")


def test_found_before_the_run():
    """Each restart succeeds, and no checkpoint is saved. The same files are tested once; later runs
    report the saved finding."""
    bad = "lag|signal 6|fmi2DeSerializeFMUstate"
    other = "lag|another process|y"
    for fmu, why in ((hostile_fmu.make("foreign_state"), bad), (keeper_fmu.make_false("stranger"), other)):
        with Device(0.6) as device:
            config, database = make_config(device, fmu)
            with Supervised(config) as live:
                wait_for_steps(live, database, 1)
                expect(kill_the_twin(live, database, 1) == 1, live.log())
                expect_line(live.log(), why)
                expect_no_line(live.log(), LOADED)
                state = live.state
                end_orderly(live)
            told = texts(database, "saved|lag")
            expect(len(told) == 1 and has_line(told[0], why), f"{told}")
            expect_line(remembered(state)["why"], why)
            remember(state, "our reason")
            with Supervised(config, state=state) as live:
                wait_for_steps(live, database, 3)
                end_orderly(live)
        expect(texts(database, "our reason"), f"{texts(database)}")
        expect(number(database, "SELECT count(*) FROM checkpoints") == 0, "something was saved")
        expect(beginnings(database)[1] == (2, "inputs"), f"{beginnings(database)}")


def test_states_that_pass():
    """FMUs that pass the test. A saved finding is ignored if its file is damaged, or of other
    FMUs."""
    for kept in (None, "{", '{"of": "0", "why": "others"}'):
        with Device(0.6) as device:
            config, database = make_config(device, hostile_fmu.make("good"))
            state = scratch() / "state"
            if kept is not None:
                state.mkdir()
                (state / "states.json").write_text(kept, encoding="utf-8")
            with Supervised(config, state=state) as live:
                wait_for_steps(live, database, 1)
                expect(kill_the_twin(live, database, 1) == 1, live.log())
                end_orderly(live)
        expect(remembered(state)["why"] == "" and len(remembered(state)["of"]) == 64, f"{remembered(state)}")
        expect(beginnings(database)[1] == (2, "checkpoint"), f"{beginnings(database)}")


def test_ended_during_the_test():
    """It ends at once, although an FMU hangs. No finding is saved, and no folder is left."""
    with Device(0.6) as device:
        config, _ = make_config(device, hostile_fmu.make("hang", AT="fmi2DoStep", CALL=30))
        with Supervised(config) as live:
            member(live, "worker: states")
            begun = time.monotonic()
            end_orderly(live)
            at_most(time.monotonic() - begun, 10, "seconds until it has ended")
            expect(not (live.state / "states.json").exists(), "a finding is saved")
            expect(not list(live.process.temporary.glob("twinlock-*")), "a folder is left")


def test_recorded_during_the_test():
    """A long test is logged, and the plant is recorded during it.

    The test counts neither as a start of the twin nor as a failure. The twin then resumes the run
    before it.
    """
    with Device(0.6) as device:
        config, database = make_config(device, hostile_fmu.make("hang", AT="fmi2Instantiate", SECONDS=6))
        with Supervised(config) as live:
            live.wait_for("saved states|FMU|another process")
            wait_for_steps(live, database, 2)
            expect(remembered(live.state)["why"] == "", f"{remembered(live.state)}")
            expect(live.account()["starts"] == 1, f"{live.account()}\n{live.log()}")
            state = live.state
            live.kill()
        (state / "states.json").unlink()
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 4)
            end_orderly(live)
            expect_line(live.log(), "resume|run 2|checkpoint")
    expect([verb for (verb,) in query(database, "SELECT verb FROM runs ORDER BY run")] == 2 * ["hold", "run"], f"{query(database, 'SELECT * FROM runs')}")
    expect(dict(beginnings(database))[4] == "checkpoint", f"{beginnings(database)}")
    at_least(number(database, "SELECT count(*) FROM samples WHERE samples.run = 1"), 1000, "samples during the test")
    expect(texts(database, "saved states|FMUs|plant"), f"{texts(database)}")


def test_crashes_during_the_test():
    """States that crash the test are not used, and not tested again."""
    with Device(0.6) as device:
        config, database = make_config(device, hostile_fmu.make("end", AT="fmi2DoStep", CALL=30, HOW="abort();"))
        with Supervised(config) as live:
            live.wait_for("saved states|fmi2DoStep|lag")
            state = live.state
            live.end(signal.SIGTERM)
        why = remembered(state)["why"]
        expect_line(why, "fmi2DoStep|lag")
        remember(state, "our reason")
        with Supervised(config, state=state) as live:
            live.wait_for("our reason|checkpoints")
            live.end(signal.SIGTERM)


def test_finding_that_cannot_be_saved():
    """Without a place for its finding, the test is repeated."""
    with Device(0.6) as device:
        config, database = make_config(device)
        state = scratch() / "state"
        (state / "states.json").mkdir(parents=True)
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 1)
            end_orderly(live)
    expect(texts(database, "saved|lag|fmi2DeSerializeFMUstate"), f"{texts(database)}")


def test_without_checkpoints():
    """Without checkpoints there is no test."""
    with Device(0.6) as device:
        config, database = make_config(device)
        content = json.loads(config.read_text(encoding="utf-8"))
        content["record"]["resume_s"] = 0
        config.write_text(json.dumps(content), encoding="utf-8")
        with Supervised(config) as live:
            wait_for_steps(live, database, 1)
            expect(not (live.state / "states.json").exists(), "the states were tested")
            end_orderly(live)


def test_supervised():
    """The saved finding is wrong. After a kill the next twin crashes with the checkpoint, and the
    one after it replays the inputs.

    Then no more checkpoints are saved, and a restarted supervisor does not test again.
    """
    with Device(0.6) as device:
        config, database = make_config(device)
        with Supervised(config) as live:
            wait_for_steps(live, database, 1)
            state = live.state
            end_orderly(live)
        remember(state, "")
        database.unlink()
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 1)
            expect(number(database, "SELECT count(*) FROM checkpoints") > 0, f"nothing was saved\n{live.log()}")
            taken = kill_the_twin(live, database, 1)
            expect(taken == 2, f"{taken} starts\n{live.log()}")
            expect_line(live.log(), "record.resume_s|--state")
            taken = kill_the_twin(live, database, 2)
            expect(taken == 1, f"{taken} starts after the second kill\n{live.log()}")
            expect(int(live.account()["unreadable"], 16) != 0, f"{live.account()}")
            end_orderly(live)
            starts = live.account()["starts"]
        saved = number(database, "SELECT max(run) FROM checkpoints")
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 4)
            end_orderly(live)
            expect(live.account()["starts"] == starts + 1, f"{live.account()}\n{live.log()}")
    expect([came for _, came in beginnings(database)[1:]] == 3 * ["inputs"], f"{beginnings(database)}")
    expect(saved == 1 and number(database, "SELECT max(run) FROM checkpoints") == 1, f"run {saved} has saved some")
    expect(len(texts(database, LOADED)) == 1, f"{texts(database)}")
    expect(texts(database, "saved state|FMUs|process"), f"{texts(database)}")


def test_cold():
    """The whole run is killed. The database's checkpoint crashes the next twin, but not the one
    after it."""
    with Device(0.6) as device:
        config, database = make_config(device)
        with Program("run", config) as live:
            wait_for_steps(live, database, 1)
            live.kill()
        with Program("run", config, "--supervise") as live:  # without --state there is no test
            wait_for_steps(live, database, 2)
            expect(texts(database, "start 2"), live.log())
            expect_line(live.log(), "fmi2DeSerializeFMUstate")
            code, _, log = live.end(signal.SIGTERM)
            expect(code == 0, f"ended with {code}\n{log}")
    expect(beginnings(database)[1:] == [(2, "start")], f"{beginnings(database)}")
    expect(len(texts(database, LOADED)) == 1, f"{texts(database)}")


if __name__ == "__main__":
    main()
