#!/usr/bin/env python3
"""`twinlock probe` on a real Modbus server (pymodbus), FIFOs and absent devices.

The device has the registers of the motor bench: speed as float32 in the input registers 0 and 1,
torque as int16 in register 2. Each test changes how the configuration reads them.
"""
import asyncio
import contextlib
import json
import logging
import os
import signal
import socket
import struct
import sys
import threading

try:
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice
except ImportError as reason:
    print(f"no pymodbus here: {reason}")
    sys.exit(1 if os.environ.get("CI") == "true" else 77)

from live_test import Device, Program, member, wait_until  # noqa: E402 (a skip comes first)
from twinlock_test import (BAD_DATA, BAD_USAGE, PLAIN_BOX, PLAIN_LIVE, PLANT_DOWN, Skip, edited_config,  # noqa: E402
                           expect, has_line, main, merge, run)

OMEGA, TORQUE = struct.unpack(">f", bytes.fromhex("427BEC8B"))[0], 542
TRY_AGAIN = 75
logging.disable(logging.CRITICAL)  # pymodbus logs each exception that it sends
SPEED = struct.unpack(">HH", struct.pack(">f", OMEGA))


class Server:
    """A pymodbus server in a thread: units -> {table (1 to 4): {address: registers}}.

    `missing`: exception for all other units; None: they are silent.
    """

    def __init__(self, units, port=0, missing=None):
        self.units, self.wanted, self.missing, self.functions = units, port, missing, set()
        self.loop = asyncio.new_event_loop()
        self.ready = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def trace(self, sending, pdu):
        if not sending:
            self.functions.add(pdu.function_code)
        elif pdu.dev_id not in self.units:
            pdu.exception_code = self.missing
        return pdu

    async def serve(self):
        devices = []
        for unit, tables in self.units.items():
            bits = [[SimData(9, values=[False], datatype=DataType.BITS)] for _ in (1, 2)]
            words = [[SimData(address, values=list(values), datatype=DataType.REGISTERS)
                      for address, values in sorted(tables.get(table, {9000: [0]}).items())] for table in (3, 4)]
            devices.append(SimDevice(unit, simdata=(*bits, *words)))
        self.server = ModbusTcpServer(devices, address=("127.0.0.1", self.wanted), trace_pdu=self.trace,
                                      ignore_missing_devices=self.missing is None)
        await self.server.serve_forever(background=True)
        self.port = self.server.transport.sockets[0].getsockname()[1]
        self.ready.set()

    def run(self):
        asyncio.set_event_loop(self.loop)
        self.loop.create_task(self.serve())
        self.loop.run_forever()

    def __enter__(self):
        self.thread.start()
        expect(self.ready.wait(30), "the pymodbus server does not start")
        return self

    def __exit__(self, *_):
        asyncio.run_coroutine_threadsafe(self.server.shutdown(), self.loop).result(30)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(30)
        expect(self.functions <= {1, 2, 3, 4}, f"function codes {self.functions} were sent")


def bench(omega=SPEED, address=0, table=4):
    return Server({1: {table: {address: [*omega, TORQUE]}}})


def probe_config(port, omega=None, torque=None, timeout_s=5, **changes):
    """The bench without FMU files. `omega`, `torque`: changes of the keys of their `modbus`. A loaded machine
    must not make a device silent or a value stale."""
    return edited_config(PLAIN_LIVE, merge({
        "components": {"motor": {"fmu": "absent.fmu"}},
        "sources": {"inverter": {"modbus_tcp": {"port": port, "timeout_s": timeout_s}}},
        "plant": {"omega": {"stale_s": 30, "modbus": omega or {}},
                  "torque": {"stale_s": 30, "modbus": torque or {}}}}, changes))


def probe(config, seconds=2):
    """(exit code, report, log) of a probe."""
    code, out, log = run(["probe", config, "--duration", seconds, "--json"])
    return code, json.loads(out) if out else None, log


