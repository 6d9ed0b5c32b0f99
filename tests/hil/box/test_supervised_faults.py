#!/usr/bin/env python3
"""On the box: one supervised run at a real CAN controller, with the watchdog armed, goes through a campaign: bus-off, the
wall clock set forward and back by a day, its process killed, stopped, and both processes stopped. It is back in lock after
each, and the watchdog bites in none: that the tests after this one run shows it. What makes it bite is in
tests/hil/test_box_resets.py.

The controllers' model never leaves the bus by itself. Bus-off is therefore what its driver would pass up, sent through the
driver's echo; the link that goes down and comes back with it is the controller's own.
"""
import os
import signal
import time

import box
from can_bus import ERROR, OMEGA, Bus, Motor, events_with, interface_down, interface_up, live_config, transmitted
from live_test import (GOOD, NO_LINK, PATIENCE, RESULTS, check_database, expect_events, expect_repeated, number, query, stop,
                       wait_until)
from supervised import Supervised, end_orderly, expect_in_lock, expect_starts, wait_for_run
from twinlock_test import expect, main, replay_json, scratch

DAY = 86400
HANG_S = 5
WATCHDOG_S = 15
BUS_OFF = 0x40  # linux/can/error.h


class Campaign:
    """A run, its database, and what can be waited for in its newest run."""

    def __init__(self, live, database):
        self.live, self.database, self.run = live, database, 1

    def newest_step(self):
        return number(self.database, "SELECT max(step) FROM steps WHERE run = ?", self.run) or 0

    def wait_for_lock(self):
        """20 steps from now on within tolerance."""
        begun = self.newest_step()
        wait_until(lambda: number(self.database, "SELECT count(*) FROM steps WHERE run = ? AND step > ? AND outcome IN (1, 2)",
                                  self.run, begun) >= 20, "lock", self.live.log)

    def wait_for_quality(self, quality):
        newest = """SELECT quality FROM samples JOIN signals USING (run, signal)
                    WHERE run = ? AND name = 'plant.omega' ORDER BY tick DESC LIMIT 1"""
        wait_until(lambda: query(self.database, newest, self.run) == [(quality,)], f"quality {quality}", self.live.log)

    def wait_for_next_run(self):
        self.run += 1
        wait_for_run(self.live, self.database, self.run)


def bus_off(campaign, motor, interface):
    """The link is set down and up again, which is what brings a controller back to the bus that does not restart itself."""
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
    """Forward by a day, then back by two, then right again. Stamps are not of this clock."""
    true_time, begun = time.clock_gettime(time.CLOCK_REALTIME), time.monotonic()
    try:
        for offset in DAY, -2 * DAY:
            time.clock_settime(time.CLOCK_REALTIME, time.clock_gettime(time.CLOCK_REALTIME) + offset)
            campaign.wait_for_lock()
    finally:
        time.clock_settime(time.CLOCK_REALTIME, true_time + time.monotonic() - begun)
    campaign.wait_for_lock()


def all_stopped(campaign):
    """For longer than a cycle may hang, for less than the watchdog's patience."""
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
    """Model time is plant time, whatever the wall clock: each step a period after the other, no sample from the future, none
    that was good and older than its stale_s. A stamp of the next microsecond is one of the tick's instant."""
    for run in 1, 2, 3:
        steps = query(database, "SELECT step, t_ns FROM steps WHERE run = ? ORDER BY step", run)
        wanted = [(steps[0][0] + i, (steps[0][0] + i + 1) * 10**7) for i in range(len(steps))]
        expect(steps == wanted, f"run {run}: steps are missing, or at other times")
    wrong = number(database, """SELECT count(*) FROM samples JOIN signals USING (run, signal) JOIN runs USING (run)
                                WHERE kind = 'plant' AND quality = ?
                                AND tick * step_ns - stamp_ns NOT BETWEEN -1000 AND 200000000""", GOOD)
    expect(wrong == 0, f"{wrong} good samples are from the future, or older than 0.2 s")
    ended = query(database, "SELECT run FROM runs WHERE julianday(ended) - julianday(started) NOT BETWEEN -0.01 AND 0.04")
    expect(not ended, f"the times of the runs {ended} are wrong")


def expect_replay(config, database, run):
    again = scratch() / "again.db"
    replay_json(config, "--recording", database, "--run", str(run), "--db", again, timeout=PATIENCE)
    expect_repeated(database, run, again, RESULTS, number(database, "SELECT count(*) FROM steps WHERE run = ?", run))


def test_campaign():
    bus = box.description()["can_bus"]
    near, far = bus["interface"], bus["far_interface"]
    for name in near, far:
        box.change(bus["up"], interface=name)
    config, database = live_config(sources={"bus": {"can": {"interface": near}}}, realtime={"hang_s": HANG_S})
    sent, by_us = transmitted(near), 1
    with Motor(OMEGA, name=far) as motor, Supervised(config, "--watchdog", box.description()["watchdog"]["device"],
                                                     "--watchdog-timeout", WATCHDOG_S) as live:
        wait_for_run(live, database, 1)
        campaign = Campaign(live, database)
        bus_off(campaign, motor, near)
        clock_set(campaign)
        all_stopped(campaign)
        expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{live.log()}")
        motor.omega = OMEGA - 8  # where no twin starts by itself
        campaign.wait_for_lock()
        killed_and_stopped(campaign)
        end_orderly(live)
        expect(live.account()["starts"] == 3 and live.account()["restarts"] == 2, f"{live.account()}")
    expect(transmitted(near) - sent in (0, by_us), f"{transmitted(near) - sent} frames were sent at {near}")
    expect_starts(database, "start 1, 0 of them", "it was ended by signal 9, Killed", "it hung: \"")
    expect_events(database, ("warning", "bus-off"), ("info", "is up"), ("info", "good again"))
    expect(events_with(database, "bus-off") == 1, "bus-off was told more than once")
    check_database(database)
    check_times(database)
    for run in 2, 3:
        expect_in_lock(database, run)
        expect_replay(config, database, run)
    for name in near, far:
        box.change(bus["down"], interface=name)


main()
