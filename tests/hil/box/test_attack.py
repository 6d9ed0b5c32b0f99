#!/usr/bin/env python3
"""On the box: attacks by an FMU on a bus, a serial line and a GPIO chip, and the attacks of
tests/support/attacks.py on this older kernel."""
import os
import socket
import tty

import box
from twinlock_test import HUNG_S, BUILD, expect, main

# test_rig.py makes it, because compiling takes minutes on the box
os.environ.setdefault("TL_ATTACKER", str(BUILD / "rig" / "attack.fmu"))

import attacks  # noqa: E402, because it reads the environment
from attacks import ATTACKS, Attack, Ground, users  # noqa: E402


def bus(ground):
    """Evidence: another socket on the same interface receives the frame."""
    interface = box.description()["can"]["interface"]
    listener = ground.keep(socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW))
    listener.bind((interface,))
    return (interface,), lambda: attacks.received(listener)


def line(ground):
    """Evidence: the text arrives at the other end of the serial line."""
    serial = box.description()["serial"]
    far = os.open(serial["far_device"], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(far)
    ground.kept.append(lambda: os.close(far))
    return (serial["device"], "attack"), lambda: b"attack" in attacks.readable(far)


def chip(_):
    return (box.gpio_chip(),), None


ON_THE_BOX = (
    Attack("CAN frame", "can_frame", bus, ("socket",)),
    Attack("serial line", "write_device", line, (), attacks.as_root),
    Attack("GPIO chip", "write_device", chip, (), attacks.as_root),
)


def carried_out(user, confined, verb="replay"):
    ground = Ground(user, confined=confined, verb=verb)
    for attack in (*ON_THE_BOX, *(attack for attack in ATTACKS if attack.label != "serial line")):
        ground.order(attack)
    return ground.run(timeout=HUNG_S)


def test_attacks_on_the_box():
    for user in users():
        with carried_out(user, False) as ground:
            missed = [attack.label for attack, reached in ground.evidence.items() if attack.only(ground) and not reached()]
            expect(not missed, f"{ground}: did not succeed: {missed}\n{ground.said()}")
            print(f"    {ground}: {len(ground.evidence)} tried")


def test_confined_attacks_on_the_box():
    for user, verb in ((user, verb) for user in users() for verb in ("replay", "check", "plant")):
        with carried_out(user, True, verb) as ground:
            reached = [attack.label for attack, reached in ground.evidence.items() if reached()]
            tried = ground.reports()
            silent = [attack.label for attack in ground.evidence if attack.label not in tried]
            expect(not reached and not silent, f"{ground}: reached {reached}, not even tried {silent}\n{ground.said()}")
            expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")


main()
