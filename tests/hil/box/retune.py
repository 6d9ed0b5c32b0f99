#!/usr/bin/env python3
"""On the box, for tests/hil/test_power_cuts.py: changes the configuration of a run, alternately in
place and by another twin, until the power is cut. Prints these lines:
  committed N    a reader of the database has seen tick N
  sent N         the next command sends candidate N
  validate N     the activation of candidate N reached this phase of activation_cuts.PHASES
  active N       candidate N is active and its probation starts, or `twinlock reload` has ended
"""
import os
import subprocess
import threading
import time
from pathlib import Path

import activation_cuts
import live_test
from live_test import Device
from record import committed, say
from supervised import Supervised
from twinlock_test import start

DISK = Path("/disk")


def follow(process, number):
    """Prints the phases that `twinlock reload` prints."""
    for line in process.stdout:
        step = line.split(" ")[0]
        if step == "probation":
            say("active", number)
        if step in activation_cuts.PHASES:
            say(step, number)
    process.wait()


def change_for_ever():
    number = 1
    while True:
        number += 1
        file = Path(f"/tmp/{number}.json")
        file.write_text(activation_cuts.configuration(number), encoding="utf-8")
        say("sent", number)
        options = "--shadow", "1", "--probation", "2", "--require-lock", "1", "--wait"
        follow(start(["reload", file, "--control", "/tmp/control", *options], stderr=subprocess.DEVNULL), number)
        say("active", number)


def main():
    live_test.PATIENCE = 3600  # s; the power cut ends the run
    with Device(activation_cuts.OMEGA, port=activation_cuts.PORT):
        (DISK / "config.json").write_text(activation_cuts.configuration(1), encoding="utf-8")
        os.sync()
        with Supervised(DISK / "config.json", "--control", "/tmp/control", state=DISK / "state") as live:
            live.wait_for("connected")
            threading.Thread(target=change_for_ever, daemon=True).start()
            while True:
                time.sleep(0.1)
                if (tick := committed(DISK / "twin.db")) is not None:
                    say("committed", tick)


if __name__ == "__main__":
    main()
