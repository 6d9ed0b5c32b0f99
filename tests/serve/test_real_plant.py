#!/usr/bin/env python3
"""From a terminal elsewhere to a twin that runs: twinlock push, twinlock serve, a supervised run with its activator."""
import json

from live_test import Device, query, wait_until
from pushed import expect_push, push
from retuned import Retuned, match, tolerance
from served import Box
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import expect, main, scratch


BUSY = 75
JUDGED = 500  # ticks after which the lock was judged several times (1 s each)


class RealBox(Box):
    """A box whose plant is a run; `edited` as that of Retuned."""

    def __init__(self, live):
        super().__init__(plants=())
        self.live = live

    def __enter__(self):
        super().__enter__()
        (self.folder / "plants/motor").mkdir()
        (self.folder / "plants/motor/control").symlink_to(self.live.socket)
        return self

    def push(self, *words, change=None, role="retune"):
        config = None if change is None else self.live.edited(change).read_bytes()
        return push(self, *words, config=config, role=role)


def test_a_wrong_tolerance_is_corrected_and_kept():
    """In place, and nobody was begun again."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        expect_push(box.push("--state", role="read"), 0, "motor bench", "version 1")
        found = box.push("--wait", "--probation", "3", "--require-lock", "10", "--why", "too wide", change=tolerance(0.5))
        expect_push(found, 0, "authorise", "validate", "synchronise.match.motor.omega.tolerance: ", "→ 0.5 (in place)", "activate", "kept")
        expect(live.child() == twin, "the twin was begun again")
        expect_push(box.push("--versions", role="read"), 0, "*    2", "retune", "too wide", "kept")
        code, text, _ = box.push("--get", role="read")
        expect(code == 0 and match(json.loads(text))["tolerance"] == 0.5, f"{code} {text[:200]}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_whole(read(live.database))
        expect(query(live.database, "SELECT who, why FROM tunings") == [("retune", "too wide")], "another book")


def test_what_is_refused():
    """With its own exit code each, and the version in force goes on."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        twin = live.child()

        def two_problems(document):
            match(document).update(tolerance=-1)
            document.update(step_s=0)

        def another_host(document):
            document["sources"]["inverter"]["modbus_tcp"]["host"] = "192.0.2.9"

        def horizon(document):
            document["synchronise"]["horizon"]["prediction"] = 3
            document["name"] = "another bench"  # which only a new run can have

        found = box.push(change=two_problems)
        expect_push(found, 65, "synchronise.match.motor.omega.tolerance: found -1", "step_s: found 0", "new.json:")
        expect_push(box.push("--restart", change=another_host), 77, "sources.inverter.modbus_tcp.host", "(restart, takes the right to commission)", "forbidden")
        expect_push(box.push(change=horizon), 2, "needs a restart")
        expect_push(box.push("--no-activate", change=tolerance(0.5)), 0)
        expect_push(box.push("--confirm"), 69, "absent")
        expect_push(box.push(change=tolerance(0.5), role="read"), 77)
        expect(live.child() == twin and live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_names_of_files_and_libraries():
    """Only those that the box has named before; and of an FMU only the file whose hash was given."""
    allowed = scratch() / "allowed"
    with Device(OMEGA) as device, Retuned(device.port, "--allowed", allowed) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)

        def names(document):
            document["components"]["motor"].update(libraries=["libm.so.6"], read=["/srv/tables"])

        def another_file(document):
            document["components"]["motor"]["sha256"] = 64 * "0"

        found = box.push("--no-activate", change=names, role="commission")
        expect_push(found, 77, 'components.motor.libraries[0]: found "libm.so.6", expected a name that', f"{allowed} has: let root add there the line: library NAME",
                    'components.motor.read[0]: found "/srv/tables"', "on the box")
        allowed.write_text("library libm.so.6\nfile /srv/tables\n", encoding="utf-8")
        expect_push(box.push("--no-activate", change=names), 77, "the right to commission")
        expect_push(box.push("--no-activate", "--restart", "--shadow", "1", change=names, role="commission"), 0, "it can be activated")
        expect_push(box.push("--no-activate", change=another_file, role="commission"), 65, "sha256", 64 * "0", "it cannot run")
        allowed.chmod(0o666)
        expect_push(box.push("--no-activate", change=names, role="commission"), 77, "others than root may write it")
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def newest_tick(live):
    return query(live.database, "SELECT max(tick) FROM samples")[0][0]


