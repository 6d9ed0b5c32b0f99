#!/usr/bin/env python3
"""Compares our CAN codec, script/dbc2json and the emulated bus with cantools.

cantools reads random DBC files: both byte orders, signed, floats, nested multiplexors, standard and extended ids, CAN FD.
dbc2json converts them to configurations. The program and cantools decode the same random frames; cantools decodes what the
program encodes. The test computes the expected value from the raw number of cantools.
"""
import contextlib
import io
import json
import math
import os
import random
import subprocess
import sys
import tempfile

from twinlock_test import PATIENCE, has_line, program

SOURCE = os.environ["TL_SOURCE"]
sys.path.insert(0, os.path.join(SOURCE, "script"))
try:
    import cantools
    import dbc2json
except ImportError as reason:
    print(f"no cantools here: {reason}")
    sys.exit(1 if os.environ.get("CI") == "true" else 77)

PROBE = program("can_probe")
SCRIPT = os.path.join(SOURCE, "script", "dbc2json")
FILES, FRAMES = 60, 6
FD_LENGTHS = [1, 4, 8, 12, 16, 20, 24, 32, 48, 64]

HEAD = """VERSION ""
NS_ :
BS_:
BU_: ECU
"""
TAIL = """BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG","reserved","reserved","reserved",""" + \
    """"reserved","reserved","reserved","reserved","reserved","reserved","reserved","StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "GenMsgCycleTime" 0;
"""


# ---- random DBC files ----

def places(start, length, order):
    """The bits of the frame that a signal takes."""
    if order == 1:
        return set(range(start, start + length))
    bits = set()
    for _ in range(length):
        bits.add(start)
        start = start - 1 if start % 8 else start + 15
    return bits


def find_room(choose, taken, size, length):
    """(start, order) of `length` free bits; None if 40 random tries find none."""
    for _ in range(40):
        order = choose.randint(0, 1)
        start = choose.randrange(8 * size)
        bits = places(start, length, order)
        if max(bits) < 8 * size and not bits & taken:
            taken |= bits
            return start, order
    return None


def signal_line(choose, taken, size, name, mark, kind=None):
    """(SG_ line, SIG_VALTYPE_ of a float or None); None if there is no room."""
    kind = kind or choose.choice(["int"] * 6 + ["float32", "float64"])
    length = {"float32": 32, "float64": 64, "int": choose.choice([1, 2, 7, 8, 9, 12, 16, 24, 31, 32, 33, 53, 63, 64]),
              "multiplexor": choose.choice([2, 3, 4, 8])}[kind]
    room = find_room(choose, taken, size, length)
    if room is None:
        return None
    sign = "+" if kind == "multiplexor" else choose.choice("+-")
    scale, offset = ("1", "0") if kind == "multiplexor" else (choose.choice(["1", "0.5", "-2", "0.1", "0.0078125"]),
                                                              choose.choice(["0", "16", "-40"]))
    line = f' SG_ {name} {mark}: {room[0]}|{length}@{room[1]}{sign} ({scale},{offset}) [0|0] "u{name}" ECU\n'
    return line, {"float32": 1, "float64": 2}.get(kind)


