#!/usr/bin/env python3
"""FMUs of PythonFMU in real time: one as the plant, which writes into a FIFO, and one as its twin
in `run`.

The twin must lock and end after a signal, and its replay must give the same bits.
"""
import csv
import math
import signal
import time

from live_test import Program, check_replay, check_summary, end_well, number, wait_for_steps, wait_until
from python_fmu import LIBRARY, export
from twinlock_test import expect, expect_line, main, merge, scratch, write_config

GAIN = 1.3  # of the plant; the twin starts with 1
TICKS = 6000


def recording():
    """The plant's inputs, longer than any test."""
    path = scratch() / "recording.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "u", "open"])
        writer.writerows([i / 100, 0.5 + 0.3 * math.sin(i / 20), 1] for i in range(TICKS))
    return path


def bench(changes):
    """A configuration of the plant, in a new folder."""
    return write_config(merge({
        "twinlock": 1, "name": "plant of PythonFMU", "step_s": 0.01,
        "components": {"process": {"fmu": str(export("plant", "--handle-state")), "libraries": [LIBRARY]}},
        "plant": {"u": {}, "open": {"type": "boolean", "initial": True}},
        "connect": [["plant.u", "process.u"], ["plant.open", "process.open"]],
    }, changes))


def true_plant():
    return bench({"components": {"process": {"set": {"gain": GAIN}}}, "recording": {"file": str(recording())},
                  "emulate": {"columns": {"u": {"from": "plant.u"}, "open": {"from": "plant.open"},
                                          "y": {"from": "process.y"}}}})


def twin(fifo):
    signals = {name: {"csv": {"source": "stream"}} for name in ("u", "open", "y")}
    return bench({"sources": {"stream": {"csv": {"file": str(fifo)}}}, "plant": signals,
                  "record": {"file": "twin.db", "commit_s": 0.1},
                  "synchronise": {"adjust": {"process.gain": {"step": 0.2, "min": 0.2, "max": 3}},
                                  "match": {"process.y": {"to": "plant.y", "tolerance": 0.005}}}})


def found_it(database):
    """The number of steps with about the true gain. Steps without time for a search have the
    nominal gain."""
    return number(database, "SELECT count(*) FROM adjustments WHERE abs(applied - ?) < 0.2 AND run = 1", GAIN)


def test_it_is_locked_in_real_time():
    fifo = scratch() / "fifo"
    config = twin(fifo)
    database = config.parent / "twin.db"
    with Program("plant", true_plant(), "--fifo", fifo) as plant:
        wait_until(fifo.exists, "the FIFO", plant.log)
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 1)
            wait_until(lambda: found_it(database) >= 20, "the true gain", live.log)
            told, log = end_well(live, signal.SIGINT)
        code, _, plant_log = plant.end(signal.SIGTERM)
    expect(code == 0, f"the plant ended with {code}\n{plant_log}")
    rows = check_summary(told, database, components=2)
    print(f"    {rows} steps, {told['skipped']} skipped, {found_it(database)} with about the true gain")
    check_replay(config, database, rows)
    expect("error" not in log, log)


SLEEPER = """
import time

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Sleeper(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        print("asleep", flush=True)
        time.sleep(300)
        return True
"""


def test_a_check_is_interrupted():
    """Python handles SIGINT unless the process does. `check` does: it waits ten seconds for the
    script, or for a second SIGINT."""
    config = write_config({"twinlock": 1, "name": "sleeper", "step_s": 0.01, "plant": {"y": {}},
                           "components": {"sleeper": {"fmu": str(export("sleeper", source=SLEEPER)), "libraries": [LIBRARY]}},
                           "compare": {"sleeper.y": {"to": "plant.y"}}})
    with Program("check", config) as program:
        program.wait_for("asleep")
        program.signal(signal.SIGINT)
        time.sleep(2)
        program.signal(signal.SIGINT)
        code, _, log = program.end()
        expect(code == 70, f"ended with {code}\n{log}")
        expect_line(log, "twice|SIGINT|sleeper|fmi2DoStep")


main()
