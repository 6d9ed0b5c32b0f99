#!/usr/bin/env python3
"""On the box: a live plant on a CAN bus: lock, replay, every kind of frame, and emulated
controllers. A run sends nothing."""
import re
import signal
import struct
import time
from pathlib import Path

from can_bus import (ERROR, EXTENDED, OMEGA, REMOTE, Bus, Motor, Wire, events_with, interface_down, interface_up,
                     ip, live_config, make_interface, remove_interface, transmitted, wait_for_value)
from live_test import (GOOD, NO_LINK, NOT_A_NUMBER, Program, check_database, check_replay, check_summary, end_well, events,
                       wait_for_lock, wait_for_quality, wait_for_steps, wait_until)
from twinlock_test import PLAIN_CAN, edited_config, expect, expect_line, main, run

UP = "notice|vcan0|up"


# ---- in lock ----

def test_lock_and_replay():
    config = edited_config(PLAIN_CAN, {"duration_s": 6})
    database = config.parent / "run.db"
    before = transmitted()
    with Wire() as wire, Program("run", config, "--json", "--db", database) as live:
        live.wait_for(UP)
        with Program("plant", config) as plant:
            plant.wait_for("CAN|vcan0")
            told, _ = end_well(live)
            code, _, log = plant.end(signal.SIGTERM)
    expect(code == 0, f"the plant ended with {code}\n{log}")
    sent, dropped = map(int, re.search(r"(\d+) frames\D+(\d+)", log).groups())
    expect(dropped == 0, log)
    expect(transmitted() - before == sent == len(wire.frames),
           f"the plant sent {sent} frames, the bus saw {transmitted() - before}, the wire {len(wire.frames)}")
    rows = check_summary(told, database)
    check_database(database)
    in_lock = told["outcomes"]["first guess"] + told["outcomes"]["optimised"]
    expect(in_lock > told["steps"] / 2, f"most steps not in lock: {told['outcomes']}")
    print(f"    {told['steps']} steps, {told['skipped']} skipped, {in_lock} in lock, {sent} frames, "
          f"MSE {told['match']['motor.omega']['mse']:.4g} (rad/s)\u00b2")
    again = check_replay(config, database, rows)
    for key in "steps", "evaluations", "match", "adjust", "outcomes", "skipped":
        expect(again[key] == told[key], f"{key}: the run told {told[key]}, its replay {again[key]}")


def test_run_sends_nothing():
    """All frames on the wire are the test's, also while the run handles remote requests and errors.
    """
    config, database = live_config()
    before = transmitted()
    with Wire() as wire, Bus() as bus, Program("run", config, "--json") as live:
        for i in range(300):
            bus.send(0x18FEF100 | EXTENDED, struct.pack("<f4x", OMEGA + i / 100))
            bus.send(0x182, struct.pack(">h6x", i))
            bus.send(0x182 | REMOTE, b"")  # requests an answer
            bus.send(ERROR | 0x4, bytes((0, 0x10, 0, 0, 0, 0, 0, 0)))
            time.sleep(0.005)
        wait_for_steps(live, database, 100)
        end_well(live, signal.SIGTERM)
        sent = bus.sent
        wait_until(lambda: len(wire.frames) >= sent - 300, "the frames on the wire")  # without error frames
    expect(transmitted() - before == sent, f"{transmitted() - before} frames at the interface, {sent} are ours")
    foreign = [frame for frame in wire.frames
               if struct.unpack_from("=I", frame)[0] not in (0x18FEF100 | EXTENDED, 0x182, 0x182 | REMOTE)]
    expect(not foreign, f"{len(foreign)} foreign frames: {foreign[:3]}")


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
        live.wait_for(UP)
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
        live.wait_for("vcan0|0x400|7 bytes")
        motor.send(0x400, bytes((0, 0, 0, 0, 0, 0, 0, 45)))
        wait_for_value(live, database, "long", 45)
        live.wait_for("vcan0|0x400|8 bytes")
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect(events_with(database, "0x400|7 bytes") == 1, f"reported more than once: {events(database)}")
    check_replay(config, database, rows)


