#!/usr/bin/env python3
"""`twinlock reload`: changes of the configuration during a run, in place and by a restart, and
their rollback.

A change must survive the death of processes.
"""
import os
import pty
import re
import shutil
import signal
import socket
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

from live_test import (Device, Program, children, count_lines, expect_reasons, member, number, query, title,
                       wait_until)
from retuned import Retuned, events, match, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import (HUNG_S, BAD_DATA, BAD_USAGE, FMUS, FORBIDDEN, NOT_LOCKED, PLANT_DOWN, at_most, expect, expect_line, expect_no_line,
                           has_line, main, run)

PROBATION = "--probation", "2"


def horizon(document):
    """Changes the horizon, which needs a new twin, and the name, which needs a new run."""
    document["synchronise"]["horizon"]["prediction"] = 3
    document["name"] = "another bench"


def expect_one_run(live):
    """Checks that there is one run, with each tick once."""
    expect(number(live.database, "SELECT count(*) FROM runs") == 1, "there is another run")
    expect_whole(read(live.database))


def test_in_place():
    """Another tolerance: the twin stays the same, no tick is skipped, and the change is
    recorded."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--why", "too wide", "--wait", *PROBATION)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        expect_line(out.replace("1.0", "1"), "synchronise.match.motor.omega.tolerance|1|0.5|in place")
        expect(live.child() == twin, "the twin was restarted")
        versions = live.versions()
        expect(versions[2][0] and versions[2][1].startswith("kept") and "too wide" in versions[2][1], f"{versions}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_one_run(live)
        rows = query(live.database, "SELECT tick, who, why FROM tunings")
        expect(len(rows) == 1 and rows[0][2] == "too wide", f"{rows}")
        texts = query(live.database, "SELECT count(*) FROM tunings JOIN configurations ON configuration = hash")
        expect(texts[0][0] == 1, "the database has no text of the configuration")


def test_invalid_configurations():
    """An invalid configuration: all its problems are reported, and the active version runs
    undisturbed."""
    bad = {
        "no JSON": b"{\"name\": ",
        "a NUL": b"{}\0{}",
        "nothing": b"",
        "too long": b" " * (256 * 1024 + 1),
        "two problems": lambda document: (match(document).update(tolerance=-1), document.update(step_s=0)),
        "an unknown key": lambda document: match(document).update(tolerence=1),
        "no such variable": lambda document: document["synchronise"]["adjust"].update({"motor.q": {"step": 1}}),
    }
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        for name, change in bad.items():
            code, out, err = live.reload(live.edited(change), "--restart")
            expect(code == BAD_DATA, f"{name}: {code}\n{out}{err}")
            print(f"    {name}: {err.splitlines()[-1] if err else out}")
        code, _, err = live.reload(live.edited(bad["two problems"]))
        expect_line(err, "line|synchronise.match.motor.omega.tolerance|-1")
        expect_line(err, "line|step_s|0")
        code, _, err = live.reload(live.edited(horizon))
        expect(code == BAD_USAGE and has_line(err, "name|--restart"), f"{code} {err}")
        expect(live.active() == 1 and live.child() == twin, f"{live.versions()}")
        end_orderly(live)
        expect_one_run(live)


def send(live, data, *options, **changes):
    """`twinlock reload -` with these bytes: (exit code, standard output, standard error)"""
    with tempfile.TemporaryFile() as file:
        file.write(data)
        file.seek(0)
        return run(["reload", "-", "--control", live.socket, *options], **{"stdin": file, **changes})


def test_standard_input():
    """Standard input counts as a file, with relative names. The client itself rejects what cannot
    be a configuration."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = send(live, live.edited(tolerance(0.5)).read_bytes())
        expect(code == 0 and has_line(out, "version 2"), f"{code}\n{out}{err}")
        code, out, err = send(live, live.edited(lambda document: document.update(step_s=0)).read_bytes())
        expect(code == BAD_DATA and has_line(err, "standard input|line|step_s|0"), f"{code}\n{out}{err}")
        shutil.copy(FMUS / "motor.fmu", live.file.parent / "beside.fmu")
        beside = live.edited(lambda document: document["components"]["motor"].update(fmu="beside.fmu")).read_bytes()
        code, out, err = send(live, beside, "--no-activate", "--restart", "--shadow", "1", cwd="/")
        expect(code == 0 and has_line(out, "activated"), f"{code}\n{out}{err}")
        for data, wanted in (b"", "empty"), (b" " * (256 * 1024 + 1), "large"):
            code, out, err = send(live, data)
            expect(code == BAD_DATA and has_line(err, f"standard input|{wanted}|262144 bytes"), f"{code}\n{out}{err}")
        terminal, other = pty.openpty()
        code, out, err = send(live, b"", stdin=other)
        expect(code == BAD_USAGE and has_line(err, "standard input|terminal"), f"{code}\n{out}{err}")
        os.close(terminal)
        os.close(other)
        code, out, err = run(["reload", "-"])
        expect(code == BAD_USAGE and has_line(err, "--control SOCKET"), f"{code}\n{out}{err}")
        code, out, _ = send(live, b"", "--state")
        expect(code == 0 and has_line(out, "configuration|version 2") and live.active() == 2, out)
        end_orderly(live)


