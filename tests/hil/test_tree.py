#!/usr/bin/env python3
"""The processes of a run (tests/support/tree.py): their resources, and kills of each of them at any
time.

Some kills here, more of them by tests/hil/tree_kills.
"""
import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import sys
import time
import zipfile
from pathlib import Path

import kills
from footprint import shared_kib
from live_test import (Device, Program, children, committed_steps, count_lines, expect_reasons, member, number, query, stop, title,
                       wait_until)
from supervised import WORD, Supervised, end_orderly, wait_for_run
from tree import FOLLOWED, OMEGA, Campaign, Tree, configuration, descriptors, expect_whole, kill_at_random, one_run, read
from twinlock_test import BUILD, at_least, at_most, expect, expect_line, expect_no_line, has_line, main, run_well, scratch

SEED = 1
JOBS_KIB = 160


def remote_ports(pid):
    """The remote ports of the TCP sockets of a process."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]]
    held = {name[len("socket:["):-1] for name in descriptors(pid) if name.startswith("socket:[")}
    return {str(int(row[2].partition(":")[2], 16)) for row in rows if row[9] in held}


def gone(pids):
    return all(not Path(f"/proc/{pid}").exists() or title(pid) == "" for pid in pids)


def test_resources_of_each_process():
    """Each process has only what it needs: the twin FMUs, io the socket, the recorder the database,
    the supervisor none."""
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


def idle_limit():
    """The present limit of the processor's idle states, µs; None if it cannot be read."""
    try:
        with open("/dev/cpu_dma_latency", "rb") as file:
            return int.from_bytes(file.read(4), sys.byteorder, signed=True)
    except OSError:
        return None


def test_a_run_limits_idle_states():
    """Only with a real-time priority. Other runs may limit them at the same time."""
    if idle_limit() is None:
        return
    held, texts = {}, {}
    for priority in 50, 0:
        with Device(OMEGA) as device:
            config, database = configuration(device.port, realtime={"priority": priority})
            with Tree(config) as live:
                wait_for_run(live, database, 1)
                held[priority] = "/dev/cpu_dma_latency" in descriptors(live.pid), idle_limit() <= 10
                end_orderly(live)
        texts[priority] = "\n".join(text for text, in query(database, "select text from events"))
    expect(held[50] == (True, True) and not held[0][0], f"{held}")
    expect("limited to 10" in texts[50] and "idle" not in texts[0], f"{texts}")


def test_each_kind_of_source_has_a_process():
    """The process that reads a file has no socket, and the other one has no file. If one dies, both
    are restarted."""
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
    expect_line(live.log(), "error|signal 9")


def test_check_reports_shared_memory():
    """`check` reports the shared memory of a run, except that of jobs, after a cold and a warm
    start."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            live.wait_for_tick(database)
            live.kill_one("twin")
            wait_for_run(live, database, 2)
            taken = sum(shared_kib(pid) for pid in (live.pid, *live.children()))
            end_orderly(live)
        page = run_well(["check", config])
    sizes = [float(size) for size in re.findall(r"^  \S.*? +([0-9.]+) KiB.*`run`", page, re.M)]
    print(f"    {taken} KiB of {sizes}")
    expect(len(sizes) == 5, page)
    samples, queue, checkpoint, *_ = sizes  # the others are an earlier run, and a shadow
    at_most(taken, samples + queue + checkpoint + JOBS_KIB, "KiB shared")
    at_most(queue + checkpoint, taken + JOBS_KIB, "KiB reported by check")


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
    """All processes end within a second, and the next start resumes the run."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Tree(config) as live:
            wait_for_run(live, database, 1)
            pids, at = live.children(), time.monotonic()
            live.kill()
            wait_until(lambda: gone(pids), "their end")
            at_most(time.monotonic() - at, 1.0, "seconds until all were gone")
            state = live.state
        with Program("run", config, "--supervise", "--state", state) as again:
            wait_for_run(again, database, 2)
            expect(again.end(signal.SIGTERM)[0] == 0, "ended badly")
    expect(query(database, "SELECT resumed_run FROM beginnings WHERE beginnings.run = 2") == [(1,)], "run 2 has not resumed run 1")


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
    """io is killed eight times: one line of the supervisor, two of io itself, and one with the
    count at the end."""
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
    connected = count_lines(log, "inverter|connected")
    expect(connected in (1, 2), f"{connected} lines of io\n{log}")
    expect(count_lines(log, "error|failed|signal 9") == 2 and count_lines(log, "error|failed|7|signal 9") == 1, log)


def test_the_twin_is_killed():
    killed(*["twin"] * 4)


