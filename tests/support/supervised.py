"""What the tests of `run --supervise` share: the supervisor as a program, its children, what it keeps and what it told."""
import json
import signal
from pathlib import Path

from live_test import FIRST_GUESS, MADE_UP, OPTIMISED, Program, children, member, number, query, wait_until
from twinlock_test import Failure, at_most, expect, scratch

WORD = "word"  # for TWINLOCK_UNRULY
LOCK_STEPS = 200  # until the first of 20, of 10 ms each


def left_in(file):
    """Nothing either if it goes while it is read: its folder is the twin's."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return b""


class Supervised(Program):
    """A supervised run, and the processes that it has begun. `state`: where it keeps its account."""

    def __init__(self, config, *args, state=None, **options):
        self.state = state or scratch() / "state"
        super().__init__("run", config, "--supervise", "--state", self.state, *args, **options)

    def children(self):
        return children(self.pid)

    def child(self, other_than=0, role="twin"):
        return member(self, role, other_than)

    def tell(self, word, stays=False):
        """An FMU of the twin is told what to do (tests/hil/fmus/unruly), and begins with it. `stays`: it does not take the word out."""
        def folders():
            return sorted(self.process.temporary.glob(f"twinlock-twin-{self.pid}-*"), key=lambda path: path.stat().st_mtime)
        file = wait_until(folders, "the folder of the FMUs", self.log)[-1] / WORD
        file.write_text(word, encoding="utf-8")
        wait_until(lambda: stays or not left_in(file), "a step that takes the word", self.log)

    def account(self):
        return json.loads((self.state / "supervisor.json").read_text(encoding="utf-8"))


def wait_for_run(live, database, which):
    """Until run `which` is recorded, and is in lock."""
    wait_until(lambda: database.exists() and query(database, "SELECT 1 FROM runs WHERE run = ?", which), f"run {which}", live.log)
    wait_until(lambda: number(database, "SELECT count(*) FROM steps WHERE run = ? AND outcome = 1", which) >= 20, "lock", live.log)


def first_lock(database, run):
    """How many steps of its own the run needed until 20 in a row were within tolerance. Those of the run that it goes on with
    are not its own, and those of the time in which nobody ran are made up."""
    own, lead = query(database, "SELECT coalesce(resumed_tick, 0), lead FROM beginnings JOIN runs USING (run) WHERE run = ?", run)[0]
    steps = query(database, "SELECT outcome FROM steps WHERE run = ? AND step >= ? AND outcome <> ? ORDER BY step",
                  run, own - lead, MADE_UP)
    row = 0
    for i, (outcome,) in enumerate(steps):
        row = row + 1 if outcome in (FIRST_GUESS, OPTIMISED) else 0
        if row == 20:
            return i - 19
    raise Failure(f"run {run} was never in lock")


def expect_in_lock(database, run, limit=LOCK_STEPS):
    """In lock so many steps after it began: 2 s and 20 periods, counted in steps, since a busy machine has no other clock."""
    at_most(first_lock(database, run), limit, f"steps until run {run} was in lock")


def starts(database):
    """What the supervisor told, of each run."""
    return [text for (text,) in query(database, "SELECT text FROM events WHERE source = 'supervisor' ORDER BY event")]


def expect_starts(database, *reasons):
    told = starts(database)
    expect(len(told) == len(reasons) and all(reason in text for reason, text in zip(reasons, told)), f"{told}")


def end_orderly(live, number_=signal.SIGTERM):
    code, _, log = live.end(number_)
    expect(code == 0, f"ended with {code}\n{log}")
    expect(live.account()["running"] is False and live.account()["failures"] == 0, f"{live.account()}")
