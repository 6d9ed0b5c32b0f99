#!/usr/bin/env python3
"""A running twin takes over another tuning at the start of a tick (sent by retune_probe).

The tests check its records, that a replay gives the same bits, and that it stays active after
kills.
"""
import json
import os
import re
import subprocess
from pathlib import Path

from live_test import Device, bits, query, wait_until
from supervised import end_orderly, wait_for_run
from tree import OMEGA, Tree, configuration
from twinlock_test import HUNG_S, BUILD, Skip, expect, expect_line, expect_no_line, has_line, main, run_well, scratch

PROBE = BUILD / "tests" / "retune_probe"
SKIPPED = 77
FOLLOWED = 9  # master/sync/record.h
STEPS = ("SELECT a.step, a.signal, a.applied, a.nominal, o.simulated, s.J, s.outcome, s.evaluations FROM adjustments a JOIN outputs o USING (run, step) "
         "JOIN steps s USING (run, step) WHERE run = ? ORDER BY a.step, a.signal")
TUNINGS = """SELECT tick, substr(configuration, 1, 12), who, origin, why
             FROM tunings
             WHERE run = ? ORDER BY tick"""


def other(config, name, change):
    """Writes a changed configuration beside the file. Returns its path."""
    document = json.loads(config.read_text(encoding="utf-8"))
    change(document["synchronise"])
    path = config.parent / name
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def tighter(synchronise):
    match = synchronise["match"]["motor.omega"]
    match["tolerance"] = match["tolerance"] / 5
    synchronise["adjust"]["motor.d"]["nominal"] = 0.01
    synchronise["budget"] = {"evaluations": 20}


def wider(synchronise):
    synchronise["match"]["motor.omega"]["tolerance"] = 20.0
    synchronise["match"]["motor.omega"]["weight"] = 0.5
    synchronise["adjust"]["motor.d"].update({"nominal": 0.02, "min": 0.001, "max": 1.0, "penalty": {"rate": 0.001}})


def too_many(synchronise):
    synchronise["budget"] = {"evaluations": 100000}


def descriptor(pid, name):
    """The descriptor of one of the supervisor's writable memory blocks."""
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        if os.readlink(entry).startswith(f"/memfd:{name} "):
            return entry.name
    raise AssertionError(f"the supervisor has no block {name}")


def retune(live, path, who="ann"):
    """Sends the tuning. Returns (number, tick), or (number, why it was refused)."""
    blocks = descriptor(live.pid, "twinlock tuning"), descriptor(live.pid, "twinlock twin")
    probe = subprocess.run([PROBE, str(live.pid), *blocks, path, who], capture_output=True, text=True, timeout=HUNG_S, check=False)
    if probe.returncode == SKIPPED:
        raise Skip("no permission to access the supervisor")
    expect(probe.returncode == 0, f"retune_probe ended with {probe.returncode}: {probe.stdout}{probe.stderr}")
    found = probe.stdout.split(" ", 1)
    return int(found[0]), int(found[1]) if re.fullmatch(r"\d+\n", found[1]) else found[1].strip()


def wait_for_tuning(live, database, run_number, tick):
    wait_until(lambda: query(database, "SELECT 1 FROM tunings WHERE tick = ? AND run = ?", tick, run_number), "the tuning in the database", live.log)


def wait_for_steps_after(live, database, run_number, tick, count=20):
    wait_until(lambda: query(database, "SELECT count(*) FROM samples WHERE tick > ? AND run = ?", tick, run_number)[0][0] > count, "ticks after it", live.log)


def expect_repeated(config, database, run_number):
    """Checks that a replay gives the same bits in all steps, and records the same tunings. Returns
    its --json report."""
    again = scratch() / "again.db"
    told = json.loads(run_well(["replay", config, "--recording", database, "--run", str(run_number), "--db", again, "--json"], wells=(0, 3)))
    wanted = query(database, STEPS, run_number)
    found = query(again, STEPS, 1)
    differ = [a[0] for a, b in zip(wanted, found) if bits(a) != bits(b)]
    expect(len(found) >= len(wanted) - 1 > 20 and not differ, f"{len(found)} of {len(wanted)} steps, the first that differs is {differ[:1]}")
    expect(query(again, TUNINGS, 1) == query(database, TUNINGS, run_number), f"{query(again, TUNINGS, 1)} {query(database, TUNINGS, run_number)}")
    return told


