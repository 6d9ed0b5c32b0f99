#!/usr/bin/env python3
"""script/rig: see usage below."""
import argparse
import signal
import subprocess
import sys
from pathlib import Path

import guest

USAGE = """\
usage: script/rig [--kernel KERNEL] [--source DIR] [--build DIR] [--timeout SECONDS]
                  [--disk FILE] [--reboots] -- COMMAND...

Runs COMMAND as root in a virtual box: QEMU without hardware virtualisation, with a Debian 12 kernel and
  CAN       vcan0 (up); can0 and can1, two SJA1000 on one bus (down; rig.json has the commands)
  GPIO      /dev/gpiochip0 (gpio-sim), with the lines that tests/hil/rig.json names
  serial    /dev/ttyS1 and /dev/ttyS2, connected to each other
  watchdog  /dev/watchdog (softdog) and /dev/watchdog1 (i6300esb)
COMMAND sees the files of this machine under their own paths, starts in the source folder, and has the environment of
a CTest test. Files that it writes are lost, except those in the folder rig of the build folder. It has no network but
loopback, and no standard input. The first call downloads 225 MB and makes the box; then it boots in seconds.
  --kernel KERNEL    amd64 (default)
  --source DIR       where the command starts (default: this checkout)
  --build DIR        the build folder (default: build/host in the source folder)
  --timeout SECONDS  for boot and command (default: 120)
  --disk FILE        an image of an ext4 file system, mounted at /disk; its files are kept
  --reboots          after a reset, as by a watchdog, boot again and run COMMAND again; default: exit code 125
Exit code: the command's; 124 after a timeout; 125 if the box ended early (panic, watchdog) or cannot be made;
128 + N after signal N.
"""


def seconds(text):
    try:
        value = float(text)
    except ValueError:
        value = 0
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text}: expected seconds, above 0, as 120")
    return value


def parse(arguments):
    if "-h" in arguments[:1] or "--help" in arguments[:1]:
        print(USAGE, end="")
        sys.exit(0)
    parser = argparse.ArgumentParser(prog="script/rig", usage=USAGE.removeprefix("usage: "), add_help=False,
                                     allow_abbrev=False)
    parser.add_argument("--kernel", choices=guest.MACHINES, default="amd64")
    parser.add_argument("--source", type=Path, default=guest.SOURCE)
    parser.add_argument("--build", type=Path)
    parser.add_argument("--timeout", type=seconds, default=120)
    parser.add_argument("--disk", type=Path)
    parser.add_argument("--reboots", action="store_true")
    parser.add_argument("command", nargs="+", metavar="COMMAND")
    options = parser.parse_args(arguments)
    options.build = options.build or options.source / "build" / "host"
    for name, folder in (("--source", options.source), ("--build", options.build)):
        if not folder.is_dir():
            parser.error(f"{name} {folder}: no such folder; script/build makes it")
    if options.disk is not None and not options.disk.is_file():
        parser.error(f"--disk {options.disk}: no such file; mke2fs -t ext4 makes one")
    return options


def main():
    options = parse(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM):  # so that QEMU and the temporary folder go too
        signal.signal(number, lambda received, _: sys.exit(128 + received))
    prepared = subprocess.run([Path(__file__).with_name("prepare"), options.kernel], check=False)
    if prepared.returncode != 0:
        sys.exit(guest.NO_END)
    box = guest.Guest(options.kernel, options.source, options.build, timeout=options.timeout, disk=options.disk,
                      reboots=options.reboots)
    outcome = box.run(options.command)
    if outcome.exit_code is not None:
        sys.exit(outcome.exit_code)
    guest.report(outcome)
    sys.exit(guest.TIMED_OUT if outcome.timed_out else guest.NO_END)


if __name__ == "__main__":
    main()
