#!/usr/bin/env python3
"""On the box: the serial line carries every byte value in both directions."""
import os
import select
import termios
import time

import box
import twinlock_test
from twinlock_test import expect

EVERY_BYTE = bytes(range(256))


def opened(path):
    """Opens a line as Modbus RTU does: raw, 8E1, 19200 baud."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    control = termios.CS8 | termios.PARENB | termios.CREAD | termios.CLOCAL
    settings = [0, 0, control, 0, termios.B19200, termios.B19200, termios.tcgetattr(line)[6]]
    termios.tcsetattr(line, termios.TCSANOW, settings)
    termios.tcflush(line, termios.TCIOFLUSH)
    return line


def received(line, count):
    found, deadline = b"", time.monotonic() + 5
    while len(found) < count and select.select([line], [], [], max(0, deadline - time.monotonic()))[0]:
        found += os.read(line, count - len(found))
    return found


def test_both_ways():
    serial = box.description()["serial"]
    ends = opened(serial["device"]), opened(serial["far_device"])
    for sender, receiver in (ends, ends[::-1]):
        os.write(sender, EVERY_BYTE)
        found = received(receiver, len(EVERY_BYTE))
        expect(found == EVERY_BYTE, f"{len(found)} bytes came: {found.hex()}")
    for line in ends:
        os.close(line)


twinlock_test.main()