def test_taken_and_repeated():
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        first, second, bad = other(config, "first.json", tighter), other(config, "second.json", wider), other(config, "bad.json", too_many)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            live.wait_for_tick(database)
            _, at = retune(live, first)
            wait_for_tuning(live, database, 1, at)
            wait_for_steps_after(live, database, 1, at)
            number, why = retune(live, bad)
            expect(number == 4 and has_line(str(why), "100000 evaluations"), f"{number} {why}")
            _, later = retune(live, second, "bo")
            wait_for_tuning(live, database, 1, later)
            wait_for_steps_after(live, database, 1, later)
            end_orderly(live)
        rows = query(database, TUNINGS, 1)
        expect([(row[0], *row[2:]) for row in rows] == [(at, "ann", "test", "to see what it does"), (later, "bo", "test", "to see what it does")], f"{rows}")
        started, *told = [row[0] for row in query(database, "SELECT text FROM events WHERE source = 'retune' ORDER BY event")]
        expect_line(started, f"configuration|runs: {config}")
        expect(len(told) == 3 and has_line(told[0], f"configuration {rows[0][1]}") and has_line(told[1], "rejected|100000 evaluations")
               and has_line(told[2], f"configuration {rows[1][1]}"), f"{told}")
        nominals = query(database, "SELECT nominal, count(*) FROM adjustments GROUP BY nominal ORDER BY min(step)")
        expect([row[0] for row in nominals] == [0.0031, 0.01, 0.02], f"{nominals}")
        page = run_well(["show", database])
        expect_line(page, f"tick {at}|configuration {rows[0][1]}|ann|test|to see what it does")
        shown = json.loads(run_well(["show", database, "--json"]))["tunings"]
        expect([(one["tick"], one["configuration"][:12], one["who"], one["origin"], one["why"]) for one in shown] == rows, f"{shown}")
        again = expect_repeated(config, database, 1)
        expect(again["tunings"] == {"recorded": 2, "applied": 2}, f"{again.get('tunings')}")
        page = run_well(["replay", config, "--recording", database], wells=(0, 3))
        expect_line(page, "tunings|2")
        expect_no_line(page, "tunings|another configuration")
        left_out = json.loads(run_well(["replay", first, "--recording", database, "--json"], wells=(0, 3)))
        expect(left_out["tunings"] == {"recorded": 2, "applied": 0}, f"{left_out.get('tunings')}")
        page = run_well(["replay", first, "--recording", database], wells=(0, 3))
        expect_line(page, "tunings|2|another configuration")


def test_the_twin_is_killed():
    """The next twin starts with the tuning and records it once. Its replay gives the same bits."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        first, second = other(config, "first.json", tighter), other(config, "second.json", wider)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            live.wait_for_tick(database)
            _, at = retune(live, first)
            live.kill_one("twin")
            wait_for_run(live, database, 2)
            live.wait_for_tick(database)
            followed = query(database, "SELECT resumed_tick FROM beginnings WHERE beginnings.run = 2")[0][0]
            _, later = retune(live, second)
            wait_for_tuning(live, database, 2, later)
            wait_for_steps_after(live, database, 2, later)
            end_orderly(live)
        expect(query(database, "SELECT tick, who FROM tunings WHERE tunings.run = 1 ORDER BY tick") in ([(at, "ann")], []), f"{query(database, TUNINGS, 1)}")
        rows = query(database, "SELECT tick, who FROM tunings WHERE tunings.run = 2 ORDER BY tick")
        expect(rows == [(min(at, followed) if at >= rows[0][0] else rows[0][0], "ann"), (later, "ann")], f"{rows}, at {at}, followed to {followed}")
        own = query(database, "SELECT nominal, min(step) FROM adjustments WHERE step >= ? AND run = 2 GROUP BY nominal ORDER BY 2", followed)
        expect([row[0] for row in own] == [0.01, 0.02], f"{own}")
        expect_repeated(config, database, 1)
        expect_repeated(config, database, 2)


def test_the_recorder_is_killed():
    """The recorder is killed before or after a tuning. The tuning is recorded once, with who sent
    it and why."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            live.wait_for_tick(database)
            taken = []
            for i in range(4):
                path = other(config, f"{i}.json", lambda values, i=i: values["match"]["motor.omega"].update({"tolerance": 0.5 + i}))
                live.kill_one("recorder") if i % 2 == 0 else None
                taken.append(retune(live, path, f"who {i}")[1])
                live.kill_one("recorder") if i % 2 == 1 else None
                wait_for_tuning(live, database, 1, taken[-1])
            wait_for_steps_after(live, database, 1, taken[-1])
            end_orderly(live)
        rows = query(database, "SELECT tick, who FROM tunings ORDER BY run, tick")
        expect(rows == [(tick, f"who {i}") for i, tick in enumerate(taken)], f"{rows} of {taken}")
        expect(query(database, "SELECT count(*) FROM runs") == [(1,)], "more than one run")
        expect(query(database, "SELECT entries_lost FROM runs") == [(0,)], "something was lost")
        expect_repeated(config, database, 1)


def test_a_warm_restart():
    """A restart resumes the run if the file is the tuned configuration. It does not if it is the
    first one."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        first = other(config, "first.json", tighter)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            live.wait_for_tick(database)
            _, at = retune(live, first)
            wait_for_tuning(live, database, 1, at)
            wait_for_steps_after(live, database, 1, at)
            end_orderly(live)
        with Tree(first) as live:
            wait_for_run(live, database, 2)
            live.wait_for_tick(database)
            end_orderly(live)
        expect(query(database, "SELECT resumed_run FROM beginnings WHERE beginnings.run = 2") == [(1,)],
               f"{query(database, 'SELECT run, text FROM events')}")
        hashes = query(database, "SELECT substr(configuration, 1, 12) FROM runs ORDER BY run")
        rows = query(database, TUNINGS, 2)
        expect(all(row[1] in (hashes[0][0], hashes[1][0]) for row in rows), f"{rows} {hashes}")
        expect_repeated(first, database, 2)
        with Tree(config) as live:
            wait_for_run(live, database, 3)
            live.wait_for_tick(database)
            end_orderly(live)
        expect(query(database, "SELECT resumed_run FROM beginnings WHERE beginnings.run = 3") == [(None,)], "another configuration resumed the run")
        told = [text for text, in query(database, "SELECT text FROM events WHERE source = 'resume' AND run = 3")]
        expect(any(has_line(text, "configuration|run 2") for text in told), f"{told}")


if __name__ == "__main__":
    main()
