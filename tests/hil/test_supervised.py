#!/usr/bin/env python3
"""`run --supervise`: what hangs or dies is begun again, a loop ends in safe hold, the service manager is told, and nothing that is
only dead around it makes it restart."""
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
from live_test import Device, Program, check_database, number, query, stop, wait_for_lock, wait_for_steps, wait_until
from supervised import Supervised, end_orderly, expect_starts, starts, wait_for_run
from twinlock_test import PLAIN_LIVE, at_least, at_most, edited_config, expect, main, run, run_well, scratch, write_config

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def live_config(device, **changes):
    """The motor bench, live, without an end, committed ten times a second. The port's, and the database's path."""
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
    expect_starts(database, "start 1, 0 of them after a failure; reason: it was told to",
                  "start 2, 1 of them after a failure; reason: it was ended by signal 9, Killed",
                  "start 3, 2 of them after a failure; reason: it hung: \"")
    check_database(database)


def test_the_terminal_goes():
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            end_orderly(live, signal.SIGHUP)
    expect(query(database, "SELECT ended_reason FROM runs") == [("SIGHUP",)], "another end")


def test_a_file_that_changed_meanwhile():
    """A restart runs what ran before."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            Path(config).write_text("no configuration", encoding="utf-8")
            os.kill(live.child(), signal.SIGKILL)
            wait_for_run(live, database, 2)
            end_orderly(live, signal.SIGINT)
    expect(number(database, "SELECT count(DISTINCT configuration) FROM runs") == 1, "another configuration")


def test_a_dead_device_is_no_reason():
    with Device(OMEGA) as device:
        config, database = live_config(device, realtime={"hang_s": 0.5})
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            device.silent = True
            live.wait_for("runs free")
            wait_for_steps(live, database, number(database, "SELECT max(step) FROM steps") + 300)
            device.silent = False
            wait_for_lock(live, database, number(database, "SELECT max(step) FROM steps"))
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"{live.account()}")
    expect(number(database, "SELECT count(*) FROM runs") == 1, "restarted")


def test_the_supervisor_is_killed():
    """Nobody is left; who comes next says why."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            child = live.child()
            live.kill()
            wait_until(lambda: not Path(f"/proc/{child}").exists(), "the end of the child")
            state = live.state
        with Program("run", config, "--supervise", "--state", state) as again:
            wait_for_run(again, database, 2)
            expect(again.end(signal.SIGTERM)[0] == 0, "ended badly")
    expect_starts(database, "it was told to", "start 2, 1 of them after a failure; reason: the supervisor was killed")


def test_a_stopped_supervisor_blames_nobody():
    """All were stopped for long, as on a suspended box."""
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
            begun = number(database, "SELECT max(step) FROM steps")
            wait_for_lock(live, database, begun)
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"{live.account()}\n{live.log()}")


def test_too_few_descriptors():
    """Nothing can be started: one line a minute for each process, and the end does not wait for them."""
    with Device(OMEGA) as device:
        config, _ = live_config(device)
        command = ["prlimit", "--nofile=30:30", os.environ["TWINLOCK"], "run", config, "--supervise", "--state", scratch() / "state"]
        with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, encoding="utf-8") as process:
            time.sleep(12)
            process.send_signal(signal.SIGTERM)
            asked = time.monotonic()
            _, log = process.communicate(timeout=60)
    at_most(time.monotonic() - asked, 10, "seconds from SIGTERM to the end")
    at_most(len(log.splitlines()), 15, "lines of the log")
    expect(process.returncode == 75 and "the recorder cannot be started" in log and "more times" in log, f"{process.returncode}\n{log}")


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
    """All reasons are right, and the last start knows of all. (What was not committed yet is lost with a process that is killed.)"""
    begun = [re.fullmatch(r"start (\d), (\d) of them after a failure; reason: (.*)", text) for text in told[:-1]]
    expect(all(begun) and all(one[3].startswith("it hung: \"cycle\"") for one in begun if one[1] != "1"), f"{told}")
    counts = [(int(one[1]), int(one[2])) for one in begun]
    expect(counts == sorted(set(counts)) and counts[-1] == (6, 5) and all(a == b + 1 for a, b in counts), f"{told}")
    expect(told[-1].startswith("safe hold: the twin failed 5 times"), f"{told}")


