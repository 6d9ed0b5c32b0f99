#!/usr/bin/env python3
"""The exit code of a live run whose twin was not in lock: alone, with --require-lock, and
supervised."""
import os
import shutil
import signal
import socket

from live_test import Device
from supervised import Supervised, wait_for_run
from twinlock_test import PLAIN_LIVE, NOT_LOCKED, edited_config, expect, expect_line, main, run

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def ended(port, *options):
    """(exit code, standard error) of a run of 3 s."""
    config = edited_config(PLAIN_LIVE, {"duration_s": 3, "sources": {"inverter": {"modbus_tcp": {"port": port}}}})
    code, _, err = run(["run", config, *options])
    return code, err


def free_port():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return unused.getsockname()[1]


def test_a_plant_that_never_answers():
    port = free_port()
    code, err = ended(port)
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, "error|never in lock")
    code, err = ended(port, "--supervise")
    expect(code == NOT_LOCKED, f"supervised: {code}\n{err}")
    expect_line(err, "error|never in lock")
    code, err = ended(port, "--supervise", "--require-lock", "50")
    expect(code == NOT_LOCKED, f"supervised: {code}\n{err}")
    expect_line(err, "error|in lock|0.00 %|50 %")


def test_a_twin_in_lock():
    with Device(OMEGA) as device:
        code, err = ended(device.port, "--require-lock", "90")
    expect(code == 0, f"{code}\n{err}")


def test_a_run_that_ends_without_a_twin():
    """A run in safe hold, because its FMUs have lost their folder, is not in lock."""
    with Device(OMEGA) as device:
        config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                                   "sources": {"inverter": {"modbus_tcp": {"port": device.port}}}})
        with Supervised(config) as live:
            wait_for_run(live, config.parent / "twin.db", 1)
            shutil.rmtree(live.process.temporary)
            os.kill(live.child(), signal.SIGKILL)
            live.wait_for("safe hold|started|5")
            live.process.temporary.mkdir()
            code, _, log = live.end(signal.SIGTERM)
    expect(code == NOT_LOCKED, f"{code}\n{log}")
    expect_line(log, "error|without a twin|in lock")


if __name__ == "__main__":
    main()