def expect_qualities(code, report, omega, torque):
    found = {name: one["quality"] for name, one in report["signals"].items()}
    expect(found == {"omega": omega, "torque": torque}, f"{report}")
    good = omega == torque == "good"
    expect(report["good"] == good and code == (0 if good else BAD_DATA), f"exit code {code}: {report}")


# ---- Modbus ----

def test_a_right_mapping():
    with bench() as server:
        config = probe_config(server.port)
        code, report, _ = probe(config)
        expect_qualities(code, report, "good", "good")
        omega, torque = report["signals"]["omega"], report["signals"]["torque"]
        expect((omega["value"], torque["value"]) == (OMEGA, TORQUE * 0.001), f"{report}")
        expect((omega["unit"], torque["unit"], omega["source"]) == ("rad/s", "N.m", "inverter"), f"{report}")
        expect(omega["readings"] > 1 and omega["readings_per_s"] > 0 and omega["age_s"] >= 0, f"{report}")
        expect(omega["unchanged"] and omega["rejected"] == 0, f"{report}")
        expect((omega["registers"], torque["registers"]) == ("0..1: 427B EC8B", "2..2: 021E"), f"{report}")
        code, out, _ = run(["probe", config, "--duration", 0.5])
        expect(code == 0 and has_line(out, "omega|62.981|rad/s|ok") and has_line(out, "torque|0.542|N.m|ok"), out)
        expect(server.functions == {4}, f"{server.functions}")


def test_a_moving_signal_has_changed():
    with Device(OMEGA) as device:
        stop = threading.Event()

        def move():
            while not stop.wait(0.02):
                device.omega += 0.125
        mover = threading.Thread(target=move)
        mover.start()
        _, report, _ = probe(probe_config(device.port))
        stop.set()
        mover.join()
        expect(not report["signals"]["omega"]["unchanged"] and report["signals"]["torque"]["unchanged"], f"{report}")


def test_a_wrong_word_order():
    with bench() as server:
        code, report, _ = probe(probe_config(server.port, {"words": "little"}))
        expect_qualities(code, report, "out of range", "good")
        expect(report["signals"]["omega"]["rejected"] == report["signals"]["omega"]["readings"], f"{report}")
        expect(has_line(report["signals"]["omega"]["verdict"], "-500|500|word order"), f"{report}")


def test_not_a_number():
    with bench((0x7FC0, 0)) as server:
        code, report, _ = probe(probe_config(server.port))
        expect_qualities(code, report, "not a number", "good")
        expect(report["signals"]["omega"]["value"] is None, f"{report}")


def test_a_wrong_table():
    with bench() as server:
        code, report, _ = probe(probe_config(server.port, {"table": "holding"}))
        expect_qualities(code, report, "no link", "good")
        expect(has_line(report["signals"]["omega"]["verdict"], "holding register 0 to 1|Illegal data address"), f"{report}")


def test_each_signal_has_its_own_cause():
    with bench() as server:
        code, report, _ = probe(probe_config(server.port, {"table": "holding"}, {"address": 7000}))
        expect_qualities(code, report, "no link", "no link")
        expect(has_line(report["signals"]["omega"]["verdict"], "holding register 0 to 1"), f"{report}")
        expect(has_line(report["signals"]["torque"]["verdict"], "input register 7000 to 7000"), f"{report}")


def test_a_wrong_offset():
    with bench() as server:
        code, report, _ = probe(probe_config(server.port, {"address": 1}, {"address": 3}))
        expect(code == BAD_DATA and report["signals"]["torque"]["quality"] == "no link", f"{report}")


def test_a_wrong_port():
    with bench() as server:
        port = server.port
    code, report, _ = probe(probe_config(port))
    expect_qualities(code, report, "no link", "no link")
    expect(has_line(report["signals"]["omega"]["verdict"], f"{port}|refused"), f"{report}")