def message_of(choose, number):
    """(text, tail) of one message."""
    extended = choose.random() < 0.4
    fd = choose.random() < 0.4
    frame_id = choose.randrange(2**29) if extended else choose.randrange(2**11)
    frame_id = frame_id // 64 * 64 + number  # unique
    size = choose.choice(FD_LENGTHS) if fd else choose.choice([2, 4, 8, 8, 8])
    written = frame_id | (0x80000000 if extended else 0)
    lines, tail = [f"BO_ {written} M{number}: {size} ECU\n"], []
    plain = set()

    def add(name, mark, taken, kind=None):
        made = signal_line(choose, taken, size, name, mark, kind)
        if made:
            lines.append(made[0])
            if made[1]:
                tail.append(f"SIG_VALTYPE_ {written} {name} : {made[1]};\n")
        return made is not None

    multiplexed = choose.random() < 0.5 and add(f"S{number}M", "M ", plain, "multiplexor")
    for i in range(choose.randint(1, 4)):
        add(f"S{number}_{i}", "", plain)
    if multiplexed:
        pages = choose.sample(range(4), choose.randint(1, 3))
        for page in pages:
            taken = set(plain)
            for i in range(choose.randint(1, 2)):
                name = f"S{number}_p{page}_{i}"
                if add(name, f"m{page} ", taken):
                    tail.append(f"SG_MUL_VAL_ {written} {name} S{number}M {page}-{page};\n")
        if choose.random() < 0.5:  # one below another
            page = next(value for value in range(4) if value not in pages)
            taken = set(plain)
            if add(f"S{number}N", f"m{page}M ", taken, "multiplexor"):
                tail.append(f"SG_MUL_VAL_ {written} S{number}N S{number}M {page}-{page};\n")
                if add(f"S{number}_q", "m1 ", taken):
                    tail.append(f"SG_MUL_VAL_ {written} S{number}_q S{number}N 1-1, 3-3;\n")
    attributes = [f'BA_ "VFrameFormat" BO_ {written} {(15 if extended else 14) if fd else int(extended)};\n']
    if choose.random() < 0.5:
        attributes.append(f'BA_ "GenMsgCycleTime" BO_ {written} 20;\n')
    return "".join(lines) + "\n", attributes, tail


def random_dbc(choose):
    messages = [message_of(choose, number) for number in range(choose.randint(2, 5))]
    return (HEAD + "".join(text for text, _, _ in messages) + TAIL
            + "".join(line for _, attributes, _ in messages for line in attributes)
            + "".join(line for _, _, tail in messages for line in tail))


# ---- through dbc2json ----

def convert(path, *options):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        arguments, sys.argv = sys.argv, ["dbc2json", path, *options]
        try:
            dbc2json.main()
        finally:
            sys.argv = arguments
    return json.loads(out.getvalue())


def write_configuration(folder, part):
    path = os.path.join(folder, "config.json")
    with open(path, "w", encoding="utf-8") as file:
        json.dump({"twinlock": 1, "name": "oracle", "step_s": 0.01, "components": {"c": {"fmu": "c.fmu"}}, **part}, file)
    return path


def probe(path, what, lines):
    done = subprocess.run([PROBE, path, what], input="".join(line + "\n" for line in lines), stdout=subprocess.PIPE,
                          text=True, timeout=60 * PATIENCE, check=True)
    return done.stdout.splitlines()


# ---- decode ----

def value_of(signal, raw):
    value = float(raw) * float(signal.scale) + float(signal.offset)
    return value if math.isfinite(value) else None


def same(one, other):
    return one == other and math.copysign(1, one) == math.copysign(1, other) if None not in (one, other) else one is other


def random_data(choose, message):
    """Random bits; a multiplexor has a value that selects some signal."""
    data = choose.choice([bytes(message.length), b"\xff" * message.length, choose.randbytes(message.length),
                          choose.randbytes(message.length)])
    bits = bytearray(data)
    for signal in message.signals:
        if signal.is_multiplexer:
            ids = [i for other in message.signals if other.multiplexer_signal == signal.name
                   for i in other.multiplexer_ids] or [0]
            put(bits, signal, choose.choice(ids))
    return bytes(bits)


