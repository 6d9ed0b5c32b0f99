#!/usr/bin/env python3
"""A running plant gets another twin (`twinlock reload` with a longer horizon, another parameter): it runs as a shadow first, takes over between two ticks,
and gives back the same way. No tick is left out, none is there twice, and a replay repeats what was recorded."""
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
from live_test import Device, bits, children, number, query, title, wait_until
from retuned import Retuned, events, match, tolerance
from supervised import WORD, end_orderly, wait_for_run
from tree import OMEGA, configuration, expect_whole, read
from twinlock_test import HUNG_S, BAD_DATA, BUILD, FMUS, at_most, expect, main, run_well, scratch

SHORT = "--shadow", "2", "--probation", "3"
LONG = "--shadow", "2", "--probation", "600"
HANDED_OVER = "another configuration has taken over"
RUNS = "SELECT r.run, b.resumed_run, b.resumed_tick, b.resumed_from, r.prediction, r.ended_reason FROM runs r JOIN beginnings b USING (run) ORDER BY r.run"
STEPS = ("SELECT a.step, a.signal, a.applied, a.nominal, o.simulated, s.J, s.outcome, s.evaluations, s.flags FROM adjustments a JOIN outputs o USING (run, step) "
         "JOIN steps s USING (run, step) WHERE run = ? AND a.step >= ? ORDER BY a.step, a.signal")


def horizon(prediction):
    return lambda document: document["synchronise"]["horizon"].update(prediction=prediction)


def own_fmu(port):
    """The configuration, with a copy of its FMU beside it."""
    config, _ = configuration(port)
    document = json.loads(config.read_text(encoding="utf-8"))
    component = document["components"]["motor"]
    shutil.copy(FMUS / component["fmu"], config.parent / "motor.fmu")
    component["fmu"] = "motor.fmu"
    config.write_text(json.dumps(document), encoding="utf-8")
    return config


def twins(live):
    """Both of them, if there are two."""
    return [pid for pid in children(live.pid) if title(pid).startswith("twinlock: twin")]


def shadow(live):
    return wait_until(lambda: [pid for pid in children(live.pid) if title(pid).startswith("twinlock: twin, shadow")], "a shadow", live.log)[0]


def expect_flips(database, *runs):
    """Each run but the first goes on with the one before, at the tick after its last one, and the one before says so."""
    found = query(database, RUNS)
    expect([row[4] for row in found] == list(runs), f"{found}")
    for before, row in zip(found, found[1:]):
        last = number(database, f"SELECT max(tick) FROM samples WHERE run = {before[0]}")
        expect(row[1] == before[0] and row[2] == last + 1 and row[3] == "checkpoint", f"{row} after tick {last}")
        expect(before[5] == HANDED_OVER, f"{before}")
    expect_whole(read(database))


def expect_repeated(config, database, which, lead):
    """A replay of that run with its configuration: the same bits."""
    again = scratch() / f"again{which}.db"
    run_well(["replay", config, "--recording", f"{database}", "--run", str(which), "--db", again], timeout=HUNG_S)
    first = query(database, "SELECT coalesce(resumed_tick, 0) FROM beginnings WHERE run = ?", which)[0][0] - lead
    recorded = [bits(row) for row in query(database, STEPS, which, first)]
    replayed = [bits(row) for row in query(again, STEPS, 1, first)]
    expect(recorded and recorded == replayed[:len(recorded)],
           f"run {which}: {sum(a != b for a, b in zip(recorded, replayed))} of {len(recorded)} steps differ ({len(replayed)} replayed)")


def conditioned(document):
    """A signal that is looked up again, as it was read, beside what is made of it."""
    document["plant"]["omega"]["every_s"] = 0.04
    match(document).update(between="line", condition={"low_pass_s": 0.02})


def without_free_twin(document):
    document["synchronise"]["free_twin"] = False


def test_begun_with_further_look_ups():
    """Two runs with as many signals, of which the file names fewer."""
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
            wait_until(lambda: number(live.database, "SELECT count(*) FROM steps WHERE run = 2") > 50, "steps of the other twin", live.log)
            end_orderly(live)
            expect_flips(live.database, 1, 1)


def test_taken_over_and_kept():
    """Without a gap; the old twin is gone when the new one is kept; each run is repeated by its replay."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        before = live.child()
        candidate = live.edited(horizon(3))
        code, out, err = live.reload(candidate, "--wait", "--why", "a longer look", *SHORT, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        for step in "try", "predict", "shadow", "compare", "activate", "probation", "kept":
            expect(f"\n{step} " in out, f"no step \"{step}\":\n{out}")
        wait_until(lambda: len(twins(live)) == 1, "the old twin is gone", live.log)
        expect(twins(live) != [before], "the old twin runs")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect(events(live.database, "version 2 is of %, by hand: a longer look") == 1, "nobody knows who has brought it")
        expect_flips(live.database, 1, 3)
        expect_repeated(live.file, live.database, 1, 1)
        expect_repeated(candidate, live.database, 2, 3)


def test_there_and_back():
    """By hand, on probation: the old twin has gone on beside it, and is the run's again without a gap."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        before = live.child()
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0 and len(twins(live)) == 2, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: number(live.database, "SELECT count(*) FROM steps WHERE run = 2") > 100, "run 2", live.log)
        wait_until(lambda: shadow(live) == before, "who is the shadow says so", live.log)
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and "by a flip" in out, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: twins(live) == [before], "the first twin alone", live.log)
        wait_until(lambda: number(live.database, "SELECT count(*) FROM steps WHERE run = 3") > 100, "run 3", live.log)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_flips(live.database, 1, 2, 1)
        expect_repeated(live.file, live.database, 3, 1)


