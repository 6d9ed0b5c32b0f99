#!/usr/bin/env python3
"""A killed and restarted `run` resumes: in step with the plant, in lock, and with a replay of the
same bits.

The tests count steps, not seconds, so that a slow machine does not fail them.
"""
import functools
import hashlib
import json
import random
import re
import signal
import sqlite3
import time
import zipfile
from contextlib import closing

from live_test import (FIRST_GUESS, MADE_UP, OPTIMISED, RESULTS, Program, bits, check_database, end_well, expect_reasons,
                       expect_same_events, free_port, number, query, wait_until)
from twinlock_test import (BAD_DATA, BAD_USAGE, EMULATED, FMUS, HUNG_S, PLAIN_LIVE, SANITIZER, SOURCE, Skip, at_most, edited_config, expect,
                           expect_line, has_line, main, replay_json, run, run_well, scratch)

FOLLOWED = 9  # master/sync/record.h
PERIOD = 0.01
LOCKED = 220  # steps: 2 s and 20 periods
ENOUGH = LOCKED + 30
WITHIN = FIRST_GUESS, OPTIMISED
FROM = {"start": "first recorded input", "inputs": "newest inputs"}  # resumed_from: part of the message


@functools.cache
def long_recording():
    """The motor bench's recording of 14 s, repeated 40 times: on a busy machine a test takes longer
    than 14 s."""
    header, *rows = (SOURCE / "config" / "motor" / "recording.csv").read_text(encoding="utf-8").split()
    rows = [row.partition(",") for row in rows]
    lap = float(rows[-1][0]) + 0.03
    path = scratch() / "recording.csv"
    path.write_text("\n".join([header, *(f"{i * lap + float(time_):.9f},{values}" for i in range(40) for time_, _, values in rows)]), encoding="utf-8")
    return path


def live_config(port, **changes):
    """The motor bench, live, without an end, with ten commits per second. Returns (configuration,
    database)."""
    record = {"commit_s": 0.1, **changes.pop("record", {})}
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": record, "recording": {"file": str(long_recording())},
                                               "sources": {"inverter": {"modbus_tcp": {"port": port}}}, **changes})
    return config, config.parent / "twin.db"


def execute(database, sql, *parameters):
    with closing(sqlite3.connect(database, timeout=10)) as connection:
        connection.execute(sql, parameters)
        connection.commit()


def begin(config, database, run_number, steps=100):
    """Starts a run, and waits for so many own steps. Skipped steps do not count."""
    live = Program("run", config, "--json")
    wait_until(lambda: database.exists() and query(database, "SELECT count(*) FROM runs")[0][0] >= run_number,
               f"run {run_number}", live.log)
    own = """SELECT count(*) FROM steps s LEFT JOIN beginnings b USING (run)
             WHERE run = ? AND outcome NOT IN (?, ?) AND step >= coalesce(resumed_tick, 0)"""
    wait_until(lambda: number(database, own, run_number, FOLLOWED, MADE_UP) >= steps, f"{steps} steps", live.log)
    return live


def resumption(database, run_number):
    return query(database, "SELECT resumed_run, resumed_tick, resumed_from FROM beginnings WHERE beginnings.run = ?",
                 run_number)[0]


def told_by(database, run_number):
    """The texts of the run's events about a resume."""
    return [row[0] for row in query(database, "SELECT text FROM events WHERE source = 'resume' AND run = ?",
                                    run_number)]


def expect_told(database, run_number, *wanted):
    """Checks that each of these lists of parts (see has_line()) is in an event about a resume."""
    told = told_by(database, run_number)
    expect(all(any(has_line(text, parts) for text in told) for parts in wanted), f"run {run_number} told {told}, wanted {wanted}")


