"""A supervised twin whose process is killed, or whose FMU hangs, again and again, with everything on one processor; and what that
costs: the time until the next tick, the supervisor's own processor time, and the longest pause between two strokes of its watchdog.

The strokes are those that systemd hears: a watchdog is stroked in the same moments (firmware/live/supervisor.c). Before each fault somebody
reads about all threads of the process in /proc, as every monitor of a box does: so the kernel has something to forget when the
process dies, which is what a supervisor of real-time priority once had to wait for in vain.
"""
import os
import signal
import socket
import threading
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from live_test import Device, MADE_UP, query, wait_until
from supervised import WORD, Supervised, end_orderly
from twinlock_test import BUILD, Skip, expect, scratch, write_config

OMEGA = 1.5
FOLLOWED = 9  # master/sync/record.h: run again to where the run before was
PATIENCE_S = 2.0  # of the service manager; strokes come four times as often
MOST_FAULTS = 4  # in a run: with the fifth it is a restart loop
PAUSES_S = (0, 0.25, 0.5, 1.0)  # of the supervisor before it begins a new process
LOAD_PRIORITY, BUSY_S, PERIOD_S = 60, 0.005, 0.010


@dataclass
class Pace:
    """How fast the twin is. The rig's processor is slow."""
    step_s: float = 0.01
    hang_s: float = 0.3


@dataclass
class Cost:
    """Of one fault."""
    back_s: float  # until the next tick, without the pause that the supervisor makes; a hang's patience is in it
    used_s: float  # the supervisor's processor time
    left: int  # dead processes that nobody had reaped by then
    gap_s: float = 0.0  # the longest between two strokes, of the whole run


def configuration(port, pace):
    """An FMU that obeys the file of TWINLOCK_UNRULY, at a live source."""
    omega = {"stale_s": 5,
             "modbus": {"source": "device", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}
    return write_config({
        "twinlock": 1, "name": "an FMU that obeys", "step_s": pace.step_s,
        "components": {"unruly": {"fmu": str(BUILD / "tests" / "unruly.fmu")}},
        "sources": {"device": {"modbus_tcp": {"host": "127.0.0.1", "port": port, "period_s": pace.step_s}}},
        "plant": {"omega": omega},
        "connect": [["plant.omega", "unruly.u"]],
        "compare": {"unruly.y": {"to": "plant.omega"}},
        "record": {"file": "twin.db", "commit_s": 0.05}, "realtime": {"hang_s": pace.hang_s},
    })


class Strokes(threading.Thread):
    """When the supervisor told the service manager that it is alive."""

    def __init__(self):
        super().__init__(daemon=True)
        path = scratch() / "notify"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.at = []
        self.environment = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": str(int(PATIENCE_S * 1e6))}

    def run(self):
        while text := self.socket.recv(4096):
            if b"WATCHDOG=1" in text:
                self.at.append(time.monotonic())

    def longest_gap(self):
        return max(after - before for before, after in zip(self.at, self.at[1:]))


class FifoLoad:
    """A task on the processor, as long as this is open, that is more urgent than the cycle and less so than the supervisor, and
    busy half of the time."""

    def __init__(self, core):
        ready, told = os.pipe()
        parent, self.pid = os.getpid(), os.fork()
        if self.pid == 0:
            self.run(core, parent, told)
        os.close(told)
        began = os.read(ready, 1) == b"1"
        os.close(ready)
        if not began:
            os.waitpid(self.pid, 0)
            raise Skip("needs the permission for SCHED_FIFO")

    @staticmethod
    def run(core, parent, told):
        try:
            os.sched_setaffinity(0, {core})
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOAD_PRIORITY))
        except PermissionError:
            os._exit(1)
        os.write(told, b"1")
        begin = time.monotonic()
        while os.getppid() == parent:
            while time.monotonic() < begin + BUSY_S:
                pass
            begin += PERIOD_S
            time.sleep(max(0.0, begin - time.monotonic()))
        os._exit(0)

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)