def test_limited_rights():
    """--right limits the caller to the permissions of a token of that role. A later option cannot
    raise it."""
    def unconfined(document):
        document["components"]["motor"]["unconfined"] = True

    def library(document):
        document["components"]["motor"]["libraries"] = ["libm.so.6"]

    def host(document):
        document["sources"]["inverter"]["modbus_tcp"]["host"] = "localhost"

    def forbidden(change, *options):
        code, out, err = live.reload(live.edited(change), "--no-activate", "--restart", *options)
        expect(code == FORBIDDEN and live.active() == 1, f"{options}: {code}\n{out}{err}")
        return err

    def allowed(change, *options):
        code, out, err = live.reload(live.edited(change), "--no-activate", "--restart", "--shadow", "1", *options)
        expect(code == 0 and has_line(out, "activated"), f"{options}: {code}\n{out}{err}")

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for change in unconfined, library:
            for right in "retune", "commission":
                expect_line(forbidden(change, "--right", right), "error|twinlock reload|--right")
            allowed(change)
        for options in ("--right", "retune"), ("--right", "retune", "--right", "commission"), ("--right=commission", "--rig=retune"):
            expect_line(forbidden(host, *options), "error|commission")
        allowed(host, "--right", "commission")
        forbidden(tolerance(0.5), "--right", "read")
        expect(live.reload(None, "--right", "read", "--confirm")[0] == FORBIDDEN, "confirmed with --right read")
        expect(live.reload(None, "--right", "read", "--rollback")[0] == FORBIDDEN, "rolled back with --right read")
        expect(live.reload(None, "--right", "read", "--versions")[0] == 0, "no versions with --right read")
        code, _, err = live.reload(None, "--right", "box")
        expect(code == BAD_USAGE and has_line(err, "--right|box|read|retune|commission"), err)
        end_orderly(live)


