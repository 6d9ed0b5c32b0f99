#!/usr/bin/env python3
"""Faults of a live plant: it is absent, dies, returns, is silent or sends bad values. And the end
of a `run`.

The twin must continue in every case, the database must report the fault, and a replay must give the
same steps.
"""
import signal
import time

from live_test import (GOOD, NO_LINK, NOT_A_NUMBER, OUT_OF_RANGE, STALE, Device, Program, check_database,
                       check_free_run, check_replay, check_rows, check_summary, committed_steps, end_well,
                       expect_events, expect_in_order, expect_reasons, free_port, last_step, qualities, query,
                       wait_for_lock, wait_for_quality, wait_for_steps)
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, main, run

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def live_config(port, **changes):
    """The motor bench, live, without an end, with ten commits per second. Returns (configuration,
    database)."""
    source = {"port": port, **changes.pop("source", {})}
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "sources": {"inverter": {"modbus_tcp": source}}, **changes})
    return config, config.parent / "twin.db"


# ---- the plant ----

def test_server_comes_later():
    config, database = live_config(free_port())
    with Program("run", config, "--json") as live:
        live.wait_for("warning|inverter|Modbus server")
        wait_for_steps(live, database, 20)
        begun = last_step(database)
        with Program("plant", config) as plant:
            live.wait_for("connected")
            wait_for_lock(live, database, begun)
            told, _ = end_well(live, signal.SIGTERM)
            expect(plant.end(signal.SIGTERM)[0] == 0, "the plant ended badly")
    rows = check_summary(told, database)
    expect(told["outcomes"]["free run"] >= 20, f"{told['outcomes']}")
    expect_events(database, ("warning", "inverter|Connection refused"), ("warning", "plant.omega|inverter"),
                  ("warning", "no matched signal|nominal"), ("info", "inverter|connected"), ("info", "synchronising"))
    expect_in_order(qualities(database, "omega"), [NO_LINK, GOOD], "quality of omega")
    check_free_run(database)
    check_replay(config, database, rows)


def test_server_dies_and_returns():
    config, database = live_config(free_port())
    with Program("plant", config) as first:
        first.wait_for("inverter|Modbus TCP")
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            first.kill()
            wait_for_quality(live, database, "omega", NO_LINK)
            died = last_step(database)
            wait_for_steps(live, database, died + 20)
            with Program("plant", config) as second:
                live.wait_for("notice|connected", times=2)
                wait_for_quality(live, database, "omega", GOOD)
                wait_for_lock(live, database, last_step(database))
                told, _ = end_well(live, signal.SIGTERM)
                expect(second.end(signal.SIGTERM)[0] == 0, "the plant ended badly")
    rows = check_summary(told, database)
    expect_events(database, ("info", "inverter|connected"), ("warning", "inverter|Modbus server"),
                  ("info", "inverter|connected"))
    expect_events(database, ("warning", "plant.omega|inverter"), ("info", "plant.omega|good"))
    expect_events(database, ("warning", "no matched signal|nominal"), ("info", "synchronising"))
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK, GOOD], "quality of omega")
    expect_in_order(qualities(database, "torque"), [GOOD, NO_LINK, GOOD], "quality of torque")
    check_free_run(database)
    check_replay(config, database, rows)


def test_bad_values():
    with Device(OMEGA) as device:
        config, database = live_config(device.port, source={"timeout_s": 1})
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 20)
            for bad, quality in ("600", OUT_OF_RANGE), ("nan", NOT_A_NUMBER), ("-inf", NOT_A_NUMBER):
                device.omega = float(bad)
                wait_for_quality(live, database, "omega", quality)
                device.omega = OMEGA
                wait_for_quality(live, database, "omega", GOOD)
            device.torque = 25000  # an input of the twin, not matched
            wait_for_quality(live, database, "torque", OUT_OF_RANGE)
            wait_for_lock(live, database, last_step(database))
            device.torque = 0
            wait_for_quality(live, database, "torque", GOOD)
            device.silent = True  # stale first, then no link after the time-out
            wait_for_quality(live, database, "omega", NO_LINK)
            device.silent = False
            wait_for_quality(live, database, "omega", GOOD)
            told, _ = end_well(live, signal.SIGTERM)
        expect(device.functions == {4}, f"function codes {device.functions} were sent")
    rows = check_summary(told, database)
    expect_in_order(qualities(database, "omega"),
                    [GOOD, OUT_OF_RANGE, GOOD, NOT_A_NUMBER, GOOD, NOT_A_NUMBER, GOOD, STALE, NO_LINK, GOOD],
                    "quality of omega")
    expect_in_order(qualities(database, "torque"), [GOOD, OUT_OF_RANGE, GOOD, STALE, NO_LINK, GOOD],
                    "quality of torque")
    expect_events(database, ("warning", "plant.omega|600|500"), ("info", "plant.omega|good"),
                  ("warning", "plant.omega|not a number"), ("warning", "plant.torque|25|20"),
                  ("warning", "plant.omega|stale_s"), ("warning", "plant.omega|inverter"), ("info", "plant.omega|good"))
    check_free_run(database)
    check_replay(config, database, rows)


# ---- the end ----

def end_by(number_, name):
    with Device(OMEGA) as device:
        config, database = live_config(device.port)
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 30)
            begun = time.monotonic()
            told, _ = end_well(live, number_)
            at_most(time.monotonic() - begun, 5, f"seconds from {name} to the exit")
    rows = check_summary(told, database)
    check_database(database)
    ended = query(database, "SELECT ended_reason, ended IS NOT NULL, samples_written, steps_written, "
                  "entries_lost FROM runs")
    expect(ended == [(name, 1, told["ticks"] + 1, rows, 0)], f"the database says {ended}, told was {told}")
    check_replay(config, database, rows)


def test_sigterm():
    end_by(signal.SIGTERM, "SIGTERM")


def test_sigint():
    end_by(signal.SIGINT, "SIGINT")


def test_sigterm_between_ticks_that_are_far_apart():
    with Device(OMEGA) as device:
        config, database = live_config(device.port, step_s=600)
        with Program("run", config, "--json") as live:
            live.wait_for("connected")
            time.sleep(0.3)  # the cycle then sleeps until its first tick; if it does not yet, the test still passes
            begun = time.monotonic()
            told, _ = end_well(live, signal.SIGTERM)
            at_most(time.monotonic() - begun, 5, "seconds from SIGTERM to the end, ticks 600 s apart")
    expect(told["ticks"] == told["steps"] == check_summary(told, database) == 0, f"{told}")
    expect_reasons(database, "SIGTERM")


def test_kill_and_next_run():
    with Device(OMEGA) as device:
        config, database = live_config(device.port)
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 50)
            code, _, err = run(["run", config, "--json", "--duration", "0.2"])
            expect(code == 75, f"a second run with the same database ended with {code}\n{err}")
            before = committed_steps(database)
            live.kill()
        check_database(database)
        rows = check_rows(database)
        expect(rows >= before, f"{rows} steps are left of {before}")
        expect(query(database, "SELECT ended FROM runs") == [(None,)], "the killed run has an end")
        check_replay(config, database, rows)
        with Program("run", config, "--json", "--duration", "0.3") as live:
            told, _ = end_well(live)
    check_database(database)
    expect_reasons(database, "cleanly", "duration")
    expect(check_rows(database) == rows, "the killed run has changed")
    check_summary(told, database, run=2)
    check_replay(config, database, check_rows(database, run=2), run=2)


if __name__ == "__main__":
    main()
