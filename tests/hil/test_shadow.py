#!/usr/bin/env python3
"""`twinlock reload` with changes that need a new twin, which runs as a shadow first.

The new twin takes over between two ticks, and a rollback works the same way. Each tick must be
recorded once, and a replay must give the same bits.
"""
import contextlib
import json
import os
import random
import shutil
import signal
import threading
import zipfile

from changes import moving
from hostile_fmu import make
from live_test import Device, bits, children, committed_steps, number, query, title, wait_until
from retuned import Retuned, events, match, tolerance
from supervised import WORD, end_orderly, wait_for_run
from tree import OMEGA, configuration, expect_whole, read
from twinlock_test import HUNG_S, BAD_DATA, BUILD, FMUS, at_most, expect, expect_line, has_line, main, run_well, scratch

SHORT = "--shadow", "2", "--probation", "3"
LONG = "--shadow", "2", "--probation", "600"
HANDED_OVER = "another configuration"  # in the reason for the end of a run
RUNS = "SELECT r.run, b.resumed_run, b.resumed_tick, b.resumed_from, r.prediction, r.ended_reason FROM runs r JOIN beginnings b USING (run) ORDER BY r.run"
STEPS = ("SELECT a.step, a.signal, a.applied, a.nominal, o.simulated, s.J, s.outcome, s.evaluations, s.flags FROM adjustments a JOIN outputs o USING (run, step) "
         "JOIN steps s USING (run, step) WHERE run = ? AND a.step >= ? ORDER BY a.step, a.signal")


def horizon(prediction):
    return lambda document: document["synchronise"]["horizon"].update(prediction=prediction)


def own_fmu(port):
    """A configuration with a copy of its FMU beside it. Returns its path."""
    config, _ = configuration(port)
    document = json.loads(config.read_text(encoding="utf-8"))
    component = document["components"]["motor"]
    shutil.copy(FMUS / component["fmu"], config.parent / "motor.fmu")
    component["fmu"] = "motor.fmu"
    config.write_text(json.dumps(document), encoding="utf-8")
    return config


def twins(live):
    """The processes of the twin and of the shadow, if there is one."""
    return [pid for pid in children(live.pid) if title(pid).startswith("twinlock: twin")]


def shadow(live):
    return wait_until(lambda: [pid for pid in children(live.pid) if title(pid).startswith("twinlock: twin, shadow")], "a shadow", live.log)[0]


def expect_flips(database, *runs):
    """Checks that each run but the first resumes the one before, at the tick after its last one.

    `runs`: the prediction horizon of each run.
    """
    found = query(database, RUNS)
    expect([row[4] for row in found] == list(runs), f"{found}")
    for before, row in zip(found, found[1:]):
        last = number(database, f"SELECT max(tick) FROM samples WHERE samples.run = {before[0]}")
        expect(row[1] == before[0] and row[2] == last + 1 and row[3] == "checkpoint", f"{row} after tick {last}")
        expect(has_line(before[5], HANDED_OVER), f"{before}")
    expect_whole(read(database))


def expect_repeated(config, database, which, lead):
    """Checks that a replay of that run with its configuration gives the same bits."""
    again = scratch() / f"again{which}.db"
    run_well(["replay", config, "--recording", f"{database}", "--run", str(which), "--db", again], timeout=HUNG_S)
    first = query(database, "SELECT coalesce(resumed_tick, 0) FROM beginnings WHERE beginnings.run = ?", which)[0][0] - lead
    recorded = [bits(row) for row in query(database, STEPS, which, first)]
    replayed = [bits(row) for row in query(again, STEPS, 1, first)]
    expect(recorded and recorded == replayed[:len(recorded)],
           f"run {which}: {sum(a != b for a, b in zip(recorded, replayed))} of {len(recorded)} steps differ ({len(replayed)} replayed)")


def conditioned(document):
    """Adds a conditioned look-up of a signal, beside the raw one."""
    document["plant"]["omega"]["every_s"] = 0.04
    match(document).update(between="line", condition={"low_pass_s": 0.02})


def without_free_twin(document):
    document["synchronise"]["free_twin"] = False