def test_limit_counts_from_the_commissioned_version():
    """A limited change does not extend the limit of the next one: 1 → 2.5 → 6 is forbidden, as 1 →
    6 is."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(2.5)), "--right", "retune", "--wait", "--probation", "2", "--require-lock", "10")
        expect(code == 0 and has_line(out, "version 2|kept"), f"{code}\n{out}{err}")
        code, out, err = live.reload(live.edited(tolerance(6)), "--right", "retune")
        expect(code == FORBIDDEN and live.active() == 2, f"{code}\n{out}{err}")
        expect_line(err, "synchronise.match.motor.omega|6|3|commission")
        expect(live.version_on_disk(2)["origin"] == "limited", f"{live.version_on_disk(2)}")
        expect_line(live.reload(None, "--versions")[1], "limited|in place")
        code, out, err = live.reload(live.edited(tolerance(6)), "--no-activate")
        expect(code == 0, f"{code}\n{out}{err}")
        end_orderly(live)


def test_configuration_that_cannot_run():
    """A signal without a live source is valid in a replay only. A run with it could not start, so
    it is rejected before."""
    def without_source(document):
        del document["plant"]["torque"]["modbus"]

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(without_source), "--restart")
        expect(code == BAD_DATA and has_line(err, "plant.torque|modbus") and live.active() == 1, f"{code}\n{out}{err}")
        end_orderly(live)
        expect_one_run(live)


def test_a_version_that_cannot_begin():
    """The file was edited before the start, and cannot run: the same process rolls back to the
    version before."""
    def without_source(document):
        del document["plant"]["torque"]["modbus"]

    with Device(OMEGA) as device:
        with Retuned(device.port) as live:
            wait_for_run(live, live.database, 1)
            end_orderly(live)
        live.file.write_bytes(live.edited(without_source).read_bytes())
        with Retuned(device.port, config=live.file, state=live.state) as again:
            wait_for_run(again, live.database, 2)
            versions = again.versions()
            expect(versions[1][0] and versions[2][1].startswith("returned"), f"{versions}\n{again.log()}")
            expect(not [pid for pid in children(again.pid) if title(pid) == ""], "dead processes")
            end_orderly(again)


def test_only_checked():
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for change in tolerance(0.5), horizon:
            code, out, err = live.reload(live.edited(change), "--no-activate")
            expect(code == 0 and has_line(out, "activated"), f"{code}\n{out}{err}")
        expect(live.active() == 1, f"{live.versions()}")
        code, out, _ = live.reload(None)
        expect(code == 0 and has_line(out, "active"), out)
        end_orderly(live)


def test_by_restart():
    """Another name and horizon: a new run starts with it, and is kept. --wait shows each phase,
    across the restart."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(horizon), "--restart", "--wait", "--why", "a longer look", *PROBATION)
        expect(code == 0 and has_line(out, "version 2|kept") and has_line(out, "kept|in lock|%"), f"{code}\n{out}{err}{live.log()}")
        expect(live.versions()[2][1].startswith("kept"), f"{live.versions()}")
        end_orderly(live)
    found = [prediction for prediction, in query(live.database, "SELECT prediction FROM runs ORDER BY run")]
    expect(found == [1, 3], f"predictions {found}")
    expect_reasons(live.database, "another configuration", "SIGTERM")
    expect(events(live.database, "version 2%hand%a longer look") == 1, "no event with origin and reason of version 2")


def port(number_):
    return lambda document: document["sources"]["inverter"]["modbus_tcp"].update(port=number_)


def told_gaps(database, run_number):
    """The times without a twin in s that the run reports, as "… 1.23 s (123 ticks)"."""
    told = [text for text, in query(database, "SELECT text FROM events WHERE source = 'resume' AND run = ?", run_number)]
    return [float(found[1]) for found in (re.search(r"([0-9.]+) s \(\d+ ticks", text) for text in told) if found]


def gap(database, run_number):
    """Seconds from the last step of the run before to the first tick of this one."""
    (start,), = query(database, "SELECT start_ns FROM beginnings WHERE beginnings.run = ?", run_number)
    (end,), = query(database, "SELECT start_ns + step_ns * (SELECT max(step) + lead FROM steps s WHERE s.run = r.run) FROM runs r JOIN beginnings USING (run)"
                    " WHERE run = ?", run_number - 1)
    return (start - end) / 1e9


def expect_each_run_whole(database):
    for (run_number,) in query(database, "SELECT DISTINCT runs.run FROM runs"):
        ticks = [tick for (tick,) in query(database, "SELECT DISTINCT tick FROM samples own WHERE own.run = ? ORDER BY tick", run_number)]
        expect(ticks and ticks == list(range(len(ticks))), f"run {run_number}: {len(ticks)} ticks up to {ticks and max(ticks)}")


