#!/usr/bin/env python3
"""FMUs that begin anew in the middle of a run: a run in which they did is repeated to the bit, and FMUs that refuse cost nothing but a new
instance. When they shall, test_lock_state.py tries."""
import os
import shutil
import sqlite3
from contextlib import closing

import hostile_fmu
from twinlock_test import PLAIN_LOCK, NOT_LOCKED, PATIENCE, SANITIZER, Skip, at_most, edited_config, expect, main, run_well, scratch, start

RESET = 32
STEPS = "SELECT s.step, outcome, flags, evaluations, J, simulated, applied FROM steps s JOIN outputs USING (run, step) " \
        "JOIN adjustments USING (run, step) ORDER BY s.step"


def ask(database, sql):
    with closing(sqlite3.connect(database)) as connection:
        return connection.execute(sql).fetchall()


def change(database, *statements):
    """A copy in which the run was another one."""
    copy = shutil.copy(database, scratch() / "changed.db")
    with closing(sqlite3.connect(copy)) as connection, connection:
        for statement in statements:
            connection.execute(statement)
    return copy


def resets(*steps):
    return f"UPDATE steps SET flags = flags | {RESET} WHERE step IN ({', '.join(map(str, steps))})"


def replay(path, recording=None):
    """The database of a replay, of the configuration's recording or of what another run has recorded."""
    database = scratch() / "run.db"
    options = [] if recording is None else ["--recording", recording]
    run_well(["replay", path, "--db", database, *options], wells=(0, NOT_LOCKED))  # hostile ones are not in lock
    return database


# ---- repeated ----

def test_a_run_is_repeated_to_the_bit():
    for name in ("lock", "ahead", "free"):
        path = edited_config(f"motor/{name}.json", {"duration_s": 3})
        whole = replay(path)
        marked = replay(path, change(whole, resets(40, 41, 200)))
        columns = "s.step, flags, y" if name == "free" else "s.step, flags, y, u"
        others = "" if name == "free" else "JOIN adjustments USING (run, step)"
        sql = f"SELECT {columns} FROM steps s JOIN outputs USING (run, step) {others} ORDER BY s.step"
        was, now, again = ask(whole, sql), ask(marked, sql), ask(replay(path, marked), sql)
        expect(again == now, f"{name}: the run with resets is not repeated")
        expect(was[:40] == now[:40] and was[40] != now[40], f"{name}: it does not begin anew at step 40")
        expect([row[0] for row in now if row[1] & RESET] == [40, 41, 200], f"{name}: other steps are flagged")
        ledger = ask(marked, "SELECT predicted, executions - repeated FROM components")
        expect(all(predicted == done for predicted, done in ledger), f"{name}: {ledger}")
        words = ask(marked, "SELECT count(*) FROM v_steps WHERE flags LIKE '%reset%'")
        expect(words == [(3,)], f"{name}: the view does not name the flag")


def test_another_configuration_knows_of_no_reset():
    path = edited_config(PLAIN_LOCK, {"duration_s": 1})
    other = edited_config(PLAIN_LOCK, {"duration_s": 1, "name": "other"})
    again = replay(other, change(replay(path), resets(40)))
    expect(ask(again, f"SELECT count(*) FROM steps WHERE flags & {RESET}") == [(0,)], "it has begun anew")


# ---- FMUs that refuse ----

FAILED, FATAL = 3, 4  # fmi2Error, fmi2Fatal
MARKED = tuple(range(10, 90, 2))


def marked_run(fmu):
    """A configuration with that FMU, and its run in which it began anew forty times."""
    path = hostile_fmu.config(fmu, hostile_fmu.LOCKED)
    return path, change(replay(path), resets(*MARKED))


def test_an_fmu_that_refuses_is_instantiated_anew():
    path, recorded = marked_run(hostile_fmu.make("good"))
    good = ask(replay(path, recorded), STEPS)
    expect(sum(row[2] & RESET != 0 for row in good) == len(MARKED), "it has not begun anew")
    path, recorded = marked_run(hostile_fmu.make("no_reset", RESET=FAILED))
    expect(ask(replay(path, recorded), STEPS) == good, "other values than those of an FMU that does not refuse")


def expect_end(words, fmu):
    """Whatever the FMU leaves behind."""
    path, recorded = marked_run(fmu)
    process = start(("replay", path, "--recording", recorded))
    try:
        _, log = process.communicate(timeout=60 * PATIENCE)
    finally:
        process.kill()
    expect(process.returncode == 70 and words in log, f"ended with {process.returncode}\n{log}")


def test_an_fmu_that_is_fatal_ends_the_run():
    expect_end("hostile: fmi2Reset failed for good (fmi2Fatal)", hostile_fmu.make("no_reset", RESET=FATAL))


def test_an_fmu_that_is_not_instantiated_a_second_time_ends_the_run():
    expect_end("hostile: fmi2Instantiate refused", hostile_fmu.make("no_reset", RESET=FAILED, SECOND="fmi2Instantiate"))


def test_a_crash_in_a_reset_is_told():
    expect_end("FMU hostile crashed in fmi2Reset", hostile_fmu.make("end", AT="fmi2Reset", HOW="*(volatile int *)8 = 0;"))


# ---- memory ----

BALLAST = 1 << 20  # bytes of each state


def resident(path, recorded):
    """Bytes at most of a replay."""
    process = start(["replay", path, "--recording", recorded])
    out, err = process.stdout.read(), process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    expect(process.returncode in (0, NOT_LOCKED), f"replay ended with {process.returncode}\n{out}{err}")
    return usage.ru_maxrss * 1024


def test_states_do_not_pile_up():
    """Neither if their handles are used again, nor if they are given back with their instance."""
    if SANITIZER:
        raise Skip("a sanitizer keeps memory that was freed")
    for name in ("good", "no_reset"):
        path, recorded = marked_run(hostile_fmu.make(name, BALLAST=BALLAST))
        once = resident(path, change(recorded, f"UPDATE steps SET flags = 0 WHERE step > {MARKED[0]}"))
        at_most(resident(path, recorded) - once, 8 << 20, f"{name}: bytes for {len(MARKED) - 1} resets more")


main()
