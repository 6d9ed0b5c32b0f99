#!/usr/bin/env python3
"""On the box: the watchdog is fed, and closed by the magic character. tests/hil/test_rig.py has the case where it
bites. With the word `bite` as argument it does."""
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
    """The watchdog, running, with a short time to live. Opened without O_CREAT: no plain file where it is missing."""
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
    time.sleep(TIMEOUT_S + 1)  # it would bite now


def bite():
    opened()
    print("watchdog opened", flush=True)
    time.sleep(10 * TIMEOUT_S)
    sys.exit("the watchdog has not bitten")


if sys.argv[1:] == ["bite"]:
    bite()
twinlock_test.main()