def check_resumed(config, database, told, run_number, before, origin):
    """Checks that the run resumes the one before: in step, in lock, without a gap, and with a
    replay of the same bits."""
    lead = number(database, "SELECT lead FROM runs WHERE runs.run = ?", run_number)
    run_before, tick, source = resumption(database, run_number)
    expect((run_before, source) == (before, origin), f"run {run_number} resumes {run_before} from {source}")
    expect(told["resumed"] == {"run": before, "tick": tick, "from": origin}, f"told {told['resumed']}")
    newest = number(database, "SELECT max(step) FROM steps WHERE steps.run = ?", before)
    expect(tick == newest + lead + 1, f"resumed at tick {tick} after step {newest}")
    steps = query(database, "SELECT step, outcome FROM steps WHERE steps.run = ? ORDER BY step", run_number)
    expect([step for step, _ in steps] == list(range(steps[0][0], steps[0][0] + len(steps))), "steps are missing")
    own = [(step, outcome) for step, outcome in steps if step + lead >= tick]
    expect(all(outcome == FOLLOWED for step, outcome in steps if step + lead < tick), "other outcomes before the first own step")
    expect(told["steps"] + told["skipped"] == told["ticks"] == len(own),
           f"{told['steps']} steps, {told['skipped']} skipped, {told['ticks']} ticks, {len(own)} rows")
    met = [outcome for _, outcome in own if outcome != MADE_UP]
    locked = next(i for i in range(len(met)) if all(outcome in WITHIN for outcome in met[i:i + 20]))
    at_most(locked, LOCKED - 20, f"run {run_number}: steps until lock, of {len(met)}")
    shown = json.loads(run_well(["show", database, "--run", str(run_number), "--json"]))["lock"]
    expect(abs(shown["percent"] - told["lock"]["percent"]) <= 5, f"show tells {shown}, run told {told['lock']}")
    check_clock(database, run_number, before)
    check_database(database)
    return check_repeated(config, database, run_number)


def check_clock(database, run_number, before):
    """Checks that the run has the t_start of the run before, so its ticks continue."""
    starts = query(database, "SELECT start_ns, started FROM beginnings JOIN runs USING (run) WHERE run IN (?, ?)",
                   before, run_number)
    expect(starts[0] == starts[1], f"t_start moved: {starts}")


def check_repeated(config, database, run_number):
    """Checks that a replay with the same configuration gives the same bits. Returns its --json
    report."""
    again = scratch() / "again.db"
    told = replay_json(config, "--recording", database, "--run", str(run_number), "--db", again, timeout=HUNG_S)
    wanted = [bits(row) for row in query(database, RESULTS, run_number)]
    found = [bits(row) for row in query(again, RESULTS, 1)]
    different = [i for i, pair in enumerate(zip(found, wanted)) if pair[0] != pair[1]]
    expect(len(found) == len(wanted) and not different,
           f"{len(found)} steps replayed, {len(wanted)} recorded, {len(different)} differ: "
           f"{[(query(database, RESULTS, run_number)[i], query(again, RESULTS, 1)[i]) for i in different[:1]]}")
    expect_same_events(database, run_number, again)
    return told


def same_course(database, before, run_number):
    """Checks that the followed steps of the new run have the same bits as those of the run
    before."""
    sql = """SELECT n.step, n.simulated, o.simulated, na.applied, oa.applied FROM outputs n JOIN outputs o USING (step, signal)
             JOIN adjustments na ON na.run = n.run AND na.step = n.step
             JOIN adjustments oa ON oa.run = o.run AND oa.step = n.step
             WHERE n.run = ? AND o.run = ? ORDER BY n.step"""
    rows = query(database, sql, run_number, before)
    different = [row for row in rows if bits(row[1:2]) != bits(row[2:3]) or bits(row[3:4]) != bits(row[4:5])]
    expect(rows and not different, f"{len(different)} of {len(rows)} followed steps differ: {different[:1]}")


def kill_and_resume(pause, origin="checkpoint", **changes):
    config, database = live_config(free_port(), **changes)
    with Program("plant", config):
        live = begin(config, database, 1, 100 + random.randrange(60))
        live.kill()
        time.sleep(pause)
        again = begin(config, database, 2, ENOUGH)
        told, log = end_well(again, signal.SIGTERM)
    expect_line(log, f"notice|resume|run 1|tick {told['resumed']['tick']}")
    check_resumed(config, database, told, 2, 1, origin)
    same_course(database, 1, 2)
    expect_reasons(database, "cleanly", "SIGTERM")
    own = number(database, "SELECT count(*) FROM checkpoints WHERE tick >= ? AND run = 2", told["resumed"]["tick"])
    expect(own == 1, f"the new run has saved {own} checkpoints of its own\n{log}")
    return config, database, told


