#!/usr/bin/env python3
"""The processes of a run (tests/support/tree.py): who holds what, and that each may die at any instant without harm to the others. Some kills here,
as many as you like by tests/hil/tree_kills."""
import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import time
import zipfile
from pathlib import Path

import kills
from footprint import shared_kib
from live_test import Device, Program, children, expect_reasons, member, number, query, stop, title, wait_until
from supervised import WORD, Supervised, end_orderly, wait_for_run
from tree import FOLLOWED, OMEGA, Campaign, Tree, configuration, descriptors, expect_whole, kill_at_random, one_run, read
from twinlock_test import BUILD, at_least, at_most, expect, main, run_well, scratch

SEED = 1
JOBS_KIB = 64


def remote_ports(pid):
    """Of TCP connections whose sockets this process holds."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]]
    held = {name[len("socket:["):-1] for name in descriptors(pid) if name.startswith("socket:[")}
    return {str(int(row[2].partition(":")[2], 16)) for row in rows if row[9] in held}


def gone(pids):
    return all(not Path(f"/proc/{pid}").exists() or title(pid) == "" for pid in pids)


def test_who_holds_what():
    """Nothing but what it needs: the twin no socket, no database; io no FMU and no database; the recorder no socket and no FMU; the supervisor nothing
    of all that."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            twin, io, recorder = (live.child(role=role) for role in ("twin", "io", "recorder"))
            expect(sorted(live.children()) == sorted((twin, io, recorder)), f"{[title(pid) for pid in live.children()]}")
            held = {name: " ".join(descriptors(pid)) for name, pid in
                    (("twin", twin), ("io", io), ("recorder", recorder), ("supervisor", live.pid))}
            maps = {name: Path(f"/proc/{pid}/maps").read_text(encoding="utf-8") for name, pid in
                    (("io", io), ("recorder", recorder), ("supervisor", live.pid))}
            end_orderly(live)
    expect("socket:" in held["io"], f"io: {held['io']}")
    for name in "twin", "recorder":
        expect("socket:" not in held[name], f"{name}: {held[name]}")
    expect("twin.db" in held["recorder"], f"the recorder: {held['recorder']}")
    for name in "twin", "io", "supervisor":
        expect("twin.db" not in held[name], f"{name}: {held[name]}")
    for name, mapped in maps.items():
        expect("motor.so" not in mapped and "twinlock-fmu" not in mapped, f"{name} has an FMU")


def test_each_kind_of_source_has_a_process():
    """Who reads a file has no socket to the device, and neither has the other's. If one of them dies both begin anew, and at the end none is left."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port, sources={"inverter": {"modbus_tcp": {"host": "localhost", "port": device.port}},
                                                               "load": {"csv": {"file": "load.csv", "time_column": "t"}}},
                                         plant={"torque": {"modbus": None, "csv": {"source": "load"}}})
        rows = "".join(f"{i / 100},0\n" for i in range(10_000))
        (config.parent / "load.csv").write_text(f"t,M_brake\n{rows}", encoding="utf-8")
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            first = live.child(role="io")
            second, = children(first)
            opened = {pid: descriptors(pid) for pid in (first, second)}
            readers = [pid for pid in opened if any("load.csv" in name for name in opened[pid])]
            expect(len(readers) == 1, f"{opened}")
            by_file, = readers
            by_tcp, = {first, second} - {by_file}
            expect(str(device.port) not in remote_ports(by_file) and str(device.port) in remote_ports(by_tcp),
                   f"{remote_ports(by_file)}, {remote_ports(by_tcp)}")
            os.kill(by_tcp, signal.SIGKILL)
            again = live.child(first, "io")
            wait_until(lambda: children(again), "its other process", live.log)
            live.wait_for_tick(database)
            pids = [again, *children(again)]
            end_orderly(live)
            expect(gone([first, second, *pids]), "a process is left")
    expect("was ended by signal 9" in live.log(), live.log())


def test_check_names_what_they_share():
    """After a cold start and a warm one: no more than that, but for the jobs, and rounding to pages; and no less than what is always in use."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            live.wait_for_tick(database)
            live.kill_one("twin")
            wait_for_run(live, database, 2)
            taken = sum(shared_kib(pid) for pid in (live.pid, *live.children()))
            end_orderly(live)
        named = {name: float(size) for name, size in
                 re.findall(r"^  (mail|outbox|checkpoint|past) +([0-9.]+) KiB ", run_well(["check", config]), re.M)}
    print(f"    {taken} KiB of {named}")
    expect(len(named) == 4, f"{named}")
    at_most(taken, named["mail"] + named["outbox"] + named["checkpoint"] + JOBS_KIB, "KiB shared")
    at_most(named["outbox"] + named["checkpoint"], taken + JOBS_KIB, "KiB named")


