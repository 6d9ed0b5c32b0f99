#!/usr/bin/env python3
"""On the box, for tests/hil/power_cuts --in-a-row: runs the twin on the disk that the power cuts before have left, until the power is cut again.
Tells on standard output, a line each time:
  started N      the supervisor is begun, on a disk with N runs
  served N       as record.py
  committed N    as record.py
  begun N        as record.py
  locked N       N steps of this boot's runs were within tolerance, as a reader of the database sees
  back N         20 of them N ms after the supervisor was begun
"""
import os
import time

import live_test
import power_cuts
from live_test import FIRST_GUESS, OPTIMISED, number
from record import DISK, CountingDevice, begun, committed, say
from supervised import Supervised

PORT = 1502  # the same at each boot, so that the configuration stays the same


def count(database, question, *values):
    return number(database, question, *values) if database.exists() else 0


def main():
    live_test.PATIENCE = 3600  # until the power is cut
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
                locked = count(database, "SELECT count(*) FROM steps WHERE run > ? AND outcome IN (?, ?)", before, FIRST_GUESS, OPTIMISED)
                say("locked", locked)
                if locked >= 20 and not is_back:
                    is_back = True
                    say("back", round(1000 * (time.monotonic() - begin)))


if __name__ == "__main__":
    main()
