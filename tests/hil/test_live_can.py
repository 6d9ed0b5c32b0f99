#!/usr/bin/env python3
"""A live plant on a real CAN bus: in lock, and what may happen to a bus: link down, interface gone, errors, floods, clocks
that are set. And that a run sends nothing.
"""
import re
import signal
import struct
import time
from pathlib import Path

from can_bus import (ERROR, EXTENDED, REMOTE, Bus, Motor, Wire, in_rig, interface_down, interface_up, ip, make_interface,
                     remove_interface, transmitted)
from live_test import (GOOD, NO_LINK, NOT_A_NUMBER, STALE, Program, check_database, check_free_run, check_replay,
                       check_summary, end_well, events, expect_events, expect_in_order, last_step, number, qualities,
                       query, SAMPLES, stop, wait_for_lock, wait_for_quality, wait_for_steps, wait_until)
from twinlock_test import at_most, edited_config, expect, main, run, within

LIVE = "motor/can.json"
OMEGA = 62.981  # rad/s: where config/motor's twin starts
FLOOD = 100000


def live_config(**changes):
    """can.json without an end, committed ten times a second; and the database's path."""
    config = edited_config(LIVE, {"duration_s": None, "record": {"commit_s": 0.1}, **changes})
    return config, config.parent / "twin.db"


def newest(database, name):
    """(quality, value) of the newest sample."""
    return query(database, SAMPLES + " ORDER BY tick DESC LIMIT 1", {"run": 1, "name": "plant." + name})[0][1:]


def wait_for_value(live, database, name, value):
    wait_for_steps(live, database, 1)
    wait_until(lambda: newest(database, name) == (GOOD, value), f"{name} = {value}",
               lambda: f"{newest(database, name)}\n{live.log()}")


def told_times(database, words):
    return sum(words in text for _, text in events(database))


# ---- in lock ----

def test_lock_and_replay():
    config = edited_config(LIVE, {"duration_s": 6})
    database = config.parent / "run.db"
    before = transmitted()
    with Wire() as wire, Program("run", config, "--json", "--db", database) as live:
        live.wait_for("is up")
        with Program("plant", config) as plant:
            plant.wait_for("by CAN at vcan0")
            told, _ = end_well(live)
            code, _, log = plant.end(signal.SIGTERM)
    expect(code == 0, f"the plant ended with {code}\n{log}")
    sent, dropped = map(int, re.search(r"(\d+) frames sent, (\d+) that the interface did not take", log).groups())
    expect(dropped == 0, log)
    expect(transmitted() - before == sent == len(wire.frames),
           f"the plant sent {sent} frames, the bus saw {transmitted() - before}, the wire {len(wire.frames)}")
    rows = check_summary(told, database)
    check_database(database)
    in_lock = told["outcomes"]["first guess"] + told["outcomes"]["optimised"]
    expect(in_lock > told["steps"] / 2, f"hardly ever in lock: {told['outcomes']}")
    print(f"    {told['steps']} steps, {told['skipped']} skipped, {in_lock} in lock, {sent} frames, "
          f"MSE {told['match']['motor.omega']['mse']:.4g} (rad/s)\u00b2")
    again = check_replay(config, database, rows)
    for key in "steps", "evaluations", "match", "adjust", "outcomes", "skipped":
        expect(again[key] == told[key], f"{key}: the run told {told[key]}, its replay {again[key]}")


