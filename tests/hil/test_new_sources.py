#!/usr/bin/env python3
"""A running plant is read by other sources from one tick on (`twinlock reload` with another host, another signal): the new twin runs as a shadow that sees what
the run sees, takes over, and only then is the plant read anew. No tick is left out; what does not answer leads back."""
import contextlib
import os
import random
import signal
import socket
import threading

from changes import moving
from live_test import GOOD, Device, query, title, wait_until
from retuned import Retuned
from supervised import end_orderly, wait_for_run
from test_shadow import expect_flips, expect_repeated, horizon, twins
from tree import OMEGA, STEP_NS
from twinlock_test import HUNG_S, at_most, expect, main

SHORT = "--shadow", "2", "--probation", "10"
LONG = "--shadow", "2", "--probation", "600"
STALE_NS = 1_000_000_000
LATE_S = 1  # of an answer and of a reading: a device shares a busy machine with all else
SETTLED = 300  # ticks after a flip; what happens later has other causes
NOT_GOOD = """SELECT tick, max(quality <> ?) FROM samples JOIN signals USING (run, signal) JOIN beginnings USING (run)
              WHERE run = ? AND kind = 'plant' AND tick >= resumed_tick AND tick < resumed_tick + ? GROUP BY tick ORDER BY tick"""


def port(number_, source="inverter"):
    return lambda document: document["sources"][source]["modbus_tcp"].update(port=number_)


def meter(number_):
    """The speed comes from another device, as another signal; the torque from where it came from before."""
    def change(document):
        document["sources"]["meter"] = {"modbus_tcp": {"host": "127.0.0.1", "port": number_, "period_s": 0.005, "timeout_s": LATE_S}}
        document["plant"]["speed"] = {"unit": "rad/s", "min": -500, "max": 500, "stale_s": 0.2, "modbus": {
            "source": "meter", "unit_id": 1, "table": "input", "address": 0, "type": "float32"}}
        document["synchronise"]["match"]["motor.omega"]["to"] = "plant.speed"
    return change


def patient(number_):
    return {"plant": {name: {"stale_s": LATE_S} for name in ("torque", "omega")},
            "sources": {"inverter": {"modbus_tcp": {"port": number_, "timeout_s": LATE_S}}}}


def longest_outage(database, run):
    """From the flip on: for how long a signal was not good, in ns."""
    longest = since = 0
    for _, bad in query(database, NOT_GOOD, GOOD, run, SETTLED):
        since = since + STEP_NS if bad else 0
        longest = max(longest, since)
    return longest


def expect_kept(live, change, run, *options):
    candidate = live.edited(change)
    code, out, err = live.reload(candidate, "--wait", *(options or SHORT), timeout=HUNG_S)
    expect(code == 0 and "\nkept " in out and "the plant is read anew then" in out, f"{code}\n{out}{err}{live.log()}")
    wait_until(lambda: len(twins(live)) == 1, "one twin", live.log)
    at_most(longest_outage(live.database, run), STALE_NS, "ns in which a signal was not good")
    return candidate, out


def failures(live):
    return [text for (text,) in query(live.database, "SELECT text FROM events WHERE text LIKE '%failed%'")]


def test_another_device():
    """The same signals come from another host: nothing of it can be seen before; then all of it, at once."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child(role="io")
        candidate, out = expect_kept(live, port(other.port), 2)
        expect("it cannot see torque, omega" in out and "not seen" in out and "could not be judged" in out, out)
        expect("(new sources" in out, out)
        expect(live.child(role="io") != before and other.functions, "the other device is not asked")
        live.wait_for_tick(live.database)
        end_orderly(live)
        expect_flips(live.database, 1, 1)
        expect(not failures(live), f"{failures(live)}")
        expect_repeated(live.file, live.database, 1, 1)
        expect_repeated(candidate, live.database, 2, 1)


def test_one_signal_more():
    """From a new source, and matched; the one that was read before goes on without being stale."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port, **patient(device.port)) as live, moving(other):
        wait_for_run(live, live.database, 1)
        candidate, out = expect_kept(live, meter(other.port), 2)
        expect("it cannot see speed:" in out, out)
        torque = query(live.database, "SELECT count(*) FROM samples JOIN signals USING (run, signal) WHERE run = 2 AND kind = 'plant' AND name = 'plant.torque'"
                       " AND quality <> ?", GOOD)
        expect(torque == [(0,)], f"torque was not good {torque} times")
        code, out, err = live.reload(live.edited(lambda document: (meter(other.port)(document), horizon(2)(document))),
                                     "--wait", "--shadow", "2", "--probation", "2", "--require-lock", "10", timeout=HUNG_S)
        expect(code == 0 and "cannot see" not in out, f"a new twin of the same plant afterwards: {code}\n{out}{err}{live.log()}")
        end_orderly(live)
        expect_flips(live.database, 1, 1, 2)
        expect_repeated(candidate, live.database, 2, 1)


