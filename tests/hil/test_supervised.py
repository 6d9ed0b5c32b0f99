#!/usr/bin/env python3
"""`run --supervise`: restarts processes that hang or die, enters safe hold after a loop, and
notifies systemd.

A dead device must not cause a restart.
"""
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import kills
from live_test import (Device, Program, check_database, expect_reasons, last_step, number, query, stop,
                       wait_for_steps, wait_until)
from supervised import Supervised, end_orderly, expect_starts, starts, wait_for_run
from twinlock_test import (BAD_DATA, NOT_LOCKED, PLAIN_LIVE, at_least, at_most, edited_config, expect, expect_line, expect_no_line, has_line, main,
                           run, run_well, scratch, write_config)

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def live_config(device, **changes):
    """The motor bench, live, without an end, with ten commits per second. Returns (configuration,
    database)."""
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "sources": {"inverter": {"modbus_tcp": {"port": device.port}}}, **changes})
    return config, config.parent / "twin.db"


def test_killed_and_stopped():
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            first = live.child()
            os.kill(first, signal.SIGKILL)
            wait_for_run(live, database, 2)
            second = live.child(first)
            os.kill(second, signal.SIGSTOP)
            wait_for_run(live, database, 3)
            expect(live.child() not in (first, second), "the same process")
            end_orderly(live)
            expect(live.account()["starts"] == 3 and live.account()["restarts"] == 2, f"{live.account()}")
    expect_starts(database, "start", "start 2|1|signal 9|Killed", "start 3|2|heartbeat|s")
    check_database(database)


def test_the_terminal_goes():
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            end_orderly(live, signal.SIGHUP)
    expect_reasons(database, "SIGHUP")


def test_a_file_that_changed_meanwhile():
    """A restart uses the same configuration, although the file has changed."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            Path(config).write_text("no configuration", encoding="utf-8")
            os.kill(live.child(), signal.SIGKILL)
            wait_for_run(live, database, 2)
            end_orderly(live, signal.SIGINT)
    expect(number(database, "SELECT count(DISTINCT configuration) FROM runs") == 1, "another configuration")


def test_a_dead_device_causes_no_restart():
    with Device(OMEGA) as device:
        config, database = live_config(device, realtime={"hang_s": 0.5})
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            device.silent = True
            live.wait_for("warning|no matched signal")
            wait_for_steps(live, database, last_step(database) + 300)
            device.silent = False
            live.wait_for("lock: locked")
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"{live.account()}")
    expect(number(database, "SELECT count(*) FROM runs") == 1, "restarted")


def test_the_supervisor_is_killed():
    """No process is left, and the next start reports the reason."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            child = live.child()
            live.kill()
            wait_until(lambda: not Path(f"/proc/{child}").exists(), "the child's end")
            state = live.state
        with Program("run", config, "--supervise", "--state", state) as again:
            wait_for_run(again, database, 2)
            code, _, log = again.end(signal.SIGTERM)
            expect(code == 0, f"ended with {code}\n{log}")
    expect_starts(database, "start", "start 2|1|supervisor|killed")


def test_all_stopped_is_no_failure():
    """All processes were stopped for some time, as on a suspended box. That is no failure."""
    with Device(OMEGA) as device:
        config, database = live_config(device, realtime={"hang_s": 0.5})
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            all_of_them = [live.pid, *live.children()]
            for pid in all_of_them:
                stop(pid)
            time.sleep(3)
            for pid in reversed(all_of_them):
                os.kill(pid, signal.SIGCONT)
            live.wait_for("lock: locked")
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"{live.account()}\n{live.log()}")


def test_too_few_descriptors():
    """No process can be started: at most one line per minute and process, and the end does not wait
    for them."""
    with Device(OMEGA) as device:
        config, _ = live_config(device)
        command = ["prlimit", "--nofile=32:32", os.environ["TWINLOCK"], "run", config, "--supervise", "--state", scratch() / "state"]
        with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, encoding="utf-8") as process:
            time.sleep(12)
            process.send_signal(signal.SIGTERM)
            asked = time.monotonic()
            _, log = process.communicate(timeout=60)
    at_most(time.monotonic() - asked, 10, "seconds from SIGTERM to the end")
    at_most(len(log.splitlines()), 15, "lines of the log")
    expect(process.returncode == 75, f"{process.returncode}\n{log}")
    expect_line(log, "error|recorder|Too many open files")
    expect_line(log, "error|recorder|failed|8")


# ---- an FMU that hangs ----

HANGS = """
import os
import time

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class hangs(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.0
        self.y = 0.0
        self.first = None
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.y = self.u
        if self.first is None:
            self.first = time.monotonic()
        # 2 s after its first step, since a twin has 120 s for its first tick, not hang_s.
        while time.monotonic() > self.first + 2 and os.path.exists({path!r}):
            time.sleep(0.01)
        return True
"""


