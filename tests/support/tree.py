"""A supervised run as a tree of processes, each of which is killed again and again while the plant goes on: what is recorded then.

A sample's stamp says when it was read, so a sample that was looked up later is held against that: it must have been read just before its own
instant. At most four twins are killed in a run, since the fifth failure is a restart loop; io and recorder may die as often as they like.
"""
import os
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from live_test import FIRST_GUESS, GOOD, MADE_UP, OPTIMISED, query, wait_until
from supervised import Supervised, end_orderly
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect

OMEGA = 62.981  # rad/s: where config/motor's twin starts
FOLLOWED = 9  # master/sync/record.h
MOST_TWINS = 4
STEP_NS = 10_000_000
OLD_NS = 3 * STEP_NS  # of a sample that is polled twice a step, on a busy machine
BACK_NS = 1_000_000_000  # io
LOCK_STEPS = 10
ROLES = "twin", "io", "recorder"


def configuration(port, **changes):
    """The motor bench, live, without an end, committed ten times a second."""
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "sources": {"inverter": {"modbus_tcp": {"port": port}}}, **changes})
    return config, config.parent / "twin.db"


# ---- what is recorded ----

@dataclass(frozen=True)
class Newest:
    """How far somebody has read in a database that is still written."""
    run: int = 0
    tick: int = -1
    step: int = -1


BEGINNING = Newest()


@dataclass
class Recorded:
    """All runs with a twin of a database as one: ticks count on from run to run."""
    ticks: dict  # tick → the oldest stamp of its signals, relative to the run's start (None: never), and whether all are good
    steps: dict  # step → outcome, of the run that computed it
    firsts: list  # the first tick of its own of each run but the first
    doubled: list  # what is there twice, and in which run
    newest: Newest


RUN = """SELECT b.run, coalesce(resumed_tick, 0), r.lead, coalesce(before.lead, r.lead) FROM beginnings b JOIN runs r USING (run)
         LEFT JOIN runs before ON before.run = resumed_run WHERE r.verb = 'run' AND b.run >= ? ORDER BY b.run"""
SAMPLE = "SELECT tick, min(quality = ?), min(coalesce(stamp_ns, -1)) FROM samples WHERE run = ? AND tick > ? GROUP BY tick ORDER BY tick"
STEP = "SELECT step, outcome FROM steps WHERE run = ? AND step > ? ORDER BY step"


def read(database, after=BEGINNING):
    """Ticks that a run follows are the run's before, and so are steps, but for one that was not complete yet (mode ahead); and so is what a twin has computed as a
    shadow, before it took over: up to the last step of the run before. Each of its own is there once. Only what is newer than `after`: a newer run whose ticks were there before has them twice."""
    found = Recorded({}, {}, [], [], after)
    for run, first, lead, lead_before in query(database, RUN, after.run):
        known = after if run == after.run else BEGINNING
        for tick, good, stamp in query(database, SAMPLE, GOOD, run, known.tick):
            if tick >= first:
                found.doubled += [f"tick {tick}, run {run}"] * (tick in found.ticks or tick <= after.tick)
                found.ticks[tick] = stamp, bool(good)
        for step, outcome in query(database, STEP, run, known.step):
            is_own = step >= first - lead_before and outcome != FOLLOWED
            if is_own or (outcome == FOLLOWED and step not in found.steps and step > after.step):
                found.doubled += [f"step {step}, run {run}"] * (step in found.steps or step <= after.step)
                found.steps[step] = outcome
        if run > 1:
            found.firsts.append(first - lead)
        found.newest = Newest(run, max(found.ticks, default=after.tick), max(found.steps, default=after.step))
    return found


def expect_whole(found, after=BEGINNING):
    """No tick and no step is missing or there twice."""
    expect(found.ticks and found.steps, "nothing is recorded")
    for what, numbers, last in (("samples", found.ticks, after.tick), ("steps", found.steps, after.step)):
        missing = sorted(set(range(last + 1, max(numbers, default=last) + 1)) - set(numbers))
        expect(not missing, f"{len(missing)} {what} are missing: {missing[:10]}")
    expect(not found.doubled, f"{len(found.doubled)} are there twice: {found.doubled[:10]}")


