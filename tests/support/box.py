"""The box that tests/hil/rig.json describes: its wiring, and commands that change its signals or
run programs on it. The default is the rig, a virtual machine. TL_RIG names another description, for
example of a real box.

A test on the host runs commands on the box with run(). A test in tests/hil/box runs on the box
itself, and gets interfaces, lines and devices from the other functions. The description has these
parts:
  reach     command: prefix that runs a command on the box, with {source} and {build};
            lost: its exit code if the connection ended early, as after a reset
  can       interface, and the commands up and down of its link; no other device is on the bus
  can_bus   interface and far_interface, two controllers on one bus; up and down with {interface}
  gpio      the chip's label, the names of its lines by offset; high and low with {offset}
  serial    device and far_device, the ends of one line
  watchdog  device, and the identity that its driver gives
"""
import fcntl
import json
import os
import subprocess
from pathlib import Path

from twinlock_test import BUILD, SOURCE, expect

GET_CHIP_INFO = 0x8044B401


def description():
    path = Path(os.environ.get("TL_RIG") or SOURCE / "tests" / "hil" / "rig.json")
    return json.loads(path.read_text(encoding="utf-8"))


def filled(command, **values):
    return [word.format(**values) for word in command]


def run(command, timeout):
    """Runs a command on the box for at most `timeout` seconds. Returns the finished process, with
    its output as text."""
    whole = [*filled(description()["reach"]["command"], source=SOURCE, build=BUILD), *map(str, command)]
    return subprocess.run(whole, capture_output=True, encoding="utf-8", errors="backslashreplace", timeout=timeout,
                          check=False)


def change(command, **values):
    """Runs a command of the description, on the box."""
    done = subprocess.run(filled(command, **values), capture_output=True, encoding="utf-8", timeout=10, check=False)
    expect(done.returncode == 0, f"{' '.join(done.args)} ended with {done.returncode}: {done.stderr}")


def set_line(name, is_high):
    """Pulls a line of the GPIO chip up or down, outside of the box."""
    gpio = description()["gpio"]
    change(gpio["high" if is_high else "low"], offset=gpio["lines"].index(name))


def set_link(is_up):
    """Brings the CAN interface up or down."""
    can = description()["can"]
    change(can["up" if is_up else "down"])


def gpio_chip():
    """Finds the device file of the GPIO chip by its label, like libgpiod."""
    wanted = description()["gpio"]["chip"]
    for path in sorted(Path("/dev").glob("gpiochip*")):
        if chip_label(path) == wanted:
            return path
    raise LookupError(f"no GPIO chip has the label {wanted}")


def chip_label(path):
    """struct gpiochip_info of linux/gpio.h: name, label, number of lines."""
    with open(path, "rb") as chip:
        info = fcntl.ioctl(chip, GET_CHIP_INFO, bytes(68))
    return info[32:64].split(b"\0")[0].decode()