def test_runs_with_more_look_ups_than_signals():
    """Two runs with more look-ups than the file has signals."""
    with Device(OMEGA) as device:
        config, _ = configuration(device.port)
        document = json.loads(config.read_text(encoding="utf-8"))
        conditioned(document)
        document["synchronise"]["free_twin"] = True
        config.write_text(json.dumps(document), encoding="utf-8")
        with Retuned(device.port, config=config) as live:
            wait_for_run(live, live.database, 1)
            code, out, err = live.reload(live.edited(without_free_twin), *SHORT, timeout=HUNG_S)
            expect(code == 0, f"{code}\n{out}{err}{live.log()}")
            wait_until(lambda: committed_steps(live.database, 2) > 50, "steps of the other twin", live.log)
            end_orderly(live)
            expect_flips(live.database, 1, 1)


def test_taken_over_and_kept():
    """No gap between both twins. The old twin ends when the new one is kept. Each replay gives the
    same bits."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        before = live.child()
        candidate = live.edited(horizon(3))
        code, out, err = live.reload(candidate, "--wait", "--why", "a longer look", *SHORT, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        for step in "try", "predict", "shadow", "compare", "activate", "probation", "kept":
            expect(f"\n{step} " in out, f"no phase \"{step}\":\n{out}")
        wait_until(lambda: len(twins(live)) == 1, "the old twin is gone", live.log)
        expect(twins(live) != [before], "the old twin runs")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect(events(live.database, "version 2%hand%a longer look") == 1, "no event with origin and reason of version 2")
        expect_flips(live.database, 1, 3)
        expect_repeated(live.file, live.database, 1, 1)
        expect_repeated(candidate, live.database, 2, 3)


def test_there_and_back():
    """A rollback by hand during the probation. The old twin was running as a shadow, and takes over
    without a gap."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        before = live.child()
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0 and len(twins(live)) == 2, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: committed_steps(live.database, 2) > 100, "run 2", live.log)
        wait_until(lambda: shadow(live) == before, "the title of the shadow", live.log)
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and has_line(out, "version 1") and not has_line(out, "restart"), f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: twins(live) == [before], "the first twin alone", live.log)
        wait_until(lambda: committed_steps(live.database, 3) > 100, "run 3", live.log)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_flips(live.database, 1, 2, 1)
        expect_repeated(live.file, live.database, 3, 1)


def test_automatic_rollback():
    """The new twin is in lock as a shadow, but loses the lock later, because its bounds are too
    narrow."""
    def bound(document):
        horizon(2)(document)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(bound), "--shadow", "2", "--probation", "30", timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        device.omega = 20.0
        wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.5)
        result = live.versions()[2][1]
        expect(result.startswith("returned: ") and "lost" in result, result)
        wait_until(lambda: committed_steps(live.database, 3) > 100, "run 3", live.log)
        end_orderly(live)
        expect_flips(live.database, 1, 2, 1)


def test_refused_as_a_shadow():
    """A shadow that cannot follow the plant never takes over, and the run is not disturbed."""
    def bound(document):
        horizon(2)(document)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(20.0) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(bound), *SHORT, timeout=HUNG_S)
        expect(code == BAD_DATA and has_line(err, "error|in lock|95 %"), f"{code}\n{out}{err}")
        wait_until(lambda: len(twins(live)) == 1, "no shadow is left", live.log)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_flips(live.database, 1)


def test_worse_and_in_lock():
    """A very wide tolerance hides the error of the new twin from the lock, but not from the
    comparison.

    The option --accept-worse overrides that.
    """
    def wide(document):
        horizon(2)(document)
        tolerance(1000)(document)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(20.0) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        candidate = live.edited(wide)
        code, out, err = live.reload(candidate, *SHORT, timeout=HUNG_S)
        expect(code == BAD_DATA and has_line(err, "motor.omega|rad/s|tolerance|1|--accept-worse"), f"{code}\n{out}{err}")
        expect(live.active() == 1, f"{live.versions()}")
        code, out, err = live.reload(candidate, "--accept-worse", *SHORT, timeout=HUNG_S)
        expect(code == 0 and has_line(out, "compare|motor.omega|rad/s|tolerance|1"), f"{code}\n{out}{err}")
        expect(live.active() == 2, f"{live.versions()}")
        end_orderly(live)