def expect_refused(wanted, parts, *args):
    code, _, log = run(args)
    expect(code == wanted and has_line(log, parts), f"{args} ended with {code}, wanted {wanted} and {parts}\n{log}")


# ---- resumed runs ----

def test_killed_and_started_at_once():
    kill_and_resume(0)


def test_killed_and_started_a_second_later():
    _, database, told = kill_and_resume(1)
    expect(told["skipped"] >= 90, f"only {told['skipped']} ticks of the pause were skipped")
    expect_line(run_well(["show", database]), f"run 1|tick {told['resumed']['tick']}")
    document = json.loads(run_well(["show", database, "--json"]))
    expect([entry["resumed"] is None for entry in document["runs"]] == [True, False], document["runs"])


def test_modes():
    for mode in "hold", "ahead":
        kill_and_resume(0.2, synchronise={"horizon": {"measurements": mode}})


def test_conditioned_measurement_and_a_longer_horizon():
    kill_and_resume(0, synchronise={"horizon": {"prediction": 4, "shape": "dynamic"}, "match": {
        "motor.omega": {"condition": {"median": 5, "low_pass_s": 0.05}}}})


def test_killed_twice_in_quick_succession():
    """The second run is killed before its first own step. The third one resumes the first or the
    second."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        second = Program("run", config, "--json")
        wait_until(lambda: number(database, "SELECT count(*) FROM runs") == 2, "the second run", second.log)
        second.kill()
        third = begin(config, database, 3, ENOUGH)
        told, _ = end_well(third, signal.SIGTERM)
        before = told["resumed"]["run"]
        check_resumed(config, database, told, 3, before, "checkpoint")
        begin(config, database, 4, 20).kill()
        told, _ = end_well(begin(config, database, 5, ENOUGH), signal.SIGTERM)
    expect(told["resumed"]["run"] == 4, f"{told['resumed']}")
    check_resumed(config, database, told, 5, 4, "checkpoint")


def test_killed_at_any_moment():
    """Kills at random times, also during a resume or a checkpoint: no committed entry is lost."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1, 50).kill()
        for number_of_run in range(2, 8):
            newest = number(database, "SELECT max(step) FROM steps")
            live = Program("run", config, "--json")
            wait_until(lambda: number(database, "SELECT count(*) FROM runs") >= number_of_run, "a run", live.log)
            time.sleep(random.uniform(0, 0.4))
            live.kill()
            check_database(database)
            expect(number(database, "SELECT max(step) FROM steps") >= newest, "steps went back")
        last = number(database, "SELECT max(run) FROM runs") + 1
        told, log = end_well(begin(config, database, last, ENOUGH), signal.SIGTERM)
    if told["resumed"] is None:
        expect_line(log, "resume|3 runs")
    else:
        check_resumed(config, database, told, last, told["resumed"]["run"], "checkpoint")


def test_asked_to_stop_and_started_again():
    """A run that ended by SIGTERM is resumed. A run that reached its duration is not."""
    more = 500  # steps; on a busy machine the start takes some of them
    config, database = live_config(free_port())
    with Program("plant", config):
        end_well(begin(config, database, 1), signal.SIGTERM)
        told, _ = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
        check_resumed(config, database, told, 2, 1, "checkpoint")
        last = number(database, "SELECT max(step) FROM steps")
        code, out, log = Program("run", config, "--json", "--duration", str((last + more) * PERIOD)).end()
        expect(code == 0 and json.loads(out)["resumed"]["run"] == 2, f"{code} {out}\n{log}")
        expect(number(database, "SELECT max(step) FROM steps WHERE steps.run = 3") == last + more, "the duration is from t_start")
        told, _ = end_well(begin(config, database, 4, 20), signal.SIGTERM)
    expect(told["resumed"] is None, f"{told['resumed']}")


