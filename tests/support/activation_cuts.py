"""Power cuts of a box during changes of its configuration, in place and by another twin: checks its disk, and that a run starts with it."""
import hashlib
import json
import random
import sys
from dataclasses import dataclass
from pathlib import Path

from live_test import Device, query, wait_until
from power_cuts import PATIENCE_S, RECORDS, Late, check_file_system, record_and_cut
from retuned import Retuned
from supervised import end_orderly
from tree import read
from twinlock_test import PLAIN_LIVE, SOURCE, expect, merge, read_config, scratch

OMEGA = 62.981  # rad/s: where config/motor's twin starts
PORT = 15029  # the same on the box and here, since it is in the configuration

# Phases of an activation by another twin, and the longest time between the report of a phase and the cut. On an emulated box
# each phase takes longer.
PHASES = {"validate": 1.0, "try": 3.0, "shadow": 6.0, "activate": 0.5, "probation": 1.5}
CANDIDATES = 2, 2, 4  # number of the candidate that is in the phase


def configuration(number, port=PORT):
    """Candidate N. Each one differs from the one before by its tolerance, each second one also by its horizon."""
    edits = {"duration_s": None, "recording": None, "record": {"commit_s": 0.1}, "realtime": {"hang_s": 20},
             "sources": {"inverter": {"modbus_tcp": {"port": port, "timeout_s": 1}}},
             "synchronise": {"match": {"motor.omega": {"tolerance": 1.0 + number / 1000}}, "horizon": {"prediction": 1 + number // 2 % 2}}}
    return json.dumps(merge(read_config(PLAIN_LIVE), edits))


def hash_of(number):
    return hashlib.sha256(configuration(number).encode()).hexdigest()


@dataclass
class Cut:
    phase: str  # last reported phase; "active": the next candidate was not sent yet
    after_s: float  # after the report of the phase
    sent: int  # candidates
    active: int  # active candidate on disk
    runs: int
    on_probation: bool


def check_versions(folder, sent):
    """Returns (active candidate, is on probation). The active version must be complete and one that was sent."""
    active = json.loads((folder / "active.json").read_text(encoding="utf-8"))
    record = json.loads((folder / f"{active['active']}.record.json").read_text(encoding="utf-8"))
    text = (folder / f"{record['hash']}.json").read_bytes()
    expect(hashlib.sha256(text).hexdigest() == record["hash"], f"version {active['active']} is not whole")
    which = next((number for number in range(1, sent + 1) if hash_of(number) == record["hash"]), None)
    expect(which is not None, f"version {active['active']} is none that was sent: {record}")
    return which, active["probation"] != 0


def check_database(path):
    """Returns the number of runs. The database must be intact, and have each tick exactly once."""
    expect(query(path, "PRAGMA integrity_check") == [("ok",)], "the database is not intact")
    found = read(path)
    expect(not found.doubled, f"{found.doubled[:10]}")
    missing = set(range(max(found.ticks) + 1)) - set(found.ticks)
    expect(not missing, f"{len(missing)} ticks are missing: {sorted(missing)[:10]}")
    return query(path, "SELECT count(*) FROM runs")[0][0]


def check_start(files, which):
    """A run starts with the active version on disk."""
    with Device(OMEGA, port=PORT) as device, Retuned(device.port, config=files / "config.json", state=files / "state") as live:
        wait_until(lambda: live.reload(None, "--state")[0] == 0, "its state", live.log, every=0.2)
        number = next(number for number, (active, _) in live.versions().items() if active)
        expect(live.version_on_disk(number)["hash"] == hash_of(which), f"version {number} is active, and not candidate {which}\n{live.log()}")
        end_orderly(live)


def newest(told):
    return next(kind for kind in reversed(told) if kind in PHASES or kind in ("sent", "active"))


def one_cut(guest_module, phase, candidate, after_s, patience_s):
    folder = scratch()
    disk, told = record_and_cut(guest_module, folder, after_s, patience_s, "retune.py", (RECORDS, (phase, candidate)))
    files = check_file_system(disk, folder)
    which, on_probation = check_versions(files / "state" / "versions", told["sent"])
    expect(which >= told.get("active", 1) - 2, f"candidate {which} is active, though {told.get('active')} was")
    runs = check_database(files / "twin.db")
    check_start(Path(files), which)
    disk.unlink()
    return Cut(newest(told), after_s, told["sent"], which, runs, on_probation)


def phases(count, chance):
    """Returns `count` phases in random order, each equally often."""
    found = []
    while len(found) < count:
        found += chance.sample(list(PHASES), len(PHASES))
    return found[:count]


def cuts(count, seed, each=lambda number, cut: None, late=lambda number, why: None):
    """Makes `count` cuts, without those of a box that was too slow. Fails if more than half of the boxes are too slow."""
    sys.path.insert(0, str(SOURCE / "tests" / "hil" / "rig"))
    import guest  # pylint: disable=import-outside-toplevel
    chance, table = random.Random(seed), []
    for number, phase in enumerate(phases(count, chance), 1):
        try:
            table.append(one_cut(guest, phase, chance.choice(CANDIDATES), chance.uniform(0, PHASES[phase]), PATIENCE_S))
            each(number, table[-1])
        except Late as box:
            late(number, str(box))
    expect(2 * len(table) >= count, f"of {count} boxes only {len(table)} came so far in time: this machine is too busy")
    return table
