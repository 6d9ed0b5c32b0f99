#!/usr/bin/env python3
"""Resets of all FMUs during a run: a replay repeats them to the bit. FMUs that fail to reset are instantiated again.

test_lock_state.py tests when the lock monitor resets them."""
import os
import shutil
import sqlite3
from contextlib import closing

import hostile_fmu
from twinlock_test import (NOT_LOCKED, PATIENCE, PLAIN_LOCK, SANITIZER, Skip, at_most, edited_config, expect, expect_line, main, merge, run_well, scratch,
                           start)

RESET = 32  # flag of a step
STEPS = "SELECT s.step, outcome, flags, evaluations, J, simulated, applied FROM outputs JOIN steps s USING (run, step) " \
        "JOIN adjustments USING (run, step) ORDER BY s.step"


def ask(database, sql):
    with closing(sqlite3.connect(database)) as connection:
        return connection.execute(sql).fetchall()


def change(database, *statements):
    """A changed copy of a database."""
    copy = shutil.copy(database, scratch() / "changed.db")
    with closing(sqlite3.connect(copy)) as connection, connection:
        for statement in statements:
            connection.execute(statement)
    return copy


def resets(*steps):
    return f"UPDATE steps SET flags = flags | {RESET} WHERE step IN ({', '.join(map(str, steps))})"


def replay(path, recording=None):
    """The database of a replay of `recording`, by default of the configuration's."""
    database = scratch() / "run.db"
    options = [] if recording is None else ["--recording", recording]
    run_well(["replay", path, "--db", database, *options], wells=(0, NOT_LOCKED))  # a hostile FMU is not in lock
    return database


# ---- repeated ----

def test_a_run_is_repeated_to_the_bit():
    for name in ("lock", "ahead", "free"):
        path = edited_config(f"motor/{name}.json", {"duration_s": 3})
        whole = replay(path)
        marked = replay(path, change(whole, resets(40, 41, 200)))
        columns = "s.step, flags, simulated" if name == "free" else "s.step, flags, simulated, applied"
        others = "" if name == "free" else "JOIN adjustments USING (run, step)"
        sql = f"SELECT {columns} FROM outputs JOIN steps s USING (run, step) {others} ORDER BY s.step"
        was, now, again = ask(whole, sql), ask(marked, sql), ask(replay(path, marked), sql)
        expect(again == now, f"{name}: the run with resets is not repeated")
        expect(was[:40] == now[:40] and was[40] != now[40], f"{name}: no reset at step 40")
        expect([row[0] for row in now if row[1] & RESET] == [40, 41, 200], f"{name}: other steps are flagged")
        ledger = ask(marked, "SELECT predicted, executions - repeated FROM components")
        expect(all(predicted == done for predicted, done in ledger), f"{name}: {ledger}")
        words = ask(marked, "SELECT count(*) FROM v_steps WHERE flags LIKE '%reset%'")
        expect(words == [(3,)], f"{name}: the view does not name the flag")


def test_another_configuration_repeats_no_reset():
    path = edited_config(PLAIN_LOCK, {"duration_s": 1})
    other = edited_config(PLAIN_LOCK, {"duration_s": 1, "name": "other"})
    again = replay(other, change(replay(path), resets(40)))
    expect(ask(again, f"SELECT count(*) FROM steps WHERE flags & {RESET}") == [(0,)], "a reset")


# ---- FMUs that fail to reset ----

OK, FAILED, FATAL = 0, 3, 4  # fmi2OK, fmi2Error, fmi2Fatal
MARKED = tuple(range(10, 90, 2))


def marked_run(fmu, way="state"):
    """(configuration with that FMU, database of its run with forty resets). By own states, fmi2Reset is called."""
    path = hostile_fmu.config(fmu, merge(hostile_fmu.LOCKED, {"components": {"hostile": {"rollback": way}}}))
    return path, change(replay(path), resets(*MARKED))