def test_an_fmu_that_was_replaced():
    """The same configuration with another FMU file is not the active version."""
    with Device(OMEGA) as device, Retuned(device.port, config=own_fmu(device.port)) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.file)
        expect(code == 0 and has_line(out, "active"), f"{code}\n{out}{err}")
        with zipfile.ZipFile(live.file.parent / "motor.fmu", "a") as fmu:
            fmu.comment = b"another build"
        code, out, err = live.reload(live.file, "--wait", *SHORT, timeout=HUNG_S)
        expect(code == 0 and has_line(out, "version 2|kept"), f"{code}\n{out}{err}{live.log()}")
        expect_line(out, "FMU|new twin")
        code, out, err = live.reload(live.file)
        expect(code == 0 and has_line(out, "active"), f"{code}\n{out}{err}")
        end_orderly(live)
        expect(len(set(query(live.database, "SELECT fmus FROM beginnings"))) == 2, "the same FMU files")


def test_a_shadow_that_dies():
    """The change is rejected with the reason, and the run continues."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        killed = threading.Thread(target=lambda: os.kill(shadow(live), signal.SIGKILL))
        killed.start()
        code, out, err = live.reload(live.edited(horizon(2)), "--shadow", "20", timeout=HUNG_S)
        killed.join()
        expect(code == BAD_DATA and has_line(err, "error|signal 9"), f"{code}\n{out}{err}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_flips(live.database, 1)


def test_a_twin_that_dies_on_probation():
    """The change is rolled back: the old twin, which was running as a shadow, takes over at
    once."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        before = live.child()
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        os.kill(next(pid for pid in twins(live) if pid != before), signal.SIGKILL)
        wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.5)
        wait_until(lambda: twins(live) == [before], "the first twin alone", live.log)
        live.wait_for_tick(live.database)
        end_orderly(live)
        found = read(live.database)
        expect(not found.doubled, f"{found.doubled[:5]}")
        expect(has_line(live.version_on_disk(2)["reason"], "failed"), f"{live.version_on_disk(2)}")


def fails_beside(fmu, **more):
    """Adds an FMU without connections."""
    def change(document):
        document["components"]["extra"] = {"fmu": str(fmu), "set": {"u": 1.0}, **more}
    return change


def fail_on_probation(live, candidate, fail):
    """`fail` lets the new twin fail after its handover. The old twin must take over again. Returns
    the reason."""
    before = live.child()
    code, out, err = live.reload(live.edited(candidate), *LONG, timeout=HUNG_S)
    expect(code == 0, f"{code}\n{out}{err}{live.log()}")
    wait_until(lambda: committed_steps(live.database, 2) > 20, "run 2", live.log)
    fail()
    wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.1)
    live.wait_for("version 1|signal|fmi2DoStep|extra")
    wait_until(lambda: twins(live) == [before], "the first twin alone", live.log)
    live.wait_for_tick(live.database)
    end_orderly(live)
    return live.version_on_disk(2)["reason"]


def test_an_fmu_that_crashes_on_probation():
    """The FMU crashes once. The reason names it, and the function.

    The next twin catches up until the old one takes over, so no tick and no step is missing.
    """
    os.environ["TWINLOCK_UNRULY"] = WORD
    with Device(OMEGA) as device, moving(device), Retuned(device.port) as live:
        del os.environ["TWINLOCK_UNRULY"]
        wait_for_run(live, live.database, 1)
        reason = fail_on_probation(live, fails_beside(BUILD / "tests" / "unruly.fmu"), lambda: live.tell("crash"))
        expect(has_line(reason, "signal 11|Segmentation fault|fmi2DoStep|extra"), reason)
        expect_whole(read(live.database))


def test_an_fmu_that_crashes_again_on_probation():
    """The FMU of the next twins crashes, too. Only the ticks from the crash to the handover are
    missing."""
    switch = scratch() / "switch"
    for folder in switch.parents[:2]:
        folder.chmod(0o755)  # FMUs may run as another user
    fmu = make("end", AT="fmi2DoStep", HOW=f'calls = 0; if (access("{switch}", F_OK) == 0) {{ abort(); }};')
    with Device(OMEGA) as device, moving(device), Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        reason = fail_on_probation(live, fails_beside(fmu), lambda: switch.write_text("crash", encoding="utf-8"))
        expect(has_line(reason, "signal 6|Aborted|fmi2DoStep|extra"), reason)
        found = read(live.database)
        expect(not found.doubled, f"{found.doubled[:5]}")
        missing = sorted(set(range(max(found.ticks) + 1)) - set(found.ticks))
        at_most(len(missing), 300, "missing ticks of 10 ms")