# ---- from the inputs ----

def test_without_checkpoints():
    """The whole recording if it is short, to the bit; else its newest part."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        execute(database, "DELETE FROM checkpoints")
        told, _ = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
        check_resumed(config, database, told, 2, 1, "start")
        same_course(database, 1, 2)
        execute(database, "DELETE FROM checkpoints")
        execute(database, "DELETE FROM samples AS old WHERE old.run = 2 AND tick < 100")
        told, _ = end_well(begin(config, database, 3, ENOUGH), signal.SIGTERM)
    check_resumed(config, database, told, 3, 2, "inputs")


def test_damaged_checkpoints():
    """The older checkpoint if the newest is damaged; the inputs if both are."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        execute(database, "INSERT INTO checkpoints SELECT run, tick + 20, format, sha256, zeroblob(length(bytes)) "
                "FROM checkpoints")
        told, _ = end_well(begin(config, database, 2), signal.SIGTERM)
        check_resumed(config, database, told, 2, 1, "checkpoint")
        expect_told(database, 2, "checkpoint|tick 20|run 1|damaged", f"run 1|tick {told['resumed']['tick']}|checkpoint")
        execute(database, "UPDATE checkpoints SET bytes = substr(bytes, 1, 100)")
        told, _ = end_well(begin(config, database, 3), signal.SIGTERM)
        expect(told["resumed"]["from"] in ("start", "inputs"), f"{told['resumed']}")
        expect_told(database, 3, "checkpoint|run 2|damaged", f"run 2|tick {told['resumed']['tick']}|{FROM[told['resumed']['from']]}")
        execute(database, "UPDATE checkpoints SET format = 'twinlock 0'")
        told, _ = end_well(begin(config, database, 4), signal.SIGTERM)
        expect(told["resumed"]["from"] in ("start", "inputs"), f"{told['resumed']}")
        expect_told(database, 4, "checkpoint|run 3|another version", f"run 3|tick {told['resumed']['tick']}|{FROM[told['resumed']['from']]}")
    expect_refused(BAD_DATA, f"error|{database}|checkpoint|run 2|damaged", "replay", config, "--recording", database, "--run", "2")


def without_serializing(config):
    """Puts FMUs beside the configuration that cannot serialise their state."""
    for name in "drive.fmu", "motor.fmu":
        with zipfile.ZipFile(FMUS / name) as source, zipfile.ZipFile(config.parent / name, "w") as changed:
            for entry in source.infolist():
                data = source.read(entry)
                if entry.filename == "modelDescription.xml":
                    expect(b'canSerializeFMUstate="true"' in data, f"{name} has no such capability")
                    data = data.replace(b'canSerializeFMUstate="true"', b'canSerializeFMUstate="false"')
                changed.writestr(entry, data)


def test_fmus_that_cannot_be_turned_into_bytes():
    config, database = live_config(free_port())
    without_serializing(config)
    with Program("plant", config):
        begin(config, database, 1).kill()
        expect(number(database, "SELECT count(*) FROM checkpoints") == 0, "there is a checkpoint")
        told, log = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
    expect_line(log, "checkpoint|canSerializeFMUstate")
    check_resumed(config, database, told, 2, 1, "start")
    same_course(database, 1, 2)


def test_states_that_are_slow():
    """An FMU that is rolled back by copies of its memory uses its own states for checkpoints."""
    if SANITIZER or EMULATED:
        raise Skip("no memory copies of FMUs with a sanitizer, and no FMUs for an emulated machine")
    import keeper_fmu  # pylint: disable=import-outside-toplevel  # skips the test if it cannot run here
    config, database = live_config(free_port())
    keeper_fmu.slow_states("motor", config.parent / "motor.fmu")
    expect_line(run_well(["check", config]), "motor|motor.fmu|memory")
    with Program("plant", config):
        begin(config, database, 1, 120).kill()
        told, log = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
    expect_line(log, f"notice|resume|run 1|tick {told['resumed']['tick']}|checkpoint")
    check_resumed(config, database, told, 2, 1, "checkpoint")
    same_course(database, 1, 2)