def test_another_device():
    """Another device needs a restart. Each tick of both runs is recorded, and the time between them
    is reported."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        candidate = live.edited(port(other.port))
        code, out, err = live.reload(candidate)
        expect(code == BAD_USAGE and has_line(err, "sources.inverter.modbus_tcp.port|--restart"), f"{code}\n{out}{err}")
        expect(live.active() == 1 and not other.functions, f"{live.versions()}")
        code, out, err = live.reload(candidate, "--restart", "--wait", *PROBATION)
        expect(code == 0 and has_line(out, "version 2|kept"), f"{code}\n{out}{err}{live.log()}")
        expect_line(out, f"sources.inverter.modbus_tcp.port|{device.port}|{other.port}|restart")
        expect(other.functions, "no request to the other device")
        end_orderly(live)
        expect_each_run_whole(live.database)
        told = told_gaps(live.database, 2)
        expect(len(told) == 1 and 0 < told[0] <= gap(live.database, 2) + 0.02, f"{told}, and it was {gap(live.database, 2)}")
        expect_line(live.log(), f"resume|{told[0]:.2f} s|ticks")


def test_a_device_that_does_not_answer():
    """The change is rolled back by a restart. All three runs are recorded."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = free.getsockname()[1]
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(port(nobody)), "--restart", "--wait", "--probation", "5")
        expect(code == NOT_LOCKED and has_line(err, "error|in lock|0 %|95 %"), f"{code}\n{out}{err}{live.log()}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_each_run_whole(live.database)
        expect([len(told_gaps(live.database, run_number)) for run_number in (1, 2, 3)] == [0, 1, 1], live.log())


def test_rollback_by_restart():
    """A change that is not confirmed in time: --wait shows the rollback, although the restart
    closed its connection."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(horizon), "--restart", "--wait", "--until-confirmed", *PROBATION)
        expect(code == NOT_LOCKED and has_line(err, "error|confirmed"), f"{code}\n{out}{err}{live.log()}")
        expect_line(out, "returned|confirmed")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        expect(events(live.database, "runs: version 1 of ") == 2, "the version of the third start is not named")
        end_orderly(live)


def test_config_manager_killed_during_wait():
    """The config manager dies during a probation: a client with --wait continues with the next one."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        with Program("reload", live.edited(tolerance(0.5)), "--control", live.socket, "--wait", "--probation", "6") as waiting:
            wait_until(lambda: len(live.versions()) == 2 and "probation" in live.versions()[2][1], "its probation", live.log)
            os.kill(member(live, "config manager"), signal.SIGKILL)
            code, out, log = waiting.end()
            expect(code == 0 and has_line(out, "version 2|kept"), f"{code}\n{out}{log}")
            expect_line(out, "run|60 s")
        end_orderly(live)


def test_interrupted():
    """Ctrl-C ends the client, but not the change. The client says so, and how to cancel the
    change."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        with Program("reload", live.edited(tolerance(0.5)), "--control", live.socket, "--wait", "--probation", "600") as waiting:
            wait_until(lambda: live.active() == 2, "its probation", live.log)
            waiting.signal(signal.SIGINT)
            code, log = waiting.process.wait(timeout=HUNG_S), waiting.log()
            expect(code == -signal.SIGINT and has_line(log, "change|--state|--rollback"), f"{code}\n{log}")
        wait_until(lambda: has_line(live.reload(None, "--state")[1], "probation"), "its probation", live.log)
        end_orderly(live)


def test_rollback_in_place():
    """Bounds within which the twin cannot follow: the lock is lost, and the change is rolled back
    automatically."""
    def bound(document):
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(OMEGA) as device, Retuned(device.port) as live:
        live.wait_for("lock: locked")
        code, out, err = live.reload(live.edited(bound), "--probation", "20")
        expect(code == 0, f"{code}\n{out}{err}")
        device.omega = 20.0
        wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.5)
        result = live.versions()[2][1]
        expect(result.startswith("returned: ") and "lost" in result, result)
        live.wait_for_tick(live.database)
        expect(events(live.database, "rolled back") == 1, "not one event of the rollback")
        end_orderly(live)
        expect_one_run(live)


def test_a_damaged_text():
    """A worn-out card has damaged the texts of the active version and the one before. They are
    restored from memory."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for value in 0.5, 0.6:
            for text in (live.state / "versions").glob("*.json"):
                if len(text.stem) == 64:
                    text.write_bytes(b"{}")
            code, out, err = live.reload(live.edited(tolerance(value)))
            expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: events(live.database, "damaged") == 3, "one event for each text", live.log)
        end_orderly(live)


