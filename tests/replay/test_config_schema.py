#!/usr/bin/env python3
"""The schema for editors and the program's own reader agree about every configuration.

Both must accept the configurations of the repository. Mutants of configurations that together use every key follow: deleted,
renamed and doubled keys, values of other types and at the limits of their ranges. If the schema rejects one, the reader must
reject it at the same place. If the schema accepts it, the reader must apply the few rules that a schema cannot express;
`beyond_schema` repeats them.
"""
import collections
import copy
import decimal
import glob
import itertools
import json
import os
import random
import subprocess
import sys
import tempfile

import jsonschema

from twinlock_test import program

SOURCE = os.environ["TL_SOURCE"]
PROBE = program("config_probe")
FULL = os.path.join(SOURCE, "tests", "support", "configuration_full.json")
FREE = os.path.join(SOURCE, "tests", "support", "configuration_free.json")
EPSILON = os.path.join(SOURCE, "tests", "support", "configuration_epsilon.json")
CAN = os.path.join(SOURCE, "tests", "support", "configuration_can.json")
MODBUS = os.path.join(SOURCE, "tests", "support", "configuration_modbus.json")
EVENT = os.path.join(SOURCE, "tests", "support", "configuration_event.json")  # excludes a horizon of steps
MUTANTS = 600
SOLVERS = {1: "nelder-mead", 100: "l-bfgs", 1000: "bobyqa"}  # the dissertation's numbers
CODES = {"int8": (-2**7, 2**8 - 1), "uint8": (0, 2**8 - 1), "int16": (-2**15, 2**16 - 1), "uint16": (0, 2**16 - 1),
         "int32": (-2**31, 2**32 - 1), "uint32": (0, 2**32 - 1), "int64": (-2**63, 2**63), "uint64": (0, 2**64),
         "bcd16": (0, 9999), "bcd32": (0, 99999999), "float32": (-(2 - 2**-23) * 2**127, (2 - 2**-23) * 2**127)}
REGISTERS = {"int32": 2, "uint32": 2, "float32": 2, "bcd32": 2, "int64": 4, "uint64": 4, "float64": 4}
VALUES = [None, True, False, "", "text", "a\tb", "plant.omega", "motor.omega", "nobody.omega", "plant.nobody", "plc", "stream",
          "holding", "coil", "bit", "int16", "float64", "boolean", 0, -1, 1, 2, 3, 1.5, 5.0, 0.5, 1e-6, 1e-5, 3600, 3601,
          62, 64, 65, 98, 99, 247, 248, 255, 1000, 1001, 65534, 65535, 65536, 100001, 2147483647, 2147483648, 1e9, 1.1e9,
          1e300, -1e300, [], {}, [1, 2], [2, 1], [0.1, 0.1], ["a", "b"], {"to": "plant.omega"}, {"step": 1}, {"fmu": "x"},
          4, 99, 100, 100000, 1000000, 1000001, 1e-3, "states", "outputs", "dynamic", "hold", "secant", "nelder-mead", "bobyqa",
          "bus", "can0", "a/b", "0x7FF", "0x800", "0x1FFFFFFF", "0x20000000", "x", 2047, 2048, 536870911, 536870912, 8, 12, 32, 33,
          63, 511, 512, 4294967295, 4294967296, "signed", "float32", "intel", "motorola", [1, 2, 3], [0] * 16, [0] * 17,
          {"start": 0, "length": 4, "value": 3}, {"median": 3}, {"rate": 0.1}, {"nodes": 2}, {"to": "plant.omega", "tolerance": 1}]


class Members(list):
    """An object as a list of [key, value], so that it can contain a key twice."""


def parse(text):
    return json.loads(text, object_pairs_hook=lambda pairs: Members([key, value] for key, value in pairs))


def dump(value):
    if isinstance(value, Members):
        return "{" + ",\n".join(f"{json.dumps(key)}: {dump(inner)}" for key, inner in value) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(dump(inner) for inner in value) + "]"
    return json.dumps(value, allow_nan=False)