def test_an_fmu_that_refuses_its_bytes():
    """The FMU rejects the bytes of the checkpoint: the twin starts again and follows all inputs."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        for tick, data in query(database, "SELECT tick, bytes FROM checkpoints"):
            guid = re.search(rb"\{[0-9a-fA-F-]{36}\}", data).start()  # a brace alone may be a byte of a number
            data = data[:guid] + b"x" + data[guid + 1:]
            execute(database, "UPDATE checkpoints SET bytes = ?, sha256 = ? WHERE tick = ?", data,
                    hashlib.sha256(data).hexdigest(), tick)
        told, _ = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
    expect_told(database, 2, "checkpoint|tick 0|run 1|fmi2DeSerializeFMUstate", f"run 1|tick {told['resumed']['tick']}|{FROM['start']}")
    check_resumed(config, database, told, 2, 1, "start")


def test_an_fmu_that_fails_on_the_way():
    """An FMU fails with the recorded inputs: that attempt is a separate run, and the next run
    starts at tick 0."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        execute(database, "UPDATE samples SET value = 1e308 WHERE signal = 0 AND tick > 20")
        live = begin(config, database, 3, 20)
        told, _ = end_well(live, signal.SIGTERM)
        expect(told["resumed"] is None, f"{told['resumed']}")
        expect_reasons(database, "cleanly", "earlier run", "SIGTERM")
        expect_told(database, 2, "run 1|failed|motor|fmi2DoStep")
        told, _ = end_well(begin(config, database, 4, 20), signal.SIGTERM)
    expect(told["resumed"]["run"] == 3, f"{told['resumed']}")


# ---- a long pause ----

def test_pause_of_50_s():
    """The twin catches up some 5000 ticks, as many per cycle as its budget permits. Then it
    locks."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        execute(database, "UPDATE beginnings SET start_ns = start_ns - 50000000000")
        begun = time.monotonic()
        told, _ = end_well(begin(config, database, 2, 5000 + 2 * LOCKED), signal.SIGTERM)
    print(f"    {told['skipped']} ticks caught up, {time.monotonic() - begun:.2f} s in all, "
          f"the run {told['wall_s']:.2f} s")
    expect(told["skipped"] >= 5000, f"{told['skipped']} ticks were skipped")
    lead = number(database, "SELECT lead FROM runs WHERE runs.run = 2")
    first = number(database, "SELECT min(step) FROM steps WHERE outcome NOT IN (?, ?) AND run = 2", MADE_UP, FOLLOWED)
    late = number(database, "SELECT count(*) FROM steps WHERE step > ? AND step < ? AND outcome NOT IN (?, ?) AND run = 2",
                  first, first + LOCKED, *WITHIN)
    print(f"    {late} of {LOCKED} steps after the first searched one (lead {lead}) were not locked")
    expect(late < LOCKED // 2, f"{late} of {LOCKED} steps were not locked")
    check_repeated(config, database, 2)


# ---- runs that are not resumed ----

def expect_not_resumed(prepare, *wanted, record=None):
    """`prepare` changes the database or the configuration, so that the next run starts at tick 0.

    Checks its events about that: `wanted` are lists of parts (see has_line()).
    """
    config, database = live_config(free_port(), record=record or {})
    with Program("plant", config):
        begin(config, database, 1, 40).kill()
        config = prepare(config, database) or config
        told, _ = end_well(begin(config, database, 2, 20), signal.SIGTERM)
    expect(told["resumed"] is None, f"resumed: {told['resumed']}")
    expect(number(database, "SELECT min(step) FROM steps WHERE steps.run = 2") == 0, "not from step 0")
    told = told_by(database, 2)
    expect(len(told) == len(wanted) and all(has_line(text, parts) for parts, text in zip(wanted, told)), f"{told}, wanted {wanted}")


def test_runs_that_are_not_resumed():
    """The reason, and the time without a twin if the run before is a different one."""
    gap = "s|ticks"

    def other_tolerance(config, _):
        document = json.loads(config.read_text())
        document["synchronise"]["match"]["motor.omega"]["tolerance"] = 1.1
        config.write_text(json.dumps(document))

    def sql(*statements):
        def change(_, database):
            for statement in statements:
                execute(database, statement)
        return change
    expect_not_resumed(other_tolerance, "configuration|run 1", gap)
    expect_not_resumed(sql("UPDATE beginnings SET fmus = 'x'"), "FMU files|run 1", gap)
    expect_not_resumed(sql("UPDATE beginnings SET start_ns = start_ns - 120000000000"), "run 1|s|record.resume_s")
    expect_not_resumed(sql("UPDATE beginnings SET boot = ''"), "run 1", gap)
    expect_not_resumed(sql("UPDATE runs SET (ended, ended_reason) = (committed, 'drive: fmi2DoStep failed')"),
                "run 1|drive: fmi2DoStep failed", gap)
    expect_not_resumed(sql("DELETE FROM checkpoints", "DELETE FROM steps AS one WHERE one.step = 20"), "run 1|ticks")
    expect_not_resumed(lambda *_: None, record={"resume_s": 0})


def test_three_runs_without_steps():
    """After three runs in a row without an own step, the next run does not resume."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        for run_number in 2, 3, 4:
            begin(config, database, run_number, 1).kill()
            execute(database, "DELETE FROM steps AS own WHERE own.run = ?", run_number)
        told, log = end_well(begin(config, database, 5, 20), signal.SIGTERM)
    expect(told["resumed"] is None and has_line(log, "notice|resume|3 runs"), log)


