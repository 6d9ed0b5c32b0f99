#!/usr/bin/env python3
"""Faults of a Modbus device in one supervised run, which must be in lock after each fault, without
a restart.

The device is silent, sends garbage, refuses requests or stops within an answer. It answers another
request, as another unit, in another protocol or with another length. It drops all connections.
"""
import time

from faulty_device import FaultyDevice
from live_test import (GOOD, NO_LINK, check_database, check_free_run, check_replay, check_rows, events, expect_events,
                       expect_in_order, last_step, qualities, wait_for_lock, wait_for_quality, wait_for_steps)
from supervised import Supervised, end_orderly
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, has_line, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts
# Severity and parts of the event of each fault, and parts of the event of its end. See has_line().
# A device that refuses requests stays connected.
TOLD = {
    "silence": ("warning", "inverter|answer|0.1 s", "inverter|connected"),
    "garbage": ("warning", "inverter|Modbus server", "inverter|connected"),
    "exception": ("warning", "unit 1|0 to 2|server failure", "unit 1|0 to 2|answers"),
    "exception_0": ("warning", "unit 1|0 to 2|exception 0", "unit 1|0 to 2|answers"),
    "other_unit": ("warning", "unit 6|1|any_unit_id", "inverter|connected"),
    "other_protocol": ("warning", "protocol 1|0", "inverter|connected"),
    "other_length": ("warning", "65535 bytes|9", "inverter|connected"),
    "half_frame": ("warning", "inverter|answer|0.1 s", "inverter|connected"),
    "other_answer": ("warning", "inverter|transaction", "inverter|connected"),
    "storm": ("warning", "inverter|Modbus server", "inverter|connected"),
}
FAULT_STEPS = 60


def live_config(device):
    config = edited_config(PLAIN_LIVE, {
        "duration_s": None, "record": {"commit_s": 0.1},
        "sources": {"inverter": {"modbus_tcp": {"port": device.port, "timeout_s": 0.1}}}})
    return config, config.parent / "twin.db"


def bear(fault, device, live, database):
    """Causes the fault, ends it, and waits for the lock. Returns (connections, seconds of the
    fault)."""
    before, begun = device.connections, time.monotonic()
    device.fault = fault
    wait_for_quality(live, database, "omega", NO_LINK)
    wait_for_steps(live, database, last_step(database) + FAULT_STEPS)
    device.fault = None
    seconds = time.monotonic() - begun
    wait_for_quality(live, database, "omega", GOOD)
    wait_for_lock(live, database, last_step(database))
    return device.connections - before, seconds


def test_campaign():
    with FaultyDevice(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            live.wait_for("lock: locked")
            for fault in TOLD:
                connections, seconds = bear(fault, device, live, database)
                print(f"    {fault}: {connections} connections in {seconds:.1f} s")
                # the pause between two connections is 0.1 s, doubled each time, up to 2 s
                at_most(connections, 10 * seconds + 3, f"connections during {fault}")
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{live.log()}")
        expect(device.functions == {4}, f"function codes {device.functions} were sent")
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK] * len(TOLD) + [GOOD], "quality of omega")
    for i, (severity, begin, end) in enumerate(TOLD.values()):
        repeated = "info" if i > 0 else "warning"  # a cause is one warning an hour
        expect_events(database, (severity, begin), ("warning", "plant.omega|inverter"), (repeated, "no matched signal|nominal"),
                      ("info", end), ("info", "plant.omega|good"), ("info", "synchronising"))
    told = sum(has_line(text, "inverter|Modbus server") for _, text in events(database))
    at_most(told, 1 + 3 * len(TOLD), "events of the device")
    check_database(database)
    check_free_run(database)
    check_replay(config, database, check_rows(database))


main()
