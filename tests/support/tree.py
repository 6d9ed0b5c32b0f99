"""Kills the processes of a supervised run while the plant goes on, and checks what is recorded.

A sample's stamp is the time of its reading. A fresh sample was read just before the instant of its
tick. Of each run at most four twins are killed, because the fifth failure is a restart loop. The
number of kills of io and recorder is not limited.
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
OLD_NS = 3 * STEP_NS  # age limit of a sample that is polled twice a step, on a busy machine
BACK_NS = 1_000_000_000  # time until a restarted io reads again
LOCK_STEPS = 10  # until lock
ROLES = "twin", "io", "recorder"


def configuration(port, **changes):
    """The motor bench, live, without a duration, with ten commits a second; and the path of its
    database."""
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "sources": {"inverter": {"modbus_tcp": {"port": port}}}, **changes})
    return config, config.parent / "twin.db"


# ---- what is recorded ----

@dataclass(frozen=True)
class Newest:
    """The end of what was read so far of a database that is still written."""
    run: int = 0
    tick: int = -1
    step: int = -1


BEGINNING = Newest()


@dataclass
class Recorded:
    """All runs with a twin as one run: ticks continue from run to run."""
    ticks: dict  # tick → (oldest stamp of its signals since the run's start, -1: never read; whether all are good)
    steps: dict  # step → outcome in the run that computed it
    firsts: list  # first own tick of each run but the first
    doubled: list  # duplicate ticks and steps, each with its run
    newest: Newest


RUN = """SELECT b.run, coalesce(resumed_tick, 0), own.lead, coalesce(before.lead, own.lead) FROM beginnings b JOIN runs own USING (run)
         LEFT JOIN runs before ON before.run = resumed_run WHERE own.verb = 'run' AND b.run >= ? ORDER BY b.run"""
SAMPLE = "SELECT tick, min(quality = ?), min(coalesce(stamp_ns, -1)) FROM samples WHERE samples.run = ? AND tick > ? GROUP BY tick ORDER BY tick"
STEP = "SELECT step, outcome FROM steps WHERE steps.run = ? AND step > ? ORDER BY step"


def read(database, after=BEGINNING):
    """Reads ticks and steps that are newer than `after`. Each belongs to one run, and must be there
    once.

    Ticks and steps that a run follows belong to the run before, except a step that was not complete
    yet (mode ahead). Steps that a twin computed as a shadow, before the last step of the run
    before, belong to the run before.
    """
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
    """Checks that no tick and no step is missing or duplicate."""
    expect(found.ticks and found.steps, "nothing is recorded")
    for what, numbers, last in (("samples", found.ticks, after.tick), ("steps", found.steps, after.step)):
        missing = sorted(set(range(last + 1, max(numbers, default=last) + 1)) - set(numbers))
        expect(not missing, f"{len(missing)} {what} are missing: {missing[:10]}")
    expect(not found.doubled, f"{len(found.doubled)} duplicates: {found.doubled[:10]}")


def outages(found):
    """Lengths in ns of the times without a good and fresh sample. The first 20 ticks may precede
    the first reading."""
    lengths, since = [], None
    for tick in sorted(found.ticks):
        stamp, good = found.ticks[tick]
        fresh = good and 0 <= tick * STEP_NS - stamp <= OLD_NS
        if fresh and since is not None:
            lengths.append((tick - since) * STEP_NS)
        since = None if fresh else tick if since is None and tick > 20 else since
    return lengths


def steps_to_lock(found, first):
    """The number of steps before lock, of those that the run computed at their own tick."""
    own = [found.steps[step] for step in sorted(found.steps) if step >= first and found.steps[step] != MADE_UP]
    return next((i for i, outcome in enumerate(own) if outcome in (FIRST_GUESS, OPTIMISED)), len(own))


# ---- killing ----

class Tree(Supervised):
    def kill_one(self, role, number=signal.SIGKILL):
        """Kills the process of a role, and waits for the next one. Returns its process id."""
        before = self.child(role=role)
        os.kill(before, number)
        return wait_until(lambda: [pid for pid in [self.child(before, role)] if pid != before], f"another {role}", self.log)[0]

    def wait_for_tick(self, database, count=20):
        """Waits for so many more steps at their own tick."""
        sql = "SELECT count(*) FROM steps WHERE outcome NOT IN (?, ?)"
        before = query(database, sql, MADE_UP, FOLLOWED)[0][0] if database.exists() else 0
        wait_until(lambda: database.exists() and query(database, sql, MADE_UP, FOLLOWED)[0][0] >= before + count, f"{count} steps", self.log)


@dataclass
class Campaign:
    """Losses and delays of many kills."""
    kills: int = 0
    lost: int = 0
    longest_outage_s: float = 0.0
    longest_lock: int = 0
    longest_back_s: float = 0.0  # from the kill of a twin to the first own tick of the next one
    missed: int = 0  # ticks that were caught up

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
    """Kills processes of these roles in this order, at random instants of one run."""
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
    """Kills `count` random processes, at most MOST_TWINS twins in each run."""
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


# ---- leaks ----

def shared_memory(pid):
    """Shared memory of twinlock that a process has mapped."""
    try:
        return {line.split(maxsplit=5)[5] for line in Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines()
                if "memfd:twinlock" in line}
    except OSError:
        return set()


def descriptors(pid):
    """The targets of a process's descriptors."""
    found = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found.append(os.readlink(link))
        except OSError:
            pass
    return found