def test_a_silent_device():
    with Device(OMEGA) as device:
        device.silent = True
        code, report, _ = probe(probe_config(device.port, timeout_s=0.2))
        expect_qualities(code, report, "no link", "no link")
        expect(has_line(report["signals"]["omega"]["verdict"], "answer|0.2 s"), f"{report}")


# Address, registers, keys of `modbus`, value (None: not a number).
EVERY_TYPE = {
    "int8": (10, "FB03", {"type": "int8", "byte": "high", "not_available": [-128]}, -5),
    "uint8": (10, "FB03", {"type": "uint8", "byte": "low"}, 3),
    "bit": (10, "FB03", {"type": "bit", "bit": 1}, 1),
    "bcd16": (11, "1234", {"type": "bcd16", "not_available": [9999]}, 1234),
    "bcd32": (12, "5678 1234", {"type": "bcd32", "words": "little"}, 12345678),
    "int16": (14, "FBFF", {"type": "int16", "bytes": "little", "scale": 0.5, "offset": 10}, 7.5),
    "uint16": (15, "8001", {"type": "uint16", "not_available": [32768, 65535]}, 32769),
    "int32": (16, "FFFB FFFF", {"type": "int32", "words": "little", "not_available": [-1]}, -5),
    "uint32": (18, "FFFF 0000", {"type": "uint32", "words": "little", "not_available": [4294901760]}, 65535),
    "float32": (20, "2040 0000", {"type": "float32", "bytes": "little", "not_available": [-1]}, 2.5),
    "int64": (22, "FFFF FFFF FFFF FFFB", {"type": "int64", "not_available": [-1]}, -5),
    "uint64": (26, "FFF0 0000 0000 0000", {"type": "uint64", "words": "little", "scale": 0.5}, 32760),
    "float64": (30, "FFF0 0000 0000 4004", {"type": "float64", "words": "little"}, 2.5 + 0xFFF0 / 2**51),
    "no_int16": (34, "8000", {"type": "int16", "not_available": [32768]}, None),
    "no_uint32": (35, "0000 FFFF", {"type": "uint32", "words": "little", "not_available": [4294901760]}, None),
    "no_int64": (37, "FFFF FFFF FFFF FFFF", {"type": "int64", "not_available": [-1]}, None),
    "no_float64": (41, "7FF8 0000 0000 0000", {"type": "float64"}, None),
}


def test_every_type_and_key():
    memory = {address: [int(word, 16) for word in words.split()] for address, words, _, _ in EVERY_TYPE.values()}
    plant = {name: {"modbus": {"source": "inverter", "table": "input", "address": address, **keys}}
             for name, (address, _, keys, _) in EVERY_TYPE.items()}
    plant["discrete"] = {"modbus": {"source": "inverter", "table": "discrete", "address": 9}}
    with Server({1: {4: {0: [*SPEED, TORQUE], **memory}}}) as server:
        code, report, log = probe(probe_config(server.port, plant=plant))
    expect(code == BAD_DATA and report, f"exit code {code}: {log}")
    signals = report["signals"]
    for name, (address, words, _, value) in EVERY_TYPE.items():
        one, count = signals[name], len(words.split())
        expect((one["value"], one["quality"]) == (value, "not a number" if value is None else "good"), f"{name}: {one}")
        wanted = None if name == "no_float64" else f"{address}..{address + count - 1}: {words}"
        expect(one["registers"] == wanted, f"{name}: {one}")
    good = [signals[name]["quality"] for name in ("omega", "torque", "discrete")]
    expect(good == ["good"] * 3 and signals["discrete"]["value"] == 0, f"{signals}")


# ---- other mappings ----

