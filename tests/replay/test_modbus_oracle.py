#!/usr/bin/env python3
"""Compares our Modbus driver and our emulated device with pymodbus.

The driver reads a pymodbus server by TCP, by RTU frames over TCP, and by RTU on a pseudo-terminal; a pymodbus client reads the device. They use all
tables, types and orders, at random addresses with gaps. The test computes the content of the registers by `struct`. The
pymodbus server sees every request of the driver: only reads.
"""
import asyncio
import logging
import os
import random
import select
import socket
import struct
import subprocess
import sys
import threading
import tty

try:
    from pymodbus import FramerType
    from pymodbus.client import ModbusTcpClient
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice
except ImportError as reason:
    print(f"no pymodbus here: {reason}")
    sys.exit(1 if os.environ.get("CI") == "true" else 77)

from twinlock_test import PATIENCE, program  # noqa: E402 (a skip comes first)

PROBE = program("modbus_probe")
GOOD, NOT_A_NUMBER, NO_LINK = 0, 3, 4
BIT = 0
BCD = {9: 4, 10: 8}  # digits
PARTS = {11: 1, 12: 8, 13: 8}  # bits of a bit and a byte of a register
# as board/modbus/modbus_map.h numbers them
TYPES = {1: "h", 2: "H", 3: "i", 4: "I", 5: "f", 6: "d", 7: "q", 8: "Q", 9: "H", 10: "I", 11: "H", 12: "b", 13: "B"}
# The larger numbers of 64 bits are multiples of 2^11, which doubles have.
RANGES = {1: (-2**15, 2**15 - 1), 2: (0, 2**16 - 1), 3: (-2**31, 2**31 - 1), 4: (0, 2**32 - 1), 7: (-2**63, 2**63 - 2**11),
          8: (0, 2**64 - 2**11), 9: (0, 9999), 10: (0, 99999999), 11: (0, 1), 12: (-128, 127), 13: (0, 255)}
UNITS = (1, 17, 247)
PER_COMBINATION = 3


class Channel:
    """One value and its registers."""

    def __init__(self, unit, table, address, kind, words_little, bytes_little, raw, scale, offset, bit=0, quality=GOOD):
        self.unit, self.table, self.address, self.kind, self.bit = unit, table, address, kind, bit
        self.words_little, self.bytes_little, self.raw, self.scale, self.offset = words_little, bytes_little, raw, scale, offset
        self.quality = quality  # of the driver's reading

    def value(self):
        return self.raw * self.scale + self.offset

    def expected(self):
        return self.value() if self.quality == GOOD else 0

    def line(self):
        code = self.raw if self.quality == NOT_A_NUMBER else "nan"
        return (f"{self.unit} {self.table} {self.address} {self.kind} {int(self.words_little)} {int(self.bytes_little)} "
                f"{self.bit} {self.scale!r} {self.offset!r} {code} {self.value()!r}\n")

    def registers(self, rest=0):
        """The content of the registers, or the bit. `rest`: the other bits, if the value is a part of a register."""
        if self.kind == BIT:
            return [int(self.raw)]
        if self.kind in PARTS:
            mask = 2**PARTS[self.kind] - 1 << self.bit
            data = struct.pack(">H", int(self.raw) << self.bit & mask | rest & ~mask)
        elif self.kind in BCD:
            data = bytes.fromhex(f"{self.raw:0{BCD[self.kind]}d}")
        else:
            data = struct.pack(">" + TYPES[self.kind], self.raw)
        words = [data[i:i + 2] for i in range(0, len(data), 2)]
        if self.words_little:
            words.reverse()
        return [int.from_bytes(word, "little" if self.bytes_little else "big") for word in words]


def raw_value(choose, kind):
    code = TYPES[kind]
    if kind in RANGES:
        low, high = RANGES[kind]
        raw = choose.choice([low, high, 0, choose.randint(low, high)])
        return raw if abs(raw) < 2**53 else raw // 2**11 * 2**11
    return struct.unpack(code, struct.pack(code, choose.choice([0.0, -1.5, choose.uniform(-1e6, 1e6), 1e-30])))[0]