def test_until_confirmed():
    """Without a confirmation the change is rolled back, with one it is kept. Rollback by hand
    works, too."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        narrower = live.edited(tolerance(0.8))
        code, out, err = live.reload(narrower, "--until-confirmed", "--wait", *PROBATION)
        expect(code == NOT_LOCKED and live.active() == 1, f"{code}\n{out}{err}{live.versions()}")
        code, out, err = live.reload(narrower, "--until-confirmed", "--probation", "600")
        expect(code == 0, f"{code}\n{out}{err}")
        code, _, err = live.reload(None, "--confirm")
        expect(code == 0 and live.active() == 3, f"{code}\n{err}{live.versions()}")
        code, _, err = live.reload(None, "--confirm")
        expect(code == PLANT_DOWN and has_line(err, "error|probation"), f"{code} {err}")
        code, _, err = live.reload(None, "--rollback", "--wait", *PROBATION)
        expect(code == 0, f"{code} {err}")
        text = live.file.read_bytes()
        expect(query(live.database, "SELECT count(*) FROM tunings")[0][0] == 4, "tunings")
        end_orderly(live)
        last = query(live.database, "SELECT text FROM tunings JOIN configurations ON configuration = hash ORDER BY tick")[-1]
        expect(last[0].encode() == text, "the first version is not active")
        expect_one_run(live)


def test_wait_shows_the_result():
    """A client with --wait is not affected by a candidate that is only checked, but by one that
    replaces its version."""
    with Device(OMEGA) as device, Retuned(device.port) as live, ThreadPoolExecutor() as pool:
        wait_for_run(live, live.database, 1)
        first = pool.submit(live.reload, live.edited(tolerance(0.8)), "--wait", "--probation", "4")
        wait_until(lambda: live.active() == 2 and has_line(live.reload(None, "--state")[1], "probation"), "version 2", live.log)
        code, out, err = live.reload(live.edited(tolerance(0.7)), "--no-activate")
        expect(code == 0, f"{code}\n{out}{err}")
        code, out, err = first.result()
        expect(code == 0 and has_line(out, "in lock|%"), f"{code}\n{out}{err}")
        first = pool.submit(live.reload, live.edited(tolerance(0.6)), "--wait", "--probation", "60")
        wait_until(lambda: live.active() == 3 and has_line(live.reload(None, "--state")[1], "probation"), "version 3", live.log)
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--probation", "2", "--wait")
        expect(code == 0, f"{code}\n{out}{err}")
        code, out, err = first.result()
        expect(code == NOT_LOCKED and has_line(err, "error|version 4"), f"{code}\n{out}{err}")
        end_orderly(live)


def test_deaths_on_probation():
    """Activator, recorder, io and twin are killed during a probation. It continues, and the version
    stays active."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.8)), "--until-confirmed", "--probation", "600")
        expect(code == 0, f"{code}\n{out}{err}")
        for role in "config manager", "recorder", "io":
            live.kill_one(role)
            live.wait_for_tick(live.database)
        code, out, _ = live.reload(None, "--state")
        expect(code == 0 and has_line(out, "probation"), out)
        code, _, err = live.reload(None, "--confirm")
        expect(code == 0 and live.active() == 2, f"{code}\n{err}{live.versions()}")
        live.kill_one("twin")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_whole(read(live.database))
        expect(number(live.database, "SELECT count(*) FROM tunings") >= 1, "no tuning")


