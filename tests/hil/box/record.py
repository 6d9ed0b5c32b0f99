#!/usr/bin/env python3
"""On the box, for tests/hil/power_cuts.py: records onto /disk until the power is cut, and tells on standard output what
the cut must not undo, a line each time:
  served N       the plant, a Modbus device, has answered N requests; each answer has its number in it
  committed N    a reader of the database has seen tick N
  replacing N    an administrator begins to replace the configuration by version N: new file, fsync, rename
  begun N        the supervisor has begun its twin for the Nth time
  starts N       an account of restarts was kept N times, by the supervisor's own code (tests/hil/restarts_probe.c)
"""
import os
import re
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import live_test
import power_cuts
from live_test import Device, query
from supervised import Supervised
from twinlock_test import BUILD

DISK = Path("/disk")


class CountingDevice(Device):
    """Input registers 3 and 4 count the answers."""

    served = 0

    def _reply(self, request):
        function, address, count = struct.unpack(">BHH", request[:5])
        self.served += 1
        data = struct.pack(">fhI", self.omega, self.torque, self.served)[2 * address:2 * (address + count)]
        return bytes((function, len(data))) + data


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")  # one write each: there are several threads
    sys.stdout.flush()


def replace_for_ever(port):
    """As a careful tool does: whole under another name, on the disk, then renamed."""
    version = 1
    while True:
        time.sleep(0.2)
        version += 1
        say("replacing", version)
        with open(DISK / "config.json.tmp", "w", encoding="utf-8") as file:
            file.write(power_cuts.configuration(port, version))
            file.flush()
            os.fsync(file.fileno())
        os.rename(DISK / "config.json.tmp", DISK / "config.json")


def begun(live):
    """After it was kept: the twin says so itself."""
    return max(map(int, re.findall(r"supervisor: start (\d+), ", live.log())), default=None)


def committed(database):
    return query(database, power_cuts.LAST_TICK)[0][0] if database.exists() else None


def main():
    live_test.PATIENCE = 3600  # whoever cuts the power knows how long he waits
    with CountingDevice(power_cuts.OMEGA) as device:
        (DISK / "config.json").write_text(power_cuts.configuration(device.port, 1), encoding="utf-8")
        os.sync()
        with Supervised(DISK / "config.json", state=DISK / "state") as live:
            live.wait_for("connected")
            threading.Thread(target=replace_for_ever, args=(device.port,), daemon=True).start()
            with subprocess.Popen([BUILD / "tests" / "restarts_probe", DISK / "account"]):
                while True:
                    for _ in range(4):
                        say("served", device.served)
                        time.sleep(0.05)
                    if (start := begun(live)) is not None:
                        say("begun", start)
                    if (tick := committed(DISK / "twin.db")) is not None:
                        say("committed", tick)


if __name__ == "__main__":
    main()