def hanging_config(device, path):
    from python_fmu import LIBRARY, export  # pylint: disable=import-outside-toplevel
    fmu = export("hangs", "--handle-state", source=HANGS.format(path=str(path)))
    omega = {"unit": "rad/s", "stale_s": 0.2,
             "modbus": {"source": "inverter", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}
    return write_config({
        "twinlock": 1, "name": "an FMU that hangs", "step_s": 0.01,
        "components": {"hangs": {"fmu": str(fmu), "libraries": [LIBRARY]}},
        "sources": {"inverter": {"modbus_tcp": {"host": "127.0.0.1", "port": device.port, "period_s": 0.005}}},
        "plant": {"omega": {key: value for key, value in omega.items() if key != "unit"}},
        "connect": [["plant.omega", "hangs.u"]],
        "compare": {"hangs.y": {"to": "plant.omega"}},
        "record": {"file": "twin.db", "commit_s": 0.1}, "realtime": {"hang_s": 0.5},
    })


def expect_loop(told):
    """Checks the reason and both counters of each start, and the event of the safe hold.

    The events of a start may be missing, because a kill loses entries that are not committed.
    """
    first, *others = told[:-1] if has_line(told[0], "start") and not has_line(told[0], "heartbeat") else [None, *told[:-1]]
    expect(all(has_line(text, "start|heartbeat|cycle") for text in others), f"{first}, {told}")
    counts = [tuple(map(int, re.findall(r"\b\d\b", text)[:2])) for text in others]  # starts, failures
    expect(counts == sorted(set(counts)) and counts[-1] == (6, 5) and all(a == b + 1 for a, b in counts), f"{told}")
    expect(has_line(told[-1], "safe hold|failed|5"), f"{told}")


def test_a_loop_ends_in_safe_hold():
    path = scratch() / "hang"
    path.write_text("now", encoding="utf-8")
    with Device(OMEGA) as device:
        config = hanging_config(device, path)
        database = Path(config).parent / "twin.db"
        with Supervised(config) as live:
            live.wait_for("error|safe hold|failed|5|60 s|recorded|heartbeat|cycle")
            wait_until(lambda: number(database, "SELECT count(*) FROM samples JOIN runs USING (run) WHERE verb = 'hold'") > 100,
                       "samples in safe hold", live.log)
            held = live.child()
            time.sleep(1)
            expect(live.child() == held, "a restart during safe hold")
            end_orderly(live)
        expect(number(database, "SELECT count(*) FROM steps JOIN runs USING (run) WHERE verb = 'hold'") == 0, "a twin ran")
        expect_loop(starts(database))
        shown = run_well(["show", database])
        expect("hold" in shown, shown)
        path.unlink()
        told = json.loads(run_well(["replay", config, "--recording", database, "--json"]))
        at_least(told["steps"], 100, "steps of the samples of safe hold")
        with Program("run", config, "--supervise", "--state", live.state) as again:  # without the fault
            again.wait_for("notice|supervisor|start 7")
            wait_for_steps(again, database, 100, run=7)
            code, _, log = again.end(signal.SIGTERM)
            expect(code == 0, f"ended with {code}\n{log}")
    check_database(database)


def test_safe_hold_without_record():
    """Without a database, safe hold does not claim to record."""
    with Device(OMEGA) as device, Supervised(live_config(device, record=None)[0]) as live:
        live.wait_for("notice|record|--db")
        shutil.rmtree(live.process.temporary)
        os.kill(live.child(), signal.SIGKILL)
        live.wait_for("error|safe hold|started|5|nothing is recorded")
        live.process.temporary.mkdir()
        end_orderly(live, ends_with=NOT_LOCKED)


def test_safe_hold_needs_no_folder():
    """The folder for the files of FMUs is gone: no twin can start, but the plant is recorded."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            shutil.rmtree(live.process.temporary)
            os.kill(live.child(), signal.SIGKILL)
            live.wait_for("error|safe hold|started|5|recorded")
            wait_until(lambda: number(database, "SELECT count(*) FROM samples JOIN runs USING (run) WHERE verb = 'hold'") > 100,
                       "samples in safe hold", live.log)
            live.process.temporary.mkdir()
            end_orderly(live, ends_with=NOT_LOCKED)
    check_database(database)


# ---- faults of an FMU ----

def test_an_fmu_is_named():
    """Each fault of an FMU counts as a failure of the twin, also an exit of the process, and names
    the FMU."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        for run, word in enumerate(("exit", "crash", "hang"), 1):
            unruly.wait_for_tick(run)
            unruly.tell(word)
        unruly.wait_for_tick(4)
        end_orderly(unruly.live)
        expect(unruly.live.account()["starts"] == 4 and unruly.live.account()["restarts"] == 3, f"{unruly.live.account()}")
    expect_starts(unruly.database, "start", "exit code 70|fmi2DoStep|unruly",
                  "signal 11|Segmentation fault|fmi2DoStep|unruly", "heartbeat|s|fmi2DoStep|unruly")


def test_safe_hold_tries_again():
    """Safe hold retries the twin after a minute, because the cause may be gone."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        for run in range(1, 6):
            unruly.wait_for_tick(run)
            unruly.tell("crash")
        unruly.live.wait_for("error|safe hold|failed|5|60 s")
        unruly.live.wait_for("notice|safe hold|retry 1")
        unruly.wait_for_tick(7)
        expect(unruly.live.account()["failures"] == 5 and unruly.live.account()["tries"] == 1, f"{unruly.live.account()}")
        end_orderly(unruly.live)
    expect(query(unruly.database, "SELECT verb FROM runs ORDER BY run") == [("run",)] * 5 + [("hold",), ("run",)], "other runs")


def test_erased_heartbeats():
    """The FMU erases the twin's table of heartbeats, and hangs. An empty table counts as
    silence."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        unruly.tell("heartless")
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "start", "start 2|heartbeat|every thread|s")