def test_the_twin_is_killed_in_mode_ahead():
    """In mode ahead a tick ends only when the next one has come."""
    killed(*["twin"] * 4, synchronise={"horizon": {"measurements": "ahead"}})


def test_the_twin_dies_in_its_step():
    """The twin dies after its sample, and before its step: the next twin computes that tick.

    Every other time the recorder is killed, too.
    """
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
    lead = number(unruly.database, "SELECT lead FROM runs WHERE runs.run = 1")
    expect(sorted(found.ticks) == [*range(lead), *(step + lead for step in sorted(found.steps))], "a tick without a step")


def corruptions(database):
    """The number of events of a corrupted record queue of the twin."""
    return sum(has_line(text, "queue|twin|corrupted") for text, in query(database, "SELECT text FROM events WHERE source = 'recorder'"))


def test_corrupted_record_queue():
    """An FMU overwrites the record queue. The recorder reports it, and a new twin resumes from the
    database."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        unruly.tell("scribble")
        live.wait_for("error|twin|failed|memory|recorder")
        unruly.wait_for_tick(2)
        unruly.tell("crash")  # the new twin handles other faults, too
        unruly.wait_for_tick(3)
        end_orderly(live)
        expect(live.account()["restarts"] == 2, f"{live.account()}")
    expect(corruptions(unruly.database) == 1, "not one event")
    expect_whole(read(unruly.database))


def test_record_queue_corrupted_in_each_step():
    """The second twin continues, and the recorder can read few of its steps. All samples of io are
    still recorded."""
    with Device(OMEGA) as device, kills.Unruly(device) as unruly:
        live = unruly.live
        unruly.wait_for_tick(1)
        first, child = kills.first_tick(unruly.database, 1), live.child()
        live.tell("scribbles", stays=True)
        live.wait_for("resume|run 1|tick")
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
    expect(1 <= corruptions(unruly.database) <= 2, "not one or two events")


def test_all_are_killed_at_random():
    with Device(OMEGA) as device:
        campaign = kill_at_random(device, 12, SEED)
    expect(campaign.lost == 0, f"{campaign}")
    print(f"    {campaign}")


def digest_of(document):
    """The value of `fmus` in the database."""
    files = [(BUILD / "fmus" / entry["fmu"]).read_bytes() for entry in document["components"].values()]
    return hashlib.sha256(b"".join(hashlib.sha256(file).hexdigest().encode() + b"\0" for file in files)).hexdigest()


def test_an_fmu_that_is_replaced():
    """The FMU file is replaced: the next twin cannot use the checkpoint, starts again, and reports
    why.

    Its run has the digest of the new FMU, and later runs resume it.
    """
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
            live.wait_for("notice|resume|FMU files")
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
    """The recorder stops for some seconds, as with a slow disk. The twin is not disturbed, and
    nothing is lost."""
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
    """io is restarted after hang_s. Only the readings of that time and of its start are missing."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port, realtime={"hang_s": 1})
        with Tree(config) as live:
            live.wait_for("lock: locked")
            io = live.child(role="io")
            stop(io)
            wait_until(lambda: live.child(io, "io") != io, "another io", live.log)
            live.wait_for_tick(database)
            end_orderly(live)
            silence = re.search(r'error: .*heartbeat.* "inverter" .*?\b([0-9.]+) s\b', live.log())
    expect(silence, f"no line of a hang of inverter\n{live.log()}")
    at_most(float(silence[1]), 5, "seconds of silence")
    expect_whole(read(database))


def stop_one(live, role, other_than=0):
    """Stops the process of that role, and returns its id."""
    pid = wait_until(lambda: [pid for pid in live.children() if pid != other_than and title(pid).startswith(f"twinlock: {role}")],
                     role, live.log, every=0.001)[0]
    stop(pid)
    return pid


def test_a_recorder_that_hangs_at_the_end():
    """After a second signal the supervisor kills the recorder, and a new one writes the remaining
    entries."""
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
    at_least(len(found.steps), 100, "steps, also of the time of the stop")
    expect_reasons(database, "SIGINT")
    told = [text for text, in query(database, "SELECT text FROM events WHERE source = 'supervisor'")]
    expect(sum(has_line(text, "recorder|failed|2 s") for text in told) == 1, f"{told}")


def test_recorders_that_hang_at_the_end():
    """Two recorders hang at the end: the log has the number of lost entries."""
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
    lost = [int(count) for count in re.findall(r"error: .*?\b(\d+) samples\b.*\blost\b.*\brecorder\b", log)]
    expect(code == 75 and len(lost) == 1, f"ended with {code}\n{log}")
    at_least(lost[0], 100, "samples, steps and events lost")
    expect_whole(read(database))