def test_limits_only():
    """How a reading is judged is no other source: the plant is read on, and the way back has no gap."""
    def change(document):
        document["plant"]["omega"].update(stale_s=0.5, max=400)

    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        before = live.child(role="io")
        code, out, err = live.reload(live.edited(change), *LONG, timeout=HUNG_S)
        expect(code == 0 and "(new sources" in out and "cannot see" not in out, f"{code}\n{out}{err}{live.log()}")
        expect(live.child(role="io") == before and len(twins(live)) == 2, f"{[title(pid) for pid in live.children()]}")
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and "by a flip" in out, f"{code}\n{out}{err}{live.log()}")
        end_orderly(live)
        expect_flips(live.database, 1, 1, 1)


def test_way_back():
    """By hand: the twin before cannot have seen the plant meanwhile, so it is gone, and the way is a restart."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(port(other.port)), *LONG, timeout=HUNG_S)
        expect(code == 0 and "a way back is by a restart" in out, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: len(twins(live)) == 1, "one twin", live.log)
        code, out, err = live.reload(None, "--rollback")
        expect(code == 0 and "by a restart" in out, f"{code}\n{out}{err}{live.log()}")
        wait_for_run(live, live.database, 3)
        expect(live.active() == 1, f"{live.versions()}")
        end_orderly(live)


def test_while_another_is_on_probation():
    """It takes its place, as any candidate; and what would be returned to is the same."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(horizon(2)), *LONG, timeout=HUNG_S)
        expect(code == 0 and len(twins(live)) == 2, f"{code}\n{out}{err}{live.log()}")

        def both(document):
            horizon(2)(document)
            port(other.port)(document)
        expect_kept(live, both, 3)
        expect(live.active() == 3, f"{live.versions()}")
        end_orderly(live)
        expect_flips(live.database, 1, 2, 2)


def test_deaths_at_any_moment():
    """While the plant is read from here and from there, who reads and who writes die now and then: ticks are there once, and the plant is read from where the disk says."""
    order = random.Random(20261124)
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live, moving(device), moving(other):
        wait_for_run(live, live.database, 1)
        stop = threading.Event()

        def kill():
            while not stop.wait(order.uniform(0.3, 2)):
                role = order.choice(("io", "recorder"))
                for pid in live.children():
                    if title(pid).startswith(f"twinlock: {role}"):
                        with contextlib.suppress(ProcessLookupError):
                            os.kill(pid, signal.SIGKILL)
        killer = threading.Thread(target=kill)
        killer.start()
        done = []
        for port_ in (other.port, device.port) * 3:
            done.append(live.reload(live.edited(port(port_)), "--wait", "--shadow", "1", "--probation", "2", "--require-lock", "1", timeout=HUNG_S))
        stop.set()
        killer.join()
        codes = [code for code, _, _ in done]
        expect(codes.count(0) >= 2, f"{codes}\n{done}\n{live.log()}")
        live.wait_for_tick(live.database, 100)
        versions = live.versions()
        active = live.version_on_disk(live.active())["hash"]
        silent, asked = (device, other) if str(other.port) in (live.state / "versions" / f"{active}.json").read_text(encoding="utf-8") else (other, device)
        asked.functions.clear()
        silent.functions.clear()
        wait_until(lambda: asked.functions, "a question to the device of the active version", live.log)
        expect(not silent.functions, f"both are asked: {versions}")
        end_orderly(live)
        expect_each_tick_once(live.database, codes)


def expect_each_tick_once(database, about):
    """Of the runs that go on with each other; one that began anew, since a change was returned from, has ticks of its own."""
    anew = [run for (run,) in query(database, "SELECT run FROM beginnings WHERE resumed_run IS NULL ORDER BY run")] + [1 << 30]
    ticks = [tick for (tick,) in query(database, "SELECT tick FROM (SELECT DISTINCT run, tick FROM samples JOIN beginnings USING (run)"
                                       " WHERE run < ? AND tick >= coalesce(resumed_tick, 0)) ORDER BY tick", anew[1])]
    expect(ticks == list(range(len(ticks))), f"{len(ticks)} ticks, {len(set(ticks))} different ones up to {max(ticks)}; {about}")


def nobody():
    """A port at which nobody listens."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_a_device_that_does_not_answer():
    """It is returned from before its time is over, and samples were taken all the while."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(port(nobody())), *LONG, timeout=HUNG_S)
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        wait_until(lambda: live.active() == 1, "the first version is back", live.log, every=0.5)
        expect("nothing of what is matched was good" in live.version_on_disk(2)["reason"], f"{live.version_on_disk(2)}")
        wait_for_run(live, live.database, 3)
        end_orderly(live)
        expect_each_tick_once(live.database, "")


def test_io_dies_at_the_flip():
    """Whoever comes next reads the plant of the run."""
    with Device(OMEGA) as device, Device(OMEGA) as other, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        expect_kept(live, port(other.port), 2)
        live.kill_one("io")
        device.silent = True
        live.wait_for_tick(live.database, 100)
        good = query(live.database, "SELECT count(*) FROM samples WHERE run = 2 AND quality = ? AND tick > (SELECT max(tick) FROM samples) - 20", GOOD)
        expect(good[0][0] > 0, f"nothing is read from the other device: {live.log()}")
        end_orderly(live)


if __name__ == "__main__":
    main()