def test_after_a_reboot():
    """After a reboot UTC decides. A clock that was set back, or too far ahead, prevents the
    resume."""
    other = "UPDATE beginnings SET boot = 'another'"
    shifted = "UPDATE runs SET started = strftime('%Y-%m-%dT%H:%M:%fZ', started, '{0}'), " \
              "committed = strftime('%Y-%m-%dT%H:%M:%fZ', committed, '{0}')"
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        execute(database, other)
        execute(database, "UPDATE beginnings SET start_ns = 12345")
        told, _ = end_well(begin(config, database, 2, ENOUGH), signal.SIGTERM)
    expect(told["resumed"]["run"] == 1 and told["skipped"] < 1000, f"{told['resumed']} {told['skipped']}")
    check_repeated(config, database, 2)

    def after(days):
        def change(_, path):
            execute(path, other)
            execute(path, shifted.format(days))
        return change
    expect_not_resumed(after("+1 day"), "clock|run 1")
    expect_not_resumed(after("-1 day"), "run 1|s|record.resume_s")


def test_a_database_that_was_removed():
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1, 40).kill()
        for file in database.parent.glob("twin.db*"):
            file.unlink()
        told, _ = end_well(begin(config, database, 1, 40), signal.SIGTERM)
    expect(told["resumed"] is None and told_by(database, 1) == [], f"{told['resumed']} {told_by(database, 1)}")


def test_replay_without_the_beginning():
    """A replay of a resumed run fails if its FMUs or its checkpoint are missing, and reports
    which."""
    config, database = live_config(free_port())
    with Program("plant", config):
        begin(config, database, 1).kill()
        end_well(begin(config, database, 2, 40), signal.SIGTERM)
    execute(database, "UPDATE beginnings SET fmus = 'x' WHERE run = 2")
    replay = "replay", config, "--recording", database
    expect_refused(BAD_DATA, "error|FMU files|run 2|run 1", *replay)
    execute(database, "DELETE FROM checkpoints AS own WHERE own.run = 2")
    expect_refused(BAD_DATA, f"error|{database}|run 2|no start", *replay)
    expect_refused(BAD_DATA, f"error|{database}|run 7", *replay, "--run", "7")
    expect_refused(BAD_USAGE, "--run|\"x\"|3", *replay, "--run", "x")
    expect_refused(BAD_USAGE, "recording.csv|run 7|--run", "replay", config, "--run", "7")


if __name__ == "__main__":
    main()
