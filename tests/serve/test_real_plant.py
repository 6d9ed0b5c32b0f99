#!/usr/bin/env python3
"""Changes from an HTTPS client to a running twin: twinlock-serve, and a supervised run with its
config manager."""
import json

from live_test import Device, query, wait_until
from retuned import Retuned, match, tolerance
from served import MOTOR, Box, tag
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import IN_LOCK, expect, has_line, main, scratch

JUDGED = 500  # ticks; the lock monitor judges once a second


class RealBox(Box):
    """A server whose only plant is a real run."""

    def __init__(self, live):
        super().__init__(plants=())
        self.live = live

    def __enter__(self):
        super().__enter__()
        (self.folder / "plants/motor").mkdir()
        (self.folder / "plants/motor/control").symlink_to(self.live.socket)
        return self

    def change(self, change, query="", role="retune", match="*"):
        """Sends an edited configuration. Answers when it is active, or with wait=1 when its
        probation ends."""
        return self.put(self.live.edited(change).read_bytes(), query, role, match, connection=self.connect(timeout=60))

    def post(self, action, query="", role="retune"):
        return self.ask("POST", f"{MOTOR}/{action}{query}", role)

    def state(self):
        """The plant's state; without "lock" and "step" while the run restarts."""
        return self.ask("GET", MOTOR, "read").lines[0]

    def expect_locked(self):
        wait_until(lambda: self.state().get("lock") in IN_LOCK, "its lock", self.live.log, every=0.2)


def expect_end(answer, result, *parts):
    """Checks the result of the last line. Each of `parts` (see has_line()) must be in a value of
    some line, in "path: text" of a problem, or in "path: before → after (kind)" of a change."""
    told = []
    for line in answer.lines:
        told += [str(value) for value in line.values()]
        told += [f"{line['path']}: {line['text']}"] if line["reply"] == "problem" else []
        told += [f"{line['path']}: {line['before']} → {line['after']} ({line['kind']})"] if line["reply"] == "change" else []
    for some in parts:
        expect(any(has_line(one, some) for one in told), f"no {some} in {told}")
    expect(answer.end["result"] == result, f"found {answer.end}, wanted {result}")


def test_a_wrong_tolerance_is_corrected_and_kept():
    """In place: the twin keeps running."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        state = box.ask("GET", MOTOR, "read").lines
        expect(len(state) == 1 and state[0]["plant"].startswith("motor bench") and state[0]["version"] == 1, f"{state}")
        answer = box.change(tolerance(0.5), "?wait=1&probation=3&require_lock=10&why=too+wide")
        expect_end(answer, "done", "authorise", "validate", "synchronise.match.motor.omega.tolerance|1 → 0.5|in place", "activate", "kept")
        expect(live.child() == twin, "another twin runs")
        newest = box.ask("GET", f"{MOTOR}/versions", "read").lines[0]
        expect(newest["version"] == 2 and newest["is_active"] and newest["who"] == "retune" and newest["why"] == "too wide" and has_line(newest["result"], "kept"), f"{newest}")
        text = box.ask("GET", f"{MOTOR}/configuration", "read").body
        expect(match(json.loads(text))["tolerance"] == 0.5, f"{text[:200]}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_whole(read(live.database))
        expect(query(live.database, "SELECT who, why FROM tunings") == [("retune", "too wide")], "other tunings in the database")


def test_rejected_changes():
    """Each with its result. The active version stays active."""
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
            document["name"] = "another bench"  # takes a restart

        answer = box.change(two_problems)
        expect_end(answer, "invalid", "synchronise.match.motor.omega.tolerance|-1", "step_s|0")
        expect(answer.status == 422, f"{answer.status}")
        answer = box.change(another_host, "?restart=1")
        expect_end(answer, "forbidden", 'sources.inverter.modbus_tcp.host|"127.0.0.1" → "192.0.2.9"|restart', "commission")
        expect_end(box.change(horizon), "needs a restart")
        expect_end(box.change(tolerance(0.5), "?check=1"), "done")
        expect_end(box.post("confirm"), "absent")
        expect_end(box.change(tolerance(0.5), role="read"), "forbidden")
        expect(live.child() == twin and live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_names_of_files_and_libraries():
    """A change may use only names that the box allows, and only the FMU file with the given hash.
    """
    allowed = scratch() / "allowed"
    with Device(OMEGA) as device, Retuned(device.port, "--allowed", allowed) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)

        def names(document):
            document["components"]["motor"].update(libraries=["libm.so.6"], read=["/srv/tables"])

        def another_file(document):
            document["components"]["motor"]["sha256"] = 64 * "0"

        answer = box.change(names, "?check=1", "commission")
        expect_end(answer, "forbidden", f'components.motor.libraries[0]|"libm.so.6"|{allowed}|root|library NAME',
                    f'components.motor.read[0]|"/srv/tables"|{allowed}|root|file NAME', "on the box")
        allowed.write_text("library libm.so.6\nfile /srv/tables\n", encoding="utf-8")
        expect_end(box.change(names, "?check=1"), "forbidden", "commission")
        expect_end(box.change(names, "?check=1&restart=1&shadow=1", "commission"), "done", 'components.motor.libraries|["libm.so.6"]|new twin')
        expect_end(box.change(another_file, "?check=1", "commission"), "invalid", f"components.motor|motor.fmu|{64 * '0'}|sha256")
        allowed.chmod(0o666)
        expect_end(box.change(names, "?check=1", "commission"), "forbidden", f"{allowed}|root|write", "on the box")
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def newest_tick(live):
    return query(live.database, "SELECT max(tick) FROM samples")[0][0]


def test_a_tolerance_does_not_decide_on_itself():
    """A wide tolerance requires the right `commission`. Its probation also uses the tolerance
    before it: lost lock causes a rollback."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        for wide in 1e300, 1e6, 10.0:
            answer = box.change(tolerance(wide))
            expect_end(answer, "forbidden", f"synchronise.match.motor.omega|{wide:g}|3|commission")
            expect_end(box.change(tolerance(wide), "?probation=10", "commission"), "done", "in place")
            device.omega = -400.0
            wait_until(lambda: live.active() == 1, "the version before", live.log, every=0.2)
            result = live.versions()[max(live.versions())][1]
            expect(has_line(result, f"motor.omega|1 → {wide:g}") or (wide == 10.0 and has_line(result, "returned|lock")), result)
            device.omega = OMEGA
            box.expect_locked()
        end_orderly(live)