def test_an_fmu_that_fails_to_reset_is_instantiated_again():
    path, recorded = marked_run(hostile_fmu.make("good"))
    good = ask(replay(path, recorded), STEPS)
    expect(sum(row[2] & RESET != 0 for row in good) == len(MARKED), "no resets")
    path, recorded = marked_run(hostile_fmu.make("no_reset", RESET=FAILED))
    expect(ask(replay(path, recorded), STEPS) == good, "other values than with fmi2Reset")


def test_an_fmu_whose_reset_does_nothing():
    """Rolled back by memory, it is reset by the copy from after fmi2Instantiate, and fmi2Reset is not called."""
    if SANITIZER:
        raise Skip("no memory copies of FMUs with a sanitizer's allocator")
    runs = [marked_run(hostile_fmu.make(name, **settings), "memory")
            for name, settings in (("good", {}), ("no_reset", {"RESET": OK}), ("no_reset", {"RESET": FATAL}))]
    good, *others = [ask(replay(path, recorded), STEPS) for path, recorded in runs]
    expect(sum(row[2] & RESET != 0 for row in good) == len(MARKED), "no resets")
    expect(all(other == good for other in others), "other values than after a complete reset")


def test_an_fmu_that_starts_at_0_only():
    """Its time is shifted. Without that, a run would end at its first reset, or resume."""
    for way in ("auto", "replay"):
        tables = []
        for fmu in (hostile_fmu.make("good"), hostile_fmu.make("good", STARTS_AT_0=True)):
            path = hostile_fmu.config(fmu, merge(hostile_fmu.LOCKED, {"components": {"hostile": {"rollback": way}}}))
            tables.append(ask(replay(path, change(replay(path), resets(*MARKED))), STEPS))
        expect(tables[0] == tables[1], f"{way}: other values than those of an FMU that starts at any time")


def expect_end(parts, fmu):
    """The replay ends with 70, and a line of the log has `parts`. The FMU may leave temporary files."""
    path, recorded = marked_run(fmu)
    process = start(("replay", path, "--recording", recorded))
    try:
        _, log = process.communicate(timeout=60 * PATIENCE)
    finally:
        process.kill()
    expect(process.returncode == 70, f"ended with {process.returncode}\n{log}")
    expect_line(log, parts)


def test_an_fmu_that_is_fatal_ends_the_run():
    expect_end("error|hostile|fmi2Reset|fmi2Fatal", hostile_fmu.make("no_reset", RESET=FATAL))


def test_an_fmu_without_a_second_instance_ends_the_run():
    expect_end("error|hostile|fmi2Instantiate", hostile_fmu.make("no_reset", RESET=FAILED, SECOND="fmi2Instantiate"))


def test_a_crash_in_a_reset_is_logged():
    expect_end("error|FMU hostile|crashed|fmi2Reset", hostile_fmu.make("end", AT="fmi2Reset", HOW="*(volatile int *)8 = 0;"))


# ---- memory ----

BALLAST = 1 << 20  # bytes of each state


def resident(path, recorded):
    """The largest resident size of a replay, bytes."""
    process = start(["replay", path, "--recording", recorded])
    out, err = process.stdout.read(), process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    expect(process.returncode in (0, NOT_LOCKED), f"replay ended with {process.returncode}\n{out}{err}")
    return usage.ru_maxrss * 1024


def test_memory_of_states_does_not_grow():
    """Neither if their handles are reused, nor if they are freed with their instance."""
    if SANITIZER:
        raise Skip("a sanitizer keeps memory that was freed")
    for name in ("good", "no_reset"):
        path, recorded = marked_run(hostile_fmu.make(name, BALLAST=BALLAST))
        once = resident(path, change(recorded, f"UPDATE steps SET flags = 0 WHERE step > {MARKED[0]}"))
        at_most(resident(path, recorded) - once, 8 << 20, f"{name}: bytes for {len(MARKED) - 1} resets more")


main()