def test_an_fmu_fakes_the_end_of_the_run():
    """The FMU writes a normal end of the run into the shared memory. A run without a duration has
    no such end."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        unruly.tell("over")
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "start", "start 2|exit code 2")


def test_end_while_an_fmu_hangs():
    """An FMU hangs at the end of the run: the twin ends without it.

    tests/unit/firmware/live/test_supervisor_end.c tests a twin that does not.
    """
    with Device(OMEGA) as device, kills.Unruly(device, kills.Pace(hang_s=60)) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        unruly.tell("hang")
        live.signal(signal.SIGTERM)
        code, _, log = live.end()
        expect(code == 75, f"ended with {code}\n{log}")
        expect_line(log, "error|twin|exit code 70|fmi2DoStep|unruly")
        expect(live.account()["running"] is False and live.account()["failures"] == 0, f"{live.account()}")


def test_sigterm_from_another_process():
    """Another process, for example earlyoom, sends SIGTERM to the twin. The supervisor restarts
    it."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        os.kill(unruly.live.child(), signal.SIGTERM)
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "start", "start 2|1|supervisor")


# ---- the service manager ----

class ServiceManager:
    """Receives the notifications for systemd."""

    def __init__(self):
        self.path = scratch() / "notify"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(self.path))
        self.socket.settimeout(30)
        self.heard = []

    def wait_for(self, text, times=1):
        while sum(text in line for line in self.heard) < times:
            self.heard += self.socket.recv(4096).decode().splitlines()

    def rest(self):
        self.socket.setblocking(False)
        try:
            while True:
                self.heard += self.socket.recv(4096).decode().splitlines()
        except BlockingIOError:
            return self.heard


def told_service_manager(config, database):
    manager = ServiceManager()
    os.environ.update(NOTIFY_SOCKET=str(manager.path), WATCHDOG_USEC="1000000")
    try:
        with Supervised(config) as live:
            manager.wait_for("READY=1")
            manager.wait_for("WATCHDOG=1", 5)
            wait_for_run(live, database, 1)
            manager.wait_for("STATUS=")
            os.kill(live.child(), signal.SIGKILL)
            wait_for_run(live, database, 2)
            end_orderly(live)
    finally:
        del os.environ["NOTIFY_SOCKET"], os.environ["WATCHDOG_USEC"]
    return manager.rest()


def test_service_manager_notifications():
    with Device(OMEGA) as device:
        config, database = live_config(device)
        heard = told_service_manager(config, database)
    expect(heard.count("READY=1") == 1, f"{heard}")
    after = heard[heard.index("STOPPING=1"):]  # keepalives continue until the twin has ended
    expect(set(after) <= {"STOPPING=1", "WATCHDOG=1"} and heard.count("STOPPING=1") == 1, f"{heard}")
    expect(any("rad/s" in line or "motor.d" in line for line in heard if line.startswith("STATUS=")), f"{heard}")


# ---- wrong usage ----

def expect_usage(parts, *options, code=2):
    config, _ = live_config_without_device()
    found, _, log = run(["run", config, *options])
    expect(found == code and has_line(log, parts), f"{options}: ended with {found}, wanted {code} and {parts}\n{log}")


def live_config_without_device():
    config = edited_config(PLAIN_LIVE, {})
    return config, config.parent / "twin.db"


def test_wrong_usage():
    expect_usage("--watchdog|--supervise", "--watchdog", "/dev/watchdog")
    expect_usage("--state|--supervise", "--state", "/tmp")
    expect_usage("--watchdog-timeout|--watchdog DEVICE", "--supervise", "--watchdog-timeout", "30")
    for wrong in "0", "-3", "2.5", "4000", "soon", "":
        expect_usage(f"--watchdog-timeout|\"{wrong}\"|1|3600", "--supervise", "--watchdog", "/dev/null", "--watchdog-timeout", wrong)
    expect_usage("error|watchdog /nowhere/dog", "--supervise", "--watchdog", "/nowhere/dog", code=69)
    expect_usage("error|watchdog /dev/null", "--supervise", "--watchdog", "/dev/null", code=69)
    expect_usage("error|--state /nowhere/state", "--supervise", "--state", "/nowhere/state", code=BAD_DATA)


def test_invalid_configuration():
    config = scratch() / "bad.json"
    config.write_text("{}", encoding="utf-8")
    code, _, log = run(["run", config, "--supervise", "--watchdog", "/nowhere/dog"])
    expect(code == BAD_DATA, f"ended with {code}\n{log}")
    expect_line(log, f"error|{config}|step_s")
    expect_no_line(log, "watchdog")


main()
