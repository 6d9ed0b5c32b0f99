#!/usr/bin/env python3
"""A live twin that diverges after it got no processor time.

It must report the loss within 2 s and be in lock again within 10 s. A replay must do the same.
"""
import os
import random
import re
import signal
import time

from live_test import MADE_UP, Device, Program, check_replay, end_well, member, number, query, stop, wait_for_lock
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, has_line, main

OMEGA = 62.981  # rad/s: where config/motor's twin starts
STEP_S = 0.001
NOISE = 0.7  # rad/s: the tolerance is 1, so corrections are noise
RISE, RISES_S = 1500, 0.05  # rad/s² and s: to follow it, Δu makes the friction negative
TRIES, STARVED_S = 30, 2  # one try in three loses the twin, if the last step has such a Δu
RECOVERED = "FMUs|start values"  # parts of the event of a recovery
PATIENCE_S = 12


class NoisyDevice(Device):
    """A device whose readings are noise around OMEGA, or rise from there."""

    def __init__(self, seed):
        super().__init__(OMEGA)
        self.draw, self.rises_since = random.Random(seed), None

    def _reply(self, request):
        since = self.rises_since
        self.omega = OMEGA + (self.draw.gauss(0, NOISE) if since is None else RISE * (time.monotonic() - since))
        return super()._reply(request)


def ticks(database, state):
    """The ticks of the events that report this lock state, or the recovery of the twin
    (RECOVERED)."""
    told = query(database, "SELECT tick, text FROM events WHERE source = 'lock' ORDER BY tick")
    return [tick for tick, text in told if (has_line(text, state) if state == RECOVERED else re.match(r"\w+", text)[0] == state)]


def starve(live, device, database):
    """Stops the twin while it follows a rise, until it has diverged once because of a held Δu, and
    has recovered."""
    for _ in range(TRIES):
        twin = member(live, "twin")
        device.rises_since = time.monotonic()
        time.sleep(RISES_S)
        stop(twin)
        device.rises_since = None
        time.sleep(STARVED_S)
        os.kill(twin, signal.SIGCONT)
        time.sleep(1)
        if ticks(database, RECOVERED):
            return
    expect(False, f"no loss in {TRIES} times {STARVED_S} s without processor time")


def wait_until_locked(database):
    """Waits until the twin is locked, after its last recovery if there was one."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and max(ticks(database, "locked"), default=-1) <= max(ticks(database, RECOVERED), default=0):
        time.sleep(0.1)


def test_starved():
    with NoisyDevice(1) as device:
        config = edited_config(PLAIN_LIVE, {  # u must not rest at nominal, as it soon would because corrections are noise
            "duration_s": None, "step_s": STEP_S, "record": {"commit_s": 0.1}, "synchronise": {"rest": False, "budget": {"time_s": 0.6 * STEP_S}},
            "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": 0.002}}}})
        database = config.parent / "twin.db"
        with Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            wait_until_locked(database)
            starve(live, device, database)
            wait_until_locked(database)
            told, _ = end_well(live, signal.SIGTERM)
    back = ticks(database, RECOVERED)[0]
    lost = [tick for tick in ticks(database, "lost") if tick < back][-1]
    locked = next(iter(tick for tick in ticks(database, "locked") if tick > back), None)
    began = number(database, "SELECT max(step) FROM steps WHERE outcome <> ? AND step < ?", MADE_UP, lost - 100)
    expect(locked is not None, f"no lock after the recovery: {told['lock']}")
    at_most((lost - began) * STEP_S, 2, "s until the loss was reported, in plant time")
    at_most((locked - began) * STEP_S, 10, "s until it was in lock again, in plant time")
    expect(told["lock"]["losses"] >= 1, f"{told['lock']}")
    rows = number(database, "SELECT count(*) FROM steps")
    check_replay(config, database, rows)


if __name__ == "__main__":
    main()