def expect_locked(live):
    wait_until(lambda: "motor bench, live by Modbus TCP: locked" in live.reload(None, "--state")[1], "its lock", live.log, every=0.2)


def test_a_tolerance_does_not_decide_on_itself():
    """A wide one takes the right to commission, and is judged by the one before it as well: it is returned from when the plant goes away."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        for wide in 1e300, 1e6, 10.0:
            found = box.push(change=tolerance(wide))
            expect_push(found, 77, "synchronise.match.motor.omega: found an error of", "that is in lock, expected at most 3, which is 3 times", "forbidden")
            found = box.push("--probation", "10", change=tolerance(wide), role="commission")
            expect_push(found, 0, "in place")
            device.omega = -400.0
            wait_until(lambda: live.active() == 1, "the version before", live.log, every=0.2)
            result = live.versions()[max(live.versions())][1]
            expect(f"motor.omega: tolerance 1 → {wide:g}" in result or (wide == 10.0 and "the lock was lost" in result), result)
            device.omega = OMEGA
            expect_locked(live)
        end_orderly(live)


def test_a_wider_tolerance_is_judged_by_the_one_before():
    """The plant is where only the new one calls it in lock: whoever may only retune cannot confirm it, and it is not kept, whatever way it came by."""
    def in_place(_):
        pass

    def by_a_flip(document):
        document["synchronise"]["horizon"]["prediction"] = 2

    def by_a_restart(document):
        document["name"] = "motor bench, live by Modbus TCP, once more"

    def within(document):
        match(document).update(tolerance=3.0)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.00309, max=0.00311)  # the twin stays where it is

    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        expect_locked(live)
        expect_push(box.push("--probation", "600", "--until-confirmed", change=within), 0)
        device.omega = OMEGA - 2
        since = newest_tick(live)
        wait_until(lambda: newest_tick(live) > since + JUDGED, "its judgement", live.log, every=0.2)
        expect_locked(live)
        expect_push(box.push("--confirm"), 77, "by the tolerances of the version before, the lock is lost")
        expect_push(box.push("--rollback"), 0)
        device.omega = OMEGA
        expect_locked(live)
        for kind in in_place, by_a_flip, by_a_restart:
            def change(document, kind=kind):
                within(document)
                kind(document)

            wait_until(lambda change=change: box.push("--probation", "20", "--shadow", "2", "--restart", change=change)[0] != BUSY, "an end of the change before",
                       live.log, every=0.5)
            wait_until(lambda: "on probation" in live.reload(None, "--state")[1], "its probation", live.log, every=0.2)
            device.omega = OMEGA - 2
            wait_until(lambda: live.active() == 1, "the version before", live.log, every=0.2)
            result = live.versions()[max(live.versions())][1]
            expect("by the tolerances of the version before, the lock was lost for " in result and "(motor.omega: tolerance 1 → 3)" in result, f"{kind.__name__}: {result}")
            device.omega = OMEGA
            expect_locked(live)
        end_orderly(live)


def test_a_tolerance_is_not_walked_up():
    """What `retune` may set is held against what was commissioned, and not against what `retune` has set before. Who may commission begins anew."""
    def another(document):
        match(document).update(tolerance=1.0, to="plant.torque")

    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        for value in 2.0, 3.0:
            expect_push(box.push("--wait", "--probation", "2", change=tolerance(value)), 0, "kept")
        expect_push(box.push(change=tolerance(4.0)), 77, "expected at most 3")
        expect_push(box.push(change=another), 77, "synchronise.match.motor.omega: found no match with plant.omega that has an effect")
        expect_push(box.push("--wait", "--probation", "2", change=tolerance(4.0), role="commission"), 0, "kept")
        expect_push(box.push("--no-activate", change=tolerance(12.0)), 0)
        expect_push(box.push("--no-activate", change=tolerance(12.1)), 77, "expected at most 12")
        end_orderly(live)


def test_a_person_confirms_or_takes_it_back():
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        expect_push(box.push("--until-confirmed", change=tolerance(0.5)), 0, "version 2")
        expect_push(box.push("--state"), 0, "probation")
        expect_push(box.push("--base", live.file, change=tolerance(0.25)), 75, "changed")
        expect_push(box.push("--confirm"), 0)
        expect_push(box.push("--rollback", "--version", "1", "--why", "it was better"), 0)
        code, text, _ = box.push("--get")
        expect(code == 0 and text.encode() == live.file.read_bytes(), "another configuration is active")
        end_orderly(live)


main()
