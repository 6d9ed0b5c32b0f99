"""Helpers for tests of `run --supervise`: the supervisor, its child processes, its account and its
events."""
import json
import shutil
import signal
from pathlib import Path

from live_test import FIRST_GUESS, MADE_UP, OPTIMISED, Program, children, member, number, query, wait_until
from twinlock_test import Failure, at_most, edited_config, expect, has_line, scratch

WORD = "word"  # for TWINLOCK_UNRULY
LOCK_STEPS = 200  # of 10 ms, before the first of 20 steps in a row that are within tolerance


def left_in(file):
    """The content of a file; nothing if the file disappears meanwhile, because its folder is the
    twin's."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return b""


class Supervised(Program):
    """A supervised run and its child processes. `state`: the folder of its account."""

    def __init__(self, config, *args, state=None, **options):
        self.state = state or scratch() / "state"
        super().__init__("run", config, "--supervise", "--state", self.state, *args, **options)

    def children(self):
        return children(self.pid)

    def child(self, other_than=0, role="twin"):
        return member(self, role, other_than)

    def tell(self, word, stays=False):
        """Gives the FMU tests/hil/fmus/unruly an order, and waits until it starts.

        `stays`: the FMU does not remove the order, so it obeys in every step.
        """
        def folders():
            return sorted(self.process.temporary.glob(f"twinlock-twin-{self.pid}-*"), key=lambda path: path.stat().st_mtime)
        file = wait_until(folders, "the twin's folder", self.log)[-1] / WORD
        file.write_text(word, encoding="utf-8")
        wait_until(lambda: stays or not left_in(file), "a step that takes the word", self.log)

    def account(self):
        return json.loads((self.state / "supervisor.json").read_text(encoding="utf-8"))


def store_saved_states(base, file):
    """Stores in `file` what the supervisor finds when it tests the saved states of the FMUs of the configuration
    `base`. A slow box needs longer for this test than the supervisor waits, so that its first run would have no
    twin."""
    with Supervised(edited_config(base, {"duration_s": None})) as live:
        found = live.state / "states.json"
        wait_until(found.exists, "the result of the test", live.log)
        shutil.copy(found, file)


def known_state(file):
    """A new state folder with what store_saved_states() has stored in `file`."""
    folder = scratch() / "state"
    folder.mkdir(mode=0o700)
    shutil.copy(file, folder / "states.json")
    return folder


def wait_for_run(live, database, which):
    """Waits until run `which` is recorded and in lock."""
    wait_until(lambda: database.exists() and query(database, "SELECT 1 FROM runs WHERE runs.run = ?", which), f"run {which}", live.log)
    wait_until(lambda: number(database, "SELECT count(*) FROM steps WHERE outcome = 1 AND run = ?", which) >= 20, "lock", live.log)


def first_lock(database, run):
    """The number of its own steps before 20 in a row were within tolerance.

    Steps of the resumed run are not its own. Steps of the time without a twin are caught up, and
    not counted.
    """
    own, lead = query(database, "SELECT coalesce(resumed_tick, 0), lead FROM beginnings JOIN runs USING (run) WHERE run = ?", run)[0]
    steps = query(database, "SELECT outcome FROM steps WHERE step >= ? AND outcome <> ? AND run = ? ORDER BY step",
                  own - lead, MADE_UP, run)
    row = 0
    for i, (outcome,) in enumerate(steps):
        row = row + 1 if outcome in (FIRST_GUESS, OPTIMISED) else 0
        if row == 20:
            return i - 19
    raise Failure(f"run {run} has no 20 steps in lock in a row")


def expect_in_lock(database, run, limit=LOCK_STEPS):
    """Checks that the run is in lock after at most `limit` steps. A busy machine slows time down,
    but not steps."""
    at_most(first_lock(database, run), limit, f"steps until run {run} was in lock")


def starts(database):
    """The texts of the supervisor's events, in order."""
    return [text for (text,) in query(database, "SELECT text FROM events WHERE source = 'supervisor' ORDER BY event")]


def expect_starts(database, *reasons):
    """Checks the supervisor's events: one for each start, with all parts of its reason (see
    has_line())."""
    told = starts(database)
    expect(len(told) == len(reasons) and all(has_line(text, parts) for parts, text in zip(reasons, told)),
           f"{told}, wanted {reasons}")


def end_orderly(live, number_=signal.SIGTERM, ends_with=0):
    code, _, log = live.end(number_)
    expect(code == ends_with, f"ended with {code}\n{log}")
    expect(live.account()["running"] is False and live.account()["failures"] == 0, f"{live.account()}")
