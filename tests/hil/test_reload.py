#!/usr/bin/env python3
"""The configuration of a run is changed while it runs (`twinlock reload`): in place, by a restart, and back again; and nothing of it is lost when
processes die."""
import os
import pty
import re
import shutil
import signal
import socket
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

from live_test import Device, Program, children, member, number, query, title, wait_until
from retuned import Retuned, events, match, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import HUNG_S, BAD_DATA, BAD_USAGE, FMUS, FORBIDDEN, NOT_LOCKED, PLANT_DOWN, at_most, expect, main, run

PROBATION = "--probation", "2"


def horizon(document):
    """And another name, which only a new run can have."""
    document["synchronise"]["horizon"]["prediction"] = 3
    document["name"] = "another bench"


def expect_one_run(live):
    """Nobody was begun again, and every tick is there once."""
    expect(number(live.database, "SELECT count(*) FROM runs") == 1, "there is another run")
    expect_whole(read(live.database))


def test_in_place():
    """A wrong tolerance is corrected: the twin stays, no tick is made up for it, the way is written down."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--why", "too wide", "--wait", *PROBATION)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        expect("synchronise.match.motor.omega.tolerance: 1 → 0.5 (in place)" in out.replace("1.0", "1"), out)
        expect(live.child() == twin, "the twin was begun again")
        versions = live.versions()
        expect(versions[2][0] and versions[2][1].startswith("kept") and "too wide" in versions[2][1], f"{versions}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_one_run(live)
        rows = query(live.database, "SELECT tick, who, why FROM tunings")
        expect(len(rows) == 1 and rows[0][2] == "too wide", f"{rows}")
        texts = query(live.database, "SELECT count(*) FROM tunings JOIN configurations ON configuration = hash")
        expect(texts[0][0] == 1, "its text is not in the database")


def test_what_is_wrong_changes_nothing():
    """All problems at once; the version in force goes on without a trace in the cycle."""
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
        expect("synchronise.match.motor.omega.tolerance" in err and "step_s" in err and "line " in err, err)
        code, _, err = live.reload(live.edited(horizon))
        expect(code == BAD_USAGE and "--restart" in err, f"{code} {err}")
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
    """It is taken as a file is, relative names too; what cannot be a configuration is refused before the run is asked."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = send(live, live.edited(tolerance(0.5)).read_bytes())
        expect(code == 0 and "version 2 " in out, f"{code}\n{out}{err}")
        code, out, err = send(live, live.edited(lambda document: document.update(step_s=0)).read_bytes())
        expect(code == BAD_DATA and "standard input: line " in err and "step_s" in err, f"{code}\n{out}{err}")
        shutil.copy(FMUS / "motor.fmu", live.file.parent / "beside.fmu")
        beside = live.edited(lambda document: document["components"]["motor"].update(fmu="beside.fmu")).read_bytes()
        code, out, err = send(live, beside, "--no-activate", "--restart", "--shadow", "1", cwd="/")
        expect(code == 0 and "it can be activated" in out, f"{code}\n{out}{err}")
        for data, wanted in (b"", "is empty (expected a"), (b" " * (256 * 1024 + 1), "is too large (expected a"):
            code, out, err = send(live, data)
            expect(code == BAD_DATA and f"standard input: {wanted} configuration of 1 to 262144 bytes)" in err, f"{code}\n{out}{err}")
        terminal, other = pty.openpty()
        code, out, err = send(live, b"", stdin=other)
        expect(code == BAD_USAGE and "standard input: is a terminal" in err, f"{code}\n{out}{err}")
        os.close(terminal)
        os.close(other)
        code, out, err = run(["reload", "-"])
        expect(code == BAD_USAGE and "--control SOCKET" in err, f"{code}\n{out}{err}")
        code, out, _ = send(live, b"", "--state")
        expect(code == 0 and "version 2" in out and live.active() == 2, out)
        end_orderly(live)