def expect_cures(report, omega=None, torque=None):
    """Each is None, or parts of the text (see has_line())."""
    for name, parts in ("omega", omega), ("torque", torque):
        cure = report["signals"][name]["cure"]
        expect(cure is None if parts is None else cure and has_line(cure, parts), f"{name}, expected {parts}: {report}")
        words = {word for word in ("words", "bytes", "table", "address", "unit_id", "port", "type", "scale", "framing") if cure and f'"{word}"' in cure}
        expect(words == {word for word in words if f'"{word}"' in parts}, f"{name}, expected only {parts}: {report}")


def expect_no_keys(report):
    cures = [one["cure"] for one in report["signals"].values()]
    expect(all(cure is None or ("display" in cure and '"' not in cure) for cure in cures), f"{report}")


def test_cures():
    """One change at a time, then two."""
    for omega, torque, wanted in (
            ({"words": "little"}, {}, ('likely|"words": "big"', None)),
            ({"table": "holding"}, {"table": "holding"}, ('"table": "input"', '"table": "input"')),
            ({"address": 1}, {"address": 3}, ('"address": 0', '"address": 2')),
            ({"address": 1, "words": "little"}, {"address": 3}, ('"address": 0|"words": "big"', '"address": 2')),
            ({"address": 1, "table": "holding"}, {"address": 3, "table": "holding"},
             ('"table": "input"|"address": 0', '"table": "input"|"address": 2'))):
        with bench() as server:
            config = probe_config(server.port, omega, torque)
            code, report, _ = probe(config)
            expect(code == BAD_DATA, f"exit code {code}")
            expect_cures(report, *wanted)


def test_a_right_signal_keeps_its_order():
    """Only one signal of the source has the wrong order."""
    with Server({1: {4: {0: [*SPEED, TORQUE, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFB]}}}) as server:
        total = {"modbus": {"source": "inverter", "table": "input", "address": 3, "type": "int64"}}
        code, report, _ = probe(probe_config(server.port, {"words": "little"}, plant={"total": total}))
        expect(code == BAD_DATA, f"exit code {code}")
        expect_cures(report, 'likely|"words": "big"')
        expect((report["signals"]["total"]["value"], report["signals"]["total"]["cure"]) == (-5, None), f"{report}")


def test_64_bits_are_cured():
    """Negative integers and fractions, of which a double does not hold the registers in each order."""
    total, energy = [0xE364, 0xFFFF, 0xFFFF, 0xFFFF], [0x0004, 0x0000, 0xFFF0, 0x4004]
    with Server({1: {4: {0: [*SPEED[::-1], TORQUE, *total, *energy]}}}) as server:
        plant = {name: {"min": -10000, "max": 10000, "modbus": {"source": "inverter", "table": "input", "address": address, "type": kind}}
                 for name, address, kind in (("total", 3, "int64"), ("energy", 7, "float64"))}
        _, report, _ = probe(probe_config(server.port, {"words": "little"}, plant=plant))
        cures = {name: one["cure"] for name, one in report["signals"].items()}
        expect(cures["omega"] is None and all(has_line(cures[name] or "", 'likely|"words": "little"') for name in plant), f"{report}")


def test_a_cure_cures():
    with bench(address=1) as server:
        code, out, _ = run(["probe", probe_config(server.port), "--duration", 2])
        expect(code == BAD_DATA and has_line(out, 'plant.omega.modbus|"address": 1') and
               has_line(out, 'plant.torque.modbus|"address": 3'), out)
        code, report, _ = probe(probe_config(server.port, {"address": 1}, {"address": 3}))
        expect_qualities(code, report, "good", "good")
        expect_cures(report)


def test_another_unit():
    """Other units are silent, or their gateway says that they do not answer."""
    for missing in (None, 11):
        with Server({3: {4: {0: [*SPEED, TORQUE]}}}, missing=missing) as server:
            code, report, _ = probe(probe_config(server.port, {"unit_id": 9}, {"unit_id": 9}, timeout_s=1))
            expect(code == BAD_DATA, f"exit code {code}")
            expect_cures(report, 'perhaps|"unit_id": 3', 'perhaps|"unit_id": 3')