def plain(value):
    """The document with ordinary objects."""
    if isinstance(value, Members):
        return {key: plain(inner) for key, inner in value}
    return [plain(inner) for inner in value] if isinstance(value, list) else value


def has_double(value):
    if isinstance(value, Members):
        keys = [key for key, _ in value]
        return len(set(keys)) < len(keys) or any(has_double(inner) for _, inner in value)
    return isinstance(value, list) and any(has_double(inner) for inner in value)


# ---- mutants ----

def slots(value):
    """Every [container, index] of a value. For an object the container is its [key, value] pair."""
    members = [(pair, 1) for pair in value] if isinstance(value, Members) else [(value, i) for i in range(len(value))]
    for container, index in members:
        yield container, index
        if isinstance(container[index], list):
            yield from slots(container[index])


def objects(value):
    if isinstance(value, Members):
        yield value
    if isinstance(value, list):
        for inner in value:
            yield from objects(inner[1] if isinstance(value, Members) else inner)


def typo(key, rng):
    at = rng.randrange(len(key) + 1)
    return rng.choice([key[:at] + "x" + key[at:], key[:at] + key[at + 1:], key.upper(), "2" + key, "", "plant",
                       key.replace("motor.", "nobody."), "plant.omega"])


def mutate(document, rng):
    """Changes one thing and returns the name of the change."""
    what = rng.choice(["delete", "rename", "double", "retype", "retype", "retype", "scale", "move", "grow"])
    chosen = rng.choice([one for one in objects(document) if one] or [Members([["twinlock", 1]])])
    at = rng.randrange(len(chosen))
    container, index = rng.choice(list(slots(document)))
    if what == "delete":
        del chosen[at]
    elif what == "rename":
        chosen[at][0] = typo(chosen[at][0], rng)
    elif what == "double":
        chosen.append(copy.deepcopy(chosen[at]))
    elif what == "retype":
        container[index] = parse(json.dumps(rng.choice(VALUES)))
    elif what == "scale":
        numbers = [slot for slot in slots(document) if type(slot[0][slot[1]]) in (int, float)]
        if numbers:
            container, index = rng.choice(numbers)
            container[index] *= rng.choice([-1, 0, 0.5, 3, 1000, 1e-9])
    elif what == "move":
        other, other_index = rng.choice(list(slots(document)))
        container[index] = copy.deepcopy(other[other_index])
    else:
        for i in range(rng.choice([8, 16, 62, 64]) - len(chosen) + rng.choice([0, 1])):
            chosen.append([chosen[at][0] + str(i), copy.deepcopy(chosen[at][1])])
    return what


# ---- what a schema cannot say ----

def exists(document, name):
    head, _, tail = name.partition(".")
    return tail in document["plant"] if head == "plant" else head in document["components"]


def names(document):
    """Every reference of a configuration that fits the schema."""
    for ends in document.get("connect", []):
        yield from ends
    synchronise = document.get("synchronise", {})
    matches = {**synchronise.get("match", {}), **document.get("compare", {})}
    yield from synchronise.get("adjust", {})
    yield from matches
    yield from (match["to"] for match in matches.values())
    yield from (column["from"] for column in document.get("emulate", {}).get("columns", {}).values())


def field_holds(field, bytes_, length=None):
    """True if the CAN frame contains all bits of the field."""
    length = length or field["length"]
    start = int(field["start"])
    first = start if field.get("order", "intel") == "intel" else start // 8 * 8 + 7 - start % 8
    return first + length <= 8 * bytes_


def value_holds(value, length):
    low, high = map(int, value.split("-")) if isinstance(value, str) else (value, value)
    return low <= high < 2**length


def multiplex_holds(outer, bytes_, level=1):
    multiplex = outer.get("multiplex")
    if multiplex is None:
        return True
    values = multiplex["value"] if isinstance(multiplex["value"], list) else [multiplex["value"]]
    return (level <= 4 and field_holds(multiplex, bytes_) and all(value_holds(value, multiplex["length"]) for value in values)
            and multiplex_holds(multiplex, bytes_, level + 1))