def test_a_loop_ends_in_safe_hold():
    path = scratch() / "hang"
    path.write_text("now", encoding="utf-8")
    with Device(OMEGA) as device:
        config = hanging_config(device, path)
        database = Path(config).parent / "twin.db"
        with Supervised(config) as live:
            live.wait_for("safe hold: the twin failed 5 times; next try in 60 s. The plant is read and recorded.")
            live.wait_for("Last failure: it hung: \"cycle\"")
            wait_until(lambda: number(database, "SELECT count(*) FROM samples JOIN runs USING (run) WHERE verb = 'hold'") > 100,
                       "samples in safe hold", live.log)
            held = live.child()
            time.sleep(1)
            expect(live.child() == held, "safe hold was not held")
            end_orderly(live)
        expect(number(database, "SELECT count(*) FROM steps JOIN runs USING (run) WHERE verb = 'hold'") == 0, "a twin ran")
        expect_loop(starts(database))
        shown = run_well(["show", database])
        expect("hold" in shown, shown)
        path.unlink()
        told = json.loads(run_well(["replay", config, "--recording", database, "--json"]))
        at_least(told["steps"], 100, "steps of what was recorded in safe hold")
        with Program("run", config, "--supervise", "--state", live.state) as again:  # the fault is gone, and it was stopped
            again.wait_for("reason: it was told to")
            wait_for_steps(again, database, 100, run=7)
            expect(again.end(signal.SIGTERM)[0] == 0, "ended badly")
    check_database(database)


def test_safe_hold_without_record():
    """What is nowhere recorded is not said to be."""
    with Device(OMEGA) as device, Supervised(live_config(device, record=None)[0]) as live:
        live.wait_for("nothing is recorded: the configuration has no")
        shutil.rmtree(live.process.temporary)
        os.kill(live.child(), signal.SIGKILL)
        live.wait_for("safe hold: the twin could not be started 5 times")
        live.wait_for("The plant is read; nothing is recorded.")
        live.process.temporary.mkdir()
        end_orderly(live)


def test_safe_hold_needs_no_place():
    """The folder for what FMUs write is gone: there can be no twin, but the plant is recorded."""
    with Device(OMEGA) as device:
        config, database = live_config(device)
        with Supervised(config) as live:
            wait_for_run(live, database, 1)
            shutil.rmtree(live.process.temporary)
            os.kill(live.child(), signal.SIGKILL)
            live.wait_for("safe hold: the twin could not be started 5 times")
            wait_until(lambda: number(database, "SELECT count(*) FROM samples JOIN runs USING (run) WHERE verb = 'hold'") > 100,
                       "samples in safe hold", live.log)
            live.process.temporary.mkdir()
            end_orderly(live)
    check_database(database)


# ---- an FMU that is to blame ----

def test_an_fmu_is_named():
    """Whatever it does, it is a failure of the twin; also to end the process as if all was well."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        for run, word in enumerate(("exit", "crash", "hang"), 1):
            unruly.wait_for_tick(run)
            unruly.tell(word)
        unruly.wait_for_tick(4)
        end_orderly(unruly.live)
        expect(unruly.live.account()["starts"] == 4 and unruly.live.account()["restarts"] == 3, f"{unruly.live.account()}")
    expect_starts(unruly.database, "it was told to", "reason: it ended unannounced, with exit code 70, in fmi2DoStep of unruly",
                  "reason: it was ended by signal 11, Segmentation fault, in fmi2DoStep of unruly", " s, in fmi2DoStep of unruly")


def test_safe_hold_tries_again():
    """The cause may be gone: after a minute the twin runs again."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        for run in range(1, 6):
            unruly.wait_for_tick(run)
            unruly.tell("crash")
        unruly.live.wait_for("safe hold: the twin failed 5 times")
        unruly.live.wait_for("next try in 60 s")
        unruly.live.wait_for("safe hold ends: retry 1 of the twin")
        unruly.wait_for_tick(7)
        expect(unruly.live.account()["failures"] == 5 and unruly.live.account()["tries"] == 1, f"{unruly.live.account()}")
        end_orderly(unruly.live)
    expect(query(unruly.database, "SELECT verb FROM runs ORDER BY run") == [("run",)] * 5 + [("hold",), ("run",)], "other runs")


