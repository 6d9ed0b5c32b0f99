#!/usr/bin/env python3
"""Makes the seeds of fuzz_mailbox: an honest plant, one that was killed in the middle of a post, and lies around each look-up. The build runs it:
tests/fuzz/mailbox_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

POST, COUNT, SET_COUNT, SLOT, WORD, MEND = range(6)  # what an enemy does
LOOK_UP, TAKE = 160, 210


def word(value):
    return struct.pack(">I", value & 0xFFFFFFFF)


def number(value):
    """As take_number() reads a small one."""
    return b"\1" + word(value)


def wide(value):
    return b"\0" + word(value) + word(value >> 32)


def negative(value):
    return b"\x81" + word(~value)


def shape(*signals):
    """How deep each is (a power of two, 128 more: looked up by the next reading), and how far back it is looked up."""
    return bytes([len(signals) - 1]) + bytes(byte for signal in signals for byte in signal)


def act(what, signal=0):
    """Of all bytes that mean both, one."""
    return bytes([next(byte for byte in range(160) if byte % 6 == what and byte // 8 % 3 == signal)])


def post(signal, value, instant):
    return act(POST, signal) + bytes([value]) + word(instant) + b"\0\0"


def take(instant):
    return bytes([TAKE]) + word(instant) + b"\0"


def look_up(signal, first, last, how=number):
    return bytes([LOOK_UP, signal]) + how(first) + how(last)


def slot(back, value, stamp, quality=0):
    return act(SLOT) + bytes([back]) + number(value) + number(stamp) + number(quality)


def honest():
    ticks = b"".join(post(0, i, 100 * i) + post(1, 1, 100 * i) + take(100 * i + 50) for i in range(12))
    return shape((2, 0), (0x82, 1)) + ticks + look_up(1, 850, 900) + look_up(1, 0, 2000) + take(0x77359400) + look_up(0, 1 << 40, 1 << 20, wide)


def killed():
    """A count behind its slots; a successor mends it and goes on."""
    posts = b"".join(post(0, i, 10 * i) for i in range(9))
    half = act(WORD) + word(4) + number(0x13)
    return shape((3, 0)) + posts + half + take(100) + act(MEND) + take(100) + post(0, 9, 90) + take(100) + look_up(0, 0, 1000)


def lies():
    """Stamps that go back and forth, counts that jump, qualities that there are not."""
    slots = b"".join(slot(i, i, i, 7) + slot(i, 1 << 31, i) for i in range(20))
    jump = act(SET_COUNT) + number(100000) + act(COUNT) + b"\5"
    ends = b"".join(slot(i, 5, stamp, 0) for i, stamp in enumerate((2**31, 1, 2**32 - 1)))
    return (shape((8, 0)) + post(0, 1, 10) + jump + slots + take(0) + look_up(0, 1, 30) + take(-5) + ends + look_up(0, 0, 2**63 - 1, wide)
            + take(50) + act(SET_COUNT) + negative(1) + take(0) + look_up(0, 2**62, 7, wide))


def main():
    folder = Path(sys.argv[1])
    for seed in (honest, killed, lies):
        (folder / seed.__name__).write_bytes(seed())


if __name__ == "__main__":
    main()
