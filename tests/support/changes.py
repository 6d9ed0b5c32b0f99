"""Run with many changes of its configuration, in place and by another twin, and their cost (tests/hil/test_changes.py)."""
import contextlib
import json
import math
import random
import re
import threading
import time
from dataclasses import dataclass

from footprint import footprint
from live_test import FIRST_GUESS, MADE_UP, Device, children, number, query, wait_until
from retuned import Retuned, match
from supervised import end_orderly, wait_for_run
from tree import OMEGA, read
from twinlock_test import expect

SETTLED = 3  # changes of each kind, after which all memory that changes need is in use


@contextlib.contextmanager
def moving(device):
    """Moves the plant, so that the correction changes all the time."""
    stop = threading.Event()

    def move():
        began = time.monotonic()
        while not stop.wait(0.002):
            device.omega = OMEGA + 4 * math.sin(2 * math.pi * (time.monotonic() - began) / 3)
    thread = threading.Thread(target=move)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def in_place(document, order):
    """Does not widen the tolerance: the tolerance before would judge it, too, and undo the change."""
    synchronise = document["synchronise"]
    match(document)["tolerance"] = round(order.uniform(0.98, 1.0) * match(document)["tolerance"], 6)
    synchronise["adjust"]["motor.d"]["nominal"] = round(order.uniform(0.002, 0.004), 9)
    synchronise["budget"]["evaluations"] = order.randrange(20, 61)


def another_twin(document, order):
    synchronise = document["synchronise"]
    before = synchronise["horizon"]["prediction"]
    synchronise["horizon"]["prediction"] = order.choice([prediction for prediction in (1, 2, 3) if prediction != before])
    document["components"]["motor"]["set"]["J"] = round(order.uniform(0.045, 0.055), 9)
    synchronise["algorithm"] = order.choice(["secant", "nelder-mead"])


@dataclass
class Cost:
    """Cost of all changes together."""
    changes: int = 0
    busy: int = 0  # candidates that a busy machine refused, and that were sent again
    runs: int = 0
    ticks: int = 0
    skipped: int = 0  # ticks
    misses: int = 0  # deadlines
    out_of_lock: int = 0  # steps that were not within tolerance
    grown_kib: int = 0
    log: str = ""


def private_kib(live):
    """Private memory of all processes of the run, after the activation process has ended."""
    wait_until(lambda: len(children(live.pid)) == 3, "three processes", live.log)
    found = [footprint(pid) for pid in (live.pid, *children(live.pid))]
    return sum(print_.private for print_ in found if print_ is not None)


def misses(live):
    """Returns the missed deadlines of the current run, from its state."""
    _, out, _ = live.reload(None, "--state")
    return int(re.search(r"(\d+) deadlines", out)[1])


def send(live, kind):
    code, out, err = live.reload(live.newest, "--wait", "--shadow", "1", "--probation", "1", "--require-lock", "1", timeout=300)
    expect(code == 0, f"{kind.__name__}: {code}\n{out}{err}{live.log()}")


def change(live, kind, order, cost):
    document = json.loads(live.newest.read_text(encoding="utf-8"))
    kind(document, order)
    live.newest = live.edited(document)
    before = misses(live)
    send(live, kind)
    cost.busy = live.refused
    cost.misses += before if kind is another_twin else 0


def undisturbed(seconds, processor=None):
    """Returns (ticks, skipped, missed deadlines) of a run without changes: the cost of the machine itself."""
    with Device(OMEGA) as device, Retuned(device.port, processor=processor) as live, moving(device):
        wait_for_run(live, live.database, 1)
        time.sleep(seconds)
        missed = misses(live)
        end_orderly(live)
    found = read(live.database)
    return len(found.ticks), sum(outcome == MADE_UP for outcome in found.steps.values()), missed


def many_changes(count, seed, each=lambda number, kind: None, processor=None):
    """Returns the cost of `count` changes. `processor`: the only one that the run may use."""
    order, cost = random.Random(seed), Cost()
    kinds = [in_place, another_twin] * ((count + 1) // 2)
    with Device(OMEGA) as device, Retuned(device.port, processor=processor) as live, moving(device):
        live.newest = live.file
        wait_for_run(live, live.database, 1)
        settled = None
        for cost.changes, kind in enumerate(kinds[:count], 1):
            change(live, kind, order, cost)
            each(cost.changes, kind.__name__)
            if cost.changes == min(2 * SETTLED, count):
                settled = private_kib(live)
        cost.grown_kib = private_kib(live) - settled
        cost.misses += misses(live)
        end_orderly(live)
        cost.log = live.log()
    found = read(live.database)
    ticks = set(found.ticks)
    expect(not found.doubled, f"{found.doubled[:10]}\n{cost.log}")
    expect(ticks == set(range(max(ticks) + 1)), f"{max(ticks) + 1 - len(ticks)} ticks are missing\n{cost.log}")
    cost.runs = number(live.database, "SELECT count(*) FROM runs")
    cost.ticks = len(ticks)
    cost.skipped = sum(outcome == MADE_UP for outcome in found.steps.values())
    cost.out_of_lock = sum(outcome not in (FIRST_GUESS, 2, MADE_UP) for outcome in found.steps.values())
    expect(cost.runs == 1 + count // 2, f"{cost.runs} runs: {query(live.database, 'SELECT run, ended_reason FROM runs')}\n{cost.log}")
    return cost