def test_another_port():
    with bench() as server:
        closed = server.port
    try:
        socket.create_server(("127.0.0.1", 502)).close()
    except OSError as reason:
        raise Skip(f"port 502 cannot be bound: {reason}") from reason
    with Server({1: {4: {0: [*SPEED, TORQUE]}}}, 502):
        code, report, _ = probe(probe_config(closed))
        expect(code == BAD_DATA, f"exit code {code}")
        expect_cures(report, '"port": 502', '"port": 502')


def test_several_cures():
    """The same values are above and below, and the speed is here in the other word order."""
    with Server({1: {4: {99: [*SPEED, *SPEED, TORQUE]}}}) as server:
        config = probe_config(server.port, {"address": 100}, {"address": 102})
        code, report, _ = probe(config)
        expect(code == BAD_DATA, f"exit code {code}")
        expect_cures(report, "display")
        _, out, _ = run(["probe", config, "--duration", 2])
        expect(has_line(out, "plant.omega.modbus|display") and "likely" not in out, out)


def test_a_right_mapping_is_not_cured():
    """A sensor is out of range, off or missing: other mappings are not even tried. The other tables
    and addresses hold plausible values."""
    for speed, torque in ((600.0, TORQUE), (float("nan"), TORQUE), (float("nan"), 30000), (600.0, 0)):
        words = struct.unpack(">HH", struct.pack(">f", speed))
        with Server({1: {4: {0: [*words, torque, *SPEED]}, 3: {0: [*SPEED, TORQUE, *SPEED]}}}) as server:
            code, report, log = probe(probe_config(server.port))
            expect(code == BAD_DATA and not has_line(log, "other mappings"), log)
            expect_no_keys(report)
            expect(server.functions == {4}, f"{server.functions}")


def test_one_value_proves_little():
    """The speed has the number of a faulty sensor; the holding registers have a set point."""
    words = struct.unpack(">HH", struct.pack(">f", 1e20))
    with Server({1: {4: {0: [*words, TORQUE]}, 3: {0: [*SPEED, TORQUE]}}}) as server:
        code, report, _ = probe(probe_config(server.port))
        expect(code == BAD_DATA, f"exit code {code}")
        expect_cures(report, "display", "display")


def test_interrupted_while_it_tries():
    with bench() as server, Program("probe", probe_config(server.port, {"address": 1}, {"address": 3}),
                                    "--json", "--duration", 2) as program:
        program.wait_for("other mappings")
        code, out, _ = program.end(signal.SIGINT)
        expect(code == BAD_DATA, f"exit code {code}")
        expect_cures(json.loads(out))


def test_a_dead_process_while_it_tries():
    with Device(OMEGA) as device:
        device.silent = True
        config = probe_config(device.port, timeout_s=2)
        with Program("probe", config, "--json", "--duration", 4) as program:
            program.wait_for("other mappings")
            os.kill(member(program, "io"), signal.SIGKILL)
            code, out, log = program.end()
        expect(code == BAD_DATA and has_line(log, "warning|other mappings|9"), f"{code}: {log}")
        expect_cures(json.loads(out))


# ---- other drivers ----

def csv_config(file):
    return edited_config(PLAIN_LIVE, {
        "components": {"motor": {"fmu": "absent.fmu"}}, "sources": {"inverter": None, "stream": {"csv": {"file": file}}},
        "plant": {name: {"modbus": None, "csv": {"source": "stream"}, "stale_s": None} for name in ("omega", "torque")}})


def test_a_fifo_without_a_writer():
    config = csv_config("plant.fifo")
    os.mkfifo(config.parent / "plant.fifo")
    code, report, _ = probe(config)
    expect_qualities(code, report, "no link", "no link")
    expect(has_line(report["signals"]["omega"]["verdict"], "plant.fifo|writer"), f"{report}")