def test_nothing_is_left():
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            pids = live.children()
            end_orderly(live)
            expect(gone(pids), "a process is left")
            expect(not list(live.process.temporary.glob("twinlock-*")), f"{list(live.process.temporary.iterdir())}")


def test_the_supervisor_is_killed():
    """All are gone within a second, and who comes next goes on."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            pids, at = live.children(), time.monotonic()
            live.kill()
            wait_until(lambda: gone(pids), "the end of all")
            at_most(time.monotonic() - at, 1.0, "seconds until all were gone")
            state = live.state
        with Program("run", config, "--supervise", "--state", state) as again:
            wait_for_run(again, database, 2)
            expect(again.end(signal.SIGTERM)[0] == 0, "ended badly")
    expect(query(database, "SELECT resumed_run FROM beginnings WHERE run = 2") == [(1,)], "it began anew")


def killed(*roles, **changes):
    with Device(OMEGA) as device:
        campaign = one_run(device, roles, random.Random(SEED), Campaign(), **changes)
    expect(campaign.lost == 0, f"{campaign}")
    print(f"    {campaign}")


def test_the_recorder_is_killed():
    killed(*["recorder"] * 6)


def test_io_is_killed():
    killed(*["io"] * 3)


def test_a_restart_loop_writes_few_lines():
    """Of io, killed eight times: the supervisor's line once, the lines of the process itself twice, and in the end how often."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            for _ in range(8):
                live.kill_one("io")
                time.sleep(0.5)
            live.wait_for_tick(database)
            end_orderly(live)
            log = live.log()
    connected = log.count("connected")
    expect(connected in (1, 2), f"{connected} lines of io\n{log}")
    expect(log.count("the reading of the plant failed: ") == 1 and log.count("the reading of the plant failed 7 more times") == 1, log)


def test_the_twin_is_killed():
    killed(*["twin"] * 4)


def test_the_twin_is_killed_in_mode_ahead():
    """There a tick is over only when the next one has come."""
    killed(*["twin"] * 4, synchronise={"horizon": {"measurements": "ahead"}})


def test_the_twin_dies_in_its_step():
    """It has taken the sample, and there is no step: the next one takes that tick as its own. The recorder is killed with it every other time."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        for run in range(1, 5):
            unruly.wait_for_tick(run)
            unruly.tell("crash")
            if run % 2 == 0:
                os.kill(unruly.live.child(role="recorder"), signal.SIGKILL)
        unruly.wait_for_tick(5)
        end_orderly(unruly.live)
    found = read(unruly.database)
    expect_whole(found)
    expect(len(found.firsts) == 4, f"{found.firsts}")
    lead = number(unruly.database, "SELECT lead FROM runs WHERE run = 1")
    expect(sorted(found.ticks) == [*range(lead), *(step + lead for step in sorted(found.steps))], "half a tick")


def test_a_twin_that_has_destroyed_its_outbox():
    """Its heart beats, and nothing of it can be recorded any more: the recorder says so, and another one goes on with what is in the database."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        unruly.tell("scribble")
        live.wait_for("the twin failed: it has destroyed its own memory: what it hands to the recorder cannot be read on")
        unruly.wait_for_tick(2)
        unruly.tell("crash")  # it is a twin like any other
        unruly.wait_for_tick(3)
        end_orderly(live)
        expect(live.account()["restarts"] == 2, f"{live.account()}")
    expect(number(unruly.database, "SELECT count(*) FROM events WHERE text LIKE 'the queue of twin was corrupted by the process of the FMUs: it %'") == 1, "not said")
    expect_whole(read(unruly.database))


