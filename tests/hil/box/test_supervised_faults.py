#!/usr/bin/env python3
"""On the box: faults of one supervised run at a CAN controller, with the watchdog armed: bus-off,
the wall clock set forward and back by a day, the twin killed, the twin stopped, all processes
stopped. The run is in lock after each. The watchdog never resets the box, or the next tests would
not run; tests/hil/test_box_resets.py has resets.

The emulated controller never leaves the bus. So the test sends the error frame of bus-off through
the driver's echo. The link that goes down and up is the controller's.
"""
import os
import signal
import time

import box
from can_bus import ERROR, OMEGA, Bus, Motor, events_with, interface_down, interface_up, live_config, transmitted
from live_test import GOOD, NO_LINK, PATIENCE, RESULTS, bits, check_database, expect_events, number, query, stop, wait_until
from supervised import Supervised, end_orderly, expect_in_lock, expect_starts, known_state, wait_for_run
from twinlock_test import BUILD, expect, main, replay_json, scratch

DAY = 86400
HANG_S = 5
WATCHDOG_S = 15
BUS_OFF = 0x40  # linux/can/error.h


class Campaign:
    """A run and its database. The methods wait for events of its newest run."""

    def __init__(self, live, database):
        self.live, self.database, self.run = live, database, 1

    def newest_step(self):
        return number(self.database, "SELECT max(step) FROM steps WHERE steps.run = ?", self.run) or 0

    def wait_for_lock(self):
        """Waits for 20 more steps within tolerance."""
        begun = self.newest_step()
        wait_until(lambda: number(self.database, "SELECT count(*) FROM steps WHERE steps.run = ? AND step > ? AND outcome IN (1, 2)",
                                  self.run, begun) >= 20, "lock", self.live.log)

    def wait_for_quality(self, quality):
        newest = """SELECT quality FROM samples JOIN signals USING (run, signal)
                    WHERE run = ? AND name = 'plant.omega' ORDER BY samples.tick DESC LIMIT 1"""
        wait_until(lambda: query(self.database, newest, self.run) == [(quality,)], f"quality {quality}", self.live.log)

    def wait_for_next_run(self):
        self.run += 1
        wait_for_run(self.live, self.database, self.run)


def bus_off(campaign, motor, interface):
    """After bus-off, the link goes down and up, which restarts a controller without restart-ms."""
    motor.quiet = True
    with Bus(interface) as driver:
        driver.send(ERROR | BUS_OFF, bytes(8))
        campaign.live.wait_for("bus-off")
        campaign.wait_for_quality(NO_LINK)
    interface_down(interface)
    interface_up(interface)
    motor.quiet = False
    campaign.wait_for_quality(GOOD)
    campaign.wait_for_lock()


def clock_set(campaign):
    """Sets the wall clock forward by a day, back by two, and right. Stamps are of another clock."""
    true_time, begun = time.clock_gettime(time.CLOCK_REALTIME), time.monotonic()
    try:
        for offset in DAY, -2 * DAY:
            time.clock_settime(time.CLOCK_REALTIME, time.clock_gettime(time.CLOCK_REALTIME) + offset)
            campaign.wait_for_lock()
    finally:
        time.clock_settime(time.CLOCK_REALTIME, true_time + time.monotonic() - begun)
    campaign.wait_for_lock()


def all_stopped(campaign):
    """Stops all processes for longer than hang_s, and for less than the watchdog's timeout."""
    child = campaign.live.child()
    all_of_them = [campaign.live.pid, *campaign.live.children()]
    for pid in all_of_them:
        stop(pid)
    time.sleep(HANG_S + 1)
    for pid in reversed(all_of_them):
        os.kill(pid, signal.SIGCONT)
    campaign.wait_for_lock()
    expect(campaign.live.child() == child, "it was restarted")


def killed_and_stopped(campaign):
    first = campaign.live.child()
    os.kill(first, signal.SIGKILL)
    campaign.wait_for_next_run()
    second = campaign.live.child(first)
    os.kill(second, signal.SIGSTOP)
    campaign.wait_for_next_run()
    expect(campaign.live.child() not in (first, second), "the same process")


def check_times(database):
    """Checks that the wall clock does not affect model time: each step is a period after the one
    before, and no good sample is from the future or older than stale_s. A stamp may be 1 us after
    the instant of its tick."""
    for run in 1, 2, 3:
        steps = query(database, "SELECT step, t_ns FROM steps WHERE steps.run = ? ORDER BY step", run)
        wanted = [(steps[0][0] + i, (steps[0][0] + i + 1) * 10**7) for i in range(len(steps))]
        expect(steps == wanted, f"run {run}: steps are missing, or at other times")
    wrong = number(database, """SELECT count(*) FROM samples JOIN signals USING (run, signal) JOIN runs USING (run)
                                WHERE kind = 'plant' AND quality = ? AND signals.name NOT LIKE '%@reading'
                                AND tick * step_ns - stamp_ns NOT BETWEEN -1000 AND 200000000""", GOOD)
    expect(wrong == 0, f"{wrong} good samples are from the future, or older than 0.2 s")
    ended = query(database, "SELECT run, started, ended FROM runs WHERE julianday(ended) - julianday(started) NOT BETWEEN -0.01 AND 0.04")
    expect(not ended, f"wrong times of runs: {ended}")


def expect_replay(config, database, run):
    """A slow box may end a run while its twin is behind the samples. Then the replay has more steps."""
    again = scratch() / "again.db"
    replay_json(config, "--recording", database, "--run", str(run), "--db", again, timeout=PATIENCE)
    wanted, found = [bits(row) for row in query(database, RESULTS, run)], [bits(row) for row in query(again, RESULTS, 1)]
    expect(wanted and found[:len(wanted)] == wanted, f"run {run}: {len(wanted)} steps, {len(found)} replayed, or other values")


def test_campaign():
    bus = box.description()["can_bus"]
    near, far = bus["interface"], bus["far_interface"]
    for name in near, far:
        box.change(bus["up"], interface=name)
    config, database = live_config(sources={"bus": {"can": {"interface": near}}}, realtime={"hang_s": HANG_S})
    sent, by_us = transmitted(near), 1
    with Motor(OMEGA, name=far) as motor, Supervised(config, "--watchdog", box.description()["watchdog"]["device"],
                                                     "--watchdog-timeout", WATCHDOG_S, state=known_state(BUILD / "rig" / "can_states.json")) as live:
        wait_for_run(live, database, 1)
        campaign = Campaign(live, database)
        bus_off(campaign, motor, near)
        clock_set(campaign)
        all_stopped(campaign)
        expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{live.log()}")
        motor.omega = OMEGA - 8  # far from where a new twin starts
        campaign.wait_for_lock()
        killed_and_stopped(campaign)
        end_orderly(live)
        expect(live.account()["starts"] == 3 and live.account()["restarts"] == 2, f"{live.account()}")
    expect(transmitted(near) - sent in (0, by_us), f"{transmitted(near) - sent} frames were sent at {near}")
    expect_starts(database, "start", "2|1|signal 9|Killed", "3|2|heartbeat")
    expect_events(database, ("warning", f"{near}|bus-off"), ("info", f"{near}|up"), ("info", "plant.omega|good"))
    expect(events_with(database, "bus-off") == 1, "bus-off was reported more than once")
    check_database(database)
    check_times(database)
    for run in 2, 3:
        expect_in_lock(database, run)
        expect_replay(config, database, run)
    for name in near, far:
        box.change(bus["down"], interface=name)


main()