def test_the_first_twin_dies_on_probation():
    """Without the first twin, a rollback needs a restart, and the output says so."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child()
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: len(twins(live)) == 1, "the new twin alone", live.log)
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and has_line(out, "activate|restart"), f"{code}\n{out}{err}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_limits_and_look_ups():
    """Other limits and look-ups of signals need a new twin, but no new io process. The rollback has
    no gap."""
    def change(document):
        document["plant"]["omega"].update(stale_s=0.5, max=400)
        match(document).update(condition={"outliers": "keep"})

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child(role="io")
        code, out, err = live.reload(live.edited(change), *LONG, timeout=HUNG_S)
        expect(code == 0 and has_line(out, "plant.omega.max|500|400|new twin"), f"{code}\n{out}{err}{live.log()}")
        expect(live.child(role="io") == before and len(twins(live)) == 2, f"{[title(pid) for pid in children(live.pid)]}")
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and has_line(out, "version 1") and not has_line(out, "restart"), f"{code}\n{out}{err}{live.log()}")
        expect(live.child(role="io") == before, "another io process")
        end_orderly(live)
        expect_flips(live.database, 1, 1, 1)
        signals = query(live.database, "SELECT run, count(*) FROM signals WHERE kind = 'plant' GROUP BY run ORDER BY run")
        expect([count for _, count in signals] == [3, 2, 3], f"{signals}")


def test_in_place_after_a_flip():
    """The new run supports changes in place."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        longer = live.edited(horizon(2))
        code, out, err = live.reload(longer, "--wait", *SHORT, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")

        def both(document):
            horizon(2)(document)
            tolerance(0.5)(document)
        code, out, err = live.reload(live.edited(both), "--wait", "--probation", "2")
        expect(code == 0 and has_line(out, "synchronise.match.motor.omega.tolerance|0.5|in place"), f"{code}\n{out}{err}{live.log()}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_flips(live.database, 1, 2)
        expect(query(live.database, "SELECT run FROM tunings") == [(2,)], "the tuning is not of run 2")
        expect_repeated(longer, live.database, 2, 2)


def test_every_mode_of_measurements():
    """Changes between all modes of horizon.measurements."""
    def mode(name):
        return lambda document: document["synchronise"]["horizon"].update(measurements=name)

    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        for name in "hold", "ahead", "lag", "ahead", "hold", "lag":
            code, out, err = live.reload(live.edited(mode(name)), "--wait", "--shadow", "1", "--probation", "1", timeout=HUNG_S)
            expect(code == 0, f"{name}: {code}\n{out}{err}{live.log()}")
            live.wait_for_tick(live.database)
        end_orderly(live)
        expect(number(live.database, "SELECT count(*) FROM runs") == 7, "runs")
        expect_whole_ticks(live.database)


def expect_whole_ticks(database):
    """Checks that each tick is recorded once, if the steps of a run may have other ticks than its
    samples."""
    found = read(database)
    firsts = {row[2] for row in query(database, RUNS)}  # in mode ahead the run before may have used that sample
    twice = [text for text in found.doubled if text.startswith("tick") and int(text.split()[1].rstrip(",")) not in firsts]
    expect(not twice, f"{twice[:10]}")
    missing = sorted(set(range(max(found.ticks) + 1)) - set(found.ticks))
    expect(not missing, f"{len(missing)} ticks are missing: {missing[:10]}")


def test_deaths_at_any_moment():
    """Kills processes at random times while configurations change. Each tick must be recorded
    once."""
    order = random.Random(20261123)
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        stop = threading.Event()

        def kill():
            while not stop.wait(order.uniform(1, 4)):
                role = order.choice(("io", "recorder", "config manager", "twin, shadow"))
                for pid in children(live.pid):
                    if title(pid).startswith(f"twinlock: {role}"):
                        with contextlib.suppress(ProcessLookupError):
                            os.kill(pid, signal.SIGKILL)
        killer = threading.Thread(target=kill)
        killer.start()
        for prediction in 2, 3, 1, 2, 3, 1:
            live.reload(live.edited(horizon(prediction)), "--wait", "--shadow", "1", "--probation", "2", timeout=HUNG_S)
        stop.set()
        killer.join()
        live.wait_for_tick(live.database)
        code, out, _ = live.reload(None, "--state")
        expect(code == 0, out)
        end_orderly(live)
        found = read(live.database)
        expect(not found.doubled, f"{found.doubled[:10]}")
        at_most(len(set(range(max(found.ticks) + 1)) - set(found.ticks)), 0, f"ticks that are missing\n{live.log()}")


if __name__ == "__main__":
    main()
