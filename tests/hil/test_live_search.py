#!/usr/bin/env python3
"""Events of a live search: an unobservable variable, a fallback solver, and horizons without enough
time.

They are recorded, and a replay must give the same steps.
"""
import signal

from live_test import (STOP_TIME, Device, Program, check_replay, check_rows, check_summary, end_well, events,
                       expect_events, number, wait_for_steps)
from twinlock_test import PLAIN_LIVE, edited_config, expect, has_line, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts
AMISS = 5  # rad/s, so that every step needs a search


def run_for(steps, **synchronise):
    """(configuration, database, --json report) of a live run."""
    with Device(OMEGA - AMISS) as device:
        source = {"modbus_tcp": {"port": device.port}}
        config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                                   "sources": {"inverter": source}, "synchronise": synchronise})
        database = config.parent / "twin.db"
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, steps)
            return config, database, end_well(live, signal.SIGTERM)[0]


def test_unobservable_variable():
    config, database, told = run_for(50, algorithm="nelder-mead", noise_floor=1e9)
    rows = check_summary(told, database)
    parts = "motor.d|react"
    expect_events(database, ("warning", parts))
    expect(sum(has_line(text, parts) for _, text in events(database)) == 1, f"more than once: {events(database)}")
    held = number(database, "SELECT count(*) FROM v_steps WHERE held = 'motor.d'")
    moved = number(database, "SELECT count(*) FROM steps JOIN adjustments USING (run, step) WHERE held AND correction <> 0")
    expect(held >= 20 and moved == 0, f"held in {held} of {rows} steps, elsewhere than at nominal in {moved}")
    check_replay(config, database, rows)


def test_fallback_solver():
    config, database, told = run_for(50, algorithm="nelder-mead", fallback="bobyqa", stagnation=4,
                                     match={"motor.omega": {"tolerance": 1e-9}})
    rows = check_summary(told, database)
    expect_events(database, ("warning", "solver|bobyqa"))
    taken = number(database, "SELECT count(*) FROM v_steps WHERE flags LIKE '%fallback%'")
    expect(taken >= 5, f"the fallback solver ran in {taken} of {rows} steps")
    expect(len(events(database)) < 12, f"{len(events(database))} events: {events(database)}")
    check_replay(config, database, rows)


def test_horizons_without_enough_time():
    config, database, told = run_for(150, algorithm="nelder-mead", budget={"time_s": 3e-5},
                                     horizon={"prediction": 8, "shape": "dynamic"},
                                     adjust={"motor.d": {"step": 1e-4}},
                                     match={"motor.omega": {"tolerance": 1e-9}})
    rows = check_rows(database)
    late = number(database, "SELECT count(*) FROM steps WHERE stop = ?", STOP_TIME)
    expect(late >= 20, f"{late} of {rows} searches were cut short: {told}")
    check_replay(config, database, rows, costs=False)


if __name__ == "__main__":
    main()