def put(bits, signal, value):
    """Writes `value` bit by bit, in the DBC format's order."""
    at = signal.start
    for i in range(signal.length):
        bit = value >> i & 1 if signal.byte_order == "little_endian" else value >> (signal.length - 1 - i) & 1
        bits[at // 8] = bits[at // 8] & ~(1 << at % 8) | bit << at % 8
        if signal.byte_order == "little_endian":
            at += 1
        else:
            at = at - 1 if at % 8 else at + 15


def check_decode(choose, database, path):
    cases = [(message, random_data(choose, message)) for message in database.messages for _ in range(FRAMES)]
    lines = probe(path, "decode", [f"{message.frame_id:x} {int(message.is_extended_frame)} {data.hex()}"
                                   for message, data in cases])
    failures = 0
    compared = 0
    for (message, data), line in zip(cases, lines, strict=True):
        raw = message.decode(data, decode_choices=False, scaling=False)
        wanted = {name: value_of(message.get_signal_by_name(name), number) for name, number in raw.items()}
        found = {name: None if text == "nan" else float(text)
                 for name, text in (pair.split("=") for pair in line.split())}
        compared += len(wanted)
        if found.keys() != wanted.keys() or not all(same(found[name], wanted[name]) for name in wanted):
            failures += 1
            print(f"decode {message.name} {data.hex()}: {found}, cantools {wanted}")
    return compared, failures


# ---- encode ----

def random_raw(choose, signal):
    if signal.is_float:
        return choose.choice([0.0, -1.5, 1024.0, 2.0**-20])
    bits = min(signal.length, 50)
    low, high = (-2**(bits - 1), 2**(bits - 1) - 1) if signal.is_signed else (0, 2**bits - 1)
    return choose.choice([low, high, choose.randint(low, high)])


def check_encode(choose, database, path, plant):
    """cantools decodes what the emulated plant sends. A scale that is no power of two causes a rounding error."""
    signals = {signal.name: (message, signal) for message in database.messages for signal in message.signals}
    raws = {name: random_raw(choose, signals[name][1]) for name in plant}
    values = [value_of(signals[name][1], raws[name]) for name in plant]
    words = probe(path, "encode", [" ".join(repr(value) for value in values)])[0].split()
    seen, failures = set(), 0
    for frame_id, extended, fd, data in zip(*[iter(words)] * 4, strict=True):
        message = database.get_message_by_frame_id(int(frame_id, 16))
        raw = message.decode(bytes.fromhex(data), decode_choices=False, scaling=False)
        wrong = [(name, number, raws[name]) for name, number in raw.items()
                 if name in raws and not math.isclose(number, raws[name], rel_tol=1e-14, abs_tol=1e-12)]
        seen |= raw.keys()
        if wrong or bool(int(extended)) != message.is_extended_frame or bool(int(fd)) != message.is_fd:
            failures += 1
            print(f"encode {message.name} {data}: {wrong}, extended {extended}, fd {fd}")
    if raws.keys() - seen:
        failures += 1
        print(f"encode: no frame has {raws.keys() - seen}")
    return failures


def check_random(choose, folder):
    compared, layouts, failures = 0, 0, 0
    for number in range(FILES):
        path = os.path.join(folder, f"{number}.dbc")
        with open(path, "w", encoding="cp1252") as file:
            file.write(random_dbc(choose))
        database = cantools.database.load_file(path)
        part = convert(path, "--interface", "vcan0")
        # Decoding has the multiplexors as signals; encoding sets them from the selected signals, so they are removed below.
        config = write_configuration(folder, part)
        layouts += len(part["plant"])
        done, wrong = check_decode(choose, database, config)
        compared += done
        failures += wrong
        for name in {signal.multiplexer_signal for message in database.messages for signal in message.signals} - {None}:
            del part["plant"][name]
        if part["plant"]:
            failures += check_encode(choose, database, write_configuration(folder, part), part["plant"])
        for name, entry in part["plant"].items():
            if entry.get("unit") != "u" + name:
                failures += 1
                print(f"dbc2json: the unit of {name} is {entry.get('unit')}")
    print(f"{FILES} files, {layouts} layouts, {compared} values compared, {failures} failures")
    return failures + (0 if layouts > 500 and compared > 2000 else 1)


# ---- the command ----

SMALL = HEAD + """BO_ 291 Engine: 8 ECU
 SG_ Speed : 0|16@1+ (0.125,0) [0|8031.875] "rpm" ECU
 SG_ Temperature : 23|8@0- (1,-40) [-40|210] "\u00b0C" ECU
 SG_ Running : 32|1@1+ (1,0) [0|0] "" ECU
BO_ 2566844672 Shared: 8 ECU
 SG_ Speed : 0|16@1+ (1,0) [0|0] "" ECU
 SG_ Half : 16|16@1- (1,0) [0|0] "" ECU
 SG_ Beyond : 56|16@1+ (1,0) [0|0] "" ECU
""" + TAIL + 'BA_ "GenMsgCycleTime" BO_ 291 20;\nSIG_VALTYPE_ 2566844672 Half : 1;\n'

EXPECTED = {
    "Engine_Speed": {"unit": "rpm", "min": 0, "max": 8031.875, "stale_s": 0.1,
                     "can": {"source": "vcan0", "id": "0x123", "start": 0, "length": 16, "scale": 0.125}},
    "Temperature": {"unit": "\u00b0C", "min": -40, "max": 210, "stale_s": 0.1,
                    "can": {"source": "vcan0", "id": "0x123", "start": 23, "length": 8, "order": "motorola",
                            "type": "signed", "offset": -40}},
    "Running": {"type": "boolean", "stale_s": 0.1, "can": {"source": "vcan0", "id": "0x123", "start": 32, "length": 1}},
    "Shared_Speed": {"can": {"source": "vcan0", "id": "0x18FEF100", "start": 0, "length": 16}},
}

J1939 = HEAD + """BO_ 2364540158 EEC1: 8 ECU
 SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" ECU
 SG_ Mode : 0|4@1+ (1,0) [0|15] "" ECU
BO_ 2348810243 TSC1: 8 ECU
 SG_ Requested : 8|8@1+ (1,0) [0|250] "" ECU
BO_ 2566843904 ET1: 8 ECU
 SG_ Coolant : 0|8@1+ (1,-40) [-40|210] "" ECU
BO_ 2566843905 ET2: 8 ECU
 SG_ Oil : 0|8@1- (1,0) [0|0] "" ECU
BO_ 2566844672 Plain: 8 ECU
 SG_ Load : 0|8@1+ (1,0) [0|250] "" ECU
BO_ 2348941315 ToFirst: 8 ECU
 SG_ First : 0|8@1- (1,0) [0|0] "" ECU
BO_ 2348941571 ToSecond: 8 ECU
 SG_ Second : 0|8@1- (1,0) [0|0] "" ECU
BO_ 2348941316 OtherSender: 8 ECU
 SG_ Other : 0|8@1- (1,0) [0|0] "" ECU
""" + TAIL + "".join(f'BA_ "VFrameFormat" BO_ {frame} 3;\n'
                   for frame in (2364540158, 2348810243, 2566843904, 2566843905, 2348941315, 2348941571, 2348941316))

EXPECTED_J1939 = {
    "EngineSpeed": {"source": "can0", "pgn": 0xF004, "start": 24, "length": 16, "scale": 0.125, "not_available": True},
    "Mode": {"source": "can0", "pgn": 0xF004, "start": 0, "length": 4},
    "Requested": {"source": "can0", "pgn": 0, "start": 8, "length": 8, "not_available": True},
    "Coolant": {"source": "can0", "pgn": 0xFEEE, "source_address": 0, "start": 0, "length": 8, "offset": -40,
                "not_available": True},
    "Oil": {"source": "can0", "pgn": 0xFEEE, "source_address": 1, "start": 0, "length": 8, "type": "signed"},
    "Load": {"source": "can0", "id": "0x18FEF100", "start": 0, "length": 8},
    "First": {"source": "can0", "id": "0xC020003", "start": 0, "length": 8, "type": "signed"},
    "Second": {"source": "can0", "id": "0xC020103", "start": 0, "length": 8, "type": "signed"},
    "Other": {"source": "can0", "pgn": 0x200, "source_address": 4, "start": 0, "length": 8, "type": "signed"},
}

# (id, data, what the program reads)
J1939_FRAMES = [
    ("18f00417", "0f0000401f000000", "EngineSpeed=1000 Mode=15"),
    ("cf004fe", "00000000fd000000", "EngineSpeed=8096 Mode=0"),
    ("cf004fe", "00000000feff0000", "EngineSpeed=nan Mode=0"),
    ("cf004fe", "000000ffffffffff", "EngineSpeed=nan Mode=0"),
    ("cf00504", "0000000000000000", ""),
    ("c00ff21", "0005000000000000", "Requested=5"),
    ("c0000fe", "00fe000000000000", "Requested=nan"),
    ("c010003", "0005000000000000", ""),
    ("18feee00", "6400000000000000", "Coolant=60"),
    ("18feee01", "ff00000000000000", "Oil=-1"),
    ("18feee02", "6400000000000000", ""),
    ("18fef100", "ff00000000000000", "Load=255"),
    ("1cfef100", "ff00000000000000", ""),
    ("c020003", "0100000000000000", "First=1"),
    ("c020103", "0200000000000000", "Second=2"),
    ("c020504", "0300000000000000", "Other=3"),
]

# (options, exit code, parts of the message)
WRONG = [
    (["--message", "Engin"], 65, "message|Engin|Engine"),
    (["--message", "Zzz"], 65, "message|Zzz|Engine, Shared"),
    (["--signal", "Sped"], 65, "signal|Sped|Speed"),
    (["--message", "Engine", "--signal", "Half"], 65, "signal|Half|Speed, Temperature, Running"),
    (["--signal", "Half"], 65, "Shared.Half|float|16 bits|32|64"),
    (["--signal", "Beyond"], 65, "Shared.Beyond|16 bits|56|8 bytes"),
    (["--interface", "a/b"], 65, "--interface|a/b|1 to 15"),
    (["--interfaces", "a"], 2, "usage: script/dbc2json"),
    (["--signal"], 2, "usage: script/dbc2json"),
]


def run_script(*arguments):
    return subprocess.run([SCRIPT, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=300,
                          check=False)


def check_j1939(folder):
    path = os.path.join(folder, "j1939.dbc")
    with open(path, "w", encoding="cp1252") as file:
        file.write(J1939)
    part = convert(path)
    found = {name: entry["can"] for name, entry in part["plant"].items()}
    failures = 0
    if found != EXPECTED_J1939:
        failures += 1
        print(f"dbc2json of J1939: {found}")
    config = write_configuration(folder, part)
    lines = probe(config, "decode", [f"{frame} 1 {data}" for frame, data, _ in J1939_FRAMES])
    for (frame, data, wanted), line in zip(J1939_FRAMES, lines, strict=True):
        if sorted(line.split()) != sorted(wanted.split()):
            failures += 1
            print(f"decode {frame} {data}: {line}, expected {wanted}")
    sent = probe(config, "encode", ["1000 1 5 60 -1 7 1 2 3"])[0].split()[::4]
    if sent != ["18f00400", "1800ff00", "18feee00", "18feee01", "18fef100", "c020003", "c020103", "1802ff04"]:
        failures += 1
        print(f"encode: ids {sent}")
    return failures


def check_ranges(folder):
    """More values of a multiplexor than a list takes."""
    path = os.path.join(folder, "ranges.dbc")
    with open(path, "w", encoding="cp1252") as file:
        file.write(HEAD + 'BO_ 291 Pages: 8 ECU\n SG_ Page M : 0|8@1+ (1,0) [0|0] "" ECU\n'
                   ' SG_ Level m1 : 8|8@1+ (1,0) [0|0] "" ECU\n\n' + TAIL + "SG_MUL_VAL_ 291 Level Page 1-1, 3-30, 200-255;\n")
    part = convert(path)
    found = part["plant"]["Level"]["can"]["multiplex"]["value"]
    lines = probe(write_configuration(folder, part), "decode", [f"123 0 {page:02x}07000000000000" for page in range(256)])
    pages = [page for page, line in enumerate(lines) if "Level=7" in line]
    right = found == [1, "3-30", "200-255"] and pages == [1, *range(3, 31), *range(200, 256)]
    if not right:
        print(f"ranges: {found}, present at {pages}")
    return 0 if right else 1


def check_command(folder):
    failures = 0

    def expect(condition, what):
        nonlocal failures
        if not condition:
            failures += 1
            print(f"dbc2json: {what}")

    path = os.path.join(folder, "small.dbc")
    with open(path, "w", encoding="cp1252") as file:
        file.write(SMALL)
    done = run_script(path, "--interface", "vcan0")
    expect(done.returncode == 0, f"ends with {done.returncode}: {done.stderr}")
    part = json.loads(done.stdout)
    expect(part["sources"] == {"vcan0": {"can": {"interface": "vcan0"}}}, f"sources: {part['sources']}")
    expect(part["plant"] == EXPECTED, f"plant: {part['plant']}")
    expect(has_line(done.stderr, "Shared.Half|float|16 bits") and has_line(done.stderr, "Shared.Beyond|16 bits|56"), f"logs {done.stderr}")
    probe(write_configuration(folder, part), "decode", [])  # the program accepts it
    one = json.loads(run_script(path, "--signal", "Engine.Speed").stdout)["plant"]
    expect(list(one) == ["Speed"] and one["Speed"]["can"]["source"] == "can0", f"one signal: {one}")
    for options, code, parts in WRONG:
        done = run_script(path, *options)
        expect(done.returncode == code and has_line(done.stderr, parts) and not done.stdout,
               f"{options}: ends with {done.returncode}, logs {done.stderr}{done.stdout}")
    for name, text, parts in (("none.dbc", None, "none.dbc|No such file"), ("bad.dbc", "this is no DBC", "bad.dbc|DBC file"),
                              ("empty.dbc", HEAD, "empty.dbc|no signal"),
                              ("many.dbc", HEAD + "".join(f"BO_ {i + 1} M{i}: 8 ECU\n" + "".join(
                                  f' SG_ S{i}_{k} : {k}|1@1+ (1,0) [0|0] "" ECU\n' for k in range(60)) + "\n"
                                  for i in range(2)), "120 signals|64")):
        if text is not None:
            with open(os.path.join(folder, name), "w", encoding="cp1252") as file:
                file.write(text)
        done = run_script(os.path.join(folder, name))
        expect(done.returncode == 65 and has_line(done.stderr, parts) and not done.stdout,
               f"{name}: ends with {done.returncode}, logs {done.stderr}{done.stdout}")
    return failures + check_encodings(folder)


def check_encodings(folder):
    """A unit beyond cp1252, and bytes that the encoding does not have."""
    failures = 0
    path = os.path.join(folder, "encoded.dbc")
    # (encoding of the file, options, unit or parts of the message)
    for encoding, options, wanted in (("utf-8", ["--encoding", "utf-8"], "\u2103"), ("gb2312", ["--encoding", "gb2312"], "\u2103"),
                                      ("cp1252", [], "\u00b0C"), ("gb2312", ["--encoding", "utf-8"], "decoded|utf-8|--encoding"),
                                      ("utf-8", ["--encoding", "ascii"], "decoded|ascii|--encoding"),
                                      ("cp1252", ["--encoding", "latin-none"], "--encoding|latin-none|cp1252")):
        with open(path, "w", encoding=encoding) as file:
            file.write(SMALL if encoding == "cp1252" else SMALL.replace("\u00b0C", "\u2103"))
        done = run_script(path, "--signal", "Temperature", *options)
        if "|" not in wanted:
            right = done.returncode == 0 and json.loads(done.stdout)["plant"]["Temperature"]["unit"] == wanted
        else:
            right = done.returncode == 65 and has_line(done.stderr, wanted) and not done.stdout
        if not right:
            failures += 1
            print(f"encoding {encoding}, {options}: ends with {done.returncode}, {done.stdout}{done.stderr}")
    return failures


def main():
    seed = int(os.environ.get("TL_SEED", "4711"))
    with tempfile.TemporaryDirectory() as folder:
        failures = check_random(random.Random(seed), folder) + check_j1939(folder) + check_ranges(folder) + check_command(folder)
    print(f"{failures} failures (TL_SEED={seed})")
    sys.exit(1 if failures else 0)


main()
