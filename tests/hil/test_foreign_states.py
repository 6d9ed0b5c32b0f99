#!/usr/bin/env python3
"""FMUs whose saved states end the process that loads them, unless it has made them, or go on otherwise there. Who keeps an account finds that out before the run; else one start is lost by
it, and no second one, nor by who comes later."""
import json
import os
import signal
import time

import hostile_fmu
import keeper_fmu
from live_test import Device, Program, member, number, query, wait_until
from supervised import Supervised, end_orderly
from twinlock_test import at_least, at_most, expect, main, scratch, write_config

STEPS = 150  # of a run, before it is killed
LOADED = "the twin before has ended as it loaded a checkpoint"
OWN = """SELECT count(*) FROM steps LEFT JOIN beginnings USING (run) WHERE run = ? AND outcome <> 9 AND step >= coalesce(resumed_tick, 0)"""


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


def texts(database, words):
    return query(database, "SELECT text FROM events WHERE text LIKE ?", f"%{words}%")


def kill_the_twin(live, database, run):
    """It goes on in the run after that. How many starts that took."""
    before = live.account()["starts"]
    child = live.child()
    os.kill(child, signal.SIGKILL)
    wait_for_steps(live, database, run + 1)
    return live.account()["starts"] - before


def remembered(state):
    return json.loads((state / "states.json").read_text(encoding="utf-8"))


def remember(state, why):
    """As if that had been found out of the same files."""
    kept = {**remembered(state), "why": why}
    (state / "states.json").write_text(json.dumps(kept), encoding="utf-8")


def test_found_out_before():
    """No start is lost and nothing is saved. It is tried once for the same files: what is remembered of them is what is told by who comes later."""
    bad = "a saved state of lag ends the process that loads it (the process of the FMUs was ended by signal 6 (Aborted), in fmi2DeSerializeFMUstate of FMU lag)"
    other = "a saved state of lag goes on otherwise in another process (y is "
    for fmu, why in ((hostile_fmu.make("foreign_state"), bad), (keeper_fmu.make_false("stranger"), other)):
        with Device(0.6) as device:
            config, database = make_config(device, fmu)
            with Supervised(config) as live:
                wait_for_steps(live, database, 1)
                expect(kill_the_twin(live, database, 1) == 1, live.log())
                expect(why in live.log() and "crashed" not in live.log(), live.log())
                state = live.state
                end_orderly(live)
            told = texts(database, "a saved state of lag % none are saved")
            expect(len(told) == 1 and told[0][0].startswith(why), f"{told}")
            expect(remembered(state)["why"].startswith(why), f"{remembered(state)}")
            remember(state, "it is said")
            with Supervised(config, state=state) as live:
                wait_for_steps(live, database, 3)
                end_orderly(live)
        expect(texts(database, "it is said: none are saved"), f"{texts(database, '')}")
        expect(number(database, "SELECT count(*) FROM checkpoints") == 0, "something was saved")
        expect(beginnings(database)[1] == (2, "inputs"), f"{beginnings(database)}")


def test_nothing_speaks_against_it():
    """What is remembered of others is none: a file that is damaged, or of another file."""
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


def test_told_to_end_in_a_trial():
    """At once, though an FMU hangs. Nothing is remembered, and nothing is left."""
    with Device(0.6) as device:
        config, _ = make_config(device, hostile_fmu.make("hang", AT="fmi2DoStep", CALL=30))
        with Supervised(config) as live:
            member(live, "worker: states")
            begun = time.monotonic()
            end_orderly(live)
            at_most(time.monotonic() - begun, 10, "seconds until it has ended")
            expect(not (live.state / "states.json").exists(), "it is remembered")
            expect(not list(live.process.temporary.glob("twinlock-*")), "a folder is left")


