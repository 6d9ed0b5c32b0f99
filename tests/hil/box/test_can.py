#!/usr/bin/env python3
"""On the box: SocketCAN carries frames, on a virtual interface and between two controllers."""
import socket
import struct
import time

import box
import twinlock_test
from twinlock_test import expect

FRAME = struct.Struct("=IB3x8s")  # can_id, can_dlc, data: linux/can.h
ENETDOWN = 100


def opened(interface):
    can = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    can.bind((interface,))
    can.settimeout(5)
    return can


def carried(sender, receiver):
    """Sends a frame; gives what the other end received."""
    with opened(sender) as out, opened(receiver) as into:
        out.send(FRAME.pack(0x123, 5, b"\x11\x22\x33\x44\x55"))
        number, length, data = FRAME.unpack(into.recv(FRAME.size))
    return number, data[:length]


def test_a_frame_is_received():
    interface = box.description()["can"]["interface"]
    expect(carried(interface, interface) == (0x123, b"\x11\x22\x33\x44\x55"), "another frame was received")


def test_a_link_goes_down_and_up():
    interface = box.description()["can"]["interface"]
    with opened(interface) as can:
        box.set_link(False)
        try:
            can.recv(FRAME.size)
            raise twinlock_test.Failure("a link that is down must not deliver")
        except OSError as error:
            expect(error.errno == ENETDOWN, f"wanted ENETDOWN, found {error}")
        finally:
            box.set_link(True)
    expect(carried(interface, interface)[0] == 0x123, "no frame after the link was up again")


def test_two_controllers_on_one_bus():
    bus = box.description()["can_bus"]
    ends = [bus["interface"], bus["far_interface"]]
    for interface in ends:
        box.change(bus["up"], interface=interface)
    time.sleep(0.1)
    expect(carried(*ends) == (0x123, b"\x11\x22\x33\x44\x55"), "the frame did not cross the bus")
    for interface in ends:
        box.change(bus["down"], interface=interface)


twinlock_test.main()