def test_twins_that_destroy_their_outbox_at_each_step():
    """The second one goes on, and hardly anything that it hands over can be read: what io reads is recorded all the same."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        first, child = kills.first_tick(unruly.database, 1), live.child()
        live.tell("scribbles", stays=True)
        live.wait_for("resume: goes on with")
        live.child(child)
        live.tell("scribbles", stays=True)
        time.sleep(5)
        last = time.time()
        end_orderly(live)
    ticks = [tick for tick, in query(unruly.database, "SELECT DISTINCT tick FROM samples ORDER BY tick")]
    expect(ticks == [*range(len(ticks))], f"samples are missing: {sorted(set(range(ticks[-1])) - set(ticks))[:10]}")
    at_least(len(ticks), (last - first) / 0.01 - 10, "samples")
    at_most(number(unruly.database, "SELECT count(*) FROM steps"), len(ticks) - 200, "steps that could be read")
    at_most(number(unruly.database, "SELECT sum(entries_lost) FROM runs"), 3 * len(ticks), "samples, steps and events lost")
    expect(number(unruly.database, "SELECT count(*) FROM events WHERE text LIKE 'the queue of twin was corrupted %'") <= 2, "said again and again")


def test_all_are_killed_at_random():
    with Device(OMEGA) as device:
        campaign = kill_at_random(device, 12, SEED)
    expect(campaign.lost == 0, f"{campaign}")
    print(f"    {campaign}")


def digest_of(document):
    """As `fmus` in the database."""
    files = [(BUILD / "fmus" / entry["fmu"]).read_bytes() for entry in document["components"].values()]
    return hashlib.sha256(b"".join(hashlib.sha256(file).hexdigest().encode() + b"\0" for file in files)).hexdigest()


def test_an_fmu_that_is_replaced():
    """A checkpoint is of no use to another FMU: the next twin begins anew, and says why. Its run is that of the other FMU, also for who goes on with
    it after another start, and whoever records."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        fmu = scratch() / "motor.fmu"
        shutil.copy(BUILD / "fmus" / "motor.fmu", fmu)
        document = json.loads(Path(config).read_text(encoding="utf-8"))
        document["components"]["motor"]["fmu"] = str(fmu)
        Path(config).write_text(json.dumps(document), encoding="utf-8")
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            first, other = digest_of(document), fmu.with_suffix(".new")
            shutil.copy(fmu, other)
            with zipfile.ZipFile(other, "a") as file:
                file.writestr("resources/another", "one")
            other.rename(fmu)
            live.kill_one("twin")
            live.wait_for("begins anew: the FMUs are not those of the run before")
            wait_for_run(live, database, 2)
            live.kill_one("twin")
            wait_for_run(live, database, 3)
            end_orderly(live)
        with Tree(config) as live:
            wait_for_run(live, database, 4)
            end_orderly(live)
    second = digest_of(document)
    rows = query(database, "SELECT fmus, resumed_run FROM beginnings ORDER BY run")
    expect(first != second and rows == [(first, None), (second, None), (second, 2), (second, 3)], f"{first}, {second}: {rows}")


def test_a_recorder_that_hangs():
    """Stopped for some seconds, as by a disk: the twin does not notice, and nothing is lost."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            live.wait_for_tick(database)
            recorder = live.child(role="recorder")
            os.kill(recorder, signal.SIGSTOP)
            time.sleep(4)
            os.kill(recorder, signal.SIGCONT)
            live.wait_for_tick(database)
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"{live.account()}")
    found = read(database)
    expect_whole(found)
    expect(number(database, "SELECT sum(entries_lost) FROM runs") == 0, "something was lost")


def test_io_that_hangs():
    """It is begun again after hang_s, so that the readings of no more than that, and of its start, are missing."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port, realtime={"hang_s": 1})
        with Tree(config) as live:
            live.wait_for_tick(database)
            io = live.child(role="io")
            stop(io)
            wait_until(lambda: live.child(io, "io") != io, "another io", live.log)
            live.wait_for_tick(database)
            end_orderly(live)
            silence = re.search(r'it hung: "\S+" gave no sign of life for ([0-9.]+) s', live.log())
    expect(silence, "io was not said to hang")
    at_most(float(silence[1]), 5, "seconds of silence")
    expect_whole(read(database))