class Unruly:
    """A supervised twin with an FMU that obeys (tests/hil/fmus/unruly)."""

    def __init__(self, device, pace=Pace()):
        config = configuration(device.port, pace)
        self.database, self.child = config.parent / "twin.db", 0
        os.environ["TWINLOCK_UNRULY"] = WORD
        self.live = Supervised(config)

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        del os.environ["TWINLOCK_UNRULY"]
        self.live.__exit__()

    def wait_for_tick(self, run):
        wait_until(lambda: first_tick(self.database, run), f"a tick of run {run}", self.live.log)

    def tell(self, word):
        self.child = self.live.child(self.child)
        self.live.tell(word)


def observe(pid):
    """As top and the exporters of monitoring do."""
    for file in [*Path(f"/proc/{pid}").glob("task/*/stat*"), *Path(f"/proc/{pid}").glob("stat*")]:
        try:
            file.read_bytes()
        except OSError:
            pass


def used_s(pid):
    """Processor time of a process' first thread so far."""
    return int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[0]) / 1e9


def is_dead(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


TICK = """SELECT (julianday(started) - 2440587.5) * 86400.0 + t_ns / 1e9 FROM steps JOIN runs USING (run)
          WHERE run = ? AND outcome NOT IN (?, ?) ORDER BY step LIMIT 1"""


def first_tick(database, run):
    """When the run made its first step of its own, in seconds of the system's clock; None where it has not."""
    rows = query(database, TICK, run, MADE_UP, FOLLOWED) if database.exists() else []
    return rows[0][0] if rows else None


class Patient:
    """One supervised run."""

    def __init__(self, live, database):
        self.live, self.database = live, database

    def wait_for_tick(self, run):
        def ticked():
            expect(self.live.process.poll() is None, f"it has ended\n{self.live.log()}")
            return first_tick(self.database, run)
        return wait_until(ticked, f"a tick of run {run}", self.live.log)

    def harm(self, child, kind):
        """When the fault was there."""
        observe(child)
        if kind == "kill":
            at = time.time()
            os.kill(child, signal.SIGKILL)
            return at
        self.live.tell(kind)
        return time.time()

    def suffer(self, kind, count):
        child, costs = 0, []
        self.wait_for_tick(1)
        for i in range(count):
            child = self.live.child(child)
            before = used_s(self.live.pid)
            at = self.harm(child, kind)
            back_s = self.wait_for_tick(i + 2) - at - PAUSES_S[i]
            costs.append(Cost(back_s, used_s(self.live.pid) - before, sum(map(is_dead, self.live.children()))))
        return costs


def one_run(kind, count, core, load, pace):
    """What each fault of a run cost."""
    with Device(OMEGA) as device:
        strokes, config = Strokes(), configuration(device.port, pace)
        strokes.start()
        added = {**strokes.environment, "TWINLOCK_UNRULY": WORD}
        os.environ.update(added)
        try:
            with Supervised(config, preexec_fn=lambda: os.sched_setaffinity(0, {core})) as live:
                with FifoLoad(core) if load else nullcontext():
                    costs = Patient(live, config.parent / "twin.db").suffer(kind, count)
                end_orderly(live)
                expect(live.account()["restarts"] == count, f"{count} faults, but {live.account()}\n{live.log()}")
        finally:
            for name in added:
                del os.environ[name]
    for cost in costs:
        cost.gap_s = strokes.longest_gap()
    return costs


def campaign(kind, count, core, load=False, pace=Pace()):
    """What each of so many faults cost: "kill" is SIGKILL, every other kind a word for the FMU (tests/hil/fmus/unruly)."""
    costs = []
    while len(costs) < count:
        costs += one_run(kind, min(MOST_FAULTS, count - len(costs)), core, load, pace)
    return costs


def describe(costs):
    """One line."""
    def figures(values, unit=1e3):
        values = sorted(values)
        return f"{values[len(values) // 2] * unit:.0f} ({values[-1] * unit:.0f})"
    return (f"{len(costs)} faults; median (most), ms: until the next tick {figures([cost.back_s for cost in costs])}, "
            f"the supervisor's processor time {figures([cost.used_s for cost in costs])}, longest pause between two strokes "
            f"{figures([cost.gap_s for cost in costs])}; dead processes left {sum(cost.left for cost in costs)}")
