#!/usr/bin/env python3
"""FMUs of PythonFMU in real time: one as the plant, which writes into a FIFO, and one as its twin
in `run`.

The twin must lock and end after a signal, and its replay must give the same bits. TL_LIVE_SECONDS is
the duration of the runs of FMUs without states; for a campaign: 600.
"""
import csv
import math
import os
import re
import signal
import sys
import time

from live_test import FIRST_GUESS, OPTIMISED, Program, check_replay, check_rows, check_summary, end_well, number, wait_for_steps, wait_until
from python_fmu import LIBRARY, export
from twinlock_test import IN_LOCK, expect, expect_line, expect_no_line, main, merge, scratch, write_config

GAIN = 1.3  # of the plant; the twin starts with 1
SECONDS = float(os.environ.get("TL_LIVE_SECONDS", "6"))
TICKS = 6000 + int(100 * SECONDS)


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


LAG = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
{top}

class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y, self.gain, self.u, self.x = 0.0, 1.0, 0.0, 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        self.x += step_size / 0.05 * ({value} - self.x)
        self.y = self.x
        return True
"""
PLAIN = ("", "self.gain * self.u")
SLOW = ("import time", "(time.sleep(0.0012), self.gain * self.u)[1]")
NUMPY = ("import numpy", "float(numpy.array([self.gain, 0.0]) @ numpy.array([self.u, 1.0]))")


def lag(name, top, value):
    source = LAG.replace("{name}", name).replace("{top}", top).replace("{value}", value)
    return {"fmu": str(export(name.lower(), source=source)), "libraries": [LIBRARY]}


def series(fmus, changes):
    names = list(fmus)
    return write_config(merge({
        "twinlock": 1, "name": "series", "step_s": 0.02, "components": fmus, "plant": {"u": {}},
        "connect": [["plant.u", f"{names[0]}.u"]] + [[f"{a}.y", f"{b}.u"] for a, b in zip(names, names[1:])],
    }, changes))


# The gain on average, where a search reached the tolerance after the first second.
FOUND = f"""SELECT avg(adjustments.applied) FROM steps JOIN adjustments USING (run, step)
            WHERE run = 1 AND step >= 100 AND steps.outcome IN ({FIRST_GUESS}, {OPTIMISED})"""


def is_locked(log):
    """Only changes are logged, and the first state is locked."""
    return (re.findall(r"lock: (\w+)", log) or ["locked"])[-1] in IN_LOCK


def lock_live(fmus):
    """FMUs without states, rolled back by memory: the twin finds the gain of the plant, and is in lock
    again soon after each pause of the machine."""
    fifo = scratch() / "fifo"
    last = list(fmus)[-1]
    plant_config = series(fmus, {
        "components": {"first": {"set": {"gain": GAIN}}}, "recording": {"file": str(recording())},
        "emulate": {"columns": {"u": {"from": "plant.u"}, "y": {"from": f"{last}.y"}}}})
    config = series(fmus, {
        "sources": {"stream": {"csv": {"file": str(fifo)}}},
        "plant": {name: {"csv": {"source": "stream"}} for name in ("u", "y")},
        "record": {"file": "twin.db", "commit_s": 0.1},
        "synchronise": {"horizon": {"prediction": len(fmus)}, "adjust": {"first.gain": {"step": 0.2, "min": 0.2, "max": 3}},
                        "match": {f"{last}.y": {"to": "plant.y", "tolerance": 0.005}}}})
    database = config.parent / "twin.db"
    os.environ["PATH"] = os.path.dirname(sys.executable) + ":" + os.environ["PATH"]
    with Program("plant", plant_config, "--fifo", fifo) as plant:
        wait_until(fifo.exists, "the FIFO", plant.log)
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 100)
            time.sleep(SECONDS)
            wait_until(lambda: is_locked(live.log()), "the lock", live.log)
            told, log = end_well(live, signal.SIGINT)
        plant.end(signal.SIGTERM)
    lock = told["lock"]
    gain = number(database, FOUND)
    print(f"    {told['steps']} steps, {told['skipped']} skipped, in lock {lock['percent']:.1f} %, gain {gain:.3f}")
    rows = check_rows(database)
    expect(rows == told["ticks"] == told["steps"] + told["skipped"], f"{rows} rows: {told}")
    expect(abs(gain - GAIN) < 0.05, f"gain {gain}, that of the plant is {GAIN}\n{log}")
    pauses = len(re.findall(r"ticks? missed", log))
    expect(lock["losses"] <= pauses, f"{pauses} pauses, lock {lock}\n{log}")
    expect_no_line(log, "cannot be copied")
    check_replay(config, database, rows, costs=False)  # a search may have run out of time within a candidate
    return log


def test_one_without_states():
    lock_live({"first": lag("First", *PLAIN)})


def test_two_without_states():
    lock_live({"first": lag("First", *PLAIN), "second": lag("Second", *PLAIN)})


def test_one_with_numpy():
    lock_live({"first": lag("First", *NUMPY)})


def test_released_twins_are_too_slow():
    """They end at the same step of the run and of its replay, which has no clock."""
    log = lock_live({"first": lag("First", *SLOW)})
    expect_line(log, "warning|twin|released twins end|step_s")


def test_two_with_numpy():
    lock_live({"first": lag("First", *NUMPY), "second": lag("Second", *NUMPY)})


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