def test_returned_from_by_itself():
    """A new twin that is in lock while it is a shadow, and loses it later, since its bounds are too narrow."""
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
        wait_until(lambda: number(live.database, "SELECT count(*) FROM steps WHERE run = 3") > 100, "run 3", live.log)
        end_orderly(live)
        expect_flips(live.database, 1, 2, 1)


def test_refused_as_a_shadow():
    """One that cannot follow the plant is never the run's, and the run notices nothing."""
    def bound(document):
        horizon(2)(document)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(20.0) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(bound), *SHORT, timeout=HUNG_S)
        expect(code == BAD_DATA and "the new twin was in lock for " in err, f"{code}\n{out}{err}")
        wait_until(lambda: len(twins(live)) == 1, "no shadow is left", live.log)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_flips(live.database, 1)


def test_worse_and_in_lock():
    """A tolerance that no twin can miss, and one that is tens of rad/s off: its lock says nothing, its error does. A person may insist."""
    def wide(document):
        horizon(2)(document)
        tolerance(1000)(document)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(20.0) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        candidate = live.edited(wide)
        code, out, err = live.reload(candidate, *SHORT, timeout=HUNG_S)
        expect(code == BAD_DATA and "motor.omega is worse: off by" in err and "--accept-worse" in err, f"{code}\n{out}{err}")
        expect(live.active() == 1, f"{live.versions()}")
        code, out, err = live.reload(candidate, "--accept-worse", *SHORT, timeout=HUNG_S)
        expect(code == 0 and "taken all the same, as asked" in out, f"{code}\n{out}{err}")
        expect(live.active() == 2, f"{live.versions()}")
        end_orderly(live)


def test_an_fmu_that_was_replaced():
    """The same configuration, and another file under the name of its FMU: that is not what runs."""
    with Device(OMEGA) as device, Retuned(device.port, config=own_fmu(device.port)) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.file)
        expect(code == 0 and "that is what is active" in out, f"{code}\n{out}{err}")
        with zipfile.ZipFile(live.file.parent / "motor.fmu", "a") as fmu:
            fmu.comment = b"another build"
        code, out, err = live.reload(live.file, "--wait", *SHORT, timeout=HUNG_S)
        expect(code == 0 and "an FMU's file is another" in out and "version 2 is kept" in out, f"{code}\n{out}{err}{live.log()}")
        code, out, err = live.reload(live.file)
        expect(code == 0 and "that is what is active" in out, f"{code}\n{out}{err}")
        end_orderly(live)
        expect(len(set(query(live.database, "SELECT fmus FROM beginnings"))) == 2, "the same files")


def test_a_shadow_that_dies():
    """The upload is refused with the reason, and the run goes on."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        killed = threading.Thread(target=lambda: os.kill(shadow(live), signal.SIGKILL))
        killed.start()
        code, out, err = live.reload(live.edited(horizon(2)), "--shadow", "20", timeout=HUNG_S)
        killed.join()
        expect(code == BAD_DATA and "signal 9" in err, f"{code}\n{out}{err}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_flips(live.database, 1)


def test_a_twin_that_dies_on_probation():
    """It is returned from: the old twin, which has gone on beside it, is there at once."""
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
        expect("failed" in live.version_on_disk(2)["reason"], f"{live.version_on_disk(2)}")


def fails_beside(fmu, **more):
    """One FMU more, which nobody is connected with."""
    def change(document):
        document["components"]["extra"] = {"fmu": str(fmu), "set": {"u": 1.0}, **more}
    return change


def fail_on_probation(live, candidate, fail):
    """The new twin has taken over, and `fail` makes it fail: the old one is the run's again, and what is recorded is found to have no hole. Returns the reason."""
    before = live.child()
    code, out, err = live.reload(live.edited(candidate), *LONG, timeout=HUNG_S)
    expect(code == 0, f"{code}\n{out}{err}{live.log()}")
    wait_until(lambda: number(live.database, "SELECT count(*) FROM steps WHERE run = 2") > 20, "run 2", live.log)
    fail()
    wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.1)
    live.wait_for("is in force: returned, by a flip: the twin has failed: it ")
    wait_until(lambda: twins(live) == [before], "the first twin alone", live.log)
    live.wait_for_tick(live.database)
    end_orderly(live)
    return live.version_on_disk(2)["reason"]


