#!/usr/bin/env python3
"""A live twin verifies the rollback of its FMUs in the idle time of its ticks, and reports a
difference."""
import keeper_fmu
from live_test import Device, Program, check_replay, end_well, number, query
from twinlock_test import IN_LOCK, SANITIZER, Skip, at_least, expect, has_line, main, scratch, write_config

LATE = 3000  # inner steps of 1 ms until the FMU's states are wrong
DIFFERED = 64  # master/sync/record.h
WARNING, ERROR = 1, 2


def run_live(fmu, way, *options, seconds=8, hang_s=2):
    """(configuration, database, --json report)"""
    database = scratch() / "twin.db"
    with Device(0.6) as device:
        path = write_config({
            "twinlock": 1, "name": "late", "step_s": 0.01, "duration_s": seconds,
            "components": {"late": {"fmu": str(fmu), "rollback": way}},
            "sources": {"device": {"modbus_tcp": {"host": "127.0.0.1", "port": device.port, "period_s": 0.005}}},
            "plant": {"y": {"modbus": {"source": "device", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}},
            "synchronise": {"adjust": {"late.u": {"step": 0.1, "nominal": 1, "min": -20, "max": 20}},
                            "match": {"late.y": {"to": "plant.y", "tolerance": 0.01}}, "verify_every": 10},
            "record": {"file": str(database), "commit_s": 0.1}, "realtime": {"priority": 50, "hang_s": hang_s}})
        with Program("run", path, "--json", *options) as live:
            told, _ = end_well(live)
    return path, database, told


def run_late(late, way):
    return run_live(keeper_fmu.make_late(late), way)


def events(database, parts=""):
    """[(tick, severity, text)] of the twin's events that have all parts (see has_line())."""
    found = query(database, "SELECT tick, severity, text FROM events WHERE source = 'twin' ORDER BY event")
    return [event for event in found if has_line(event[2], parts)]


def need_copies():
    """Skips the test if FMUs cannot be rolled back by copies of their memory."""
    if SANITIZER:
        raise Skip("no memory copies of FMUs with a sanitizer's allocator")


def test_honest():
    """The verification runs all the time, without a difference or an event."""
    path, database, told = run_late(10**9, "state")
    print(f"    deadlines missed: {told['deadline_misses']} (a busy machine misses some)")
    at_least(told["verified"]["times"], 20, "verifications")
    expect(told["verified"]["differed"] == 0, f"{told['verified']}")
    expect(not events(database, "late") and told["lock"]["steps"]["degraded"] == 0, f"{told['lock']}, {events(database)}")
    expect(told["executions"]["total"] == number(database, "SELECT sum(executions) FROM steps"), "the total includes the verification")
    check_replay(path, database, number(database, "SELECT count(*) FROM steps"))


def test_wrong_later():
    """Wrong states without another rollback method: the lock is degraded from then on."""
    _, database, told = run_late(LATE, "state")
    found = events(database, "late|y|tolerances")
    expect(len(found) == 1 and found[0][0] is None and found[0][1] == ERROR, f"{events(database)}")
    first, last, count = query(database, "SELECT min(step), max(step), count(*) FROM steps WHERE flags & ?", DIFFERED)[0]
    expect(count == last - first + 1 and last == number(database, "SELECT max(step) FROM steps"), f"{first} to {last}: {count}")
    expect(told["lock"]["state"] in ("degraded", "lost"), f"{told['lock']}")


def test_replaced_rollback_method():
    """Wrong states: the twin changes to copies of the FMU's memory. The lock is degraded for a
    moment."""
    need_copies()
    _, database, told = run_late(LATE, "auto")
    found = events(database, "late|y|memory")
    expect(len(found) == 1 and found[0][1] == WARNING, f"{events(database)}")
    expect(number(database, "SELECT count(*) FROM steps WHERE flags & ?", DIFFERED) == 1, "more than one step")
    expect(told["lock"]["state"] in IN_LOCK and told["verified"]["differed"] == 1, f"{told['lock']}, {told['verified']}")
    at_least(told["verified"]["times"], 20, "verifications")


def test_wrong_from_the_start():
    """The FMU's own states are wrong, so there are no checkpoints, and an event says so."""
    need_copies()
    _, database, told = run_live(keeper_fmu.make_false("parameters"), "auto", seconds=2)
    said = query(database, "SELECT text FROM events WHERE source = 'checkpoint'")
    expect(len(said) == 1 and has_line(said[0][0], "late|own states"), f"{said}")
    expect(told["lock"]["state"] in IN_LOCK, f"{told['lock']}")


def test_copy_that_fails_later():
    """The FMU does something that no copy can undo: the restarted twin uses the FMU's own states,
    which are slower."""
    need_copies()
    _, database, told = run_live(keeper_fmu.make_slow(PAUSE=50000, MAPS=300), "auto", "--supervise")
    runs = query(database, "SELECT run, ended_reason FROM runs ORDER BY run")
    expect(len(runs) == 2, f"{runs}, {query(database, 'SELECT source, text FROM events')}")
    at_least(number(database, "SELECT count(*) FROM steps WHERE steps.run = 2"), 400, "steps of the second")
    expect(told["lock"]["state"] in IN_LOCK, f"{told['lock']}")


def test_a_long_proof_is_no_hang():
    """The proof restores states, and each restore takes longer than hang_s. That is no hang."""
    need_copies()  # else the twin would use these slow states all the time
    _, database, _ = run_live(keeper_fmu.make_slow(PAUSE=300000000), "auto", "--supervise", hang_s=0.2)
    runs = number(database, "SELECT count(*) FROM runs")
    expect(runs == 1, f"{runs} runs, {query(database, 'SELECT source, text FROM events')}")


if __name__ == "__main__":
    main()
