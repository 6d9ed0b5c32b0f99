#!/usr/bin/env python3
"""On the box, for tests/hil/test_box_resets.py: a supervised run onto /disk with the watchdog that is outside of the kernel.
It is run anew at each boot, and goes on where the last one was reset:
  boot 1  its process is killed, and for longer than the watchdog's patience all goes on; then the supervisor is stopped
  boot 2  the supervisor is killed, with nobody to start it again
  boot 3  all ends orderly, and the watchdog is not armed any more
"""
import os
import signal
import sys
import time
from pathlib import Path

from live_test import Device, check_database, wait_until
from supervised import Supervised, end_orderly, expect_starts, wait_for_run
from twinlock_test import PLAIN_LIVE, edited_config, expect

DISK = Path("/disk")
OMEGA = 62.981  # rad/s: where config/motor's twin starts
WATCHDOG, WATCHDOG_S = "watchdog1", 8


def say(text):
    print(text, flush=True)


def boot():
    """Which one this is."""
    file = DISK / "boots"
    number = 1 + (len(file.read_text(encoding="ascii")) if file.exists() else 0)
    with open(file, "a", encoding="ascii") as boots:
        boots.write("x")
        boots.flush()
        os.fsync(boots.fileno())
    return number


def wait_to_be_reset():
    time.sleep(6 * WATCHDOG_S)
    sys.exit("the watchdog has not bitten")


def stopped_supervisor(live, database):
    first = live.child()
    os.kill(first, signal.SIGKILL)
    wait_for_run(live, database, 2)
    expect(live.child() != first, "the same process")
    time.sleep(1.2 * WATCHDOG_S)
    say("alive though the child was killed")
    live.signal(signal.SIGSTOP)
    wait_to_be_reset()


def killed_supervisor(live, database):
    wait_for_run(live, database, 3)
    child = live.child()
    live.kill()
    wait_until(lambda: not Path(f"/proc/{child}").exists(), "the end of the child")
    say("the supervisor is killed")
    wait_to_be_reset()


def orderly_end(live, database):
    wait_for_run(live, database, 4)
    expect(live.account()["starts"] == 4 and live.account()["restarts"] == 3, f"{live.account()}")
    end_orderly(live)
    state = Path("/sys/class/watchdog", WATCHDOG, "state").read_text(encoding="ascii").strip()
    expect(state == "inactive", f"the watchdog is {state}")
    check_database(database)
    expect_starts(database, "start 1, 0 of them after a failure; reason: it was told to",
                  "start 2, 1 of them after a failure; reason: it was ended by signal 9, Killed",
                  "start 3, 2 of them after a failure; reason: the box was reset by its watchdog",
                  "start 4, 3 of them after a failure; reason: the box was reset by its watchdog")
    say("ended orderly")


def main():
    number, database = boot(), DISK / "twin.db"
    say(f"boot {number}")
    with Device(OMEGA) as device:
        config = edited_config(PLAIN_LIVE, {
            "duration_s": None, "record": {"file": str(database), "commit_s": 0.1}, "realtime": {"hang_s": 20},
            "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": 0.01}}}})
        with Supervised(config, "--watchdog", f"/dev/{WATCHDOG}", "--watchdog-timeout", WATCHDOG_S,
                        state=DISK / "state") as live:
            if number == 1:
                wait_for_run(live, database, 1)
            {1: stopped_supervisor, 2: killed_supervisor, 3: orderly_end}[number](live, database)


if __name__ == "__main__":
    main()
