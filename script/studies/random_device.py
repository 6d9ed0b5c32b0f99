"""Random Modbus devices (pymodbus) with their right configuration, and mistakes in it: for the study registers.

A device has one table with its signals. Between and beside them are registers with values of other quantities, zeros or noise.
In nine of ten devices the plant is near its start; in the others each signal is anywhere in its range.
"""
import asyncio
import copy
import math
import random
import struct
import threading
import time

from pymodbus import FramerType
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse, ReadInputRegistersResponse
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

CODES = {"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "int64": "q", "float64": "d"}
UNITS, PORTS, PAUSES, LIMITS = (1, 1, 1, 2, 3, 10, 247, 255), (502, 502, 1502, 5020, 4001, 8899), (0.1, 0.3, 0.8), (2, 4, 6, 8, 12)
RANGES = ((0, 100), (0, 10), (0, 1), (-500, 500), (-20, 20), (-40, 150), (200, 250), (45, 55), (0, 6000), (0, 16), (-10000, 10000))
ANSWERS = {3: ReadHoldingRegistersResponse, 4: ReadInputRegistersResponse}
MOTION = 0.01  # standard deviation of a value, relative to its range
ONE = ("words", "bytes", "plus 1", "minus 1", "notation", "table", "unit", "port", "framing", "pause", "limit")
ONE_SIGNAL = ("type", "scale", "sign")
KINDS = (*ONE, *ONE_SIGNAL, "two", "none", "faulty sensor")


def width(kind):
    return struct.calcsize(CODES[kind]) // 2


def swapped(words, little_words, little_bytes):
    words = words[::-1] if little_words else words
    return [(word & 255) << 8 | word >> 8 for word in words] if little_bytes else words


def encode(signal, value):
    """Registers of a value."""
    modbus = signal["modbus"]
    kind, raw = modbus["type"], (value - modbus["offset"]) / modbus["scale"]
    if not kind.startswith("float"):
        low, high = (0, 2 ** (16 * width(kind)) - 1) if kind[0] == "u" else (-2 ** (16 * width(kind) - 1), 2 ** (16 * width(kind) - 1) - 1)
        raw = min(max(round(raw), low), high)
    words = struct.unpack(f">{width(kind)}H", struct.pack(">" + CODES[kind], raw))
    return swapped(list(words), modbus["words"] == "little", modbus["bytes"] == "little")


def no_value(modbus):
    """Registers of NaN, or of the largest signed integer."""
    words = [0x7FFF] + [0xFFFF] * (width(modbus["type"]) - 1)
    return swapped(words, modbus["words"] == "little", modbus["bytes"] == "little")


def decode(signal, words):
    modbus = signal["modbus"]
    words = swapped(list(words[:width(modbus["type"])]), modbus["words"] == "little", modbus["bytes"] == "little")
    raw, = struct.unpack(">" + CODES[modbus["type"]], struct.pack(f">{len(words)}H", *words))
    return raw * modbus["scale"] + modbus["offset"]


class Device:
    """Register map, signals and habits of one device; serve() starts its server."""

    def __init__(self, choice, host, signals=3):
        self.choice, self.host = choice, host
        self.unit, self.port = choice.choice(UNITS), choice.choice(PORTS)
        self.rtu, self.pause, self.limit = choice.random() < 0.15, 0.0, 125
        self.gateway = choice.random() < 0.4  # answers for other units with an exception
        self.table, self.at_start = choice.choice((3, 4)), choice.random() < 0.9
        self.order = {"words": choice.choice(("big", "big", "little")), "bytes": choice.choice(("big", "big", "big", "little"))}
        self.signals, self.values, self.last, self.request, self.drop = {}, {}, 0.0, None, False
        self.fill(signals)

    def fill(self, count):
        """Places the signals, and what is around them."""
        choice = self.choice
        address = first = choice.choice((choice.randint(0, 40), choice.randint(100, 3000), choice.randint(3000, 9990)))
        for i in range(count):
            low, high = choice.choice(RANGES)
            signal = {"min": low, "max": high, "modbus": {"address": address, "offset": 0, **self.order, **self.number(low, high)}}
            value = low + (high - low) * choice.uniform(0.1, 0.9)
            near = self.at_start and choice.random() < 0.97
            start = value + choice.gauss(0, 0.03) * (high - low) if near else choice.uniform(low, high)
            signal["initial"] = float(f"{min(max(start, low), high):.3g}")
            self.signals[f"s{i}"], self.values[f"s{i}"] = signal, value
            address += width(signal["modbus"]["type"]) + choice.choice((0, 0, 0, 1, 2, 5))
        before, after = choice.choice((0, 1, 8)), choice.choice((0, 1, 8, 40))
        self.memory = {self.table: self.others(max(first - before, 0), address + after), 7 - self.table: {}}
        if choice.random() < 0.6:
            other = self.others(max(first - choice.choice((1, 8)), 0), address + 8)
            self.memory[7 - self.table] = other if choice.random() < 0.5 else dict.fromkeys(other, 0)

    def number(self, low, high):
        """A type and scale that can hold the range."""
        while True:
            kind = self.choice.choice(("int16", "int16", "uint16", "int32", "uint32", "float32", "float32", "int64", "float64"))
            scale = self.choice.choice((1, 1, 0.1)) if kind.startswith("float") else self.choice.choice((1, 0.1, 0.01, 0.001))
            most = 2.0 ** (16 * width(kind) - (kind[0] != "u"))
            if kind.startswith("float") or (max(abs(low), high) / scale < most and (kind[0] != "u" or low >= 0) and (high - low) / scale >= 200):
                return {"type": kind, "scale": scale}

    def others(self, first, end):
        """Registers that no signal uses."""
        memory = {}
        while len(memory) < end - first:
            kind = self.choice.choice(("value", "value", "zero", "noise"))
            words = [self.choice.choice((0, 0, 1, 0xFFFF))] if kind == "zero" else [self.choice.getrandbits(16)]
            if kind == "value":
                low, high = self.choice.choice(RANGES)
                number = {"modbus": {"offset": 0, **self.order, **self.number(low, high)}}
                words = encode(number, self.choice.uniform(low, high))
            for word in words:
                memory[first + len(memory)] = word
        return {address: word for address, word in memory.items() if address < end}

    def read(self, table, first, count):
        """Registers now, or None if one does not exist."""
        memory = dict(self.memory[table])
        for name, signal in self.signals.items() if table == self.table else ():
            moved = self.values[name]
            if math.isfinite(moved):
                moved += random.gauss(0, MOTION * (signal["max"] - signal["min"]) / 3)
            words = encode(signal, moved) if math.isfinite(moved) else no_value(signal["modbus"])
            memory.update(enumerate(words, signal["modbus"]["address"]))
        words = [memory.get(address) for address in range(first, first + count)]
        return None if None in words else words

    def config(self):
        source = {"host": self.host, "port": self.port, "period_s": 0.2, "framing": "rtu" if self.rtu else "tcp",
                  "pause_s": self.pause, "most_registers": self.limit}
        plant = copy.deepcopy(self.signals)
        for signal in plant.values():
            signal["modbus"].update(source="device", unit_id=self.unit, table={3: "holding", 4: "input"}[self.table])
            signal["stale_s"] = 30
        return {"twinlock": 1, "name": "random device", "step_s": 0.1, "components": {"c": {"fmu": "absent.fmu"}},
                "sources": {"device": {"modbus_tcp": source}}, "plant": plant}

    # ---- server ----

    def trace_pdu(self, sending, pdu):
        now = time.monotonic()
        if not sending:
            self.request, self.drop = pdu, now - self.last < self.pause
            return pdu
        request, self.last = self.request, now
        if request.dev_id != self.unit:
            self.drop = not self.gateway
            pdu.exception_code = 11
            return pdu
        words = self.read(request.function_code, request.address, request.count) if request.function_code in (3, 4) else None
        if words is None or request.count > self.limit:
            self.drop = self.drop or (request.count > self.limit and self.silent_limit)
            answer = ExceptionResponse(request.function_code, 2 if request.count <= self.limit else 4)
        else:
            answer = ANSWERS[request.function_code](registers=words)
        answer.dev_id, answer.transaction_id = pdu.dev_id, pdu.transaction_id
        return answer

    def trace_packet(self, sending, data):
        return b"" if sending and self.drop else data

    def trace_connect(self, _connected):
        self.last = time.monotonic()

    async def serve(self):
        bits = [[SimData(0, values=[False] * 16, datatype=DataType.BITS)] for _ in (1, 2)]
        words = [[SimData(0, values=[0], datatype=DataType.REGISTERS)] for _ in (3, 4)]
        self.server = ModbusTcpServer([SimDevice(self.unit, simdata=(*bits, *words))], address=(self.host, self.port),
                                      framer=FramerType.RTU if self.rtu else FramerType.SOCKET,
                                      trace_pdu=self.trace_pdu,
                                      trace_packet=self.trace_packet, trace_connect=self.trace_connect)
        await self.server.serve_forever(background=True)


class Loop:
    """An event loop in a thread, for the servers of all devices."""

    def __enter__(self):
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        return self

    def run(self, work):
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(60)

    def __exit__(self, *_):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(30)


# ---- mistakes ----

def spoil_all(config, key, change):
    for signal in config["plant"].values():
        signal["modbus"][key] = change(signal["modbus"][key])


def spoil_signal(choice, config, kind):
    """A wrong type, scale or sign of one signal."""
    modbus = choice.choice(list(config["plant"].values()))["modbus"]
    if kind == "scale":
        modbus["scale"] = float(f"{modbus['scale'] * choice.choice((0.01, 0.1, 0.1, 10, 10, 100)):.6g}")
    elif kind == "sign":
        modbus["scale"] = -modbus["scale"]
    else:
        modbus["type"] = choice.choice([other for other in CODES if other != modbus["type"]])


def spoil(choice, device, config, kind):
    """Makes a mistake. It may have no effect: see has_effect()."""
    other = {"big": "little", "little": "big", "holding": "input", "input": "holding", "tcp": "rtu", "rtu": "tcp"}
    source = config["sources"]["device"]["modbus_tcp"]
    if kind in ("words", "bytes", "table"):
        spoil_all(config, kind, other.get)
    elif kind in ("plus 1", "minus 1"):
        spoil_all(config, "address", lambda address: address + (1 if kind == "plus 1" else -1))
    elif kind == "notation":
        spoil_all(config, "address", lambda address: address + {3: 40001, 4: 30001}[device.table])
    elif kind == "unit":
        wrong = choice.choice([unit for unit in (1, 2, 3, 5, 100) if unit != device.unit])
        spoil_all(config, "unit_id", lambda _: wrong)
    elif kind == "port":
        source["port"] = choice.choice([port for port in (502, 503, 1502, 5020) if port != device.port])
    elif kind == "framing":
        source["framing"] = other[source["framing"]]
    elif kind == "pause":
        source["pause_s"] = 0
    elif kind == "limit":
        source["most_registers"] = 125
    else:
        spoil_signal(choice, config, kind)


def prepare(choice, device, kinds):
    """Gives the device the habit that the mistake is about."""
    widths = [width(signal["modbus"]["type"]) for signal in device.signals.values()]
    device.silent_limit = choice.random() < 0.5
    if "pause" in kinds:
        device.pause = choice.choice(PAUSES)
    if "limit" in kinds:
        device.limit = choice.choice([limit for limit in LIMITS if limit >= max(widths)])


def addresses_are_valid(config):
    return all(0 <= signal["modbus"]["address"] <= 65532 for signal in config["plant"].values())


def longest_request(config, most):
    """Registers of the longest request, as the driver joins near values up to the limit `most`."""
    places = sorted((signal["modbus"]["address"], width(signal["modbus"]["type"])) for signal in config["plant"].values())
    first, longest = None, 0
    for address, count in places:
        first = address if first is None or address + count - first > most else first
        longest = max(longest, address + count - first)
    return longest


def has_effect(device, config, kinds):
    """True if the mistake can be seen: a signal has no value, or one that differs by 10 % of its range. (The start is not known
    better.)"""
    right = device.config()
    if not addresses_are_valid(config) or ("limit" in kinds and longest_request(config, 125) <= device.limit):
        return False
    if config["sources"] != right["sources"] or "unit" in kinds:
        return True
    for name, signal in config["plant"].items():
        table = {"holding": 3, "input": 4}[signal["modbus"]["table"]]
        words = device.read(table, signal["modbus"]["address"], width(signal["modbus"]["type"]))
        found = decode(signal, words) if words else math.nan
        if not abs(found - device.values[name]) < 0.1 * (signal["max"] - signal["min"]):
            return True
    return False


def random_case(choice, host, kind, signals):
    """(device, configuration with the mistakes, names of the mistakes)."""
    while True:
        device = Device(choice, host, signals)
        kinds = (kind,) if kind in (*ONE, *ONE_SIGNAL) else ()
        while kind == "two" and (len(set(kinds)) < 2 or set(kinds) == {"plus 1", "minus 1"}):
            kinds = (choice.choice((*ONE, *ONE_SIGNAL)), choice.choice((*ONE, *ONE_SIGNAL)))
        prepare(choice, device, kinds)
        config = device.config()
        for one in kinds:
            spoil(choice, device, config, one)
        if kind == "faulty sensor":
            name = choice.choice(list(device.signals))
            signal = device.signals[name]
            device.values[name] = choice.choice((math.nan, 0, signal["max"] * 1.3, -1e4))
            return device, config, kinds
        if not kinds or all(has_effect(device, config, (one,)) for one in kinds):
            return device, config, kinds