@contextlib.contextmanager
def written(path, header):
    """A program that writes rows into a FIFO until the end of `with`."""
    stop = threading.Event()
    os.mkfifo(path)
    file = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def write():
        count = 0
        while not stop.wait(0.02):
            rows = f"{header}\n" if count == 0 else f"{count / 50},{count},0.5\n"
            os.write(file, rows.encode())
            count += 1
    writer = threading.Thread(target=write)
    writer.start()
    try:
        yield
    finally:
        stop.set()
        writer.join()
        os.close(file)


def test_a_stream():
    config = csv_config("plant.fifo")
    with written(config.parent / "plant.fifo", "time,omega,M_brake"):
        code, report, _ = probe(config)
    expect_qualities(code, report, "good", "good")
    expect(report["signals"]["torque"]["value"] == 0.5 and not report["signals"]["omega"]["unchanged"], f"{report}")


def test_a_wrong_column():
    config = csv_config("plant.fifo")
    with written(config.parent / "plant.fifo", "time,speed,M_brake"):
        code, report, _ = probe(config)
    expect_qualities(code, report, "no link", "no link")
    expect(has_line(report["signals"]["omega"]["verdict"], "omega|speed"), f"{report}")


def test_all_kinds_at_once():
    """A CAN interface, GPIO lines and a serial line that this machine does not have."""
    code, report, _ = probe(edited_config(PLAIN_BOX))
    expect(code == BAD_DATA, f"exit code {code}")
    bad = [name for name, one in report["signals"].items() if one["quality"] != "no link" or not one["verdict"]]
    expect(not bad, f"{bad}: {report}")


# ---- ends and refusals ----

def test_interrupted():
    with bench() as server:
        for number in (signal.SIGINT, signal.SIGTERM):
            with Program("probe", probe_config(server.port), "--json", "--duration", 1000) as program:
                member(program, "io")
                wait_until(lambda: server.functions, "a request")
                code, out, _ = program.end(number)
            report = json.loads(out)
            expect(report["duration_s"] < 1000 and code in (0, BAD_DATA), f"{code}: {out}")
            server.functions.clear()


def test_a_dead_process():
    with bench() as server, Program("probe", probe_config(server.port), "--duration", 1000) as program:
        os.kill(member(program, "io"), signal.SIGKILL)
        code, out, log = program.end()
        expect(code == PLANT_DOWN and out == "" and has_line(log, "error|reads the plant|9"), f"{code}: {out}{log}")


def test_beside_a_run():
    with Device(OMEGA) as device:
        config = edited_config(PLAIN_LIVE, {"duration_s": None, "realtime": None, "record": {"commit_s": 0.1},
                                            "plant": {"omega": {"stale_s": 30}, "torque": {"stale_s": 30}},
                                            "sources": {"inverter": {"modbus_tcp": {"port": device.port, "timeout_s": 5}}}})
        with Program("run", config) as live:
            wait_until(lambda: (config.parent / "twin.db-writer").exists(), "the database", live.log)
            code, report, log = probe(config)
            expect(code == TRY_AGAIN and report is None and has_line(log, f"{config}|is running|twinlock show"), log)
            live.end(signal.SIGINT)
        code, report, _ = probe(config)
        expect_qualities(code, report, "good", "good")


def test_wrong_configurations():
    config = edited_config(PLAIN_LIVE, {"plant": {"torque": {"modbus": None}}})
    code, report, log = probe(config)
    expect(code == BAD_DATA and report is None and has_line(log, "plant.torque|no live source"), log)
    code, report, log = probe(probe_config(0, {"table": "inputs"}))
    expect(code == BAD_DATA and report is None and has_line(log, "2 problems"), log)
    expect(probe(config.parent / "none.json")[0] == BAD_DATA, "an absent configuration")
    expect(run(["probe", config, "--duration", "0"])[0] == BAD_USAGE, "no duration")


main()
