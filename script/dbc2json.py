"""Converts a DBC file into `sources` and `plant` of a configuration: see script/dbc2json, which starts this."""
import argparse
import codecs
import difflib
import json
import re
import sys

import cantools
import textparser

SIGNALS, NAME, VALUES, LEVELS = 64, 63, 16, 4  # limits of a configuration: config/SPEC.md
LENGTHS = [1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]
STALE_CYCLES = 5
INDEPENDENT = "VECTOR__INDEPENDENT_SIG_MSG"  # not a message: editors keep signals there that belong to none


class Refused(Exception):
    """A message for the user."""


# ---- one signal ----

def frame_bytes(message):
    """The length of the frame of a message."""
    fitting = [length for length in LENGTHS if length >= message.length]
    if not fitting:
        raise Refused(f"message {message.name} has {message.length} bytes, but a frame has at most 64")
    return fitting[0]


def field_of(signal, message):
    """The position of the bits, which must be in the frame."""
    bits = signal.length
    first = signal.start if signal.byte_order == "little_endian" else signal.start // 8 * 8 + 7 - signal.start % 8
    if (first + bits + 7) // 8 > frame_bytes(message):
        raise Refused(f"{message.name}.{signal.name}: {bits} bits from {signal.start} on reach beyond the frame's "
                      f"{frame_bytes(message)} bytes")
    field = {"start": signal.start, "length": bits}
    if signal.byte_order == "big_endian":
        field["order"] = "motorola"
    return field


def type_of(signal, message):
    if signal.is_float:
        if signal.length not in (32, 64):
            raise Refused(f"{message.name}.{signal.name}: a float of {signal.length} bits; there are those of 32 and 64")
        return f"float{signal.length}"
    if not 1 <= signal.length <= 64:
        raise Refused(f"{message.name}.{signal.name}: an integer of {signal.length} bits (expected 1 to 64)")
    return "signed" if signal.is_signed else "unsigned"


def ranges_of(values):
    """Sorted values; more than fit as ranges."""
    if len(values) <= VALUES:
        return values
    starts = [value for value in values if value - 1 not in values]
    ends = [value for value in values if value + 1 not in values]
    return [low if low == high else f"{low}-{high}" for low, high in zip(starts, ends)]


def multiplex_of(signal, message, level=1):
    """The multiplexor that selects the signal, with its own multiplexor; None if the signal is always in the frame."""
    if not signal.multiplexer_ids:
        return None
    if level > LEVELS:
        raise Refused(f"{message.name}.{signal.name}: more than {LEVELS} nested multiplexors")
    values = ranges_of(sorted(signal.multiplexer_ids))
    if len(values) > VALUES:
        raise Refused(f"{message.name}.{signal.name}: {len(values)} values and ranges of {signal.multiplexer_signal} select it "
                      f"(expected at most {VALUES})")
    multiplexor = message.get_signal_by_name(signal.multiplexer_signal)
    if multiplexor.length > 32:
        raise Refused(f"{message.name}.{multiplexor.name}: a multiplexor of {multiplexor.length} bits (expected at most 32)")
    condition = {**field_of(multiplexor, message), "value": values[0] if len(values) == 1 else values}
    outer = multiplex_of(multiplexor, message, level + 1)
    if outer:
        condition["multiplex"] = outer
    return condition


def pgn_of(message):
    """The PGN of a message of J1939; None for another one."""
    if message.protocol != "j1939" or not message.is_extended_frame:
        return None
    pgn = message.frame_id >> 8 & 0x3FFFF
    return pgn if pgn & 0xFF00 >= 0xF000 else pgn & 0x3FF00  # the last byte of PDU1 is the destination


def sender_of(message):
    return pgn_of(message), message.frame_id & 0xFF


def frame_of(message, senders):
    """How its frames are known. `senders`: PGN and source address of all messages; those with the same ones differ in the
    destination, which only the id has."""
    pgn, address = sender = sender_of(message)
    if pgn is not None and senders.count(sender) == 1:
        is_shared = [other for other, _ in senders].count(pgn) > 1
        return {"pgn": pgn, "source_address": address} if is_shared else {"pgn": pgn}
    frame = {"id": f"0x{message.frame_id:X}"}
    if message.is_extended_frame and message.frame_id <= 0x7FF:
        frame["extended"] = True
    return frame


def has_not_available(signal, message):
    """True if J1939 reserves the highest values, and the file does not permit them."""
    if pgn_of(message) is None or signal.is_float or signal.is_signed or signal.length < 2:
        return False
    highest = (2**signal.length - 1) * signal.scale + signal.offset
    return signal.maximum is None or signal.maximum < highest


def can_of(signal, message, source, senders):
    can = {"source": source, **frame_of(message, senders)}
    size = frame_bytes(message)
    if size != 8:
        can["bytes"] = size
    if message.is_fd and size <= 8:
        can["fd"] = True
    kind = type_of(signal, message)
    can.update(field_of(signal, message))
    if kind != "unsigned":
        can["type"] = kind
    if signal.scale != 1:
        can["scale"] = signal.scale
    if signal.offset != 0:
        can["offset"] = signal.offset
    if has_not_available(signal, message):
        can["not_available"] = True
    multiplex = multiplex_of(signal, message)
    if multiplex:
        can["multiplex"] = multiplex
    return can


