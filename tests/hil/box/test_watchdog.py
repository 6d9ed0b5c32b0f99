#!/usr/bin/env python3
"""On the box: keepalives prevent a reset, and the magic character disarms the watchdog. With the
argument `bite` the watchdog resets the box, for tests/hil/test_rig.py."""
import fcntl
import os
import struct
import sys
import time

import box
import twinlock_test
from twinlock_test import expect

# linux/watchdog.h
GET_SUPPORT, SET_TIMEOUT = 0x80285700, 0xC0045706
TIMEOUT_S = 2


def opened():
    """Arms the watchdog with a short timeout. Without O_CREAT, so that a missing device makes no
    plain file."""
    watchdog = os.open(box.description()["watchdog"]["device"], os.O_WRONLY)
    fcntl.ioctl(watchdog, SET_TIMEOUT, struct.pack("=i", TIMEOUT_S))
    return watchdog


def test_identity():
    watchdog = opened()
    info = fcntl.ioctl(watchdog, GET_SUPPORT, bytes(40))
    os.write(watchdog, b"V")
    os.close(watchdog)
    found = info[8:].split(b"\0")[0].decode()
    expect(found == box.description()["watchdog"]["identity"], f"found {found!r}")


def test_fed_and_closed():
    watchdog = opened()
    until = time.monotonic() + TIMEOUT_S + 1
    while time.monotonic() < until:
        os.write(watchdog, b"\0")
        time.sleep(0.25)
    os.write(watchdog, b"V")
    os.close(watchdog)
    time.sleep(TIMEOUT_S + 1)  # an armed watchdog would reset the box now


def bite():
    opened()
    print("watchdog opened", flush=True)
    time.sleep(10 * TIMEOUT_S)
    sys.exit("no reset by the watchdog")


if sys.argv[1:] == ["bite"]:
    bite()
twinlock_test.main()