def test_end_before_the_recorder_answers():
    """The run ends before it knows whether there is an earlier run. That is not an error, and not
    logged."""
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
    expect(code == 0, f"ended with {code}\n{log}")
    expect_no_line(log, "resume")
    expect_reasons(database, "SIGTERM")


def test_alone_the_run_ends_with_the_twin():
    """All entries until then are recorded, the run has an end, and an event has the reason."""
    with Device(OMEGA) as device:
        config, database = configuration(device.port)
        with Program("run", config) as live:
            wait_until(lambda: committed_steps(database) > 20, "steps", live.log)
            twin = member(live, "twin")
            os.kill(twin, signal.SIGKILL)
            code, _, log = live.end()
        expect(code == 70, f"ended with {code}\n{log}")
        expect_line(log, "error|twin|failed|signal 9")
        expect_whole(read(database))
        expect_reasons(database, "cleanly")
        told = query(database, "SELECT severity, source, text FROM v_events")
        found = [event[:2] for event in told if has_line(event[2], "twin|failed|signal 9|Killed")]
        expect(found == [("error", "supervisor")], f"{told}")
        with Program("run", config) as live:  # resumes the run
            wait_for_run(live, database, 2)
            expect(live.end(signal.SIGTERM)[0] == 0, "ended badly")
    expect(query(database, "SELECT resumed_run FROM beginnings WHERE beginnings.run = 2") == [(1,)], "run 2 has not resumed run 1")


def test_alone_an_fmu_crashes():
    """The sample of the crash's tick is recorded, without a step. The next run computes that tick
    again.

    While the process dies, the recorder may write samples of further ticks.
    """
    with Device(OMEGA) as device:
        config = kills.configuration(device.port, kills.Pace())
        database = config.parent / "twin.db"
        os.environ["TWINLOCK_UNRULY"] = WORD
        with Program("run", config) as live:
            wait_until(lambda: committed_steps(database) > 20, "steps", live.log)
            Supervised.tell(live, "crash")
            code, _, log = live.end()
        with Program("run", config) as again:
            wait_until(lambda: number(database, "SELECT count(*) FROM steps WHERE outcome <> ? AND run = 2", FOLLOWED), "another run", again.log)
            again.end(signal.SIGTERM)
        del os.environ["TWINLOCK_UNRULY"]
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, "error|Segmentation fault|fmi2DoStep|unruly")
    lead, last, step = query(database, "SELECT lead, (SELECT max(tick) FROM samples s WHERE s.run = r.run), (SELECT max(step) FROM steps s "
                                       "WHERE s.run = r.run) FROM runs r WHERE run = 1")[0]
    crashed = step + lead + 1
    expect(last >= crashed, f"its last sample is that of tick {last}, its last step {step}, its lead {lead}")
    resumed = query(database, "SELECT resumed_run, resumed_tick FROM beginnings WHERE beginnings.run = 2")
    expect(resumed == [(1, crashed)], f"{resumed}, not {crashed}, last sample {last}")


def hanging(device, *options):
    """An unsupervised run whose FMU hangs from now on, and its database."""
    config = kills.configuration(device.port, kills.Pace())
    database = config.parent / "twin.db"
    os.environ["TWINLOCK_UNRULY"] = WORD
    live = Program("run", config, *options)
    del os.environ["TWINLOCK_UNRULY"]
    wait_until(lambda: committed_steps(database) > 20, "steps", live.log)
    Supervised.tell(live, "hang")
    return live, database


HUNG = "twin|failed|heartbeat|cycle|s|fmi2DoStep|unruly"  # parts of the message


def expect_given_up(live, database):
    """Checks that the log and one event name the FMU, and that all steps until then are
    recorded."""
    code, _, log = live.end()
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, f"error|{HUNG}")
    told = query(database, "SELECT text FROM v_events WHERE severity = 'error' AND source = 'supervisor'")
    expect(len(told) == 1 and has_line(told[0][0], HUNG), f"{told}")
    expect(number(database, "SELECT max(step) FROM steps") >= 20, "steps are lost")
    expect_whole(read(database))


def test_alone_an_fmu_hangs():
    """The FMU hangs for ten times --call-limit. Then the run ends."""
    with Device(OMEGA) as device:
        live, database = hanging(device, "--call-limit", "0.1")
        with live:
            expect_given_up(live, database)


def test_alone_the_twin_is_stopped():
    """A stopped twin, as by a debugger, is not killed until it continues."""
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