def stop_one(live, role, other_than=0):
    """The process, once it has stopped."""
    pid = wait_until(lambda: [pid for pid in live.children() if pid != other_than and title(pid).startswith(f"twinlock: {role}")],
                     role, live.log, every=0.001)[0]
    stop(pid)
    return pid


def test_a_recorder_that_hangs_at_the_end():
    """Asked twice, nobody waits for it; and another one writes what it has left."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            live.wait_for_tick(database)
            stop_one(live, "recorder")
            time.sleep(1)
            live.signal(signal.SIGINT)
            time.sleep(1.5)
            at = time.monotonic()
            end_orderly(live, signal.SIGINT)
            at_most(time.monotonic() - at, 5, "seconds from the second signal to the end")
    found = read(database)
    expect_whole(found)
    at_least(len(found.steps), 100, "steps, also of the time in which it had stopped")
    expect_reasons(database, "SIGINT")
    told = query(database, "SELECT count(*) FROM events WHERE source = 'supervisor' AND text = 'the recorder failed when it was to end: "
                           "it was told to end, and was still there 2 s later; another one is begun'")
    expect(told == [(1,)], f"{query(database, 'SELECT text FROM events')}")


def test_recorders_that_hang_at_the_end():
    """What is lost then is said, and how much it is."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            live.wait_for_tick(database)
            first = stop_one(live, "recorder")
            time.sleep(1)
            live.signal(signal.SIGINT)
            time.sleep(1.5)
            live.signal(signal.SIGINT)
            stop_one(live, "recorder", first)
            code, _, log = live.end()
    lost = [int(count) for count in re.findall(r"error: (\d+) samples, steps and events are lost: no recorder is left to write what came last", log)]
    expect(code == 75 and len(lost) == 1, f"ended with {code}\n{log}")
    at_least(lost[0], 100, "samples, steps and events lost")
    expect_whole(read(database))


def test_told_to_end_before_the_recorder_has_answered():
    """What it was before is not known, and does not matter any more."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            recorder = stop_one(live, "recorder")
            live.child(role="twin")
            time.sleep(1)
            live.signal(signal.SIGTERM)
            time.sleep(0.5)
            os.kill(recorder, signal.SIGCONT)
            code, _, log = live.end()
    expect(code == 0 and "begins anew" not in log, f"ended with {code}\n{log}")
    expect_reasons(database, "SIGTERM")


def test_alone_the_run_ends_with_the_twin():
    """What was recorded until then is there, the run has an end, and an event says why."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Program("run", config) as live:
            wait_until(lambda: database.exists() and number(database, "SELECT count(*) FROM steps") > 20, "steps", live.log)
            twin = member(live, "twin")
            os.kill(twin, signal.SIGKILL)
            code, _, log = live.end()
        expect(code == 70 and "the twin failed: it was ended by signal 9" in log, f"ended with {code}\n{log}")
        expect_whole(read(database))
        expect_reasons(database, "not ended cleanly")
        told = query(database, "SELECT severity, source FROM v_events WHERE text = 'the twin failed: it was ended by signal 9, Killed'")
        expect(told == [("error", "supervisor")], f"{told}")
        with Program("run", config) as live:  # and who is started after it goes on with it
            wait_for_run(live, database, 2)
            expect(live.end(signal.SIGTERM)[0] == 0, "ended badly")
    expect(query(database, "SELECT resumed_run FROM beginnings WHERE run = 2") == [(1,)], "it began anew")


