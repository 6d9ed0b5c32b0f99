"""A live 1 kHz run for hours, with a fault every minute: its memory and its records (script/soak,
test_soak.py).

There are three kinds of faults: of the device on the network, of processes (killed, crashed, hung),
and of the disk. A fault ends when everything is recorded again. Then all new ticks and steps are
checked.
"""
import errno
import os
import random
import resource
import signal
import subprocess
import threading
import time
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field

from faulty_device import FaultyDevice
from footprint import footprint
from live_test import GOOD, MADE_UP, count_lines, query, title, wait_until
from slopes import HOUR, count_grows, slope_of, without_once
from supervised import WORD
from tree import BEGINNING, OMEGA, ROLES, Tree, expect_whole, read
from twinlock_test import PLAIN_LIVE, BUILD, Failure, edited_config, expect, json, scratch

NETWORK = "silence", "storm", "garbage"  # tests/support/faulty_device.py
TWIN = "crash", "hang", "twin killed"
ELSEWHERE = (*NETWORK, "disk full", "io killed", "recorder killed")

FORGIVEN_S = 120  # firmware/live/restarts.h
MOST_FAILURES = 4  # the fifth is a restart loop
SURE_S = 15  # the start of a new twin takes less

TICKS_PER_S = 1000
SETTLED_TICKS = 500  # good ticks after a fault, until the fault is over
SETTLED_S = 1.5  # after the end of a fault, until memory is measured
WARM_S = 60.0  # a new process takes its memory step by step
ENOUGH_S = 600.0  # for an estimate of a slope
DISK_MB, DATABASE_MB = 256, 100


# ---- which fault when ----

class Bag:
    """Returns each kind once, in random order, and then starts again."""

    def __init__(self, kinds, order):
        self.kinds, self.order, self.left = kinds, order, []

    def take(self):
        self.left = self.left or self.order.sample(self.kinds, len(self.kinds))
        return self.left.pop()