def test_j1939():
    """A PGN from any source, and one from one source to any destination."""
    speed = {"source": "bus", "pgn": 0xF004, "start": 24, "length": 16, "not_available": True}
    request = {"source": "bus", "pgn": 0xEA00, "source_address": 3, "start": 0, "length": 8}
    config, database = live_config(plant={"speed": {"can": speed}, "request": {"can": request}})
    with Motor(OMEGA) as motor, Program("run", config, "--json") as live:
        live.wait_for(UP)
        for source in (0x17, 0x21):
            motor.send(0x0CF00400 | source | EXTENDED, struct.pack("<3xH3x", 1000 + source))
            wait_for_value(live, database, "speed", 1000 + source)
        motor.send(0x18EA2103 | EXTENDED, bytes((7,) * 8))
        motor.send(0x18EA2104 | EXTENDED, bytes((9,) * 8))
        motor.send(0x18F00400 | EXTENDED, bytes((255,) * 8))
        wait_for_quality(live, database, "speed", NOT_A_NUMBER)
        wait_for_value(live, database, "request", 7)
        told, _ = end_well(live, signal.SIGTERM)
    check_replay(config, database, check_summary(told, database))


def test_plant_sends_every_kind():
    """The driver reads the frames that the emulated plant sends through the kernel."""
    names = [name for name in KINDS if name != "small_fd"]
    config, database = live_config(plant={name: {"can": {"source": "bus", **KINDS[name]}} for name in names})
    values = {"standard": 4095, "extended": 1, "wide": -0.1, "page_1": 200, "page_2": 201, "deep": 202, "long": 203}
    recording = config.parent / "kinds.csv"
    with open(recording, "w", encoding="utf-8") as file:
        file.write("t,M_brake,omega," + ",".join(names) + "\n")
        for i in range(3000):
            file.write(f"{i / 100},0,{OMEGA}," + ",".join(str(values[name]) for name in names) + "\n")
    with Program("run", config, "--json") as live:
        live.wait_for(UP)
        with Program("plant", config, "--recording", recording) as plant:
            for name in names:
                wait_for_value(live, database, name, values[name])
            end_well(live, signal.SIGTERM)
            expect(plant.end(signal.SIGTERM)[0] == 0, "the plant ended badly")


def test_interface_without_fd():
    """Classic frames arrive. The run and the plant report that the interface has no CAN FD."""
    remove_interface()
    make_interface(mtu=16)
    try:
        config, database = live_config(plant={"wide": {"can": {"source": "bus", **KINDS["wide"]}}})
        with Motor(OMEGA), Program("run", config, "--json") as live:
            live.wait_for("vcan0|up|CAN FD")
            wait_for_quality(live, database, "omega", GOOD)
            end_well(live, signal.SIGTERM)
        code, _, log = run(["plant", config, "--recording", write_recording(config)])
        expect(code == 75, f"the plant ended with {code}\n{log}")
        expect_line(log, "error|vcan0|CAN FD|mtu 72")
    finally:
        remove_interface()
        make_interface()


def write_recording(config):
    path = config.parent / "short.csv"
    path.write_text("t,M_brake,omega,wide\n0,0,1,2\n", encoding="utf-8")
    return path


# ---- real controllers ----

def test_controllers():
    """Two SJA1000 on one bus, emulated by QEMU: the plant at one, the run at the other."""
    if not all(Path("/sys/class/net", name).exists() for name in ("can0", "can1")):
        print("    no can0 and can1 here")
        return
    for name in "can0", "can1":
        ip("set", name, "up", "type", "can", "bitrate", "500000")
    config, database = live_config(sources={"bus": {"can": {"interface": "can0"}}})
    sending = edited_config(PLAIN_CAN, {"sources": {"bus": {"can": {"interface": "can1"}}}})
    code, _, log = run(["plant", sending])
    expect(code == 2, f"the plant ended with {code}\n{log}")
    expect_line(log, "error|can1|hardware|--real-bus")
    before = transmitted("can0")
    with Program("run", config, "--json") as live:
        live.wait_for("notice|can0|up")
        with Program("plant", sending, "--real-bus") as plant:
            wait_for_lock(live, database)
            interface_down("can0")
            wait_for_quality(live, database, "omega", NO_LINK)
            interface_up("can0")
            wait_for_quality(live, database, "omega", GOOD)
            told, _ = end_well(live, signal.SIGTERM)
            plant.end(signal.SIGTERM)
    for name in "can0", "can1":
        interface_down(name)
    expect(transmitted("can0") == before, "the run's controller has sent frames")
    check_replay(config, database, check_summary(told, database))


if __name__ == "__main__":
    main()
