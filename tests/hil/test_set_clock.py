#!/usr/bin/env python3
"""The system clock is set during a run: from 1970, and by 5 s in both directions. Nothing is lost, and in the end each recorded
instant is right."""
import datetime
import shutil
import signal
import struct
import time
from contextlib import contextmanager

import twinlock_test
from live_test import (Device, Program, check_database, check_rows, end_well, last_step, number, query, wait_for_lock, wait_for_steps,
                       wait_until)
from tree import OMEGA
from twinlock_test import BUILD, PLAIN_LIVE, at_most, edited_config, expect, main, run_well, scratch

NEAR_S = 1.0  # of a recorded instant to the true one, on a busy machine


@contextmanager
def clock(shift):
    """The programs that are started within have a clock of their own (clock/set_clock.c). The value is a function that sets how
    many seconds it is ahead."""
    program = scratch() / "twinlock"
    file = program.with_suffix(".shift")
    shutil.copy(BUILD / "tests" / "twinlock_set_clock", program)
    file.write_bytes(struct.pack("d", shift))

    def set_clock(seconds_ahead):
        with open(file, "r+b") as opened:
            opened.write(struct.pack("d", seconds_ahead))
    usual, twinlock_test.PROGRAM = twinlock_test.PROGRAM, str(program)
    try:
        yield set_clock
    finally:
        twinlock_test.PROGRAM = usual


def seconds(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def near(found, wanted, what):
    at_most(abs(seconds(found) - wanted), NEAR_S, f"s between {what}, {found}, and the true instant")


def check_instants(database, run, begun):
    """All instants of the run lie within it; its length is that of its ticks."""
    now = time.time()
    started, committed, ended = query(database, "SELECT started, committed, ended FROM runs WHERE run = ?", run)[0]
    near(started, begun, f"the start of run {run}")
    step_s = number(database, "SELECT step_ns / 1e9 FROM runs WHERE run = ?", run)
    steps = number(database, "SELECT max(step) FROM steps WHERE steps.run = ?", run)
    length = seconds(committed) - seconds(started) - steps * step_s
    expect(0 <= length + NEAR_S < 3 * NEAR_S, f"run {run} lasted {length} s longer than its steps")
    expect(ended in (None, committed), f"{ended} {committed}")
    for view in "v_samples", "v_steps", "v_events":
        first, last = query(database, f"SELECT min(at), max(at) FROM {view} WHERE run = ?", run)[0]
        expect(begun - NEAR_S < seconds(first) <= seconds(last) < now + NEAR_S, f"{view}: {first} to {last}")
    moments = [seconds(at) for at, in query(database, "SELECT at FROM events WHERE run = ? ORDER BY event", run)]
    late = [at - before for before, at in zip(moments, moments[1:]) if at < before - 0.5]
    expect(not late, f"events go back: {late}")


def live_config(port):
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                        "sources": {"inverter": {"modbus_tcp": {"port": port}}}})
    return config, config.parent / "twin.db"


def further(live, database):
    wait_for_steps(live, database, last_step(database) + 60)


def test_clock_is_set():
    with Device(OMEGA) as device, clock(1000 - time.time()) as set_clock:
        config, database = live_config(device.port)
        begun = time.time()
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            first = query(database, "SELECT started FROM runs")[0][0]
            expect(first.startswith("1970"), f"{first}: the clock is not shifted")
            for moved, shift in enumerate((0, 5, 0, -5, 0), 1):
                set_clock(shift)
                wait_until(lambda: number(database, "SELECT count(*) FROM events WHERE text LIKE 'the system clock was set%'") >= moved,
                           "an event", live.log)
                further(live, database)
            told, _ = end_well(live, signal.SIGTERM)
        expect(told["lock"]["losses"] == 0 and told["plant"]["omega"]["not_good"] < 20, f"{told['lock']} {told['plant']}")
        check_instants(database, 1, begun)
        check_rows(database)
        check_database(database)
        expect("1970" not in run_well(["show", database, "--verbose"]), "show has wrong instants")


def test_next_run_does_not_inherit_1970():
    """The clock is set between a killed run and the next one, which resumes it."""
    with Device(OMEGA) as device, clock(1000 - time.time()) as set_clock:
        config, database = live_config(device.port)
        begun = time.time()
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
        set_clock(0)
        with Program("run", config, "--json") as live:
            wait_until(lambda: number(database, "SELECT count(*) FROM steps WHERE steps.run = 2") > 60, "steps of the next run", live.log)
            told, _ = end_well(live, signal.SIGTERM)
        expect(told["resumed"]["run"] == 1, f"{told['resumed']}")
        for run in 1, 2:
            check_instants(database, run, begun)


if __name__ == "__main__":
    main()