def test_run_sends_nothing():
    """All there is on the wire is what we sent, although the run lives through every trouble."""
    config, database = live_config()
    before = transmitted()
    with Wire() as wire, Bus() as bus, Program("run", config, "--json") as live:
        for i in range(300):
            bus.send(0x18FEF100 | EXTENDED, struct.pack("<f4x", OMEGA + i / 100))
            bus.send(0x182, struct.pack(">h6x", i))
            bus.send(0x182 | REMOTE, b"")  # asks for an answer
            bus.send(ERROR | 0x4, bytes((0, 0x10, 0, 0, 0, 0, 0, 0)))
            time.sleep(0.005)
        wait_for_steps(live, database, 100)
        end_well(live, signal.SIGTERM)
        sent = bus.sent
        wait_until(lambda: len(wire.frames) >= sent - 300, "the frames on the wire")  # error frames are not asked for there
    expect(transmitted() - before == sent, f"{transmitted() - before} frames at the interface, {sent} are ours")
    foreign = [frame for frame in wire.frames
               if struct.unpack_from("=I", frame)[0] not in (0x18FEF100 | EXTENDED, 0x182, 0x182 | REMOTE)]
    expect(not foreign, f"{len(foreign)} frames that nobody sent: {foreign[:3]}")


# ---- the interface ----

def test_link_down_and_back():
    config, database = live_config()
    with Motor(OMEGA), Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        interface_down()
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(5)
        interface_up()
        live.wait_for("is up", times=2)
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "CAN interface vcan0: is up"), ("warning", "CAN interface vcan0: it is down: set it up"),
                  ("info", "CAN interface vcan0: is up"))
    expect(told_times(database, "it is down") == 1, f"told more than once: {events(database)}")
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK, GOOD], "quality of omega")
    expect_in_order(qualities(database, "torque"), [GOOD, NO_LINK, GOOD], "quality of torque")
    check_free_run(database)
    check_replay(config, database, rows)


def test_interface_removed_and_made_again():
    config, database = live_config()
    with Program("plant", config, "--recording", edited_config(LIVE).parent / "none.csv") as plant:
        expect(plant.end()[0] == 65, "a recording that is not there")
    with Program("run", config, "--json") as live:
        with Motor(OMEGA):
            wait_for_lock(live, database)
            remove_interface()
            wait_for_quality(live, database, "omega", NO_LINK)
            time.sleep(3)
        make_interface()
        with Motor(OMEGA):
            live.wait_for("is up", times=2)
            wait_for_quality(live, database, "omega", GOOD)
            wait_for_lock(live, database, last_step(database))
            told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("info", "is up"), ("warning", "it is gone"), ("info", "is up"))
    expect(told_times(database, "is gone") == 1, f"told more than once: {events(database)}")
    check_free_run(database)
    check_replay(config, database, rows)


def test_interface_comes_later():
    remove_interface()
    config, database = live_config()
    with Program("run", config, "--json") as live:
        live.wait_for("there is none of that name")
        wait_for_quality(live, database, "omega", NO_LINK)
        make_interface()
        live.wait_for("is up")
        with Motor(OMEGA):
            wait_for_lock(live, database)
            told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))


def test_not_a_can_interface():
    config, database = live_config(sources={"bus": {"can": {"interface": "lo"}}})
    with Program("run", config, "--json") as live:
        live.wait_for("it is no CAN interface")
        wait_for_steps(live, database, 20)
        end_well(live, signal.SIGTERM)


# ---- errors on the bus ----

def test_error_frames():
    """As a controller's driver would pass them up."""
    config, database = live_config()

    def controller(bits):
        return ERROR | 0x4, bytes((0, bits, 0, 0, 0, 0, 0, 0))

    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        for bits, words in ((0x04, "error warning"), (0x10, "error passive"), (0x40, "error active again")):
            for _ in range(3):
                motor.send(*controller(bits))
            live.wait_for(words)
        motor.send(*controller(0x01))
        live.wait_for("the controller lost frames 1 times")
        time.sleep(1.1)
        for _ in range(500):  # "may flood"
            motor.send(ERROR | 0x88, bytes((0, 0, 0x04, 0, 0, 0, 0, 0)))
        live.wait_for("errors on the bus (bit stuffing errors)")
        expect(newest(database, "omega")[0] == GOOD, "errors have cost a value")
        motor.quiet = True
        time.sleep(0.05)
        motor.send(ERROR | 0x40, bytes(8))
        live.wait_for("bus-off")
        wait_for_quality(live, database, "omega", NO_LINK)
        time.sleep(0.5)
        motor.send(ERROR | 0x100, bytes(8))
        motor.quiet = False
        live.wait_for("is up", times=2)
        wait_for_quality(live, database, "omega", GOOD)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    for words in "error warning", "error passive", "error active", "bus-off":
        expect(told_times(database, words) == 1, f"\"{words}\" not once in {events(database)}")
    at_most(told_times(database, "bit stuffing"), 4, "times that bus errors were told")
    counted = [int(match[1]) for _, text in events(database) if (match := re.search(r"(\d+) errors on the bus", text))]
    expect(sum(counted) == 500, f"told of {counted} bus errors")
    check_free_run(database)
    check_replay(config, database, rows)