def test_an_fmu_that_takes_the_hearts_out():
    """It wipes out what says that the twin lives, and hangs: nobody is silent then who could be looked at, and that is no life."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        unruly.tell("heartless")
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "it was told to", 'reason: it hung: "every thread" gave no sign of life for 2.')


def test_an_fmu_that_says_that_the_run_is_over():
    """In the memory by which the twin says it; this run has no end of its own."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        unruly.tell("over")
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "it was told to", "reason: it ended unannounced, with exit code 2")


def test_told_to_end_while_an_fmu_hangs():
    """For longer than anybody wants to wait. The twin gives it up; what does not is tests/unit/firmware/live/test_supervisor_end.c's."""
    with Device(OMEGA) as device, kills.Unruly(device, kills.Pace(hang_s=60)) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        unruly.tell("hang")
        live.signal(signal.SIGTERM)
        code, _, log = live.end()
        wanted = "the twin failed when it was to end: it ended unannounced, with exit code 70, in fmi2DoStep of unruly"
        expect(code == 75 and wanted in log, f"ended with {code}\n{log}")
        expect(live.account()["running"] is False and live.account()["failures"] == 0, f"{live.account()}")


def test_told_to_end_by_somebody_else():
    """A friend of the memory, for example, who asks before he kills. Nobody wanted to be without a twin."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        unruly.wait_for_tick(1)
        os.kill(unruly.live.child(), signal.SIGTERM)
        unruly.wait_for_tick(2)
        end_orderly(unruly.live)
    expect_starts(unruly.database, "it was told to", "reason: it was told to end, and not by its supervisor")


# ---- the service manager ----

class ServiceManager:
    """What systemd hears."""

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
            expect(number(database, "SELECT count(*) FROM runs") == 1, "ready before anything ran")
            manager.wait_for("STATUS=")
            os.kill(live.child(), signal.SIGKILL)
            wait_for_run(live, database, 2)
            end_orderly(live)
    finally:
        del os.environ["NOTIFY_SOCKET"], os.environ["WATCHDOG_USEC"]
    return manager.rest()


def test_the_service_manager_is_told():
    with Device(OMEGA) as device:
        config, database = live_config(device)
        heard = told_service_manager(config, database)
    expect(heard.count("READY=1") == 1, f"{heard}")
    after = heard[heard.index("STOPPING=1"):]  # strokes go on until the twin has ended
    expect(set(after) <= {"STOPPING=1", "WATCHDOG=1"} and heard.count("STOPPING=1") == 1, f"{heard}")
    expect(any("rad/s" in line or "motor.d" in line for line in heard if line.startswith("STATUS=")), f"{heard}")


# ---- wrong usage ----

def expect_usage(words, *options, code=2):
    config, _ = live_config_without_device()
    found, _, log = run(["run", config, *options])
    expect(found == code and words in log, f"{options}: ended with {found}\n{log}")


def live_config_without_device():
    config = edited_config(PLAIN_LIVE, {})
    return config, config.parent / "twin.db"


def test_wrong_usage():
    expect_usage("--watchdog needs --supervise", "--watchdog", "/dev/watchdog")
    expect_usage("--state needs --supervise", "--state", "/tmp")
    expect_usage("--watchdog-timeout needs --watchdog DEVICE", "--supervise", "--watchdog-timeout", "30")
    for wrong in "0", "-3", "2.5", "4000", "soon", "":
        expect_usage(f"--watchdog-timeout: found \"{wrong}\", expected whole seconds from 1 to 3600, for example 30",
                     "--supervise", "--watchdog", "/dev/null", "--watchdog-timeout", wrong)
    expect_usage("watchdog /nowhere/dog: no such device", "--supervise", "--watchdog", "/nowhere/dog", code=69)
    expect_usage("watchdog /dev/null: is no watchdog", "--supervise", "--watchdog", "/dev/null", code=69)
    expect_usage("--state /nowhere/state: cannot be made", "--supervise", "--state", "/nowhere/state", code=65)


def test_a_bad_configuration_is_told_at_once():
    config = scratch() / "bad.json"
    config.write_text("{}", encoding="utf-8")
    code, _, log = run(["run", config, "--supervise", "--watchdog", "/nowhere/dog"])
    expect(code == 65 and "twinlock" in log and "watchdog" not in log, f"ended with {code}\n{log}")


main()
