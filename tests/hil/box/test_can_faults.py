#!/usr/bin/env python3
"""On the box: what may happen to a live CAN bus: link down, interface gone, errors, clocks that are set. The twin goes on, the
database says what happened, and a replay of it gives the same steps.
"""
import re
import signal
import time

from can_bus import (ERROR, OMEGA, Motor, events_with, interface_down, interface_up, live_config, make_interface,
                     newest, remove_interface)
from live_test import (GOOD, NO_LINK, STALE, Program, check_free_run, check_replay, check_summary, end_well, events,
                       expect_events, expect_in_order, last_step, qualities, query, wait_for_lock, wait_for_quality,
                       wait_for_steps)
from twinlock_test import at_most, expect, main


# ---- the interface ----

def test_link_down_and_back():
    config, database = live_config()
    with Motor(OMEGA), Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        interface_down()
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(5)
        interface_up()
        live.wait_for("is up", times=2)
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "CAN interface vcan0: is up"), ("warning", "CAN interface vcan0: it is down: set it up"),
                  ("info", "CAN interface vcan0: is up"))
    expect(events_with(database, "it is down") == 1, f"told more than once: {events(database)}")
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
            live.wait_for("is up", times=2)
            wait_for_quality(live, database, "omega", GOOD)
            wait_for_lock(live, database, last_step(database))
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "is up"), ("warning", "it is gone"), ("info", "is up"))
    expect(events_with(database, "is gone") == 1, f"told more than once: {events(database)}")
    check_free_run(database)
    check_replay(config, database, rows)


def test_interface_comes_later():
    remove_interface()
    config, database = live_config()
    with Program("run", config, "--json") as live:
        live.wait_for("there is none of that name")
        wait_for_quality(live, database, "omega", NO_LINK)
        make_interface()
        live.wait_for("is up")
        with Motor(OMEGA):
            wait_for_lock(live, database)
            told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))


def test_not_a_can_interface():
    config, database = live_config(sources={"bus": {"can": {"interface": "lo"}}})
    with Program("run", config, "--json") as live:
        live.wait_for("it is no CAN interface")
        wait_for_steps(live, database, 20)
        end_well(live, signal.SIGTERM)


# ---- errors on the bus ----

def test_error_frames():
    """As a controller's driver would pass them up."""
    config, database = live_config()

    def controller(bits):
        return ERROR | 0x4, bytes((0, bits, 0, 0, 0, 0, 0, 0))

    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        for bits, words in ((0x04, "error warning"), (0x10, "error passive"), (0x40, "error active again")):
            for _ in range(3):
                motor.send(*controller(bits))
            live.wait_for(words)
        motor.send(*controller(0x01))
        live.wait_for("the controller lost frames 1 times")
        time.sleep(1.1)
        for _ in range(500):  # "may flood"
            motor.send(ERROR | 0x88, bytes((0, 0, 0x04, 0, 0, 0, 0, 0)))
        live.wait_for("errors on the bus (bit stuffing errors)")
        expect(newest(database, "omega")[0] == GOOD, "errors have cost a value")
        motor.quiet = True
        time.sleep(0.05)
        motor.send(ERROR | 0x40, bytes(8))
        live.wait_for("bus-off")
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(0.5)
        motor.send(ERROR | 0x100, bytes(8))
        motor.quiet = False
        live.wait_for("is up", times=2)
        wait_for_quality(live, database, "omega", GOOD)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    for words in "error warning", "error passive", "error active", "bus-off":
        expect(events_with(database, words) == 1, f"\"{words}\" not once in {events(database)}")
    at_most(events_with(database, "bit stuffing"), 4, "times that bus errors were told")
    counted = [int(match[1]) for _, text in events(database) if (match := re.search(r"(\d+) errors on the bus", text))]
    expect(sum(counted) == 500, f"told of {counted} bus errors")
    check_free_run(database)
    check_replay(config, database, rows)


# ---- clocks ----

AGES = """SELECT max(tick * 10000000 - stamp_ns), min(tick * 10000000 - stamp_ns)
    FROM samples JOIN signals USING (run, signal) WHERE run = 1 AND kind = 'plant' AND name = 'plant.omega'
    AND tick BETWEEN ? AND ?"""


def test_wall_clock_is_set():
    """Stamps are CLOCK_MONOTONIC, whatever happens to the wall clock: no sample is from the future, none is older than a
    busy machine makes it (a stamp that followed the wall clock would be wrong by hours)."""
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
    expect(min(before[1], after[1]) >= -1000, "a sample from the future")  # within 1 us it is one of the instant


if __name__ == "__main__":
    main()