def test_alone_an_fmu_crashes():
    """The sample of the tick of the crash is recorded, without a step. The next run repeats that tick. While the process dies the recorder may
    write samples of further ticks."""
    with Device(OMEGA) as device:
        config = kills.configuration(device.port, kills.Pace())
        database = config.parent / "twin.db"
        os.environ["TWINLOCK_UNRULY"] = WORD
        with Program("run", config) as live:
            wait_until(lambda: database.exists() and number(database, "SELECT count(*) FROM steps") > 20, "steps", live.log)
            Supervised.tell(live, "crash")
            code, _, log = live.end()
        with Program("run", config) as again:
            wait_until(lambda: number(database, "SELECT count(*) FROM steps WHERE run = 2 AND outcome <> ?", FOLLOWED), "another run", again.log)
            again.end(signal.SIGTERM)
        del os.environ["TWINLOCK_UNRULY"]
    expect(code == 70 and "Segmentation fault, in fmi2DoStep of unruly" in log, f"ended with {code}\n{log}")
    lead, last, step = query(database, "SELECT lead, (SELECT max(tick) FROM samples s WHERE s.run = r.run), (SELECT max(step) FROM steps s "
                                       "WHERE s.run = r.run) FROM runs r WHERE run = 1")[0]
    crashed = step + lead + 1
    expect(last >= crashed, f"its last sample is that of tick {last}, its last step {step}, its lead {lead}")
    resumed = query(database, "SELECT resumed_run, resumed_tick FROM beginnings WHERE run = 2")
    expect(resumed == [(1, crashed)], f"{resumed}, not {crashed}, last sample {last}")


def hanging(device, *options):
    """A run of nobody's but its user's, whose FMU hangs from now on; and its database."""
    config = kills.configuration(device.port, kills.Pace())
    database = config.parent / "twin.db"
    os.environ["TWINLOCK_UNRULY"] = WORD
    live = Program("run", config, *options)
    del os.environ["TWINLOCK_UNRULY"]
    wait_until(lambda: database.exists() and number(database, "SELECT count(*) FROM steps") > 20, "steps", live.log)
    Supervised.tell(live, "hang")
    return live, database


HUNG = re.compile(r"the twin failed: it hung: \"cycle\" gave no sign of life for \d+\.\d s, in fmi2DoStep of unruly")


def expect_given_up(live, database):
    """Its FMU is named, on the log and by an event, and all steps until then are kept."""
    code, _, log = live.end()
    expect(code == 70 and HUNG.search(log), f"ended with {code}\n{log}")
    told = query(database, "SELECT text FROM v_events WHERE severity = 'error' AND source = 'supervisor'")
    expect(len(told) == 1 and HUNG.fullmatch(told[0][0]), f"{told}")
    expect(number(database, "SELECT max(step) FROM steps") > 20, "steps are lost")
    expect_whole(read(database))


def test_alone_an_fmu_hangs():
    """For ten times the limit of a call: that is the end."""
    with Device(OMEGA) as device:
        live, database = hanging(device, "--call-limit", "0.1")
        with live:
            expect_given_up(live, database)


def test_alone_somebody_holds_the_twin():
    """A debugger, or whoever stops it, for longer than that: it lives, until it is let go."""
    with Device(OMEGA) as device:
        live, database = hanging(device, "--call-limit", "0.1")
        with live:
            twin = member(live, "twin")
            os.kill(twin, signal.SIGSTOP)
            time.sleep(4)
            expect(title(twin).startswith("twinlock: twin"), f"it was killed\n{live.log()}")
            os.kill(twin, signal.SIGCONT)
            expect_given_up(live, database)


parser = argparse.ArgumentParser()
parser.add_argument("words", nargs="*")
parser.add_argument("--by-hand", action="store_true")
parser.add_argument("--kills", type=int, default=500)
parser.add_argument("--seed", type=int, default=SEED)
options = parser.parse_args()
if options.by_hand:
    with Device(OMEGA) as plant:
        print(kill_at_random(plant, options.kills, options.seed))
else:
    main()
