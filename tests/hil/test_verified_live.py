#!/usr/bin/env python3
"""A live twin looks in what is left of its ticks whether its FMUs still come back to where they were, and says so if one does not."""
import keeper_fmu
from live_test import Device, Program, check_replay, end_well, number, query
from twinlock_test import SANITIZER, Skip, at_least, expect, main, scratch, write_config

LATE = 550  # inner steps until the FMU's states are wrong, some 380 of which the proof at the start takes
DIFFERED = 64  # master/sync/record.h
WARNING, ERROR = 1, 2


def run_live(fmu, way, *options, seconds=8, hang_s=2):
    """(configuration, database, what --json told)"""
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


def events(database, words):
    return query(database, "SELECT tick, severity, text FROM events WHERE source = 'twin' AND text LIKE ? ORDER BY event", f"%{words}%")


def test_honest():
    """All through the run, without a missed deadline, and with nothing to tell."""
    path, database, told = run_late(10**9, "state")
    at_least(told["verified"]["times"], 20, "looked")
    expect(told["verified"]["differed"] == 0 and told["deadline_misses"] == 0, f"{told['verified']}, missed: {told['deadline_misses']}")
    expect(not events(database, "come back") and told["lock"]["steps"]["degraded"] == 0, f"{told['lock']}")
    expect(told["executions"]["total"] == number(database, "SELECT sum(executions) FROM steps"), "what is looked at is counted with the rest")
    check_replay(path, database, number(database, "SELECT count(*) FROM steps"))


def test_wrong_later():
    """It has no other way: degraded from then on."""
    _, database, told = run_late(LATE, "state")
    found = events(database, "late does not come back to where it was: y was")
    expect(len(found) == 1 and found[0][0] is None and found[0][1] == ERROR and "tolerances" in found[0][2], f"{events(database, '')}")
    first, last, count = query(database, "SELECT min(step), max(step), count(*) FROM steps WHERE flags & ?", DIFFERED)[0]
    expect(count == last - first + 1 and last == number(database, "SELECT max(step) FROM steps"), f"{first} to {last}: {count}")
    expect(told["lock"]["state"] in ("degraded", "lost"), f"{told['lock']}")


def test_mended():
    """Its memory it is from then on; degraded for a moment."""
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: FMUs are not rolled back by their memory")
    _, database, told = run_late(LATE, "auto")
    found = events(database, "it is rolled back by its memory from now on")
    expect(len(found) == 1 and found[0][1] == WARNING, f"{events(database, '')}")
    expect(number(database, "SELECT count(*) FROM steps WHERE flags & ?", DIFFERED) == 1, "more than one step")
    expect(told["lock"]["state"] == "locked" and told["verified"]["differed"] == 1, f"{told['lock']}, {told['verified']}")
    at_least(told["verified"]["times"], 20, "looked")


def test_wrong_from_the_start():
    """Its own states are not what its bytes could be made of: there are no checkpoints, and that is said."""
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: FMUs are not rolled back by their memory")
    _, database, told = run_live(keeper_fmu.make_false("parameters"), "auto", seconds=2)
    said = query(database, "SELECT text FROM events WHERE source = 'checkpoint'")
    expect(len(said) == 1 and "late is not rolled back by its own states, and only these can be turned into bytes" in said[0][0], f"{said}")
    expect(told["lock"]["state"] == "locked", f"{told['lock']}")


def test_a_copy_that_it_failed_by():
    """What no copy takes back comes after a while: the twin that is begun anew goes by the FMU's own states, though they are slower."""
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: FMUs are not rolled back by their memory")
    _, database, told = run_live(keeper_fmu.make_slow(PAUSE=50000, MAPS=300), "auto", "--supervise")
    runs = query(database, "SELECT run, ended_reason FROM runs ORDER BY run")
    expect(len(runs) == 2, f"{runs}, {query(database, 'SELECT source, text FROM events')}")
    at_least(number(database, "SELECT count(*) FROM steps WHERE run = 2"), 400, "steps of the second")
    expect(told["lock"]["state"] == "locked", f"{told['lock']}")


def test_a_long_proof_is_no_hang():
    """States are restored in it, each of which takes longer than a cycle may be silent."""
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: it would be led back by these states all the time")
    _, database, _ = run_live(keeper_fmu.make_slow(PAUSE=300000000), "auto", "--supervise", hang_s=0.2)
    runs = number(database, "SELECT count(*) FROM runs")
    expect(runs == 1, f"{runs} runs, {query(database, 'SELECT source, text FROM events')}")


if __name__ == "__main__":
    main()
