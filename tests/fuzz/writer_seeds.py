#!/usr/bin/env python3
"""Makes the seeds of fuzz_writer: runs as they should be, one with numbers that nobody has, and one whose outbox is attacked. The build runs it:
tests/fuzz/writer_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

START, ENTRY, EVENT, CHECKPOINT, ATTACK, WRITE, OTHER = 0, 1, 4, 5, 6, 7, 8  # of act()
END, SUCCEED, OPEN_AGAIN = range(3)  # of OTHER


def act(what, how=0):
    return bytes([9 * how + what])


def number(value):
    """As number() reads it: below 200 a byte."""
    if 0 <= value < 200:
        return bytes([value])
    return struct.pack(">BQ", 255 if value < 0 else 200, ~value >> 1 if value < 0 else value << 8 & 2**64 - 1)


def start(run=0, tick=0, at=0, how=1):
    numbers = b"".join(map(number, (run, tick, at, 2, 0, 1)))
    return act(START, how) + numbers + b"ab"


def sample(tick, *stamps):
    return act(ENTRY, 2) + number(tick) + number(5) + number(7) + b"".join(map(number, stamps or (tick, tick)))


def step(tick, value=1):
    return act(ENTRY, 3) + b"".join(map(number, (tick, 100, value, 40, 20, 21, value, value)))


def tuning(tick, how=4):
    """With 4 of the configuration that is known and told so, with 18 of it too, with 25 of another."""
    return act(ENTRY, how) + number(tick)


def event(tick, text=b"ABC"):
    return act(EVENT) + text + number(tick)


def checkpoint(tick, size=27):
    return act(CHECKPOINT, size) + number(tick)


def attack(word, place):
    return act(ATTACK) + struct.pack(">II", word, place)


def ticks(first, count):
    return b"".join(sample(tick) + step(tick) for tick in range(first, first + count))


WRITTEN, ENDED = act(WRITE), act(OTHER, END)
SEEDS = {
    "whole_run": start() + ticks(0, 5) + event(1) + checkpoint(4) + WRITTEN + act(OTHER, OPEN_AGAIN) + ticks(5, 1) + ENDED + WRITTEN,
    "tunings": start() + ticks(0, 2) + tuning(2, 18) + ticks(2, 1) + tuning(3) + tuning(3, 25) + ticks(3, 1) + WRITTEN + start(how=2) + tuning(3, 18)
               + WRITTEN + ENDED,
    "two_runs": start() + ticks(0, 1) + event(1) + start(how=2) + event(1) + ticks(0, 2) + WRITTEN + start(how=3) + ticks(1, 2) + event(1)
                + act(OTHER, OPEN_AGAIN) + WRITTEN,
    "wild_numbers": start(run=-2**62, tick=2**50, at=-2**40, how=3) + ticks(2**50, 1) + sample(-5, 2**50, -2**62) + step(2**55, -2**60)
                    + checkpoint(-7) + event(2**55, b"\x1b\xff\n") + WRITTEN + ENDED + WRITTEN,
    "attacked": start() + ticks(0, 1) + WRITTEN + ticks(1, 1) + attack(0x01020304, 6) + attack(0xFFFFFFFF, 64) + event(1) + WRITTEN
                + act(OTHER, SUCCEED) + start() + ticks(2, 1) + WRITTEN,
}


def main():
    for name, seed in SEEDS.items():
        (Path(sys.argv[1]) / name).write_bytes(seed)


if __name__ == "__main__":
    main()