# ---- floods ----

def reader_thread(pid):
    """/proc of the thread that reads the bus."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        if (task / "comm").read_text().strip() == "io bus":
            return task
    raise AssertionError("no thread \"io bus\"")


def wake_ups(task):
    return int(re.search(r"^voluntary_ctxt_switches:\s+(\d+)", (task / "status").read_text(), re.M)[1])


def test_flood_of_other_ids():
    """The kernel keeps them away: the reader wakes as rarely as on a silent bus."""
    config, database = live_config()
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        wait_for_quality(live, database, "omega", STALE)
        task = reader_thread(live.pid)
        woken, begun = wake_ups(task), time.monotonic()
        with Bus() as bus:
            for i in range(FLOOD):
                bus.send(0x183 if i % 2 else 0x18FEF101 | EXTENDED, bytes(8))
        seconds = time.monotonic() - begun
        woken = wake_ups(task) - woken
        print(f"    {FLOOD} frames in {seconds:.1f} s, {woken} wake-ups of the reader")
        at_most(woken, 60 * seconds + 60, "wake-ups while others talk (a poll of 50 ms and a rest make 40 a second)")
        motor.quiet = False
        wait_for_quality(live, database, "omega", GOOD)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    check_replay(config, database, rows)


def test_flood_of_own_ids():
    config, database = live_config()
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        begun = time.monotonic()
        with Bus() as bus:
            for i in range(FLOOD):
                bus.send(0x182, struct.pack(">h6x", i % 1000))
            bus.send(0x182, struct.pack(">h6x", 1234))
        seconds = time.monotonic() - begun
        wait_for_value(live, database, "torque", 1234 * 0.001)
        print(f"    {FLOOD} frames in {seconds:.1f} s")
        motor.quiet = False
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    lost = told_times(database, "frames lost")
    at_most(lost, seconds + 2, "times that lost frames were told")
    check_replay(config, database, rows)


def test_frames_lost_are_counted():
    """Whoever does not read loses frames, and hears how many when it reads again."""
    config, database = live_config()
    count = 20000
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        motor.quiet = True
        time.sleep(0.2)
        stop(live)
        for _ in range(count):
            motor.send(0x182, struct.pack(">h6x", 55))
        live.signal(signal.SIGCONT)
        motor.quiet = False
        live.wait_for("frames lost: they came faster than they were read")
        wait_for_value(live, database, "torque", 0)
        told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))
    counted = sum(int(match[1]) for _, text in events(database) if (match := re.search(r"(\d+) frames lost", text)))
    expect(0 < counted < count, f"told that {counted} of {count} frames were lost")
    print(f"    {counted} of {count} frames lost")


# ---- frames of every kind ----

KINDS = {
    "standard": {"id": 0x123, "start": 0, "length": 12},
    "extended": {"id": "0x123", "extended": True, "start": 0, "length": 12},
    "wide": {"id": "0x200", "bytes": 64, "start": 448, "length": 64, "type": "float64"},
    "small_fd": {"id": "0x201", "fd": True, "start": 7, "length": 16, "order": "motorola", "type": "signed"},
    "page_1": {"id": "0x300", "start": 8, "length": 8, "multiplex": {"start": 0, "length": 4, "value": 1}},
    "page_2": {"id": "0x300", "start": 8, "length": 8, "multiplex": {"start": 0, "length": 4, "value": [2, 3]}},
    "deep": {"id": "0x300", "start": 16, "length": 8,
             "multiplex": {"start": 4, "length": 4, "value": 7, "multiplex": {"start": 0, "length": 4, "value": 1}}},
    "long": {"id": "0x400", "start": 56, "length": 8},
}


def test_kinds_of_frames():
    config, database = live_config(plant={name: {"can": {"source": "bus", **can}} for name, can in KINDS.items()})
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        live.wait_for("is up")
        motor.send(0x123, struct.pack("<H6x", 0xF111))
        motor.send(0x123 | EXTENDED, struct.pack("<H6x", 0x222))
        motor.send(0x123 | REMOTE, bytes(8))
        motor.send(0x200, bytes(56) + struct.pack("<d", -0.1), fd=True)
        motor.send(0x201, struct.pack(">h", -300), fd=True)
        motor.send(0x300, bytes((0x01, 11, 99)))
        motor.send(0x300, bytes((0x03, 22, 99)))
        motor.send(0x300, bytes((0x71, 12, 33)))
        motor.send(0x300, bytes((0x74, 99, 99)))
        motor.send(0x400, bytes((0, 0, 0, 0, 0, 0, 0, 44)))
        for name, value in (("standard", 0x111), ("extended", 0x222), ("wide", -0.1), ("small_fd", -300), ("page_1", 12),
                            ("page_2", 22), ("deep", 33), ("long", 44)):
            wait_for_value(live, database, name, value)
        for _ in range(3):
            motor.send(0x400, bytes(7))
        wait_for_quality(live, database, "long", NOT_A_NUMBER)
        live.wait_for("frames of id 0x400 have 7 bytes, and not all bits of its signals are in them")
        motor.send(0x400, bytes((0, 0, 0, 0, 0, 0, 0, 45)))
        wait_for_value(live, database, "long", 45)
        live.wait_for("frames of id 0x400 have 8 bytes, and all their signals again")
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect(told_times(database, "have 7 bytes") == 1, f"told more than once: {events(database)}")
    check_replay(config, database, rows)


def test_plant_sends_every_kind():
    """The emulated plant's frames, through the kernel, are what the driver reads."""
    names = [name for name in KINDS if name != "small_fd"]
    config, database = live_config(plant={name: {"can": {"source": "bus", **KINDS[name]}} for name in names})
    values = {"standard": 4095, "extended": 1, "wide": -0.1, "page_1": 200, "page_2": 201, "deep": 202, "long": 203}
    recording = config.parent / "kinds.csv"
    with open(recording, "w", encoding="utf-8") as file:
        file.write("t,M_brake,omega," + ",".join(names) + "\n")
        for i in range(3000):
            file.write(f"{i / 100},0,{OMEGA}," + ",".join(str(values[name]) for name in names) + "\n")
    with Program("run", config, "--json") as live:
        live.wait_for("is up")
        with Program("plant", config, "--recording", recording) as plant:
            for name in names:
                wait_for_value(live, database, name, values[name])
            end_well(live, signal.SIGTERM)
            expect(plant.end(signal.SIGTERM)[0] == 0, "the plant ended badly")


