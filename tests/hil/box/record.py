#!/usr/bin/env python3
"""On the box, for tests/hil/test_power_cuts.py: records onto /disk until the power is cut. Prints a
line for each fact that the cut must not undo:
  served N       the plant, a Modbus device, has answered N requests; each answer has its number
  committed N    a reader of the database has seen tick N
  replacing N    an administrator replaces the configuration by version N: new file, fsync, rename
  begun N        the supervisor has reported its Nth start of the twin
  starts N       the supervisor's code, in tests/hil/restarts_probe.c, has saved its account N times
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
    """A device whose input registers 3 and 4 count its answers."""

    served = 0

    def _reply(self, request):
        function, address, count = struct.unpack(">BHH", request[:5])
        self.served += 1
        data = struct.pack(">fhI", self.omega, self.torque, self.served)[2 * address:2 * (address + count)]
        return bytes((function, len(data))) + data


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")  # one write per line, because several threads print
    sys.stdout.flush()


def replace_for_ever(port):
    """As a careful tool does: writes a new file, syncs it, and renames it."""
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
    """Number of the latest start in the log, or None. The twin logs it after the supervisor saved
    its account."""
    return max((int(number or 1) for number in re.findall(r"supervisor: .*?\bstart\b ?(\d+)?", live.log())), default=None)


def committed(database):
    return query(database, power_cuts.LAST_TICK)[0][0] if database.exists() else None


def main():
    live_test.PATIENCE = 3600  # s; the power cut ends the run
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
