"""Supervised run whose configuration is changed by `twinlock reload` during the run; shared by several tests."""
import json
import os
import re

from live_test import query, wait_until
from tree import Tree, configuration
from twinlock_test import BAD_DATA, PLANT_DOWN, expect, has_line, run, scratch, write_config

NO_ROOM = "two twins"  # refusal: the machine is too busy for a shadow
TRIES = 10  # of a reload; a shadow has no priority, so that a busy machine may refuse it


class Retuned(Tree):
    """Run of the motor bench (PLAIN_LIVE) with a control socket. `processor`: the only processor that it may use."""

    def __init__(self, port, *args, state=None, config=None, processor=None, **changes):
        self.file, self.database = (config, config.parent / "twin.db") if config else configuration(port, **changes)
        self.socket = scratch() / "control"
        pinned = {} if processor is None else {"preexec_fn": lambda: os.sched_setaffinity(0, {processor})}
        self.refused = 0  # candidates that a busy machine refused, and that were sent again
        super().__init__(self.file, "--control", self.socket, *args, state=state, **pinned)

    def edited(self, change):
        """Writes another file with the change: a function that edits the configuration, a JSON document, or bytes. Returns its path."""
        document = change
        if callable(change):
            document = json.loads(self.file.read_text(encoding="utf-8"))
            change(document)
        return write_config(document)

    def reload(self, config=None, *options, timeout=60, tries=TRIES):
        """Returns (exit code, standard output, standard error). Tries again if the machine is too busy, `tries` times at most."""
        for left in reversed(range(tries)):
            answer = run(["reload", config or self.file, "--control", self.socket, *options], timeout=timeout)
            if left == 0 or answer[0] != BAD_DATA or not has_line(answer[2], NO_ROOM):
                return answer
            self.refused += 1
            print(f"    sent again: {answer[2].splitlines()[-1]}", flush=True)

    def versions(self):
        """Returns number → (is active, result). Tries again while a restart of the run has closed its socket."""
        code, out, err = wait_until(self._ask_for_versions, "an answer", self.log)
        expect(code == 0, err)
        return {int(number): (star == "*", result) for star, number, result in
                re.findall(r"^([* ]) *(\d+)  .*\n +(.*)$", out, re.M)}

    def _ask_for_versions(self):
        code, out, err = self.reload(None, "--versions")
        return None if code == PLANT_DOWN else (code, out, err)

    def version_on_disk(self, number):
        return json.loads((self.state / "versions" / f"{number}.record.json").read_text(encoding="utf-8"))

    def active(self):
        return next(number for number, (active, _) in self.versions().items() if active)


def match(document):
    return document["synchronise"]["match"]["motor.omega"]


def tolerance(value):
    return lambda document: match(document).update(tolerance=value)


def events(database, text):
    """Returns the number of events of a change whose text contains `text`, a pattern of SQL's LIKE."""
    return query(database, "SELECT count(*) FROM events WHERE source = 'retune' AND text LIKE ?", f"%{text}%")[0][0]