def test_recorded_during_a_trial():
    """A trial that lasts is told, and the plant is recorded from its beginning on. It is no start of the twin, and no failure; the twin goes on with the run before it."""
    with Device(0.6) as device:
        config, database = make_config(device, hostile_fmu.make("hang", AT="fmi2Instantiate", SECONDS=6))
        with Supervised(config) as live:
            live.wait_for("saved states: the FMUs are tested for whether another process can load what they save")
            wait_for_steps(live, database, 2)
            expect(remembered(live.state)["why"] == "", f"{remembered(live.state)}")
            expect(live.account()["starts"] == 1, f"{live.account()}\n{live.log()}")
            state = live.state
            live.kill()
        (state / "states.json").unlink()
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 4)
            end_orderly(live)
            expect("begins anew" not in live.log(), live.log())
    expect([verb for (verb,) in query(database, "SELECT verb FROM runs ORDER BY run")] == 2 * ["hold", "run"], f"{query(database, 'SELECT * FROM runs')}")
    expect(dict(beginnings(database))[4] == "checkpoint", f"{beginnings(database)}")
    at_least(number(database, "SELECT count(*) FROM samples WHERE run = 1"), 1000, "samples of the trial's time")
    expect(texts(database, "the twin begins when the saved states of its FMUs are tested"), f"{texts(database, '')}")


def test_crashes_in_the_trial():
    """So their states count as ones that cannot be used, and they are not tried again."""
    with Device(0.6) as device:
        config, database = make_config(device, hostile_fmu.make("end", AT="fmi2DoStep", CALL=30, HOW="abort();"))
        with Supervised(config) as live:
            live.wait_for("the saved states could not be tried: ")
            state = live.state
            live.end(signal.SIGTERM)
        why = remembered(state)["why"]
        expect("in fmi2DoStep of FMU lag" in why, why)
        remember(state, "it is said")
        with Supervised(config, state=state) as live:
            live.wait_for("it is said; no checkpoint holds them")
            live.end(signal.SIGTERM)


def test_nowhere_to_keep_it():
    """It is found out again."""
    with Device(0.6) as device:
        config, database = make_config(device)
        state = scratch() / "state"
        (state / "states.json").mkdir(parents=True)
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 1)
            end_orderly(live)
    expect(texts(database, "a saved state of lag ends the process that loads it % none are saved"), f"{texts(database, '')}")


def test_not_kept():
    """Without checkpoints nothing is tried."""
    with Device(0.6) as device:
        config, database = make_config(device)
        content = json.loads(config.read_text(encoding="utf-8"))
        content["record"]["resume_s"] = 0
        config.write_text(json.dumps(content), encoding="utf-8")
        with Supervised(config) as live:
            wait_for_steps(live, database, 1)
            expect(not (live.state / "states.json").exists(), "something was tried")
            end_orderly(live)


def test_supervised():
    """What was believed is wrong. The twin that is begun after a kill dies of the checkpoint; the next follows the inputs, and no more are saved. A box that begins anew does not try."""
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
            expect(taken == 2, f"{taken} starts until it went on\n{live.log()}")
            expect("with \"record.resume_s\": 0 none is loaded, and --supervise --state DIR finds it out before" in live.log(), live.log())
            taken = kill_the_twin(live, database, 2)
            expect(taken == 1, f"{taken} starts until it went on a second time\n{live.log()}")
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
    expect(len(texts(database, LOADED)) == 1, f"{texts(database, '')}")
    expect(texts(database, "a saved state of these FMUs has ended a process"), f"{texts(database, '')}")


def test_cold():
    """The whole run was killed: what is in the database ends the first twin, and not the second."""
    with Device(0.6) as device:
        config, database = make_config(device)
        with Program("run", config) as live:
            wait_for_steps(live, database, 1)
            live.kill()
        with Program("run", config, "--supervise") as live:  # without an account nothing is tried before
            wait_for_steps(live, database, 2)
            expect(texts(database, "start 2, ") and "fmi2DeSerializeFMUstate" in live.log(), live.log())
            code, _, log = live.end(signal.SIGTERM)
            expect(code == 0, f"ended with {code}\n{log}")
    expect(beginnings(database)[1:] == [(2, "start")], f"{beginnings(database)}")
    expect(len(texts(database, LOADED)) == 1, f"{texts(database, '')}")


if __name__ == "__main__":
    main()
