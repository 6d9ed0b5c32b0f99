#!/usr/bin/env python3
"""A Modbus device that is silent, talks garbage, refuses, breaks off in the middle of an answer, answers another question, as
another unit, in another protocol or with another length, and drops every connection: one supervised run goes through all of it, in lock again after each, and never started anew.
"""
import time

from faulty_device import FaultyDevice
from live_test import (GOOD, NO_LINK, check_database, check_free_run, check_replay, check_rows, events, expect_events,
                       expect_in_order, last_step, qualities, wait_for_lock, wait_for_quality, wait_for_steps)
from supervised import Supervised, end_orderly, wait_for_run
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts
# What is told of each, and of its end. A device that refuses is there all the same.
TOLD = {
    "silence": ("warning", "no answer within 0.1 s", "connected"),
    "garbage": ("warning", "inverter: Modbus server", "connected"),
    "exception": ("info", "unit 1, input register 0 to 2: Slave device or server failure", "answers again"),
    "exception_0": ("info", "unit 1, input register 0 to 2: exception 0, which Modbus does not define", "answers again"),
    "other_unit": ("warning", "answered as unit 6 when asked for unit 1: if it always does, give its source", "connected"),
    "other_protocol": ("warning", "answered in protocol 1, and Modbus is 0", "connected"),
    "other_length": ("warning", "gives 65535 bytes as the length of an answer of 9", "connected"),
    "half_frame": ("warning", "no answer within 0.1 s", "connected"),
    "other_answer": ("warning", "answered transaction ", "connected"),
    "storm": ("warning", "inverter: Modbus server", "connected"),
}
FAULT_STEPS = 60


def live_config(device):
    config = edited_config(PLAIN_LIVE, {
        "duration_s": None, "record": {"commit_s": 0.1},
        "sources": {"inverter": {"modbus_tcp": {"port": device.port, "timeout_s": 0.1}}}})
    return config, config.parent / "twin.db"


def bear(fault, device, live, database):
    """Until it is over, and the twin in lock again. How many connections it took."""
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
            wait_for_run(live, database, 1)
            for fault in TOLD:
                connections, seconds = bear(fault, device, live, database)
                print(f"    {fault}: {connections} connections in {seconds:.1f} s")
                # a pause of 0.1 s, doubled each time, up to 2 s
                at_most(connections, 10 * seconds + 3, f"connections during {fault}")
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{live.log()}")
        expect(device.functions == {4}, f"function codes {device.functions} were sent")
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK] * len(TOLD) + [GOOD], "quality of omega")
    for severity, words, again in TOLD.values():
        expect_events(database, (severity, words), ("warning", "plant.omega: no link"), ("warning", "runs free"),
                      ("info", again), ("info", "plant.omega: good again"), ("info", "synchronising again"))
    told = sum("inverter: Modbus server" in text for _, text in events(database))
    at_most(told, 1 + 3 * len(TOLD), "events of the device")
    check_database(database)
    check_free_run(database)
    check_replay(config, database, check_rows(database))


main()
