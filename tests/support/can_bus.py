"""A CAN bus for tests on the box: the kernel's virtual one (vcan0), used by raw sockets."""
import socket
import struct
import subprocess
import threading
import time
from pathlib import Path

from live_test import GOOD, SAMPLES, events, query, wait_for_steps, wait_until
from twinlock_test import PLAIN_CAN, edited_config, expect, has_line

OMEGA = 62.981  # rad/s: where config/motor's twin starts
INTERFACE = "vcan0"
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000  # flags of an id
CLASSIC, FD = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")


def ip(*words):
    """Runs `ip link …`, of iproute2 or busybox."""
    subprocess.run(["ip", "link", *words], check=True)


def interface_up(name=INTERFACE):
    ip("set", name, "up")


def interface_down(name=INTERFACE):
    ip("set", name, "down")


def remove_interface():
    ip("del", INTERFACE)


def make_interface(mtu=72):
    ip("add", INTERFACE, "type", "vcan")
    ip("set", INTERFACE, "mtu", str(mtu))
    interface_up()


def transmitted(name=INTERFACE):
    """The kernel's count of frames that all processes sent at the interface."""
    return int(Path("/sys/class/net", name, "statistics", "tx_packets").read_text())


def pack(identifier, data, fd=False):
    form, room = (FD, 64) if fd else (CLASSIC, 8)
    values = (identifier, len(data), 0, data.ljust(room, b"\0")) if fd else (identifier, len(data), data.ljust(room, b"\0"))
    return form.pack(*values)


class Bus:
    """A socket that sends on the bus and receives nothing."""

    def __init__(self, name=INTERFACE):
        self.socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
        self.socket.bind((name,))
        self.sent = 0

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.socket.close()

    def send(self, identifier, data, fd=False):
        frame = pack(identifier, data, fd)
        while True:
            try:
                self.socket.send(frame)
                self.sent += 1
                return
            except OSError as reason:
                expect(reason.errno == 105, f"sending failed: {reason}")  # ENOBUFS: retry
                time.sleep(0.001)


class Background:
    """Runs _run() in a thread beside the test. It must return when self.done is set."""

    def __init__(self):
        self.done = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *unused):
        self.done.set()
        self.thread.join()
        self.socket.close()


class Motor(Background, Bus):
    """Sends the frames that the motor bench reads by CAN, every 5 ms from a thread, until the end
    of `with`."""

    def __init__(self, omega, torque=0.0, name=INTERFACE):
        Bus.__init__(self, name)
        Background.__init__(self)
        self.omega, self.torque, self.quiet = omega, torque, False

    def tell(self):
        self.send(0x18FEF100 | EXTENDED, struct.pack("<f4x", self.omega))
        self.send(0x182, struct.pack(">h6x", round(self.torque * 1000)))

    def _run(self):
        while not self.done.wait(0.005):
            if not self.quiet:
                try:
                    self.tell()
                except (OSError, AssertionError):
                    pass  # the interface is down or removed


class Wire(Background):
    """Receives all frames on the bus, of all senders."""

    def __init__(self, name=INTERFACE):
        self.socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 * 1024 * 1024)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        self.socket.bind((name,))
        self.socket.settimeout(0.2)
        self.frames = []
        super().__init__()

    def _run(self):
        while not self.done.is_set():
            try:
                self.frames.append(self.socket.recv(72))
            except OSError:
                continue


# ---- runs ----

def live_config(**changes):
    """The motor bench by CAN, without a duration, with ten commits a second; and the path of its
    database."""
    config = edited_config(PLAIN_CAN, {"duration_s": None, "record": {"commit_s": 0.1}, **changes})
    return config, config.parent / "twin.db"


def newest(database, name):
    """(quality, value) of the newest sample."""
    return query(database, SAMPLES + " ORDER BY samples.tick DESC LIMIT 1", {"run": 1, "name": "plant." + name})[0][1:]


def wait_for_value(live, database, name, value):
    wait_for_steps(live, database, 1)
    wait_until(lambda: newest(database, name) == (GOOD, value), f"{name} = {value}",
               lambda: f"{newest(database, name)}\n{live.log()}")


def events_with(database, parts):
    """The number of events that have all parts (see has_line())."""
    return sum(has_line(text, parts) for _, text in events(database))