def make_channels(choose):
    """Every combination, at random addresses of each unit and table, without overlap."""
    channels = []
    for unit in UNITS:
        for table in (1, 2, 3, 4):
            if table <= 2:
                wanted = [(BIT, False, False)] * 30
            else:
                wanted = [(kind, words, order) for kind in TYPES for words in (False, True) for order in (False, True)]
                wanted *= PER_COMBINATION
            choose.shuffle(wanted)
            address = choose.choice([0, 1, 1000, 40000])
            for kind, words, order in wanted:
                address += choose.choice([0, 0, 0, 1, 5, 17, 300])
                raw = choose.randint(0, 1) if kind == BIT else raw_value(choose, kind)
                # Powers of two, so that the raw number of a value is exact.
                scale, offset = (1.0, 0.0) if kind in (5, 6, 7, 8) else (choose.choice([1.0, 0.5, -2.0]), choose.choice([0.0, 16.0]))
                bit = choose.randint(0, 15) if kind == 11 else choose.choice([0, 8]) if kind in PARTS else 0
                quality = NOT_A_NUMBER if choose.random() < 0.1 else GOOD  # its code says that it is not available
                channel = Channel(unit, table, address, kind, words, order, raw, scale, offset, bit, quality)
                channels.append(channel)
                address += len(channel.registers())
    choose.shuffle(channels)
    return channels


def text_of(channels):
    return "".join(channel.line() for channel in channels) + "go\n"


# ---- the driver reads pymodbus --------------------------------------------------------------------------------------

def device_of(unit, channels):
    """A pymodbus device with exactly these registers; other addresses are illegal."""
    blocks = []
    for table in (1, 2, 3, 4):
        block = []
        for channel in sorted((c for c in channels if (c.unit, c.table) == (unit, table)), key=lambda c: c.address):
            if table <= 2:
                block.append(SimData(channel.address, values=[bool(channel.raw)], datatype=DataType.BITS))
            else:
                block.append(SimData(channel.address, values=channel.registers(rest=0xA5C3), datatype=DataType.REGISTERS))
        blocks.append(block)
    return SimDevice(unit, simdata=tuple(blocks))


class Server:
    """A pymodbus server in a thread."""

    def __init__(self, channels, framer):
        self.functions = []
        self.framer = framer
        self.loop = asyncio.new_event_loop()
        self.ready = threading.Event()
        self.channels = channels
        self.thread = threading.Thread(target=self.run, daemon=True)

    def trace(self, sending, pdu):
        if not sending:
            self.functions.append(pdu.function_code)
        return pdu

    async def serve(self):
        devices = [device_of(unit, self.channels) for unit in UNITS]
        self.server = ModbusTcpServer(devices, framer=self.framer, address=("127.0.0.1", 0), trace_pdu=self.trace)
        await self.server.serve_forever(background=True)
        self.port = self.server.transport.sockets[0].getsockname()[1]
        self.ready.set()

    def run(self):
        asyncio.set_event_loop(self.loop)
        self.loop.create_task(self.serve())
        self.loop.run_forever()

    def __enter__(self):
        self.thread.start()
        assert self.ready.wait(30), "the pymodbus server does not start"
        return self

    def __exit__(self, *_):
        asyncio.run_coroutine_threadsafe(self.server.shutdown(), self.loop).result(30)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(30)


class Line:
    """A serial line (`device`) that forwards bytes to and from a server of RTU over TCP."""

    def __init__(self, server):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.device = os.ttyname(self.slave)
        self.server = socket.create_connection(("127.0.0.1", server.port))
        self.stop, self.stopped = os.pipe()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self):
        while True:
            ready, _, _ = select.select([self.master, self.server, self.stop], [], [])
            if self.stop in ready:
                return
            if self.master in ready:
                self.server.sendall(os.read(self.master, 4096))
            if self.server in ready:
                os.write(self.master, self.server.recv(4096))

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        os.close(self.stopped)
        self.thread.join(30)
        self.server.close()
        for descriptor in (self.master, self.slave, self.stop):
            os.close(descriptor)


def run_probe(channels, *where):
    return subprocess.run([PROBE, "read", *where], input=text_of(channels), stdout=subprocess.PIPE, text=True,
                          timeout=120 * PATIENCE, check=True)