def can_holds(can):
    if can is None:
        return True
    number = 2**28 if "pgn" in can else int(can["id"], 16) if isinstance(can["id"], str) else can["id"]
    bytes_ = can.get("bytes", 8)
    length = {"float32": 32, "float64": 64}.get(can.get("type"), can.get("length"))
    return (can.get("extended", True) or number <= 0x7FF) and (can.get("fd", True) or bytes_ <= 8) and \
        field_holds(can, bytes_, length) and multiplex_holds(can, bytes_)


def gpio_holds(sources, gpio):
    return "line" in gpio or "chip" in sources[gpio["source"]]["gpio"]


def is_each_line_used_once(document):
    """True if one source uses each serial line, and one signal each GPIO line."""
    sources = document.get("sources", {})
    devices = [source["modbus_rtu"]["device"] for source in sources.values() if "modbus_rtu" in source]
    lines = [(sources[gpio["source"]]["gpio"].get("chip"), gpio.get("line"), gpio.get("offset"))
             for gpio in (signal["gpio"] for signal in document["plant"].values() if "gpio" in signal)]
    return len(set(devices)) == len(devices) and len(set(lines)) == len(lines)


def codes_hold(modbus):
    low, high = CODES.get(modbus.get("type"), (float("-inf"), float("inf")))
    return all(low <= code <= high and (modbus["type"].startswith("float") or code == int(code))
               for code in modbus.get("not_available", []))


def signal_holds(document, signal):
    modbus, can, gpio = signal.get("modbus"), signal.get("can"), signal.get("gpio")
    sources = document.get("sources", {})
    live = [(("csv",), signal.get("csv", {}).get("source"))]
    live += [(("modbus_tcp", "modbus_rtu"), modbus["source"])] if modbus else []
    live += [(("can",), can["source"])] if can else []
    live += [(("gpio",), gpio["source"])] if gpio else []
    return (signal.get("min", float("-inf")) <= signal.get("max", float("inf"))
            and all(name is None or any(kind in sources.get(name, {}) for kind in kinds) for kinds, name in live)
            and can_holds(can)
            and (not gpio or gpio_holds(sources, gpio))
            and (not modbus or "modbus_rtu" not in sources[modbus["source"]] or 1 <= modbus.get("unit_id", 1) <= 247)
            and (not modbus or codes_hold(modbus))
            and (not modbus or modbus["address"] + REGISTERS.get(modbus.get("type"), 1) <= 65536))


def is_short_enough(document, match):
    low_pass = match.get("condition", {}).get("low_pass_s", 0)
    return round(low_pass * 1e9) <= 1000 * round(document["step_s"] * 1e9)


