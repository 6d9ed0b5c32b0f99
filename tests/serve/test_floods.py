#!/usr/bin/env python3
"""Clients without a token, and slow ones, neither exhaust the server's memory nor delay other
clients."""
import os

from floods import ATTACKS, HONEST, from_everywhere, longest_wait, silent
from served import FIRST, MOTOR, Box, wait_for
from twinlock_test import SANITIZER, at_most, expect, main

MEMORY = 64 * 1024 * 1024
LIMIT_S = 10  # on a loaded machine; tests/bench/serve.py has a limit of 2 s


def descriptors(box):
    return len(os.listdir(f"/proc/{box.process.pid}/fd"))


def test_an_honest_client_is_answered_during():
    with Box() as box:
        idle = descriptors(box)
        expect(box.put(b'{"x": "' + 260000 * b"y" + b'"}').status == 200, "no large configuration")
        for attack in ATTACKS:
            at_most(longest_wait(box, attack), LIMIT_S, f"{attack.__name__}: an honest client waited, s")
        expect(box.ask("GET", MOTOR, "read", address=HONEST).status == 200, "no answer after the attacks")
        if not SANITIZER:
            at_most(box.memory() / 2**20, MEMORY / 2**20, "memory, MiB")
        wait_for(lambda: descriptors(box) == idle, "the end of all connections", 45)
        lines = box.log().count("\n")
        at_most(lines, 300, "lines in the log")


def test_connection_limits():
    """Of one address, and in total, counted as descriptors of the server."""
    with Box() as box:
        idle = descriptors(box)
        for attack, most in ((silent, 8), (from_everywhere, 64)):
            with attack(box) as held:
                wait_for(lambda: len(held) > 500, "connections")
                at_most(descriptors(box) - idle, most + 1, f"{attack.__name__}: connections, and one that is refused")


def test_a_connection_without_a_request_is_closed():
    with Box() as box:
        idle = descriptors(box)
        line = box.connect(timeout=30)
        line.connect()
        wait_for(lambda: descriptors(box) == idle + 1, "the connection")
        wait_for(lambda: descriptors(box) == idle, "its end", 15)
        expect(box.ask("GET", f"{MOTOR}/configuration").body == FIRST, "another answer")


main()