def check_driver(channels, framer, by_line=False):
    with Server(channels, framer) as server:
        # A missing register must not affect other values.
        missing = Channel(UNITS[0], 3, 65000, 2, False, False, 0, 1.0, 0.0)
        if by_line:
            with Line(server) as line:
                done = run_probe(channels + [missing], line.device)
        else:
            done = run_probe(channels + [missing], "127.0.0.1", str(server.port), *(["rtu"] if framer == FramerType.RTU else []))
        functions = list(server.functions)
    failures = 0
    lines = done.stdout.splitlines()
    assert len(lines) == len(channels) + 1, f"{len(lines)} lines for {len(channels) + 1} channels"
    for channel, line in zip(channels, lines):
        quality, value = line.split()
        if int(quality) != channel.quality or float(value) != channel.expected():
            failures += 1
            print(f"driver: read quality {quality}, {value} instead of {channel.quality}, {channel.expected()!r}: {channel.line()}",
                  end="")
    if int(lines[-1].split()[0]) != NO_LINK:
        failures += 1
        print(f"driver: a missing register has a value: {lines[-1]}")
    if not functions or not set(functions) <= {1, 2, 3, 4}:
        failures += 1
        print(f"driver: pymodbus saw the functions {sorted(set(functions))}")
    return failures, len(functions)


# ---- pymodbus reads the device --------------------------------------------------------------------------------------

def read(client, channel, count):
    call = {1: client.read_coils, 2: client.read_discrete_inputs, 3: client.read_holding_registers,
            4: client.read_input_registers}[channel.table]
    reply = call(channel.address, count=count, device_id=channel.unit)
    if reply.isError():
        return reply
    return [int(bit) for bit in reply.bits[:count]] if channel.table <= 2 else reply.registers


def check_values(client, channels):
    failures = 0
    for channel in channels:
        expected = channel.registers()
        got = read(client, channel, len(expected))
        if got != expected:
            failures += 1
            print(f"device: holds {got} instead of {expected}: {channel.line()}", end="")
    return failures


def check_refusals(client):
    """All write functions of pymodbus, and a missing address and unit."""
    unit = UNITS[0]
    writes = [client.write_coil(0, True, device_id=unit), client.write_register(0, 1, device_id=unit),
              client.write_coils(0, [True] * 8, device_id=unit), client.write_registers(0, [1, 2], device_id=unit),
              client.mask_write_register(address=0, and_mask=0, or_mask=1, device_id=unit),
              client.readwrite_registers(read_address=0, read_count=1, write_address=0, values=[1], device_id=unit)]
    failures = 0
    for reply in writes:
        if not reply.isError() or reply.exception_code != 1:
            failures += 1
            print(f"device: answers {reply} to a write")
    reply = client.read_holding_registers(65535, count=1, device_id=unit)
    if not reply.isError() or reply.exception_code != 2:
        failures += 1
        print(f"device: answers {reply} for a missing address")
    reply = client.read_holding_registers(0, count=1, device_id=99)
    if not reply.isError() or reply.exception_code != 11:
        failures += 1
        print(f"device: answers {reply} for a missing unit")
    return failures, len(writes)


def check_device(channels):
    probe = subprocess.Popen([PROBE, "serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        probe.stdin.write(text_of(channels))
        probe.stdin.flush()
        client = ModbusTcpClient("127.0.0.1", port=int(probe.stdout.readline()), timeout=30)
        assert client.connect(), "pymodbus cannot connect to the device"
        failures = check_values(client, channels)
        refusals, writes = check_refusals(client)
        failures += refusals + check_values(client, channels)  # also after the writes
        client.close()
        rest, _ = probe.communicate(timeout=30)
    finally:
        probe.kill()
    if rest.split()[1] != str(writes):
        failures += 1
        print(f"device: counted {rest.split()[1]} refused writes of {writes}")
    return failures


def main():
    logging.disable(logging.CRITICAL)  # pymodbus logs each exception that it sends
    seed = int(os.environ.get("TL_SEED", "4711"))
    channels = make_channels(random.Random(seed))
    failures, requests = check_driver(channels, FramerType.SOCKET)
    for by_line in (False, True):
        more_failures, more_requests = check_driver(channels, FramerType.RTU, by_line)
        failures += more_failures
        if more_requests != requests:  # one map for all
            failures += 1
            print(f"driver: {requests} requests by TCP, {more_requests} by RTU, by_line={by_line}")
    failures += check_device(channels)
    print(f"{len(channels)} channels, {requests} requests each by TCP, RTU by TCP, and RTU, {failures} failures (TL_SEED={seed})")
    sys.exit(1 if failures else 0)


main()
