#!/usr/bin/env python3
"""On the box: faults of a live CAN bus: link down, interface removed, bus errors, clock changes.
The twin keeps running, the database has the events, and a replay gives the same steps."""
import re
import signal
import time

from can_bus import (ERROR, OMEGA, Motor, events_with, interface_down, interface_up, live_config, make_interface,
                     newest, remove_interface)
from live_test import (GOOD, NO_LINK, STALE, Program, check_free_run, check_replay, check_summary, end_well, events,
                       expect_events, expect_in_order, last_step, qualities, query, wait_for_lock, wait_for_quality,
                       wait_for_steps)
from twinlock_test import at_most, expect, has_line, main

UP = "notice|vcan0|up"


# ---- the interface ----

def test_link_down_and_back():
    config, database = live_config()
    with Motor(OMEGA), Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        interface_down()
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(5)
        interface_up()
        live.wait_for(UP, times=2)
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "vcan0|up"), ("warning", "vcan0|down"), ("info", "vcan0|up"))
    expect(events_with(database, "vcan0|down") == 1, f"reported more than once: {events(database)}")
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK, GOOD], "quality of omega")
    expect_in_order(qualities(database, "torque"), [GOOD, NO_LINK, GOOD], "quality of torque")
    check_free_run(database)
    check_replay(config, database, rows)


def test_interface_removed_and_made_again():
    config, database = live_config()
    with Program("run", config, "--json") as live:
        with Motor(OMEGA):
            wait_for_lock(live, database)
            remove_interface()
            wait_for_quality(live, database, "omega", NO_LINK)
            time.sleep(3)
        make_interface()
        with Motor(OMEGA):
            live.wait_for(UP, times=2)
            wait_for_quality(live, database, "omega", GOOD)
            wait_for_lock(live, database, last_step(database))
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "vcan0|up"), ("warning", "vcan0|driver"), ("info", "vcan0|up"))
    expect(events_with(database, "vcan0|driver") == 1, f"reported more than once: {events(database)}")
    check_free_run(database)
    check_replay(config, database, rows)


def test_interface_comes_later():
    remove_interface()
    config, database = live_config()
    with Program("run", config, "--json") as live:
        live.wait_for("vcan0|`ip link`")
        wait_for_quality(live, database, "omega", NO_LINK)
        make_interface()
        live.wait_for(UP)
        with Motor(OMEGA):
            wait_for_lock(live, database)
            told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))


def test_not_a_can_interface():
    config, database = live_config(sources={"bus": {"can": {"interface": "lo"}}})
    with Program("run", config, "--json") as live:
        live.wait_for("CAN|lo|`ip -details link`")
        wait_for_steps(live, database, 20)
        end_well(live, signal.SIGTERM)


# ---- errors on the bus ----

def test_error_frames():
    """Error frames as a controller's driver delivers them."""
    config, database = live_config()

    def controller(bits):
        return ERROR | 0x4, bytes((0, bits, 0, 0, 0, 0, 0, 0))

    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        for bits, state in ((0x04, "error warning"), (0x10, "error passive"), (0x40, "error active")):
            for _ in range(3):
                motor.send(*controller(bits))
            live.wait_for(state)
        motor.send(*controller(0x01))
        live.wait_for("vcan0|controller|lost|1")
        time.sleep(1.1)
        for _ in range(500):  # such frames can flood the bus
            motor.send(ERROR | 0x88, bytes((0, 0, 0x04, 0, 0, 0, 0, 0)))
        live.wait_for("vcan0|bit stuffing")
        expect(newest(database, "omega")[0] == GOOD, "a value was lost by the errors")
        motor.quiet = True
        time.sleep(0.05)
        motor.send(ERROR | 0x40, bytes(8))
        live.wait_for("bus-off")
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(0.5)
        motor.send(ERROR | 0x100, bytes(8))
        motor.quiet = False
        live.wait_for(UP, times=2)
        wait_for_quality(live, database, "omega", GOOD)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    for state in "error warning", "error passive", "error active", "bus-off":
        expect(events_with(database, state) == 1, f"\"{state}\" not once in {events(database)}")
    reports = [text for _, text in events(database) if has_line(text, "bit stuffing")]
    at_most(len(reports), 4, "reports of bus errors")
    counted = [int(number) for text in reports for number in re.findall(r"(\d+) (?:bus )?errors\b", text)]
    expect(sum(counted) == 500, f"{counted} bus errors in {reports}")
    check_free_run(database)
    check_replay(config, database, rows)


# ---- clocks ----

AGES = """SELECT max(tick * 10000000 - stamp_ns), min(tick * 10000000 - stamp_ns)
    FROM samples JOIN signals USING (run, signal) WHERE run = 1 AND kind = 'plant' AND name = 'plant.omega'
    AND tick BETWEEN ? AND ?"""


def test_wall_clock_is_set():
    """Stamps are of CLOCK_MONOTONIC, so that a change of the wall clock gives no sample from the
    future, and no stale one. Stamps of the wall clock would be wrong by hours."""
    config, database = live_config(plant={"omega": {"stale_s": 2}, "torque": {"stale_s": 2}})
    true_time = time.clock_gettime(time.CLOCK_REALTIME)
    begun = time.monotonic()
    try:
        with Motor(OMEGA), Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            first = last_step(database)
            wait_for_steps(live, database, first + 100)
            last = last_step(database)
            for offset in 86400, -7200, 0.5, -0.02:
                time.clock_settime(time.CLOCK_REALTIME, time.clock_gettime(time.CLOCK_REALTIME) + offset)
                wait_for_steps(live, database, last_step(database) + 50)
            told, _ = end_well(live, signal.SIGTERM)
    finally:
        time.clock_settime(time.CLOCK_REALTIME, true_time + time.monotonic() - begun)
    check_replay(config, database, check_summary(told, database))
    expect(qualities(database, "omega")[-1] == GOOD and STALE not in qualities(database, "omega"),
           f"qualities of omega: {qualities(database, 'omega')}")
    before, after = query(database, AGES, first, last)[0], query(database, AGES, last, 10**9)[0]
    print(f"    samples were {before[1] / 1e6:.2f} to {before[0] / 1e6:.2f} ms old, while the clock was set "
          f"{after[1] / 1e6:.2f} to {after[0] / 1e6:.2f} ms")
    expect(min(before[1], after[1]) >= -1000, "a sample from the future")  # up to 1 us belongs to the instant


if __name__ == "__main__":
    main()