def is_boolean(signal):
    return (signal.length == 1 and not signal.is_signed and not signal.is_float and signal.scale == 1
            and signal.offset == 0 and signal.minimum is None and signal.maximum is None)


def entry_of(signal, message, source, senders):
    entry = {}
    if is_boolean(signal):
        entry["type"] = "boolean"
    if signal.unit:
        entry["unit"] = re.sub(r"[\x00-\x1f\x7f]", " ", signal.unit)
    for key, value in (("min", signal.minimum), ("max", signal.maximum)):
        if value is not None:
            entry[key] = value
    if message.cycle_time:
        entry["stale_s"] = STALE_CYCLES * message.cycle_time / 1000
    entry["can"] = can_of(signal, message, source, senders)
    return entry


# ---- all of them ----

def nearest(name, names):
    found = difflib.get_close_matches(name, names, 1, 0.5)
    some = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    return f"did you mean {found[0]}?" if found else f"there are: {some}" if names else "there is none"


def choose(database, messages, signals):
    """The (message, signal) pairs that the options select."""
    pairs = [(message, signal) for message in database.messages if message.name != INDEPENDENT
             for signal in message.signals]
    there = list(dict.fromkeys(message.name for message, _ in pairs))
    for name in messages:
        if name not in there:
            raise Refused(f"no message {name} with signals; {nearest(name, there)}")
    if messages:
        pairs = [pair for pair in pairs if pair[0].name in messages]
    for name in signals:
        if not any(name in (signal.name, f"{message.name}.{signal.name}") for message, signal in pairs):
            raise Refused(f"no signal {name}; {nearest(name, [signal.name for _, signal in pairs])}")
    if signals:
        pairs = [(message, signal) for message, signal in pairs
                 if signal.name in signals or f"{message.name}.{signal.name}" in signals]
    return pairs


def name_of(message, signal, doubled):
    name = f"{message.name}_{signal.name}" if signal.name in doubled else signal.name
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) or len(name) > NAME:
        raise Refused(f"{message.name}.{signal.name}: invalid name {name} (expected at most {NAME} letters, digits and _)")
    return name


def convert(pairs, source, senders, strict):
    """The entries of `plant`, and the reasons for signals that are left out."""
    names = [signal.name for _, signal in pairs]
    doubled = {name for name in names if names.count(name) > 1}
    plant, left_out = {}, []
    for message, signal in pairs:
        try:
            plant[name_of(message, signal, doubled)] = entry_of(signal, message, source, senders)
        except Refused as reason:
            if strict:
                raise
            left_out.append(str(reason))
    return plant, left_out


def load(path, encoding):
    try:
        codecs.lookup(encoding)
    except LookupError:
        raise Refused(f"--encoding {encoding}: unknown encoding (expected a name as cp1252, utf-8 or gb2312)") from None
    database = cantools.database.Database(strict=False)  # overlapping bits are allowed; field_of() checks the end of the frame
    try:
        with open(path, encoding=encoding) as file:  # cantools would replace what it cannot decode
            database.add_dbc_string(file.read())
    except OSError as reason:
        raise Refused(f"{path} cannot be read: {reason.strerror}") from reason
    except UnicodeError as reason:
        raise Refused(f"{path} cannot be decoded as {encoding}: {reason}: give its encoding, for example --encoding utf-8 or "
                      "--encoding gb2312") from reason
    except (textparser.Error, cantools.Error, ValueError, KeyError, TypeError, AttributeError, IndexError) as reason:
        raise Refused(f"{path} is not a DBC file that can be understood: {reason}") from reason
    return database


def dump(source, interface, plant):
    lines = [f'    {json.dumps(name)}: {json.dumps(entry, ensure_ascii=False)}' for name, entry in plant.items()]
    return ('{\n  "sources": { ' + json.dumps(source) + ': { "can": { "interface": ' + json.dumps(interface)
            + ' } } },\n  "plant": {\n' + ",\n".join(lines) + "\n  }\n}\n")


def run(options):
    if not re.fullmatch(r"[^/: \t]{1,15}", options.interface):
        raise Refused(f"--interface {options.interface}: the name of an interface has 1 to 15 characters, no space, slash "
                      "or colon, for example can0")
    source = options.interface if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", options.interface) else "can"
    database = load(options.file, options.encoding)
    senders = [sender_of(message) for message in database.messages]
    pairs = choose(database, options.message, options.signal)
    plant, left_out = convert(pairs, source, senders, bool(options.signal))
    for reason in left_out:
        print(f"dbc2json: left out: {reason}", file=sys.stderr)
    if not plant:
        raise Refused(f"{options.file} has no signal that can be read")
    if len(plant) > SIGNALS:
        raise Refused(f"these are {len(plant)} signals, but a configuration takes {SIGNALS}: select some with --message and --signal")
    sys.stdout.write(dump(source, options.interface, plant))


def main():
    parser = argparse.ArgumentParser(prog="dbc2json")
    parser.add_argument("file")
    parser.add_argument("--interface", default="can0")
    parser.add_argument("--encoding", default="cp1252")
    parser.add_argument("--message", action="append", default=[])
    parser.add_argument("--signal", action="append", default=[])
    try:
        run(parser.parse_args())
    except Refused as reason:
        print(f"dbc2json: {reason}", file=sys.stderr)
        sys.exit(65)


if __name__ == "__main__":
    main()
