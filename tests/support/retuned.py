"""A supervised run whose configuration is changed while it runs, by `twinlock reload`: what the tests of that share."""
import json
import os
import re

from live_test import query, wait_until
from tree import Tree, configuration
from twinlock_test import BAD_DATA, expect, run, scratch, write_config

NO_ROOM = "this box does not carry two twins"
TRIES = 10  # a shadow has no priority: who shares the machine with others may have to ask again


class Retuned(Tree):
    """A run of the motor bench (PLAIN_LIVE) with a control socket; `edited` changes its file as an engineer would.
    `processor`: the only one that it has."""

    def __init__(self, port, *args, state=None, config=None, processor=None, **changes):
        self.file, self.database = (config, config.parent / "twin.db") if config else configuration(port, **changes)
        self.socket = scratch() / "control"
        pinned = {} if processor is None else {"preexec_fn": lambda: os.sched_setaffinity(0, {processor})}
        self.refused = 0  # candidates, since the machine did not carry two twins just then; sent again
        super().__init__(self.file, "--control", self.socket, *args, state=state, **pinned)

    def edited(self, change):
        """Another file: the configuration with that change, which is a function of it, a JSON document, or bytes."""
        document = change
        if callable(change):
            document = json.loads(self.file.read_text(encoding="utf-8"))
            change(document)
        return write_config(document)

    def reload(self, config=None, *options, timeout=60, tries=TRIES):
        """(exit code, standard output, standard error). A machine that has no time for a second twin just then is asked again, so often at most."""
        for left in reversed(range(tries)):
            answer = run(["reload", config or self.file, "--control", self.socket, *options], timeout=timeout)
            if left == 0 or answer[0] != BAD_DATA or NO_ROOM not in answer[2]:
                return answer
            self.refused += 1
            print(f"    asked again: {answer[2].splitlines()[-1]}", flush=True)

    def versions(self):
        """number → (is active, what came of it). A run that restarts at this moment closes its socket for some time, and is asked again."""
        code, out, err = wait_until(self._ask_for_versions, "an answer", self.log)
        expect(code == 0, err)
        return {int(number): (star == "*", result) for star, number, result in
                re.findall(r"^([* ]) *(\d+)  .*\n +(.*)$", out, re.M)}

    def _ask_for_versions(self):
        code, out, err = self.reload(None, "--versions")
        return None if code != 0 and ("has hung up" in err or "it restarts just now" in err) else (code, out, err)

    def version_on_disk(self, number):
        return json.loads((self.state / "versions" / f"{number}.record.json").read_text(encoding="utf-8"))

    def active(self):
        return next(number for number, (active, _) in self.versions().items() if active)


def match(document):
    return document["synchronise"]["match"]["motor.omega"]


def tolerance(value):
    return lambda document: match(document).update(tolerance=value)


def events(database, text):
    return query(database, "SELECT count(*) FROM events WHERE source = 'retune' AND text LIKE ?", f"%{text}%")[0][0]