def test_less_than_the_rights_of_the_box():
    """--right limits its caller to what a token of that role may; nothing that is added behind it raises that."""
    def unconfined(document):
        document["components"]["motor"]["unconfined"] = True

    def library(document):
        document["components"]["motor"]["libraries"] = ["libm.so.6"]

    def host(document):
        document["sources"]["inverter"]["modbus_tcp"]["host"] = "localhost"

    def forbidden(change, *options):
        code, out, err = live.reload(live.edited(change), "--no-activate", "--restart", *options)
        expect(code == FORBIDDEN and live.active() == 1, f"{options}: {code}\n{out}{err}")
        return out + err

    def allowed(change, *options):
        code, out, err = live.reload(live.edited(change), "--no-activate", "--restart", "--shadow", "1", *options)
        expect(code == 0 and "it can be activated" in out, f"{options}: {code}\n{out}{err}")

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for change in unconfined, library:
            for right in "retune", "commission":
                expect("by twinlock reload without --right" in forbidden(change, "--right", right), f"{change} {right}")
            allowed(change)
        for options in ("--right", "retune"), ("--right", "retune", "--right", "commission"), ("--right=commission", "--rig=retune"):
            expect("the right to commission" in forbidden(host, *options), f"{options}")
        allowed(host, "--right", "commission")
        forbidden(tolerance(0.5), "--right", "read")
        expect(live.reload(None, "--right", "read", "--confirm")[0] == FORBIDDEN, "to read confirms")
        expect(live.reload(None, "--right", "read", "--rollback")[0] == FORBIDDEN, "to read returns")
        expect(live.reload(None, "--right", "read", "--versions")[0] == 0, "to read shows no versions")
        code, _, err = live.reload(None, "--right", "box")
        expect(code == BAD_USAGE and "read, retune or commission" in err, err)
        end_orderly(live)


def test_no_step_by_step():
    """What was kept with --right is not what the next change is measured from: 1 → 2.5 → 6 is refused as 1 → 6 is."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(2.5)), "--right", "retune", "--wait", "--probation", "2", "--require-lock", "10")
        expect(code == 0 and "version 2 is kept" in out, f"{code}\n{out}{err}")
        code, out, err = live.reload(live.edited(tolerance(6)), "--right", "retune")
        expect(code == FORBIDDEN and "commissioned last" in err and live.active() == 2, f"{code}\n{out}{err}")
        expect(live.version_on_disk(2)["origin"] == "limited" and ", limited, in place" in live.reload(None, "--versions")[1], "its origin")
        code, out, err = live.reload(live.edited(tolerance(6)), "--no-activate")
        expect(code == 0, f"{code}\n{out}{err}")
        end_orderly(live)


def test_what_no_run_can_begin_with():
    """A signal without a live source is good for a replay; a run with it could not even begin, and nobody would be left to return from it."""
    def without_source(document):
        del document["plant"]["torque"]["modbus"]

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(without_source), "--restart")
        expect(code == BAD_DATA and "live source" in out + err and live.active() == 1, f"{code}\n{out}{err}")
        end_orderly(live)
        expect_one_run(live)


def test_a_version_that_cannot_begin():
    """The edited file of the start: it is returned from, and the version before runs, in the same process."""
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
            expect(not [pid for pid in children(again.pid) if title(pid) == ""], "the dead of the run before are not buried")
            end_orderly(again)


def test_only_checked():
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for change in tolerance(0.5), horizon:
            code, out, err = live.reload(live.edited(change), "--no-activate")
            expect(code == 0 and "can be activated" in out, f"{code}\n{out}{err}")
        expect(live.active() == 1, f"{live.versions()}")
        code, out, _ = live.reload(None)
        expect(code == 0 and "is what is active" in out, out)
        end_orderly(live)


def test_by_restart():
    """Another horizon: the run ends, another one begins with it, and is kept. Who waits hears all of it, over the restart."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(horizon), "--restart", "--wait", "--why", "a longer look", *PROBATION)
        expect(code == 0 and "version 2 is kept" in out and "kept        in lock" in out, f"{code}\n{out}{err}{live.log()}")
        expect(live.versions()[2][1].startswith("kept"), f"{live.versions()}")
        end_orderly(live)
    expect(query(live.database, "SELECT prediction, ended_reason FROM runs ORDER BY run") ==
           [(1, "another configuration: the run begins anew"), (3, "SIGTERM")], f"{query(live.database, 'SELECT * FROM v_runs')}")
    expect(events(live.database, "version 2 is of %, by hand: a longer look") == 1, "nobody knows who has brought it")


