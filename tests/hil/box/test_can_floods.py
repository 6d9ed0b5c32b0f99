#!/usr/bin/env python3
"""On the box: a live CAN bus with more frames than the reader can read. Frames of other ids do not
wake it, the newest frame of its own ids counts, and events report the number of lost frames."""
import os
import re
import signal
import struct
import time
from pathlib import Path

from can_bus import EXTENDED, OMEGA, Bus, Motor, events_with, live_config, wait_for_value
from live_test import (GOOD, STALE, Program, check_replay, check_summary, end_well, events, last_step, member, stop, wait_for_lock,
                       wait_for_quality)
from twinlock_test import at_most, expect, has_line, main

LOST = "vcan0|frames|lost"
FLOOD = 30000
OWN_FLOOD = 10000  # frames; on an emulated processor, reading one takes three times as long as sending it


def reader_thread(pid):
    """Folder in /proc of the thread that reads the bus."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        if (task / "comm").read_text().strip() == "io bus":
            return task
    raise AssertionError("no thread \"io bus\"")


def wake_ups(task):
    return int(re.search(r"^voluntary_ctxt_switches:\s+(\d+)", (task / "status").read_text(), re.M)[1])


def test_flood_of_other_ids():
    """The kernel filters them, so the reader wakes as rarely as on a silent bus."""
    config, database = live_config()
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        wait_for_quality(live, database, "omega", STALE)
        task = reader_thread(member(live, "io"))
        woken, begun = wake_ups(task), time.monotonic()
        with Bus() as bus:
            for i in range(FLOOD):
                bus.send(0x183 if i % 2 else 0x18FEF101 | EXTENDED, bytes(8))
        seconds = time.monotonic() - begun
        woken = wake_ups(task) - woken
        print(f"    {FLOOD} frames in {seconds:.1f} s, {woken} wake-ups of the reader")
        at_most(woken, 60 * seconds + 60, "wake-ups during the flood (polls of 50 ms and pauses make 40 a second)")
        motor.quiet = False
        wait_for_quality(live, database, "omega", GOOD)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    check_replay(config, database, rows)


def test_flood_of_own_ids():
    config, database = live_config()
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        begun = time.monotonic()
        with Bus() as bus:
            for i in range(OWN_FLOOD):
                bus.send(0x182, struct.pack(">h6x", i % 1000))
            bus.send(0x182, struct.pack(">h6x", 1234))
        seconds = time.monotonic() - begun
        wait_for_value(live, database, "torque", 1234 * 0.001)
        print(f"    {OWN_FLOOD} frames in {seconds:.1f} s")
        motor.quiet = False
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    at_most(events_with(database, LOST), seconds + 2, "reports of lost frames")
    check_replay(config, database, rows)


def test_frames_lost_are_counted():
    """A reader that was stopped loses frames, and reports their number when it continues."""
    config, database = live_config(realtime={"hang_s": 60})
    count = 10000
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        time.sleep(0.2)
        reader = member(live, "io")
        stop(reader)
        for _ in range(count):
            motor.send(0x182, struct.pack(">h6x", 55))
        os.kill(reader, signal.SIGCONT)
        motor.quiet = False
        live.wait_for(LOST)
        wait_for_value(live, database, "torque", 0)
        told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))
    reports = [text for _, text in events(database) if has_line(text, LOST)]
    counted = sum(int(re.search(r"(\d+) (?:\w+ )?frames\b", text)[1]) for text in reports)
    expect(0 < counted < count, f"{counted} of {count} frames in {reports}")
    print(f"    {counted} of {count} frames lost")


if __name__ == "__main__":
    main()
