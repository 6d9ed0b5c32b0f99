#!/usr/bin/env python3
"""From an HTTPS client to a twin that runs: twinlock serve, a supervised run with its activator."""
import json

from live_test import Device, query, wait_until
from retuned import Retuned, match, tolerance
from served import MOTOR, Box, tag
from supervised import end_orderly, wait_for_run
from tree import OMEGA, expect_whole, read
from twinlock_test import expect, main, scratch


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

    def change(self, change, query="", role="retune", match="*"):
        """What comes of an edited configuration, until it is active; with wait=1 until the end of its probation."""
        return self.put(self.live.edited(change).read_bytes(), query, role, match, connection=self.connect(timeout=60))

    def post(self, action, query="", role="retune"):
        return self.ask("POST", f"{MOTOR}/{action}{query}", role)


def expect_end(answer, result, *words):
    """The result of the last line, and words that some line has: texts, or "path: text" of a problem, "path: before → after (kind)" of a change."""
    told = []
    for line in answer.lines:
        told += [str(value) for value in line.values()]
        told += [f"{line['path']}: {line['text']}"] if line["reply"] == "problem" else []
        told += [f"{line['path']}: {line['before']} → {line['after']} ({line['kind']})"] if line["reply"] == "change" else []
    for word in words:
        expect(any(word in one for one in told), f"no \"{word}\" in {told}")
    expect(answer.end["result"] == result, f"found {answer.end}, wanted {result}")


def test_a_wrong_tolerance_is_corrected_and_kept():
    """In place, and nobody was begun again."""
    with Device(OMEGA) as device, Retuned(device.port) as live, RealBox(live) as box:
        wait_for_run(live, live.database, 1)
        twin = live.child()
        state = box.ask("GET", MOTOR, "read").lines
        expect(len(state) == 1 and state[0]["plant"].startswith("motor bench") and state[0]["version"] == 1, f"{state}")
        answer = box.change(tolerance(0.5), "?wait=1&probation=3&require_lock=10&why=too+wide")
        expect_end(answer, "done", "authorise", "validate", "synchronise.match.motor.omega.tolerance: 1 → 0.5 (in place)", "activate", "kept")
        expect(live.child() == twin, "the twin was begun again")
        newest = box.ask("GET", f"{MOTOR}/versions", "read").lines[0]
        expect(newest["version"] == 2 and newest["is_active"] and newest["who"] == "retune" and newest["why"] == "too wide" and "kept" in newest["result"], f"{newest}")
        text = box.ask("GET", f"{MOTOR}/configuration", "read").body
        expect(match(json.loads(text))["tolerance"] == 0.5, f"{text[:200]}")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_whole(read(live.database))
        expect(query(live.database, "SELECT who, why FROM tunings") == [("retune", "too wide")], "another book")


def test_what_is_refused():
    """With its own result each, and the active version goes on."""
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

        answer = box.change(two_problems)
        expect_end(answer, "invalid", "synchronise.match.motor.omega.tolerance: found -1", "step_s: found 0")
        expect(answer.status == 422, f"{answer.status}")
        answer = box.change(another_host, "?restart=1")
        expect_end(answer, "forbidden", "sources.inverter.modbus_tcp.host: ", "(restart", "commission")
        expect_end(box.change(horizon), "needs a restart")
        expect_end(box.change(tolerance(0.5), "?check=1"), "done")
        expect_end(box.post("confirm"), "absent")
        expect_end(box.change(tolerance(0.5), role="read"), "forbidden")
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

        answer = box.change(names, "?check=1", "commission")
        expect_end(answer, "forbidden", 'components.motor.libraries[0]: found "libm.so.6", expected a name that', f"{allowed} has: let root add there the line: library NAME",
                    'components.motor.read[0]: found "/srv/tables"', "on the box")
        allowed.write_text("library libm.so.6\nfile /srv/tables\n", encoding="utf-8")
        expect_end(box.change(names, "?check=1"), "forbidden", "commission")
        expect_end(box.change(names, "?check=1&restart=1&shadow=1", "commission"), "done", "it can be activated")
        expect_end(box.change(another_file, "?check=1", "commission"), "invalid", "sha256", 64 * "0", "it cannot run")
        allowed.chmod(0o666)
        expect_end(box.change(names, "?check=1", "commission"), "forbidden", "others than root may write it")
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
            answer = box.change(tolerance(wide))
            expect_end(answer, "forbidden", "synchronise.match.motor.omega: found an error of", "that is in lock, expected at most 3, which is 3 times")
            expect_end(box.change(tolerance(wide), "?probation=10", "commission"), "done", "in place")
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
        expect_end(box.change(within, "?probation=600&confirm=1"), "done")
        device.omega = OMEGA - 2
        since = newest_tick(live)
        wait_until(lambda: newest_tick(live) > since + JUDGED, "its judgement", live.log, every=0.2)
        expect_locked(live)
        expect_end(box.post("confirm"), "forbidden", "by the tolerances of the version before, the lock is lost")
        expect_end(box.post("return"), "done")
        device.omega = OMEGA
        expect_locked(live)
        for kind in in_place, by_a_flip, by_a_restart:
            def change(document, kind=kind):
                within(document)
                kind(document)

            wait_until(lambda change=change: box.change(change, "?probation=20&shadow=2&restart=1").end["result"] not in ("busy", "failed", "cancelled"),
                       "an end of the change before", live.log, every=0.5)
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
            expect_end(box.change(tolerance(value), "?wait=1&probation=2"), "done", "kept")
        expect_end(box.change(tolerance(4.0)), "forbidden", "expected at most 3")
        expect_end(box.change(another), "forbidden", "synchronise.match.motor.omega: found no match with plant.omega that has an effect")
        expect_end(box.change(tolerance(4.0), "?wait=1&probation=2", "commission"), "done", "kept")
        expect_end(box.change(tolerance(12.0), "?check=1"), "done")
        expect_end(box.change(tolerance(12.1), "?check=1"), "forbidden", "expected at most 12")
        end_orderly(live)


def test_a_person_confirms_or_takes_it_back():
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