def test_interface_without_fd():
    """Classic frames come; that the others cannot is said, by both sides."""
    remove_interface()
    make_interface(mtu=16)
    try:
        config, database = live_config(plant={"wide": {"can": {"source": "bus", **KINDS["wide"]}}})
        with Motor(OMEGA), Program("run", config, "--json") as live:
            live.wait_for("is up, but not for CAN FD")
            wait_for_quality(live, database, "omega", GOOD)
            end_well(live, signal.SIGTERM)
        code, _, log = run(["plant", config, "--recording", write_recording(config)])
        expect(code == 75 and "does not take frames of CAN FD" in log, f"the plant ended with {code}\n{log}")
    finally:
        remove_interface()
        make_interface()


def write_recording(config):
    path = config.parent / "short.csv"
    path.write_text("t,M_brake,omega,wide\n0,0,1,2\n", encoding="utf-8")
    return path


# ---- clocks ----

AGES = """SELECT max(tick * 10000000 - stamp_ns), min(tick * 10000000 - stamp_ns)
    FROM samples JOIN signals USING (run, signal) WHERE run = 1 AND kind = 'plant' AND name = 'plant.omega'
    AND tick BETWEEN ? AND ?"""


def test_wall_clock_is_set():
    """Stamps are CLOCK_MONOTONIC, whatever happens to the wall clock: no sample is from the future, none is older than a
    busy machine makes it (a stamp that followed the wall clock would be wrong by hours)."""
    config, database = live_config(plant={"omega": {"stale_s": 2}, "torque": {"stale_s": 2}})
    true_time = time.clock_gettime(time.CLOCK_REALTIME)
    begun = time.monotonic()
    try:
        with Motor(OMEGA), Program("run", config, "--json") as live:
            wait_for_lock(live, database)
            first = last_step(database)
            wait_for_steps(live, database, first + 100)
            last = last_step(database)
            for offset in 86400, -7200, 0.5, -0.02:
                time.clock_settime(time.CLOCK_REALTIME, time.clock_gettime(time.CLOCK_REALTIME) + offset)
                wait_for_steps(live, database, last_step(database) + 50)
            told, _ = end_well(live, signal.SIGTERM)
    finally:
        time.clock_settime(time.CLOCK_REALTIME, true_time + time.monotonic() - begun)
    check_replay(config, database, check_summary(told, database))
    expect(qualities(database, "omega")[-1] == GOOD and STALE not in qualities(database, "omega"),
           f"qualities of omega: {qualities(database, 'omega')}")
    before, after = query(database, AGES, first, last)[0], query(database, AGES, last, 10**9)[0]
    print(f"    samples were {before[1] / 1e6:.2f} to {before[0] / 1e6:.2f} ms old, while the clock was set "
          f"{after[1] / 1e6:.2f} to {after[0] / 1e6:.2f} ms")
    expect(min(before[1], after[1]) >= 0, "a sample from the future")


