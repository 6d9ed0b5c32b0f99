#!/usr/bin/env python3
"""A live twin that starvation has blown up: it says so within 2 s and is in lock again within 10, and a replay does the same."""
import os
import random
import signal
import time

from live_test import MADE_UP, Device, Program, check_replay, end_well, member, number, query, stop, wait_for_lock
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts
STEP_S = 0.001
NOISE = 0.7  # rad/s: the tolerance is 1, so that corrections are noise
RISE, RISES_S = 1500, 0.05  # rad/s²: to follow it, Δu makes the friction negative
TRIES, STARVED_S = 30, 2  # one try in three loses the twin: those with such a Δu in the last step
PATIENCE_S = 12


class NoisyDevice(Device):
    """Its readings are noise around OMEGA, or rise from there."""

    def __init__(self, seed):
        super().__init__(OMEGA)
        self.draw, self.rises_since = random.Random(seed), None

    def _reply(self, request):
        since = self.rises_since
        self.omega = OMEGA + (self.draw.gauss(0, NOISE) if since is None else RISE * (time.monotonic() - since))
        return super()._reply(request)


def ticks(database, words):
    """At which the state of the lock was told so."""
    return [tick for tick, in query(database, "SELECT tick FROM events WHERE source = 'lock' AND text LIKE ? ORDER BY tick", f"{words}: %")]


def starve(live, device, database):
    """Stops the twin while it follows a rise, until a held Δu has blown it up once and it is brought back."""
    for _ in range(TRIES):
        twin = member(live, "twin")
        device.rises_since = time.monotonic()
        time.sleep(RISES_S)
        stop(twin)
        device.rises_since = None
        time.sleep(STARVED_S)
        os.kill(twin, signal.SIGCONT)
        time.sleep(1)
        if ticks(database, "begun anew"):
            return
    expect(False, f"in {TRIES} times {STARVED_S} s of starvation the twin was never lost")


def wait_until_locked(database):
    """After it was brought back, if it was."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and max(ticks(database, "locked"), default=-1) <= max(ticks(database, "begun anew"), default=0):
        time.sleep(0.1)


def test_starved():
    with NoisyDevice(1) as device:
        config = edited_config(PLAIN_LIVE, {
            "duration_s": None, "step_s": STEP_S, "record": {"commit_s": 0.1}, "synchronise": {"budget": {"time_s": 0.6 * STEP_S}},
            "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": 0.002}}}})
        database = config.parent / "twin.db"
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            wait_until_locked(database)
            starve(live, device, database)
            wait_until_locked(database)
            told, _ = end_well(live, signal.SIGTERM)
    back = ticks(database, "begun anew")[0]
    lost = [tick for tick in ticks(database, "lost") if tick < back][-1]
    locked = next(iter(tick for tick in ticks(database, "locked") if tick > back), None)
    began = number(database, "SELECT max(step) FROM steps WHERE outcome <> ? AND step < ?", MADE_UP, lost - 100)
    expect(locked is not None, f"it was not in lock again: {told['lock']}")
    at_most((lost - began) * STEP_S, 2, "told after so many s of plant time")
    at_most((locked - began) * STEP_S, 10, "in lock again after so many s of plant time")
    expect(told["lock"]["losses"] >= 1, f"{told['lock']}")
    rows = number(database, "SELECT count(*) FROM steps")
    check_replay(config, database, rows)


if __name__ == "__main__":
    main()