def test_a_wider_tolerance_is_judged_by_the_one_before():
    """Only the new tolerance counts the plant as in lock. The right `retune` cannot confirm it, and
    its probation ends with a rollback."""
    def in_place(_):
        pass

    def by_a_handover(document):
        document["synchronise"]["horizon"]["prediction"] = 2

    def by_a_restart(document):
        document["name"] = "motor bench, live by Modbus TCP, once more"

    def within(document):
        match(document).update(tolerance=3.0)
        document["synchronise"]["adjust"]["motor.d"].update(min=0.00309, max=0.00311)  # the twin cannot follow

    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        box.expect_locked()
        expect_end(box.change(within, "?probation=600&confirm=1"), "done")
        device.omega = OMEGA - 2
        since = newest_tick(live)
        wait_until(lambda: newest_tick(live) > since + JUDGED, "several judgements", live.log, every=0.2)
        box.expect_locked()
        expect_end(box.post("confirm"), "forbidden", "tolerances|lock|commission")
        expect_end(box.post("return"), "done")
        device.omega = OMEGA
        box.expect_locked()
        for kind in in_place, by_a_handover, by_a_restart:
            def change(document, kind=kind):
                within(document)
                kind(document)

            wait_until(lambda change=change: box.change(change, "?probation=20&shadow=2&restart=1").end["result"] not in ("busy", "failed", "cancelled"),
                       "an end of the change before", live.log, every=0.5)
            wait_until(lambda: box.state().get("step") == "probation", "its probation", live.log, every=0.2)
            device.omega = OMEGA - 2
            wait_until(lambda: live.active() == 1, "the version before", live.log, every=0.2)
            result = live.versions()[max(live.versions())][1]
            expect(has_line(result, "tolerances|lock|motor.omega|1 → 3"), f"{kind.__name__}: {result}")
            device.omega = OMEGA
            box.expect_locked()
        end_orderly(live)


def test_a_tolerance_is_not_walked_up():
    """The limit for `retune` follows from the tolerance that was commissioned last, not from one
    that `retune` set."""
    def another(document):
        match(document).update(tolerance=1.0, to="plant.torque")

    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        for value in 2.0, 3.0:
            expect_end(box.change(tolerance(value), "?wait=1&probation=2"), "done", "kept")
        expect_end(box.change(tolerance(4.0)), "forbidden", "synchronise.match.motor.omega|4|3|commission")
        expect_end(box.change(another), "forbidden", "synchronise.match.motor.omega|plant.omega|commission")
        expect_end(box.change(tolerance(4.0), "?wait=1&probation=2", "commission"), "done", "kept")
        expect_end(box.change(tolerance(12.0), "?check=1"), "done")
        expect_end(box.change(tolerance(12.1), "?check=1"), "forbidden", "synchronise.match.motor.omega|12.1|12|commission")
        end_orderly(live)


def test_a_person_confirms_or_returns():
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        expect_end(box.change(tolerance(0.5), "?confirm=1"), "done", "version 2")
        state = box.ask("GET", MOTOR).lines[0]
        expect(state["step"] == "probation", f"{state}")
        expect_end(box.change(tolerance(0.25), match=tag(live.file.read_bytes())), "changed")
        expect_end(box.post("confirm"), "done")
        expect_end(box.post("return", "?version=1&why=it+was+better"), "done")
        expect(box.ask("GET", f"{MOTOR}/configuration").body == live.file.read_bytes(), "another configuration is active")
        end_orderly(live)


main()