def outages(found):
    """How long nothing good and fresh was sampled, each time, in ns. The first ticks may come before the first reading."""
    lengths, since = [], None
    for tick in sorted(found.ticks):
        stamp, good = found.ticks[tick]
        fresh = good and 0 <= tick * STEP_NS - stamp <= OLD_NS
        if fresh and since is not None:
            lengths.append((tick - since) * STEP_NS)
        since = None if fresh else tick if since is None and tick > 20 else since
    return lengths


def steps_to_lock(found, first):
    """Of those computed at their own tick, after the run began."""
    own = [found.steps[step] for step in sorted(found.steps) if step >= first and found.steps[step] != MADE_UP]
    return next((i for i, outcome in enumerate(own) if outcome in (FIRST_GUESS, OPTIMISED)), len(own))


# ---- killing ----

class Tree(Supervised):
    def kill_one(self, role, number=signal.SIGKILL):
        """Its successor is there."""
        before = self.child(role=role)
        os.kill(before, number)
        return wait_until(lambda: [pid for pid in [self.child(before, role)] if pid != before], f"another {role}", self.log)[0]

    def wait_for_tick(self, database, count=20):
        """So many more steps at their own tick."""
        sql = "SELECT count(*) FROM steps WHERE outcome NOT IN (?, ?)"
        before = query(database, sql, MADE_UP, FOLLOWED)[0][0] if database.exists() else 0
        wait_until(lambda: database.exists() and query(database, sql, MADE_UP, FOLLOWED)[0][0] >= before + count, f"{count} steps", self.log)


@dataclass
class Campaign:
    """What many kills have cost."""
    kills: int = 0
    lost: int = 0
    longest_outage_s: float = 0.0
    longest_lock: int = 0
    longest_back_s: float = 0.0  # of the twin: from the kill to the first tick of its own
    missed: int = 0  # ticks made up

    def add(self, database, log):
        found = read(database)
        expect_whole(found)
        self.lost += sum(row[0] for row in query(database, "SELECT entries_lost FROM runs"))
        self.longest_outage_s = max([self.longest_outage_s, *(length / 1e9 for length in outages(found))])
        self.longest_lock = max([self.longest_lock, *(steps_to_lock(found, first) for first in found.firsts)])
        self.missed += sum(outcome == MADE_UP for outcome in found.steps.values())
        at_most(self.longest_outage_s, BACK_NS / 1e9 + 0.3, f"seconds without a fresh sample\n{log}")
        at_most(self.longest_lock, LOCK_STEPS, f"steps until lock\n{log}")


def one_run(device, roles, order, campaign, **changes):
    """Kills those in that order, at random instants."""
    config, database = configuration(device.port, **changes)
    with Tree(config) as live:
        live.wait_for_tick(database)
        for role in roles:
            time.sleep(order.uniform(0, 0.4))
            live.kill_one(role)
            campaign.kills += 1
            live.wait_for_tick(database, 5)
        live.wait_for_tick(database)
        end_orderly(live)
        log = live.log()
    campaign.add(database, log)
    return campaign


def kill_at_random(device, count, seed):
    """So many at random; in each run at most as many twins as may die."""
    order, campaign = random.Random(seed), Campaign()
    while campaign.kills < count:
        roles, twins = [], 0
        while len(roles) < min(12, count - campaign.kills):
            role = order.choice(ROLES)
            twins += role == "twin"
            if role != "twin" or twins <= MOST_TWINS:
                roles.append(role)
        one_run(device, roles, order, campaign)
    return campaign


# ---- what is left ----

def shared_memory(pid):
    """Of a process: what it has mapped of ours."""
    try:
        return {line.split(maxsplit=5)[5] for line in Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines()
                if "memfd:twinlock" in line}
    except OSError:
        return set()


def descriptors(pid):
    """What each leads to."""
    found = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found.append(os.readlink(link))
        except OSError:
            pass
    return found
