"""Measures the cures of `twinlock probe`: see the command registers, which builds and starts this."""
import argparse
import copy
import json
import logging
import math
import random
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from random_device import KINDS, ONE, ONE_SIGNAL, Loop, decode, encode, longest_request, random_case
from study import PROGRAM, Progress, Trouble, print_figures, run_command

KEY = re.compile(r'"(\w+)": ("\w+"|[-+.e\d]+)( in its source)?')
CLASSES = ("right", "half", "cannot be told", "nothing", "false")
GOALS = {**dict.fromkeys(ONE, 0.95), **dict.fromkeys(ONE_SIGNAL, 0.85)}
FALSE, LONGEST_S = 0.01, 30


def apply(config, cures):
    """The configuration with the keys of the cures."""
    cured = copy.deepcopy(config)
    for name, cure in cures.items():
        for key, value, in_source in KEY.findall(cure or ""):
            place = cured["sources"]["device"]["modbus_tcp"] if in_source else cured["plant"][name]["modbus"]
            place[key] = json.loads(value)
    return cured


def reads_alike(one, other):
    """True if two mappings of a signal give the same for each value between min and max."""
    places = [[signal["modbus"][key] for key in ("table", "address", "unit_id")] for signal in (one, other)]
    steps = [one["min"] + (one["max"] - one["min"]) * part / 16 for part in range(17)]
    words = [encode(one, value) + [0] * 4 for value in steps]
    return places[0] == places[1] and all(decode(one, word) == decode(other, word) or math.isclose(decode(one, word), decode(other, word), rel_tol=1e-6)
                                          for word in words)


def is_right(device, cured):
    """True if the configuration reads what the right one reads. Requests may be as long as the device answers."""
    right = device.config()
    sources = [{key: value for key, value in config["sources"]["device"]["modbus_tcp"].items() if key not in ("most_registers", "pause_s")}
               for config in (cured, right)]
    source = cured["sources"]["device"]["modbus_tcp"]
    return (sources[0] == sources[1] and source["pause_s"] >= device.pause and longest_request(cured, source["most_registers"]) <= device.limit
            and all(reads_alike(right["plant"][name], signal) for name, signal in cured["plant"].items()))


def classify(device, config, report):
    cures = {name: signal["cure"] for name, signal in report["signals"].items()}
    if any(KEY.search(cure or "") for cure in cures.values()):
        harmless = is_right(device, apply(device.config(), cures))
        return "right" if is_right(device, apply(config, cures)) else "half" if harmless and config != device.config() else "false"
    return "cannot be told" if any("display" in (cure or "") for cure in cures.values()) else "nothing"


def measure_one(loop, kind, index, options):
    choice = random.Random(f"{options.seed} {kind} {index}")
    host = f"127.{10 + KINDS.index(kind)}.{1 + index // 250}.{1 + index % 250}"
    device, config, mistakes = random_case(choice, host, kind, options.signals)
    loop.run(device.serve())
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "device.json"
            path.write_text(json.dumps(config), encoding="utf-8")
            began = time.monotonic()
            done = subprocess.run([PROGRAM, "probe", path, "--json", "--duration", "1"], capture_output=True, check=False)
            seconds = time.monotonic() - began
    finally:
        loop.run(device.server.shutdown())
    if not done.stdout:
        raise Trouble(f"{kind} {index}: {done.stderr.decode().strip()}")
    report = json.loads(done.stdout)
    return {"kind": kind, "index": index, "mistakes": mistakes, "class": classify(device, config, report), "seconds": seconds,
            "at_start": device.at_start, "values": device.values, "right": device.config(), "config": config, "report": report["signals"]}


def measure(options):
    logging.disable(logging.CRITICAL)  # pymodbus logs each exception that it sends
    kinds = options.only.split(",") if options.only else KINDS
    if not set(kinds) <= set(KINDS):
        raise Trouble(f"--only: found \"{options.only}\", expected some of {','.join(KINDS)}")
    progress = Progress(options.devices * len(kinds))
    cases = []
    with Loop() as loop, ThreadPoolExecutor(options.jobs) as pool:
        for case in [pool.submit(measure_one, loop, kind, index, options) for index in range(options.devices) for kind in kinds]:
            cases.append(case.result())
            progress.say(cases[-1]["kind"])
    progress.end()
    return {"seed": options.seed, "kinds": {kind: summary([case for case in cases if case["kind"] == kind]) for kind in kinds},
            "false": sum(case["class"] == "false" for case in cases) / len(cases),
            "failures": [case for case in cases if case["class"] == "false" or (case["mistakes"] and case["class"] != "right")]}


def summary(cases):
    seconds = sorted(case["seconds"] for case in cases)
    at_start = [case for case in cases if case["at_start"]]
    return {"devices": len(cases), "at_start": len(at_start), "right_at_start": sum(case["class"] == "right" for case in at_start), **{name: sum(case["class"] == name for case in cases) for name in CLASSES},
            "median_s": seconds[len(seconds) // 2], "longest_s": seconds[-1]}


def is_met(figures):
    """True if each goal is met."""
    rows = figures["kinds"].items()
    return figures["false"] <= FALSE and all(
        row["right_at_start"] >= GOALS.get(kind, 0) * row["at_start"] and (kind != "two" or row["longest_s"] <= LONGEST_S) for kind, row in rows)


def show(figures, failures):
    print(f"{'mistake':14}{'devices':>8}{'right':>7}{'half':>6}{'cannot be told':>16}{'nothing':>9}{'false':>7}{'at start':>10}{'right':>7}{'median s':>10}{'longest s':>11}")
    for kind, row in figures["kinds"].items():
        print(f"{kind:14}{row['devices']:8}{row['right']:7}{row['half']:6}{row['cannot be told']:16}{row['nothing']:9}{row['false']:7}"
              f"{row['at_start']:10}{row['right_at_start']:7}{row['median_s']:10.1f}{row['longest_s']:11.1f}")
    print(f"false cures: {100 * figures['false']:.2f} % of all devices; seed {figures['seed']}")
    for case in figures["failures"] if failures else ():
        print(f"\n{case['kind']} {case['index']}: {case['class']}, {case['mistakes']}, at start: {case['at_start']}")
        for name, signal in case["report"].items():
            right, wrong = case["right"]["plant"][name], case["config"]["plant"][name]
            print(f"  {name}: {signal['value']}, {right['min']} to {right['max']}, start {right['initial']}, true {case['values'][name]:.5g}; {signal['registers']}; "
                  f"{signal['quality']}; cure: {signal['cure']}\n    right {right['modbus']}\n    wrong {wrong['modbus']}")


def main():
    parser = argparse.ArgumentParser()
    for name, default in ("devices", 50), ("seed", 1), ("signals", 3), ("jobs", 6):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--only")
    parser.add_argument("--failures", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    figures = measure(options)
    print_figures(figures, options.json, lambda found: show(found, options.failures))
    return 0 if is_met(figures) else 1


if __name__ == "__main__":
    sys.exit(run_command("registers", main, 65))