def test_a_client_after_many_kills():
    """The config manager is killed eight times within seconds. Each client still gets its answer
    soon."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.8)), "--until-confirmed", "--probation", "600")
        expect(code == 0, f"{code}\n{out}{err}")
        for _ in range(8):
            os.kill(member(live, "config manager"), signal.SIGKILL)
            asked = time.monotonic()
            code, out, err = live.reload(None, "--state")
            at_most(time.monotonic() - asked, 5, "seconds until the client has its answer (2 on an idle machine)")
            expect(code == 0 and has_line(out, "probation"), f"{code}\n{out}{err}")
        end_orderly(live)
        expect(1 <= count_lines(live.log(), "config manager|failed") <= 3, live.log())


def test_the_supervisor_is_killed():
    """The supervisor is killed during a probation. The next start continues it, with the remaining
    time."""
    with Device(OMEGA) as device:
        with Retuned(device.port) as live:
            wait_for_run(live, live.database, 1)
            code, out, err = live.reload(live.edited(tolerance(0.8)), "--until-confirmed", "--probation", "600")
            expect(code == 0, f"{code}\n{out}{err}")
            os.kill(live.pid, signal.SIGKILL)
            live.process.wait()
        with Retuned(device.port, config=live.file, state=live.state) as again:
            wait_until(lambda: again.socket.exists(), "its socket", again.log)
            code, out, _ = again.reload(None, "--state")
            expect(code == 0 and has_line(out, "probation") and has_line(out, "version 2"), out)
            expect_line(again.log(), "version 2|probation|s")
            code, _, err = again.reload(None, "--rollback")
            expect(code == 0, err)
            wait_until(lambda: again.active() == 1, "the first version", again.log)
            code, _, err = again.reload(None, "--rollback")
            expect(code == PLANT_DOWN and has_line(err, "error|version|first"), f"{code} {err}")
            end_orderly(again)


def test_an_edited_file_at_the_start():
    """An edited file is used, on probation. An invalid one is rejected, and the active version
    runs."""
    with Device(OMEGA) as device:
        with Retuned(device.port) as live:
            wait_for_run(live, live.database, 1)
            end_orderly(live)
        live.file.write_bytes(live.edited(tolerance(0.8)).read_bytes())
        with Retuned(device.port, config=live.file, state=live.state) as second:
            wait_for_run(second, live.database, 2)
            expect(second.active() == 2, f"{second.versions()}")
            expect_line(second.log(), f"configuration|runs: version 2 of {live.file}")
            expect_no_line(second.log(), "another one")
            code, _, err = second.reload(None, "--confirm")
            expect(code == 0, err)
            end_orderly(second)
        live.file.write_bytes(b"{")
        with Retuned(device.port, config=live.file, state=live.state) as third:
            wait_for_run(third, live.database, 3)
            expect(third.active() == 2, f"{third.versions()}\n{third.log()}")
            expect_line(third.log(), f"error|{live.file}|version 2")
            expect_line(third.log(), f"configuration|runs: version 2 of {live.file}|another one|version 3, refused")
            end_orderly(third)


def held(pid):
    """The targets of its descriptors. A descriptor may be closed meanwhile."""
    folder = f"/proc/{pid}/fd"
    return [os.readlink(f"{folder}/{name}") for name in os.listdir(folder) if os.path.islink(f"{folder}/{name}")]


def test_resources_of_the_config_manager():
    """The config manager has no socket but the control socket, no FMU and no database. It ends when it
    is idle."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        wait_until(lambda: not [pid for pid in children(live.pid) if "config manager" in title(pid)], "its end", live.log)
        live.reload(None, "--state")
        config_manager = live.child(role="config manager")
        maps = open(f"/proc/{config_manager}/maps", encoding="utf-8").read()
        wait_until(lambda: " ".join(held(config_manager)).count("socket:") == 1, "a closed connection", lambda: f"{held(config_manager)}")
        expect("motor.so" not in maps and not [name for name in held(config_manager) if "twin.db" in name], f"{held(config_manager)}")
        end_orderly(live)


if __name__ == "__main__":
    main()
