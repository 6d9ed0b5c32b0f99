#!/usr/bin/env python3
"""On the box: the GPIO chip has the described lines, and the character device delivers an external
edge with its time (linux/gpio.h, version 2 of the interface, without a library)."""
import fcntl
import os
import select
import struct
import subprocess
import time
from pathlib import Path

import box
import twinlock_test
from twinlock_test import expect

# linux/gpio.h
# gpio_v2_line_info: name, consumer, offset, num_attrs, flags, attrs, padding
# gpio_v2_line_request: offsets[64], consumer, config (flags, num_attrs, padding, attrs), num_lines,
# event_buffer_size, padding, fd
# gpio_v2_line_event: timestamp_ns, id, offset, seqno, line_seqno, padding
LINE_INFO = struct.Struct("=32s32sIIQ160s16x")
LINE_REQUEST = struct.Struct("=64I32sQI20x240sII20xi")
LINE_EVENT = struct.Struct("=QIIII24x")
GET_LINE_INFO = 0xC100B405
GET_LINE = 0xC250B407
INPUT, RISING, FALLING = 1 << 2, 1 << 4, 1 << 5
RISING_EDGE, FALLING_EDGE = 1, 2


def line_name(chip, offset):
    info = bytearray(LINE_INFO.pack(b"", b"", offset, 0, 0, b""))
    fcntl.ioctl(chip, GET_LINE_INFO, info)
    return LINE_INFO.unpack(info)[0].split(b"\0")[0].decode()


def requested(chip, offset):
    """The file descriptor that delivers both edges of a line."""
    offsets = [offset] + 63 * [0]
    request = bytearray(LINE_REQUEST.pack(*offsets, b"test", INPUT | RISING | FALLING, 0, b"", 1, 0, 0))
    fcntl.ioctl(chip, GET_LINE, request)
    return LINE_REQUEST.unpack(request)[-1]


def next_edge(line):
    """(rising or falling, time in ns)"""
    ready, _, _ = select.select([line], [], [], 5)
    expect(ready, "no edge within 5 s")
    stamp, edge, *_ = LINE_EVENT.unpack(os.read(line, LINE_EVENT.size))
    return edge, stamp


def test_lines_have_their_names():
    wanted = box.description()["gpio"]["lines"]
    with open(box.gpio_chip(), "rb") as chip:
        found = [line_name(chip, offset) for offset in range(len(wanted))]
    expect(found == wanted, f"found {found}, wanted {wanted}")


def test_edges_are_seen():
    name = box.description()["gpio"]["lines"][1]
    box.set_line(name, False)
    with open(box.gpio_chip(), "rb") as chip:
        line = requested(chip, 1)
    for is_high, wanted in ((True, RISING_EDGE), (False, FALLING_EDGE)):
        before = time.monotonic_ns()
        box.set_line(name, is_high)
        edge, stamp = next_edge(line)
        expect(edge == wanted, f"found edge {edge}, wanted {wanted}")
        expect(before <= stamp <= time.monotonic_ns(), f"stamp {stamp} of the edge, pulled after {before}")
    expect(not select.select([line], [], [], 0)[0], "more edges than pulls")
    os.close(line)


def test_a_chip_goes_while_its_line_is_held():
    """As if a USB adapter is pulled out. Needs gpio-sim, which the rig has. The kernel warns that
    an interrupt was still in use, because its /proc entry leaks. It must not crash."""
    made = Path("/sys/kernel/config/gpio-sim/second")
    if not made.parent.is_dir():
        raise twinlock_test.Skip("this box has no gpio-sim")
    (made / "bank0").mkdir(parents=True)
    (made / "live").write_text("1", encoding="ascii")
    device = Path("/dev") / (made / "bank0/chip_name").read_text(encoding="ascii").strip()
    with open(device, "rb") as chip:
        line = requested(chip, 0)
    (made / "live").write_text("0", encoding="ascii")
    expect(not device.exists(), f"{device} is still there")
    os.close(line)
    (made / "bank0").rmdir()
    made.rmdir()
    log = subprocess.run(["dmesg"], capture_output=True, encoding="utf-8", check=True).stdout
    harm = [line for line in log.splitlines() if "BUG:" in line or "Oops" in line or "general protection" in line]
    expect(not harm, "\n".join(harm))
    test_edges_are_seen()


twinlock_test.main()