def mode(document, chain):
    """(rightmost mode in ns, asynchronous links) of a chain of participants."""
    delays = document["delays"]
    bases = {name: name for name in delays["participants"]}
    bases.update({name: group[0] for group in delays.get("synchronous", []) for name in group})
    times = {name: [round(one.get("dead_s", 0) * 1e9), max(round(one["cycle_s"] * 1e9), 1)]
             for name, one in delays["participants"].items()}
    groups = [list(group) for _, group in itertools.groupby(chain, key=bases.get)]
    cycles = [times[group[0]][1] for group in groups[1:]]
    dead = sum(times[name][0] for group in groups if len(group) > 1 for name in group)
    largest = max(cycles, default=0)
    return dead + (largest if 2 * largest > sum(cycles) else sum(cycles) // 2), len(cycles)


def delays_hold(document):
    delays = document.get("delays")
    if delays in (None, "measure"):
        return True
    measure = delays.get("measure")
    step = round(document["step_s"] * 1e9)
    if isinstance(measure, dict) and max(round(measure.get("range_s", 0) * 1e9), 1) > 31 * step:
        return False
    given = {key: round(delays[key] * 1e9) for key in ("input", "output") if isinstance(delays.get(key), (int, float))}
    pairs = {key: delays[key] for key in ("input", "output") if key in delays and key not in given}
    chains = [pair[key] for pair in pairs.values() for key in ("plant", "simulation")]
    grouped = [name for group in delays.get("synchronous", []) for name in group]
    if not {name for chain in [grouped, *chains] for name in chain} <= set(delays.get("participants", {})):
        return False
    if len(set(grouped)) < len(grouped) or any(mode(document, chain)[1] > 7 for chain in chains):
        return False
    delay = {key: mode(document, pair["simulation"])[0] - mode(document, pair["plant"])[0]
             for key, pair in pairs.items()} | given
    longest = 1000 * step
    shift = delay.get("input", 0) - delay["output"] if "output" in delay else 0
    wait = step
    if "output" in pairs:
        wait = max(round(delays["participants"][delays["output"]["plant"][-1]]["cycle_s"] * 1e9), 1)
    if delays.get("take") == "newest" or not ("output" in delays or measure):
        wait = 0
    return ("input" not in delay or -longest <= delay["input"] <= longest) and \
           -longest <= shift <= longest - wait


def is_approved_in_bounds(adjust):
    approved = adjust.get("nominal", 0) + adjust.get("approved", 0)
    return not {"nominal", "approved"} <= adjust.keys() or adjust.get("min", float("-inf")) <= approved <= adjust.get("max", float("inf"))


def is_watched(document, name):
    return name in document.get("synchronise", {}).get("adjust", {}) or (name.startswith("plant.") and name[6:] in document["plant"])


def beyond_schema(document):
    """True if a configuration that fits the schema also follows the other rules."""
    nanoseconds = decimal.Decimal(repr(document["step_s"])) * 10**9
    targets = [to for _, to in document.get("connect", [])]
    message = document.get("emulate", {}).get("message_s", [0, 0])
    synchronise = document.get("synchronise", {})
    adjusted = synchronise.get("adjust", {}).values()
    solvers = [SOLVERS.get(synchronise.get(key), synchronise.get(key)) for key in ("algorithm", "fallback")]
    return (abs(nanoseconds - round(nanoseconds)) < 1e-6  # 0.30000000000000004 means 0.3
            and all(exists(document, name) for name in names(document))
            and all(signal_holds(document, signal) for signal in document["plant"].values())
            and is_each_line_used_once(document)
            and len(set(targets)) == len(targets)
            and message[0] <= message[1]
            and document.get("start_s", float("-inf")) < document.get("stop_s", float("inf"))
            and all(is_short_enough(document, match) for match in synchronise.get("match", {}).values())
            and delays_hold(document)
            and (solvers[0] is None or solvers[0] != solvers[1])
            and all(one.get("min", float("-inf")) < one.get("max", float("inf")) for one in adjusted)
            and all(is_approved_in_bounds(one) for one in adjusted)
            and all(is_watched(document, name) for name in document.get("detect", {}).get("says", {}))
            and all(name in synchronise.get("adjust", {}) and limit.get("below", float("-inf")) < limit.get("above", float("inf"))
                    for name, limit in document.get("detect", {}).get("alarm", {}).items()))


# ---- the two verdicts ----

def place(error):
    """The place of a fault of the schema, as the reader writes it."""
    path = ""
    for part in error.absolute_path:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def probe(paths):
    """For each file None if the reader accepts it, else its problems as (path, text)."""
    done = subprocess.run([PROBE, *paths], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"config_probe failed with {done.returncode} at file {done.stdout.count('good') + done.stdout.count('bad')}")
    verdicts = []
    for line in done.stdout.splitlines():
        if line in ("good", "bad"):
            verdicts.append(None if line == "good" else [])
        else:
            verdicts[-1].append(tuple(line[2:].split("\t", 1)))
    return verdicts


def explain(problems):
    return "\n".join(f"    reader: {path}: {text}" for path, text in problems or []) or "    reader: good"


def compare(mutant, problems, validator):
    """None if both agree, else the difference."""
    document = plain(mutant)
    errors = list(validator.iter_errors(document))
    good = not errors and not has_double(mutant) and beyond_schema(document)
    if good != (problems is None):
        return "the verdicts differ"
    if problems is not None and (not problems or not all(text.startswith("line ") for _, text in problems)):
        return "a problem without a line"
    for error in errors:
        where = place(error)
        if not any(path.startswith(where) or where.startswith(path) for path, _ in problems):
            return f"the reader says nothing about {where}"
    return None


def check_repository(validator):
    paths = sorted(glob.glob(os.path.join(SOURCE, "config", "**", "*.json"), recursive=True))
    paths = [path for path in paths if os.sep + "schema" + os.sep not in path] + [FULL, FREE, EPSILON, CAN, MODBUS, EVENT]
    failures = 0
    for path, problems in zip(paths, probe(paths)):
        with open(path, encoding="utf-8") as file:
            errors = list(validator.iter_errors(json.load(file)))
        if errors or problems is not None:
            failures += 1
            print(f"{path}: must be good\n{explain(problems)}")
            print("\n".join(f"    schema: {place(error)}: {error.message}" for error in errors))
    print(f"{len(paths)} configurations of the repository")
    return failures


def keys_of(document):
    inner = document.values() if isinstance(document, dict) else document if isinstance(document, list) else ()
    return set(document if isinstance(document, dict) else ()).union(*map(keys_of, inner))


def keys_of_schema(schema):
    inner = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    named = schema.get("properties", {}) if isinstance(schema, dict) else {}
    return set(named if isinstance(named, dict) else ()).union(*map(keys_of_schema, inner))


def check_keys(schema):
    """FULL has all keys except those that exclude others in it. The other configurations have these."""
    found = []
    for path in (FULL, FREE, EPSILON, CAN, MODBUS, EVENT):
        with open(path, encoding="utf-8") as file:
            found.append(keys_of(json.load(file)))
    missing = keys_of_schema(schema) - set().union(*found)
    if missing:
        print("in no configuration of tests/support:", ", ".join(sorted(missing)))
    return len(missing)


def make_mutants(rng):
    bases = []
    for path in (FULL, FREE, EPSILON, CAN, MODBUS):
        with open(path, encoding="utf-8") as file:
            bases.append(parse(file.read()))
    for _ in range(MUTANTS):
        mutant = copy.deepcopy(rng.choice([bases[0], bases[0], bases[0], *bases[1:], bases[-1]]))
        changes = [mutate(mutant, rng) for _ in range(rng.choice([1, 1, 1, 2, 3]))]
        yield changes, mutant


def check_mutants(validator, seed):
    mutants = list(make_mutants(random.Random(seed)))
    counts = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        paths = [os.path.join(folder, f"{i}.json") for i in range(len(mutants))]
        for path, (_, mutant) in zip(paths, mutants):
            with open(path, "w", encoding="utf-8") as file:
                file.write(dump(mutant))
        verdicts = probe(paths)
    for (changes, mutant), problems in zip(mutants, verdicts):
        fault = compare(mutant, problems, validator)
        counts["wrong" if fault else "good" if problems is None else
               "refused by both" if not validator.is_valid(plain(mutant)) else "refused beyond the schema"] += 1
        if fault:
            errors = [f"    schema: {place(error)}: {error.message[:200]}" for error in validator.iter_errors(plain(mutant))]
            print(f"seed {seed}, {' '.join(changes)}: {fault}\n{explain(problems)}", *errors, sep="\n")
    print(f"{len(mutants)} mutants:", ", ".join(f"{count} {name}" for name, count in sorted(counts.items())))
    few = [name for name in ("good", "refused by both", "refused beyond the schema") if counts[name] < MUTANTS // 20]
    if few:
        print("too few to mean anything:", ", ".join(few))
    return counts["wrong"] + len(few)


def main():
    with open(os.path.join(SOURCE, "config", "schema", "twinlock-1.json"), encoding="utf-8") as file:
        schema = json.load(file)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    sys.exit(1 if check_repository(validator) + check_keys(schema) + check_mutants(validator, seed) else 0)


main()