def port(number_):
    return lambda document: document["sources"]["inverter"]["modbus_tcp"].update(port=number_)


def told_gaps(database, run):
    return [float(re.search(r"no twin ran for ([0-9.]+) s", text).group(1)) for (text,) in
            query(database, "SELECT text FROM events WHERE run = ? AND source = 'resume' AND text LIKE 'no twin ran for %'", run)]


def gap(database, run):
    """Seconds from the last step of the run before to the first tick of this one."""
    (start,), = query(database, "SELECT start_ns FROM beginnings WHERE run = ?", run)
    (end,), = query(database, "SELECT start_ns + step_ns * (SELECT max(step) + lead FROM steps s WHERE s.run = r.run) FROM runs r JOIN beginnings USING (run)"
                    " WHERE run = ?", run - 1)
    return (start - end) / 1e9


def expect_each_run_whole(database):
    for (run,) in query(database, "SELECT run FROM runs"):
        ticks = [tick for (tick,) in query(database, "SELECT DISTINCT tick FROM samples WHERE run = ? ORDER BY tick", run)]
        expect(ticks and ticks == list(range(len(ticks))), f"run {run}: {len(ticks)} ticks up to {ticks and max(ticks)}")


def test_another_device():
    """Only a restart reads another device, if it is allowed. Every tick of each run is recorded, and the gap between them is told."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        candidate = live.edited(port(other.port))
        code, out, err = live.reload(candidate)
        expect(code == BAD_USAGE and "can take sources.inverter.modbus_tcp.port: with --restart" in err, f"{code}\n{out}{err}")
        expect(live.active() == 1 and not other.functions, f"{live.versions()}")
        code, out, err = live.reload(candidate, "--restart", "--wait", *PROBATION)
        expect(code == 0 and "(restart" in out and "version 2 is kept" in out, f"{code}\n{out}{err}{live.log()}")
        expect(other.functions, "the other device is not asked")
        end_orderly(live)
        expect_each_run_whole(live.database)
        told = told_gaps(live.database, 2)
        expect(len(told) == 1 and 0 < told[0] <= gap(live.database, 2) + 0.02, f"{told}, and it was {gap(live.database, 2)}")
        expect(f"no twin ran for {told[0]:.2f} s" in live.log(), live.log())


def test_a_device_that_does_not_answer():
    """It is returned from, by a restart; the runs before, between and after are recorded."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = free.getsockname()[1]
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(port(nobody)), "--restart", "--wait", "--probation", "5")
        expect(code == NOT_LOCKED and "undone: in lock for 0 % of the steps" in err, f"{code}\n{out}{err}{live.log()}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)
        expect_each_run_whole(live.database)
        expect([len(told_gaps(live.database, run)) for run in (1, 2, 3)] == [0, 1, 1], live.log())


def test_returned_from_by_restart():
    """One that is not confirmed in time: who waits hears of the way back, although the connection has not lasted so long."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(horizon), "--restart", "--wait", "--until-confirmed", *PROBATION)
        expect(code == NOT_LOCKED and "undone: " in err and "returned  " in out, f"{code}\n{out}{err}{live.log()}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_killed_while_somebody_listens():
    """An activator that dies in the middle: who waits goes on with the next one; who does not is told how to look."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        with Program("reload", live.edited(tolerance(0.5)), "--control", live.socket, "--wait", "--probation", "6") as waiting:
            wait_until(lambda: len(live.versions()) == 2 and "probation" in live.versions()[2][1], "its probation", live.log)
            os.kill(member(live, "activator"), signal.SIGKILL)
            code, out, log = waiting.end()
            expect(code == 0 and "version 2 is kept" in out, f"{code}\n{out}{log}")
            expect("  the run has hung up before it said what came of it: it is waited for" in out, out)
        end_orderly(live)


def test_interrupted():
    """Ctrl-C ends who looks on, and not the change: that is said, and how to end it."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        with Program("reload", live.edited(tolerance(0.5)), "--control", live.socket, "--wait", "--probation", "600") as waiting:
            wait_until(lambda: live.active() == 2, "its probation", live.log)
            waiting.signal(signal.SIGINT)
            code, log = waiting.process.wait(timeout=HUNG_S), waiting.log()
            expect(code == -signal.SIGINT and "the change goes on in the run" in log and "--rollback" in log, f"{code}\n{log}")
        wait_until(lambda: "on probation" in live.reload(None, "--state")[1], "its probation goes on", live.log)
        end_orderly(live)


def test_returned_from():
    """Bounds within which the twin cannot follow: the lock is lost, and the version before comes back by itself."""
    def bound(document):
        document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(bound), "--probation", "20")
        expect(code == 0, f"{code}\n{out}{err}")
        device.omega = 20.0
        wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.5)
        result = live.versions()[2][1]
        expect(result.startswith("returned: ") and "lost" in result, result)
        live.wait_for_tick(live.database)
        expect(events(live.database, "returned") == 1, "no event says so")
        end_orderly(live)
        expect_one_run(live)


def test_a_damaged_text():
    """A worn-out card has lost the texts of what runs and of what would be returned to: they are written anew from memory, and the change is made."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        for value in 0.5, 0.6:
            for text in (live.state / "versions").glob("*.json"):
                if len(text.stem) == 64:
                    text.write_bytes(b"{}")
            code, out, err = live.reload(live.edited(tolerance(value)))
            expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        expect(live.log().count("is written anew from the run's memory") == 3, live.log())
        end_orderly(live)


def test_until_confirmed():
    """Nobody confirms, and it is returned from; somebody does, and it is kept. By hand, too."""
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
        expect(code == PLANT_DOWN and "no version is on probation" in err, f"{code} {err}")
        code, _, err = live.reload(None, "--rollback", "--wait", *PROBATION)
        expect(code == 0, f"{code} {err}")
        text = live.file.read_bytes()
        expect(query(live.database, "SELECT count(*) FROM tunings")[0][0] == 4, "tunings")
        end_orderly(live)
        last = query(live.database, "SELECT text FROM tunings JOIN configurations ON configuration = hash ORDER BY tick DESC LIMIT 1")
        expect(last[0][0].encode() == text, "the first version is not in force")
        expect_one_run(live)


def test_who_waits_hears_what_came_of_it():
    """Another candidate that becomes nothing takes nobody's place; one that does, does."""
    with Device(OMEGA) as device, Retuned(device.port) as live, ThreadPoolExecutor() as pool:
        wait_for_run(live, live.database, 1)
        first = pool.submit(live.reload, live.edited(tolerance(0.8)), "--wait", "--probation", "4")
        wait_until(lambda: live.active() == 2 and "on probation" in live.reload(None, "--state")[1], "version 2", live.log)
        code, out, err = live.reload(live.edited(tolerance(0.7)), "--no-activate")
        expect(code == 0, f"{code}\n{out}{err}")
        code, out, err = first.result()
        expect(code == 0 and "in lock" in out, f"{code}\n{out}{err}")
        first = pool.submit(live.reload, live.edited(tolerance(0.6)), "--wait", "--probation", "60")
        wait_until(lambda: live.active() == 3 and "on probation" in live.reload(None, "--state")[1], "version 3", live.log)
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--probation", "2", "--wait")
        expect(code == 0, f"{code}\n{out}{err}")
        code, out, err = first.result()
        expect(code == NOT_LOCKED and "took its place" in out + err, f"{code}\n{out}{err}")
        end_orderly(live)


def test_deaths_on_probation():
    """Activator, recorder and twin are killed while a version is on probation; it goes on, and what is in force stays so."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.8)), "--until-confirmed", "--probation", "600")
        expect(code == 0, f"{code}\n{out}{err}")
        for role in "activator", "recorder", "io":
            live.kill_one(role)
            live.wait_for_tick(live.database)
        code, out, _ = live.reload(None, "--state")
        expect(code == 0 and "on probation" in out, out)
        code, _, err = live.reload(None, "--confirm")
        expect(code == 0 and live.active() == 2, f"{code}\n{err}{live.versions()}")
        live.kill_one("twin")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_whole(read(live.database))
        expect(number(live.database, "SELECT count(*) FROM tunings") >= 1, "no tuning")


def test_a_client_after_many_kills():
    """An activator that was killed eight times within seconds: the next client has its answer soon."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.8)), "--until-confirmed", "--probation", "600")
        expect(code == 0, f"{code}\n{out}{err}")
        for _ in range(8):
            os.kill(member(live, "activator"), signal.SIGKILL)
            asked = time.monotonic()
            code, out, err = live.reload(None, "--state")
            at_most(time.monotonic() - asked, 5, "seconds until the client has its answer (2 beside nothing else)")
            expect(code == 0 and "on probation" in out, f"{code}\n{out}{err}")
        end_orderly(live)
        expect(live.log().count("the activator failed") <= 3, live.log())


def test_the_supervisor_is_killed():
    """On probation: the next start goes on with the version on probation and the time that is left."""
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
            expect(code == 0 and "on probation" in out and "version 2" in out, out)
            expect("version 2 is on probation, " in again.log(), again.log())
            code, _, err = again.reload(None, "--rollback")
            expect(code == 0, err)
            wait_until(lambda: again.active() == 1, "the first version", again.log)
            code, _, err = again.reload(None, "--rollback")
            expect(code == PLANT_DOWN and "there is none before it" in err, f"{code} {err}")
            end_orderly(again)


def test_an_edited_file_at_the_start():
    """It is taken, on probation; a broken one is not, and the version that was active runs."""
    with Device(OMEGA) as device:
        with Retuned(device.port) as live:
            wait_for_run(live, live.database, 1)
            end_orderly(live)
        live.file.write_bytes(live.edited(tolerance(0.8)).read_bytes())
        with Retuned(device.port, config=live.file, state=live.state) as second:
            wait_for_run(second, live.database, 2)
            expect(second.active() == 2, f"{second.versions()}")
            code, _, err = second.reload(None, "--confirm")
            expect(code == 0, err)
            end_orderly(second)
        live.file.write_bytes(b"{")
        with Retuned(device.port, config=live.file, state=live.state) as third:
            wait_for_run(third, live.database, 3)
            expect(third.active() == 2 and "is not taken" in third.log(), f"{third.versions()}\n{third.log()}")
            end_orderly(third)


def held(pid):
    """What its descriptors are of; one may be closed meanwhile."""
    folder = f"/proc/{pid}/fd"
    return [os.readlink(f"{folder}/{name}") for name in os.listdir(folder) if os.path.islink(f"{folder}/{name}")]


def test_who_holds_what():
    """An activator has no socket but the control's, no FMU and no database; it ends by itself when nothing is to be done."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        wait_until(lambda: not [pid for pid in children(live.pid) if "activator" in title(pid)], "its end", live.log)
        live.reload(None, "--state")
        activator = live.child(role="activator")
        maps = open(f"/proc/{activator}/maps", encoding="utf-8").read()
        wait_until(lambda: " ".join(held(activator)).count("socket:") == 1, "the end of the connection", lambda: f"{held(activator)}")
        expect("motor.so" not in maps and not [name for name in held(activator) if "twin.db" in name], f"{held(activator)}")
        end_orderly(live)


if __name__ == "__main__":
    main()