def test_an_fmu_that_crashes_on_probation():
    """Once: the reason says which one, and where. The twin after it makes up for it until the old one takes over: no tick is missing, and no step."""
    os.environ["TWINLOCK_UNRULY"] = WORD
    with Device(OMEGA) as device, moving(device), Retuned(device.port) as live:
        del os.environ["TWINLOCK_UNRULY"]
        wait_for_run(live, live.database, 1)
        reason = fail_on_probation(live, fails_beside(BUILD / "tests" / "unruly.fmu"), lambda: live.tell("crash"))
        expect(reason == "the twin has failed: it was ended by signal 11, Segmentation fault, in fmi2DoStep of extra", reason)
        expect_whole(read(live.database))


def test_an_fmu_that_crashes_again_on_probation():
    """Each twin after it as well: nobody makes up for it, so what is missing are the ticks from the crash to the flip."""
    switch = scratch() / "switch"
    for folder in switch.parents[:2]:
        folder.chmod(0o755)  # FMUs may have a user of their own
    fmu = make("end", AT="fmi2DoStep", HOW=f'calls = 0; if (access("{switch}", F_OK) == 0) {{ abort(); }};')
    with Device(OMEGA) as device, moving(device), Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        reason = fail_on_probation(live, fails_beside(fmu), lambda: switch.write_text("crash", encoding="utf-8"))
        expect(reason == "the twin has failed: it was ended by signal 6, Aborted, in fmi2DoStep of extra", reason)
        found = read(live.database)
        expect(not found.doubled, f"{found.doubled[:5]}")
        missing = sorted(set(range(max(found.ticks) + 1)) - set(found.ticks))
        at_most(len(missing), 300, "ticks of 10 ms that nobody has computed")


def test_the_first_twin_dies_on_probation():
    """Then the way back is a restart, and is told so."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child()
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: len(twins(live)) == 1, "the new twin alone", live.log)
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and "by a restart" in out, f"{code}\n{out}{err}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_limits_and_look_ups():
    """Another twin judges and looks up the readings in another way. The plant is read on by the same process, and the way back has no gap."""
    def change(document):
        document["plant"]["omega"].update(stale_s=0.5, max=400)
        match(document).update(condition={"low_pass_s": 0.02})

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child(role="io")
        code, out, err = live.reload(live.edited(change), *LONG, timeout=HUNG_S)
        expect(code == 0 and "plant.omega.max: 500 → 400 (new twin" in out, f"{code}\n{out}{err}{live.log()}")
        expect(live.child(role="io") == before and len(twins(live)) == 2, f"{[title(pid) for pid in children(live.pid)]}")
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and "by a flip" in out, f"{code}\n{out}{err}{live.log()}")
        expect(live.child(role="io") == before, "the plant is read by another process")
        end_orderly(live)
        expect_flips(live.database, 1, 1, 1)
        signals = query(live.database, "SELECT run, count(*) FROM signals WHERE kind = 'plant' GROUP BY run ORDER BY run")
        expect([count for _, count in signals] == [2, 3, 2], f"{signals}")


def test_in_place_after_a_flip():
    """The new run takes tunings as the first one did."""
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        longer = live.edited(horizon(2))
        code, out, err = live.reload(longer, "--wait", *SHORT, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")

        def both(document):
            horizon(2)(document)
            tolerance(0.5)(document)
        code, out, err = live.reload(live.edited(both), "--wait", "--probation", "2")
        expect(code == 0 and "in place" in out, f"{code}\n{out}{err}{live.log()}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_flips(live.database, 1, 2)
        expect(query(live.database, "SELECT run FROM tunings") == [(2,)], "the tuning is not of run 2")
        expect_repeated(longer, live.database, 2, 2)


def test_every_mode_of_measurements():
    """There and back, from each to another."""
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
    """Of runs whose steps are of other ticks than their samples': each tick is there once among those of its own."""
    found = read(database)
    firsts = {row[2] for row in query(database, RUNS)}  # the run before may have compared its last step with that sample (mode ahead)
    twice = [text for text in found.doubled if text.startswith("tick") and int(text.split()[1].rstrip(",")) not in firsts]
    expect(not twice, f"{twice[:10]}")
    missing = sorted(set(range(max(found.ticks) + 1)) - set(found.ticks))
    expect(not missing, f"{len(missing)} ticks are missing: {missing[:10]}")


def test_deaths_at_any_moment():
    """While configurations come and go each process is killed now and then: ticks are there once, and the run is of what the disk says."""
    order = random.Random(20261123)
    with Device(OMEGA) as device, Retuned(device.port) as live, moving(device):
        wait_for_run(live, live.database, 1)
        stop = threading.Event()

        def kill():
            while not stop.wait(order.uniform(1, 4)):
                role = order.choice(("io", "recorder", "activator", "shadow"))
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
