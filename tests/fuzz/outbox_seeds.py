#!/usr/bin/env python3
"""Makes the seeds of fuzz_outbox: each an outbox that is used as it should be, or harmed in one way. The build runs it:
tests/fuzz/outbox_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

PUT, ATTACK, SUCCEED, SAY, TAKE = 0, 3, 5, 6, 7  # of act()
SAMPLE, STEP, START, END, EVENT, CHECKPOINT, TUNING = range(7)  # of put()
COUNTER, BYTE, FORGE, SLOT, ANYWHERE = range(5)  # of attack()
EVENTS = 512


def act(what, how):
    return bytes([8 * how + what])


def put(kind, times=1):
    return act(PUT, kind) * times


def take(most=31):
    return act(TAKE, most)


def succeed(how=0):
    return act(SUCCEED, how)


def attack(how, rest):
    return act(ATTACK, how) + bytes(rest)


def run(ticks):
    return put(START) + (put(SAMPLE) + put(STEP)) * ticks


SEEDS = {
    "whole_run": run(5) + put(CHECKPOINT) + put(SAMPLE) + put(EVENT, 2) + put(END) + take() * 2,
    "tunings": run(2) + put(TUNING) + put(SAMPLE) + put(STEP) + put(CHECKPOINT) + put(TUNING, 3) + take() + put(SAMPLE) + succeed() + take() * 2,
    "full_ring": put(START, 7) + put(SAMPLE) + put(STEP) + put(END) + take() + succeed() + (put(SAMPLE) + put(STEP)) * 21 + take(),
    "full_queue": put(EVENT, EVENTS + 8) + take() + succeed() + take() * 20,
    "successor": run(4) + put(CHECKPOINT) + put(SAMPLE) + put(STEP) + put(CHECKPOINT) + put(SAMPLE) + put(STEP) + put(EVENT) + take(1)
                 + succeed() + run(1) + take() + succeed() + take(),
    "successor_of_nobody": run(2) + succeed(7) + take() + succeed(6) + put(CHECKPOINT) + take(),
    "moved_counters": run(1) + attack(COUNTER, [2, 200, 0]) + take() + succeed() + put(EVENT) + attack(COUNTER, [2, 255, 1]) + take()
                      + succeed() + attack(COUNTER, [3, 0, 1, 0, 0, 0]) + take() + succeed(),
    "damaged_entry": run(2) + attack(BYTE, [60, 255]) + succeed() + put(SAMPLE) + take(),
    "forged_checkpoint": run(1) + put(CHECKPOINT) + attack(FORGE, [1, 7, 9, 30, 0, 0, 0, 0]) + take()
                         + attack(FORGE, [2, 8, 9, 61, 0, 0, 0, 9]) + succeed() + take(),
    "wild_event": put(EVENT, 2) + attack(SLOT, [0, 0, 0, 30, 7]) + take() + attack(SLOT, [0, 0, 0, 200, 10]) + succeed() + put(EVENT) + take(),
    "wild_word": run(2) + attack(ANYWHERE, struct.pack(">I", 4096)) + take() + succeed() + take(),
    "hostile_reader": run(1) + act(SAY, 0) + b"\xff\xff\xff\xff\x20" + put(STEP) + act(SAY, 4) + b"\0\0\1\0\t" + put(EVENT) + succeed()
                      + take() + act(SAY, 8) + b"\x7f\xff\xff\xff\x20" + put(CHECKPOINT) + succeed() + take(),
}


def main():
    for name, seed in SEEDS.items():
        (Path(sys.argv[1]) / name).write_bytes(seed)


if __name__ == "__main__":
    main()