def plan(seconds, every, seed):
    """[(at, kind)]: one fault in the first half of each interval.

    Every third fault is one of the twin, unless the supervisor would count a restart loop.
    """
    order = random.Random(seed)
    twin, elsewhere = Bag(TWIN, order), Bag(ELSEWHERE, order)
    faults, failures, last = [], 0, 0.0
    for i in range(int(seconds // every)):
        at = (i + order.uniform(0.0, 0.5)) * every
        left = max(0, failures - int(max(0.0, at - last - SURE_S) // FORGIVEN_S))
        if i % 3 == 0 and left < MOST_FAILURES:
            failures, last = left + 1, at
            faults.append((at, twin.take()))
        else:
            faults.append((at, elsewhere.take()))
    return faults


# ---- the disk ----

@contextmanager
def small_disk():
    """The folder of the database. It is a small file system of its own if this process may mount
    one (script/soak)."""
    folder = scratch()
    own = os.environ.get("TL_OWN_MOUNTS") == "yes"
    if own:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "none", folder], check=True)
    try:
        yield folder, own
    finally:
        if own:
            subprocess.run(["umount", "--lazy", folder], check=True)


def fill(path):
    """Writes until there is no space left, not even for one byte."""
    size = 1 << 20
    with open(path, "wb", buffering=0) as file:
        while size > 0:
            try:
                file.write(bytes(size))
            except OSError as reason:
                expect(reason.errno == errno.ENOSPC, f"the ballast cannot be written: {reason}")
                size //= 2


# ---- what is held ----

@dataclass(frozen=True)
class Sample:
    at: float  # seconds since the start
    pids: dict
    prints: dict  # role → Footprint
    settled: bool


class Sampler(threading.Thread):
    """Measures all processes of a run periodically."""

    def __init__(self, live, begun, period):
        super().__init__(daemon=True)
        self.live, self.begun, self.period = live, begun, period
        self.samples, self.quiet_since, self.over = [], None, threading.Event()

    def run(self):
        while not self.over.wait(self.period):
            try:
                self.look()
            except OSError:
                return  # the run is over

    def look(self):
        pids = {"supervisor": self.live.pid}
        for pid in self.live.children():
            for role in ROLES:
                if title(pid).startswith(f"twinlock: {role}"):
                    pids[role] = pid
        prints = {role: footprint(pid) for role, pid in pids.items()}
        quiet, now = self.quiet_since, time.monotonic()
        whole = len(prints) == len(ROLES) + 1 and None not in prints.values()
        if whole:
            self.samples.append(Sample(now - self.begun, pids, prints, quiet is not None and now - quiet > SETTLED_S))

    def end(self):
        self.over.set()
        self.join()


# ---- what is recorded ----

@dataclass
class Accounts:
    """Counts all ticks and steps recorded so far."""
    database: object
    newest: object = BEGINNING
    outcomes: Counter = field(default_factory=Counter)
    lost: dict = field(default_factory=dict)  # run → entries

    def read_on(self):
        found = read(self.database, self.newest)
        expect_whole(found, self.newest)
        self.newest = found.newest
        self.outcomes.update(found.steps.values())
        self.lost.update(query(self.database, "SELECT run, entries_lost FROM runs"))
        anew = query(self.database, "SELECT run FROM beginnings WHERE resumed_run IS NULL AND run > 1")
        expect(not anew, f"run {anew} has not resumed the run before")
        expect(sum(self.lost.values()) == 0, f"entries were lost: {self.lost}")

    def describe(self):
        skipped = self.outcomes[MADE_UP]
        return f"{self.newest.tick + 1} ticks in {self.newest.run} runs: {self.outcomes.total() - skipped} steps, {skipped} caught up"


NEWEST = "SELECT tick, quality FROM samples own WHERE own.run = (SELECT max(run) FROM samples) ORDER BY own.tick DESC LIMIT 1"


# ---- the run ----

def configuration(port, folder):
    """The motor bench, live, at 1 kHz, with the FMU tests/hil/fmus/unruly beside it."""
    return edited_config(PLAIN_LIVE, {
        "duration_s": None, "step_s": 1 / TICKS_PER_S,
        "components": {"unruly": {"fmu": str(BUILD / "tests" / "unruly.fmu")}},
        "sources": {"inverter": {"modbus_tcp": {"port": port, "timeout_s": 0.1}}},
        "plant": {"speed": {"stale_s": 0.2, "csv": {"column": "omega"},
                            "modbus": {"source": "inverter", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}},
        "connect": [["plant.torque", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"], ["plant.speed", "unruly.u"]],
        "synchronise": {"budget": {"evaluations": 20, "time_s": 0.0005}},
        "record": {"file": str(folder / "twin.db"), "max_mb": DATABASE_MB, "commit_s": 0.25},
        "realtime": {"hang_s": 1},
    })


class Soak:
    """One run and its faults. `say` prints a line of progress."""

    def __init__(self, faults, every, say):
        self.faults, self.every, self.say = faults, every, say
        self.hold_s = min(every / 3, 10)  # duration of a fault that we end
        self.done, self.begun, self.restarts, self.asked = Counter(), time.monotonic(), 0, False
        self.sampler, self.accounts = None, Accounts(None)

    def now(self):
        return time.monotonic() - self.begun

    def newest(self):
        time.sleep(0.05)  # each query takes processor time
        rows = query(self.database, NEWEST) if self.database.exists() else []
        return rows[0] if rows else (-1, None)

    def wait_until_good(self):
        """Waits until SETTLED_TICKS more ticks are recorded, and the plant's signals are good."""
        before = self.newest()[0]

        def good():
            expect(self.live.process.poll() is None, f"the run has ended\n{self.live.log()}")
            tick, quality = self.newest()
            return tick >= before + SETTLED_TICKS and quality == GOOD
        wait_until(good, "fresh samples", self.live.log)

    # -- faults --

    def network(self, kind):
        self.device.fault = kind
        wait_until(lambda: self.newest()[1] != GOOD, f"the twin to notice: {kind}", self.live.log)
        time.sleep(self.hold_s)
        self.device.fault = None

    def process(self, kind):
        role = kind.removesuffix(" killed")
        if role in ROLES:
            self.live.kill_one(role)
            return
        before = self.live.child()
        self.live.tell(kind)
        self.live.child(before)

    def disk(self, _):
        said = [count_lines(self.live.log(), parts) + 1 for parts in ("cannot write", "writes again")]
        if self.own_disk:
            fill(self.ballast)
        if not self.own_disk or not self.told("cannot write", said[0]):
            self.limit_files(True)
        self.live.wait_for("cannot write", said[0])
        time.sleep(self.hold_s)
        self.ballast.unlink(missing_ok=True)
        self.limit_files(False)
        self.live.wait_for("writes again", said[1])

    def told(self, parts, times):
        """Whether so many lines of the log have these parts soon.

        SQLite reuses the pages of its log, so a full disk may have no effect for some time.
        """
        until = time.monotonic() + self.every / 3
        while count_lines(self.live.log(), parts) < times and time.monotonic() < until:
            time.sleep(0.1)
        return count_lines(self.live.log(), parts) >= times

    def limit_files(self, full):
        """Limits the recorder's files to one byte, or removes the limit."""
        recorder = self.live.child(role="recorder")
        hard = resource.prlimit(recorder, resource.RLIMIT_FSIZE)[1]
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (1 if full else hard, hard))

    def suffer(self, kind):
        self.sampler.quiet_since = None
        at = self.now()
        fault = self.network if kind in NETWORK else self.disk if kind == "disk full" else self.process
        fault(kind)
        self.done[kind] += 1
        self.wait_until_good()
        took = self.now() - at
        self.accounts.read_on()
        self.sampler.quiet_since = time.monotonic()
        held = sum(one.held for one in self.sampler.samples[-1].prints.values()) if self.sampler.samples else 0
        self.say(f"{at:7.0f} s  {kind}: whole again after {took:.1f} s; {self.accounts.describe()}; {held / 1024:.1f} MiB held")

    # -- from the start to the end --

    def expect_accounts(self, told):
        """Checks the --json report of the last twin and the supervisor's number of restarts."""
        expect(told["steps"] + told["skipped"] == told["ticks"] > 0, f"{told}")
        wanted = sum(self.done[kind] for kind in TWIN)
        expect(self.restarts == wanted, f"{self.restarts} twins were begun again, {wanted} were harmed\n{self.live.log()}")

    def end(self):
        self.sampler.end()
        self.restarts = self.live.account()["restarts"]
        children = self.live.children()
        code, out, log = self.live.end(signal.SIGTERM)
        expect(code == 0, f"the run ended with {code}\n{log}")
        self.accounts.read_on()
        self.expect_accounts(json.loads(out))
        left = [pid for pid in children if title(pid)]
        expect(not left, f"processes are left: {left}")

    def go_through(self, seconds):
        self.wait_until_good()
        self.begun = self.sampler.begun = time.monotonic()
        self.sampler.quiet_since = self.begun
        self.sampler.start()
        for at, kind in [*self.faults, (seconds, None)]:
            while not self.asked and (rest := at - self.now()) > 0:
                time.sleep(min(rest, 1.0))
                expect(self.live.process.poll() is None, f"the run has ended\n{self.live.log()}")
            if kind is not None and not self.asked:
                self.suffer(kind)

    def ask(self, number, _):
        """The first Ctrl-C ends the run after the current fault, the second one ends it at once."""
        self.asked = True
        signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)

    def run(self, seconds):
        os.environ["TWINLOCK_UNRULY"] = WORD
        for number in signal.SIGINT, signal.SIGTERM:
            signal.signal(number, self.ask)
        with small_disk() as (folder, self.own_disk), FaultyDevice(OMEGA) as self.device:
            self.database, self.ballast = folder / "twin.db", folder / "ballast"
            self.accounts = Accounts(self.database)
            if not self.own_disk:
                self.say("a file system of its own is not permitted here: a limit on files takes the place of a full disk")
            with Tree(configuration(self.device.port, folder), "--json", start_new_session=True) as self.live:
                self.sampler = Sampler(self.live, self.begun, max(0.5, min(5.0, self.every / 12)))
                self.go_through(seconds)
                if self.asked:
                    self.say(f"{self.now():7.0f} s  interrupted; the run is ended")
                self.end()


# ---- the verdict ----

def lives_of(samples, role, name):
    """[(seconds, value)] of each process of that role, without its first minute."""
    lives = {}
    for sample in samples:
        lives.setdefault(sample.pids[role], []).append((sample.at, getattr(sample.prints[role], name)))
    return [[point for point in life if point[0] >= life[0][0] + WARM_S] for life in lives.values()]


def sum_of(samples, name):
    """Sums over all processes, between faults. They show growth from restart to restart."""
    return [(sample.at, sum(getattr(one, name) for one in sample.prints.values())) for sample in samples
            if sample.settled and sample.at >= 2 * WARM_S]


def report_slope(what, unit, lives, say):
    """True if it grows."""
    slope = slope_of(lives)
    if slope is None or slope.seconds < ENOUGH_S:
        say(f"{what:30}{'too short to say':>28}")
        return False
    grows = slope.grows()
    say(f"{what:30}{slope.slope:+12.1f} {unit} an hour; noise up to {slope.noise:.1f}, {slope.seconds / HOUR:.2f} h"
        f"{'; GROWS' if grows else ''}")
    return grows


def report_counts(what, counts, say):
    grows = count_grows(counts)
    if counts:
        say(f"{what:30}{counts[0]:6} first,{counts[-1]:7} last, {min(counts)} to {max(counts)}{'; GROWS' if grows else ''}")
    return grows


def report_growth(samples, say):
    """The names of the values that grow."""
    found = []
    for role in ("supervisor", *ROLES):
        what = f"{role}, private memory"
        found += [what] * report_slope(what, "KiB", map(without_once, lives_of(samples, role, "private")), say)
        for name, words in ("shared", "shared KiB mapped"), ("descriptors", "descriptors"), ("threads", "threads"):
            what = f"{role}, {words}"
            found += [what] * report_counts(what, [getattr(sample.prints[role], name) for sample in samples if sample.settled], say)
    what = "all, memory between faults"
    found += [what] * report_slope(what, "KiB", [sum_of(samples, "held")], say)
    return found


def soak(seconds, every, seed, say=print):
    """Runs for so many seconds and reports. True if nothing is wrong."""
    faults = plan(seconds, every, seed)
    say(f"seed {seed}: {seconds / HOUR:.2f} h, {len(faults)} faults")
    one, wrong = Soak(faults, every, say), []
    try:
        one.run(seconds)
    except Failure as failure:
        wrong.append("\n".join(line for line in str(failure).splitlines() if "ticks missed" not in line))
    say("faults: " + ", ".join(f"{count} × {kind}" for kind, count in sorted(one.done.items())))
    say("recorded: " + one.accounts.describe() + f"; entries lost {sum(one.accounts.lost.values())}")
    grown = report_growth(one.sampler.samples if one.sampler else [], say)
    wrong += [f"grows: {', '.join(grown)}"] if grown else []
    for text in wrong:
        say(f"WRONG: {text}")
    say(f"verdict after {one.now() / HOUR:.2f} h: {'something is wrong' if wrong else 'all is well'}")
    return not wrong
