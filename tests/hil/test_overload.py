#!/usr/bin/env python3
"""A machine that is too slow: the twin catches up skipped ticks, loses none, and a replay does the
same."""
import os
import signal
import time

from live_test import (FREE_RUN, MADE_UP, STOP_TIME, Device, Program, check_replay, check_summary, end_well,
                       expect_events, member, number, query, stop, wait_for_lock, wait_for_steps)
from twinlock_test import PLAIN_LIVE, edited_config, expect, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def overload_config(device, **synchronise):
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "sources": {"inverter": {"modbus_tcp": {"port": device.port}}},
                                               "synchronise": synchronise})
    return config, config.parent / "twin.db"


def test_stopped_process():
    with Device(OMEGA - 2) as device:  # 2 rad/s is twice the tolerance: every step is searched
        config, database = overload_config(device)
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            twin = member(live, "twin")
            for _ in range(2):
                stop(twin)
                time.sleep(0.3)
                os.kill(twin, signal.SIGCONT)
                wait_for_steps(live, database, number(database, "SELECT count(*) FROM steps") + 50)
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect(told["skipped"] >= 40, f"{told['skipped']} ticks skipped in twice 0.3 s")
    searched = query(database, "SELECT step, evaluations, executions FROM steps s WHERE outcome = ? "
                     "AND (evaluations <> 0 OR executions <> 3)", MADE_UP)
    expect(searched == [], f"searches in skipped steps: {searched}")
    other = query(database, """SELECT s.step
                               FROM steps s
                               JOIN adjustments a USING (run, step)
                               JOIN adjustments b ON b.run = a.run AND b.step = a.step - 1
                               WHERE s.outcome = ? AND a.applied <> b.applied""", MADE_UP)
    expect(other == [], f"skipped steps with another u than the last one: {other}")
    expect_events(database, ("warning", "ticks missed"))
    print(f"    {told['steps']} steps, {told['skipped']} skipped, {told['deadline_misses']} deadline misses")
    check_replay(config, database, rows)


def test_no_time_at_all():
    with Device(OMEGA) as device:
        config, database = overload_config(device, budget={"time_s": 1e-9})
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 100)
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect(told["evaluations"] == 0, f"{told['evaluations']} evaluations in no time")
    stops = query(database, "SELECT DISTINCT stop FROM steps WHERE outcome NOT IN (?, ?)", MADE_UP, FREE_RUN)
    expect(stops == [(STOP_TIME,)], f"searches ended by {stops}")
    check_replay(config, database, rows)


def test_searches_cut_short():
    with Device(OMEGA - 5) as device:
        # a tolerance that no search reaches, and time for only a few evaluations
        config, database = overload_config(device, budget={"time_s": 3e-5},
                                           adjust={"motor.d": {"step": 1e-4}},
                                           match={"motor.omega": {"tolerance": 1e-9}})
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 150)
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect(told["time_limited"] > 0, f"no search was cut short: {told}")
    few, many = query(
        database, "SELECT min(evaluations), max(evaluations) FROM steps WHERE stop = ?", STOP_TIME)[0]
    print(f"    {told['time_limited']} of {told['steps']} searches were cut short; "
          f"after {few} to {many} evaluations")
    check_replay(config, database, rows)


if __name__ == "__main__":
    main()
