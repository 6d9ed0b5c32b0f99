"""Kills a supervised twin, or lets its FMU hang, again and again on one processor, and measures the
cost.

The cost is the time until the next tick, the supervisor's processor time, and the longest pause
between two keepalives. The test counts the keepalives of systemd: the supervisor sends those of the
watchdog at the same time (firmware/live/supervisor.c).

Before each fault the test reads the process's threads in /proc, as monitoring tools do. The kernel
frees these entries when the process dies. A supervisor with real-time priority once waited for that
forever.
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
FOLLOWED = 9  # master/sync/record.h: a step of the resumed run
PATIENCE_S = 2.0  # of the service manager; the supervisor sends keepalives four times as often
MOST_FAULTS = 4  # in a run: the fifth is a restart loop
PAUSES_S = (0, 0.25, 0.5, 1.0)  # of the supervisor before it starts a new process
LOAD_PRIORITY, BUSY_S, PERIOD_S = 60, 0.005, 0.010


@dataclass
class Pace:
    """Step and hang limit of the twin. The rig's processor is slow."""
    step_s: float = 0.01
    hang_s: float = 0.3


@dataclass
class Cost:
    """The cost of one fault."""
    back_s: float  # until the next tick, with hang_s, but without the supervisor's pause
    used_s: float  # the supervisor's processor time
    left: int  # dead processes that were not reaped by then
    gap_s: float = 0.0  # the longest pause between two keepalives of the whole run


def configuration(port, pace):
    """The FMU tests/hil/fmus/unruly, which obeys the file of TWINLOCK_UNRULY, at a live source."""
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
    """The times of the supervisor's keepalives to the service manager."""

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
    """A real-time task on the processor that is busy half of the time.

    Its priority is above the cycle's and below the supervisor's.
    """

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
    """A supervised twin with the FMU tests/hil/fmus/unruly."""

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
    """Reads what top and monitoring exporters read."""
    for file in [*Path(f"/proc/{pid}").glob("task/*/stat*"), *Path(f"/proc/{pid}").glob("stat*")]:
        try:
            file.read_bytes()
        except OSError:
            pass


def used_s(pid):
    """Processor time of the first thread of a process, in seconds."""
    return int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[0]) / 1e9


def is_dead(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


TICK = """SELECT min((julianday(started) - 2440587.5) * 86400.0 + t_ns / 1e9) FROM steps JOIN runs USING (run)
          WHERE run = ? AND outcome NOT IN (?, ?)"""


def first_tick(database, run):
    """The time of the run's first own step in seconds of the system clock; None if there is none
    yet."""
    rows = query(database, TICK, run, MADE_UP, FOLLOWED) if database.exists() else []
    return rows[0][0] if rows else None


def first_run(database):
    """The first run with own steps; None if there is none yet. On a slow box run 1 may only read the
    plant until the saved states are tested."""
    where = "SELECT min(run) FROM steps WHERE outcome NOT IN (?, ?)"
    return query(database, where, MADE_UP, FOLLOWED)[0][0] if database.exists() else None


class Patient:
    """One supervised run."""

    def __init__(self, live, database):
        self.live, self.database = live, database

    def wait_for(self, what, look):
        def looked():
            expect(self.live.process.poll() is None, f"it has ended\n{self.live.log()}")
            return look()
        return wait_until(looked, what, self.live.log)

    def harm(self, child, kind):
        """Causes the fault and returns its time."""
        observe(child)
        if kind == "kill":
            at = time.time()
            os.kill(child, signal.SIGKILL)
            return at
        self.live.tell(kind)
        return time.time()

    def suffer(self, kind, count):
        child, costs = 0, []
        first = self.wait_for("a first step", lambda: first_run(self.database))
        for i in range(count):
            child = self.live.child(child)
            before = used_s(self.live.pid)
            at = self.harm(child, kind)
            run = first + i + 1
            tick_s = self.wait_for(f"a tick of run {run}", lambda run=run: first_tick(self.database, run))
            back_s = tick_s - at - PAUSES_S[i]
            costs.append(Cost(back_s, used_s(self.live.pid) - before, sum(map(is_dead, self.live.children()))))
        return costs


def one_run(kind, count, core, load, pace):
    """The cost of each fault of one run."""
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
    """The cost of each of `count` faults. `kind`: "kill" for SIGKILL, else an order to
    tests/hil/fmus/unruly."""
    costs = []
    while len(costs) < count:
        costs += one_run(kind, min(MOST_FAULTS, count - len(costs)), core, load, pace)
    return costs


def describe(costs):
    """A summary in one line."""
    def figures(values, unit=1e3):
        values = sorted(values)
        return f"{values[len(values) // 2] * unit:.0f} ({values[-1] * unit:.0f})"
    return (f"{len(costs)} faults; median (most), ms: until the next tick {figures([cost.back_s for cost in costs])}, "
            f"the supervisor's processor time {figures([cost.used_s for cost in costs])}, longest pause between two keepalives "
            f"{figures([cost.gap_s for cost in costs])}; dead processes left {sum(cost.left for cost in costs)}")
