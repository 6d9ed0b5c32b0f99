#!/usr/bin/env python3
"""On the box, for tests/hil/test_box_resets.py: a supervised run onto /disk, with a hardware
watchdog. Each boot starts this script, and the run resumes the one before the reset:
  boot 1  kills the twin, waits for longer than the watchdog's timeout, and stops the supervisor
  boot 2  kills the supervisor, which no service manager restarts
  boot 3  ends the run, and checks that the watchdog is disarmed
"""
import os
import signal
import sys
import time
from pathlib import Path

from live_test import Device, check_database, query, wait_until
from supervised import Supervised, end_orderly, expect_starts, wait_for_run
from twinlock_test import PLAIN_LIVE, edited_config, expect

DISK = Path("/disk")
OMEGA = 62.981  # rad/s: where config/motor's twin starts
WATCHDOG, WATCHDOG_S = "watchdog1", 8


def say(text):
    print(text, flush=True)


def boot():
    """Number of this boot, from 1."""
    file = DISK / "boots"
    number = 1 + (len(file.read_text(encoding="ascii")) if file.exists() else 0)
    with open(file, "a", encoding="ascii") as boots:
        boots.write("x")
        boots.flush()
        os.fsync(boots.fileno())
    return number


def wait_for_twin(live, database, which):
    """Waits until run `which` of a twin is in lock. On a slow box the first run has no twin: it records while saved states are tested."""
    def runs():
        return [run for run, in query(database, "SELECT run FROM runs WHERE verb = 'run' ORDER BY run")] if database.exists() else []
    wait_until(lambda: len(runs()) >= which, f"run {which} of a twin", live.log)
    wait_for_run(live, database, runs()[which - 1])


def wait_to_be_reset():
    time.sleep(6 * WATCHDOG_S)
    sys.exit("no reset by the watchdog")


def stopped_supervisor(live, database):
    first = live.child()
    os.kill(first, signal.SIGKILL)
    wait_for_twin(live, database, 2)
    expect(live.child() != first, "the same process")
    time.sleep(1.2 * WATCHDOG_S)
    say("alive though the child was killed")
    live.signal(signal.SIGSTOP)
    wait_to_be_reset()


def killed_supervisor(live, database):
    wait_for_twin(live, database, 3)
    child = live.child()
    live.kill()
    wait_until(lambda: not Path(f"/proc/{child}").exists(), "its child's end")
    say("the supervisor is killed")
    wait_to_be_reset()


def orderly_end(live, database):
    wait_for_twin(live, database, 4)
    expect(live.account()["starts"] == 4 and live.account()["restarts"] == 3, f"{live.account()}")
    end_orderly(live)
    state = Path("/sys/class/watchdog", WATCHDOG, "state").read_text(encoding="ascii").strip()
    expect(state == "inactive", f"the watchdog is {state}")
    check_database(database)
    waits = ["saved states"] if query(database, "SELECT 1 FROM runs WHERE verb = 'hold'") else []
    expect_starts(database, *waits, "start", "2|1|signal 9|Killed", "3|2|watchdog", "4|3|watchdog")
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
                wait_for_twin(live, database, 1)
            {1: stopped_supervisor, 2: killed_supervisor, 3: orderly_end}[number](live, database)


if __name__ == "__main__":
    main()
