#!/usr/bin/env python3
"""Invalid configurations, sent to a run. The run rejects each with its reason, and continues
undisturbed.

The active version and the twin stay the same, and no tick is missing.
"""
import json
import time
from pathlib import Path

from hostile_fmu import make
from live_test import Device, children, committed_steps, title, wait_until
from retuned import Retuned, match
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import HUNG_S, BAD_DATA, BAD_USAGE, expect, expect_line, has_line, main, scratch


def with_fmu(fmu, **keys):
    """Adds an FMU without connections."""
    def change(document):
        document["components"]["extra"] = {"fmu": str(fmu), "set": {"u": 1.0}, **keys}
    return change


def ended(how, at="fmi2DoStep", call=1):
    return with_fmu(make("end", AT=at, CALL=call, HOW=f"{how};"))


def file(content):
    path = scratch() / "no.fmu"
    path.write_bytes(content)
    return path


def without_source(document):
    del document["plant"]["torque"]["modbus"]


def two_problems(document):
    match(document).update(tolerance=-1)
    document.update(step_s=0)


def too_narrow(document):
    document["synchronise"]["horizon"]["prediction"] = 2
    document["synchronise"]["adjust"]["motor.d"].update(min=0.003, max=0.0032)


SLOW = ended("calls = 0; usleep(6000)")


def bad_ones():
    """(what is wrong, the candidate, parts of the client's error message: see has_line())"""
    return [
        ("no JSON", b"{\"name\": ", "config.json|line 1|column 10"),
        ("a byte 0", b"{}\0{}", "invalid|NUL"),
        ("nothing", b"", "config.json|empty|262144 bytes"),
        ("too long", b" " * (256 * 1024 + 1), "config.json|large|262144 bytes"),
        ("two problems", two_problems, "invalid|2 problems"),
        ("an unknown key", lambda document: match(document).update(tolerence=1), "synchronise.match.motor.omega.tolerence|tolerance"),
        ("no such variable", lambda document: document["synchronise"]["adjust"].update({"motor.q": {"step": 1}}),
         "synchronise.adjust.motor.q|motor|q"),
        ("no live source", without_source, "plant.torque|modbus"),
        ("out of lock", too_narrow, "lock|95 %"),
        ("another step", lambda document: document.update(step_s=0.02), "step_s|--restart"),
        ("another priority", lambda document: document.setdefault("realtime", {}).update(priority=7),
         "realtime.priority|--restart"),
        ("no such FMU", with_fmu("/nowhere/extra.fmu"), "components.extra|/nowhere/extra.fmu"),
        ("no archive", with_fmu(file(b"PK")), "components.extra|no.fmu"),
        ("a crash as it is loaded", ended("abort()", "fmi2Instantiate"), "extra|fmi2Instantiate"),
        ("a crash as it begins", ended("abort()", "fmi2EnterInitializationMode"), "extra|fmi2EnterInitializationMode"),
        ("exit(0)", ended("exit(0)"), "extra|exit(0)|fmi2DoStep"),
        ("no state", with_fmu(make("refuse", AT="fmi2GetFMUstate"), rollback="state"), "hostile|fmi2GetFMUstate"),
        ("too slow", ended("calls = 0; usleep(30000)"), "step|10 ms"),
        ("too slow beside another one", SLOW, "two twins"),
        ("a crash as a shadow", ended("abort()", call=1800), "signal 6|fmi2DoStep|extra"),
        ("a hang as a shadow", ended("for (;;) { pause(); }", call=1800), "fmi2DoStep|extra"),
    ]


def test_twenty():
    with Device(20.0) as device, Retuned(device.port, realtime={"hang_s": 3}) as live:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        for what, change, parts in bad_ones():
            options = ["--restart"] if change is without_source else ["--shadow", "20" if "shadow" in what else "3"]
            code, out, err = live.reload(live.edited(change), *options, timeout=HUNG_S, tries=1)
            wanted = BAD_USAGE if "--restart" in parts else BAD_DATA
            expect(code == wanted and has_line(err, parts), f"{what}: {code}, wanted {wanted} and {parts}\n{out}{err}\n{live.log()}")
            print(f"    {what}: {err.splitlines()[-1]}", flush=True)
            expect(live.active() == 1 and live.child() == twin, f"{what}: {live.versions()}")
            wait_until(lambda: not [pid for pid in children(live.pid) if "shadow" in title(pid)], "no shadow is left", live.log)
        live.wait_for_tick(live.database)
        end_orderly(live)
        found = read(live.database)
        expect_whole(found)
        expect(found.newest.run == 1, "there is another run")
        expect(json.loads(Path(live.state / "versions" / "active.json").read_text(encoding="utf-8"))["active"] == 1, "active.json has changed")


def test_one_twin_at_a_time():
    """A box that is too slow for two twins: with --restart the change is made by a restart."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        time.sleep(5)  # enough recorded samples for the comparison
        code, out, err = live.reload(live.edited(SLOW), "--restart", timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}\n{live.log()}")
        expect_line(out, "shadow|restart")
        wait_until(lambda: committed_steps(live.database, 2) > 20, "run 2", live.log)
        expect(live.active() == 2, f"{live.versions()}")
        end_orderly(live)


if __name__ == "__main__":
    main()
