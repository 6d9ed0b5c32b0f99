#!/usr/bin/env python3
"""On the box, for tests/hil/power_cuts --in-a-row: runs the twin on the disk of the power cuts
before, until the next cut. Prints these lines:
  started N      the supervisor starts, on a disk with N runs
  served N       see record.py
  committed N    see record.py
  begun N        see record.py
  locked N       the database has N steps of this boot's runs within tolerance
  back N         the first 20 of them were there N ms after the start of the supervisor
"""
import os
import time

import live_test
import power_cuts
from live_test import FIRST_GUESS, OPTIMISED, number
from record import DISK, CountingDevice, begun, committed, say
from supervised import Supervised

PORT = 1502  # constant, so that all boots have the same configuration


def count(database, question, *values):
    return number(database, question, *values) if database.exists() else 0


def main():
    live_test.PATIENCE = 3600  # s; the power cut ends the run
    config, database = DISK / "config.json", DISK / "twin.db"
    if not config.exists():
        config.write_text(power_cuts.configuration(PORT, 1), encoding="utf-8")
        os.sync()
    with CountingDevice(power_cuts.OMEGA, port=PORT) as device:
        before = count(database, "SELECT count(*) FROM runs")
        with Supervised(config, state=DISK / "state") as live:
            say("started", before)
            begin, is_back = time.monotonic(), False
            while live.process.poll() is None:
                for _ in range(4):
                    say("served", device.served)
                    time.sleep(0.05)
                if (start := begun(live)) is not None:
                    say("begun", start)
                if (tick := committed(database)) is not None:
                    say("committed", tick)
                locked = count(database, "SELECT count(*) FROM steps WHERE steps.run > ? AND outcome IN (?, ?)", before, FIRST_GUESS, OPTIMISED)
                say("locked", locked)
                if locked >= 20 and not is_back:
                    is_back = True
                    say("back", round(1000 * (time.monotonic() - begin)))


if __name__ == "__main__":
    main()
