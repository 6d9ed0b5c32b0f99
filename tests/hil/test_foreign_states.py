#!/usr/bin/env python3
"""FMUs whose saved states end the process that loads them, unless it has made them: one start is lost by that, and no second one, nor by who comes later."""
import os
import signal

import hostile_fmu
from live_test import Device, Program, number, query, wait_until
from supervised import Supervised, end_orderly
from twinlock_test import expect, main, scratch, write_config

STEPS = 150  # of a run, before it is killed
LOADED = "the twin before has ended as it loaded a checkpoint"
OWN = """SELECT count(*) FROM steps LEFT JOIN beginnings USING (run) WHERE run = ? AND outcome <> 9 AND step >= coalesce(resumed_tick, 0)"""


def make_config(device):
    database = scratch() / "twin.db"
    path = write_config({
        "twinlock": 1, "name": "foreign", "step_s": 0.01,
        "components": {"lag": {"fmu": str(hostile_fmu.make("foreign_state"))}},
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


def test_supervised():
    """The twin that is begun after a kill dies of the checkpoint; the next follows the inputs, and no more are saved. A box that begins anew does not try."""
    with Device(0.6) as device:
        config, database = make_config(device)
        with Supervised(config) as live:
            wait_for_steps(live, database, 1)
            expect(number(database, "SELECT count(*) FROM checkpoints") > 0, f"nothing was saved\n{live.log()}")
            taken = kill_the_twin(live, database, 1)
            expect(taken == 2, f"{taken} starts until it went on\n{live.log()}")
            taken = kill_the_twin(live, database, 2)
            expect(taken == 1, f"{taken} starts until it went on a second time\n{live.log()}")
            state = live.state
            expect(int(live.account()["unreadable"], 16) != 0, f"{live.account()}")
            end_orderly(live)
        saved = number(database, "SELECT max(run) FROM checkpoints")
        with Supervised(config, state=state) as live:
            wait_for_steps(live, database, 4)
            end_orderly(live)
            expect(live.account()["starts"] == 4 + 1, f"{live.account()}\n{live.log()}")
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
        with Supervised(config) as live:
            wait_for_steps(live, database, 2)
            expect(live.account()["starts"] == 2 and "fmi2DeSerializeFMUstate" in live.log(), live.log())
            end_orderly(live)
    expect(beginnings(database)[1:] == [(2, "start")], f"{beginnings(database)}")
    expect(len(texts(database, LOADED)) == 1, f"{texts(database, '')}")


if __name__ == "__main__":
    main()