# ---- real controllers ----

def test_controllers():
    """Two SJA1000 on one bus, as QEMU emulates them: the plant at one, the run at the other."""
    if not all(Path("/sys/class/net", name).exists() for name in ("can0", "can1")):
        print("    no can0 and can1 here")
        return
    for name in "can0", "can1":
        ip("set", name, "up", "type", "can", "bitrate", "500000")
    config, database = live_config(sources={"bus": {"can": {"interface": "can0"}}})
    sending = edited_config(LIVE, {"sources": {"bus": {"can": {"interface": "can1"}}}})
    code, _, log = run(["plant", sending])
    expect(code == 2 and "is hardware" in log, f"the plant ended with {code}\n{log}")
    before = transmitted("can0")
    with Program("run", config, "--json") as live:
        live.wait_for("CAN interface can0: is up")
        with Program("plant", sending, "--real-bus") as plant:
            wait_for_lock(live, database)
            interface_down("can0")
            wait_for_quality(live, database, "omega", NO_LINK)
            interface_up("can0")
            wait_for_quality(live, database, "omega", GOOD)
            told, _ = end_well(live, signal.SIGTERM)
            plant.end(signal.SIGTERM)
    expect(transmitted("can0") == before, "the run's controller has sent frames")
    check_replay(config, database, check_summary(told, database))


if __name__ == "__main__":
    in_rig()
    main()
