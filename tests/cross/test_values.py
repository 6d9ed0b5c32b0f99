#!/usr/bin/env python3
"""What is committed on another machine is what is committed here: each configuration that has a recording, and each solver on
each scenario of the dissertation, is replayed by the program of this build in its emulator and by that of build/host, and all
that both write is compared: every step to 1e-12 of the largest value of its column, and to the bit where no model calls a function
of libm whose last bit is left to the library; what was executed and evaluated, and why, must be the same anyway.

Which models call one is read from their binaries, of all machines.
"""
import csv
import functools
import json
import math
import os
import subprocess
import zipfile
from pathlib import Path

import motor_bench
from twinlock_test import (FMUS, NOT_LOCKED, PROGRAM, SOURCE, Failure, Skip, environment, expect, main, read_config, scratch,
                           write_config)

RELATIVE = 1e-12
HOST = SOURCE / "build" / "host"
# IEEE 754 leaves these no choice: the nearest double, or an operation on bits.
EXACT = set("ceil copysign fabs floor fma fmax fmin fmod frexp ldexp llrint llround lrint lround modf nearbyint nextafter "
            "remainder rint round scalbln scalbn sqrt trunc".split())
ELSEWHERE = {"wall_s"}  # how long it took is this machine's affair


# ---- the two programs ----

def host_program():
    program = HOST / "bin" / "twinlock"
    if program.exists():
        return program
    why = f"{program} is not there to compare with: run script/build first"
    expect(os.environ.get("CI") != "true", why)
    raise Skip(why)


def replay(program, fmus, config, recording):
    """(table of texts, summary) of one replay."""
    steps, temporary = scratch() / "steps.csv", scratch()
    done = subprocess.run([program, "replay", config, "--csv", steps, "--json", *recording], capture_output=True, text=True,
                          timeout=600, check=False, env={**environment(temporary), "TWINLOCK_FMU_PATH": str(fmus)})
    expect(done.returncode in (0, NOT_LOCKED), f"{program} replay {config} ended with {done.returncode}\n{done.stderr}")
    with open(steps, encoding="utf-8", newline="") as file:
        return list(csv.reader(file)), json.loads(done.stdout)


# ---- what calls libm ----

def names(library, which):
    """Dynamic symbols of an ELF file of any machine, without their versions."""
    done = subprocess.run(["nm", "--dynamic", which, library], capture_output=True, text=True, check=True)
    return {line.split()[-1].split("@")[0] for line in done.stdout.splitlines()}


@functools.cache
def libm():
    """All that libm offers, but what is exact."""
    done = subprocess.run(["gcc", "-print-file-name=libm.so.6"], capture_output=True, text=True, check=True)
    return names(done.stdout.strip(), "--defined-only") - EXACT


@functools.cache
def libm_calls(fmu):
    """What a model calls of it, on any machine."""
    folder, found = scratch(), set()
    with zipfile.ZipFile(fmu) as archive:
        binaries = [name for name in archive.namelist() if name.startswith("binaries/")]
        for name in binaries:
            found |= names(archive.extract(name, folder), "--undefined-only") & libm()
    return len(binaries), sorted(found)


def models_of(document):
    return sorted({Path(part["fmu"]).name for part in document["components"].values()})


def may_differ(document):
    return [model for model in models_of(document) if libm_calls(FMUS / model)[1]]


# ---- comparing ----

def number(text):
    try:
        return float(text or "nan")
    except ValueError:
        return None


def check_column(name, here, there):
    """The largest difference, over the largest value."""
    values = [(number(a), number(b)) for a, b in zip(here, there)]
    if any(a is None or b is None for a, b in values):
        expect(here == there, f"column {name}: not the same words")
        return 0.0
    expect(all(math.isnan(a) == math.isnan(b) for a, b in values), f"column {name}: not the same gaps")
    largest = max((abs(a) for a, _ in values if not math.isnan(a)), default=0.0)
    off = max((abs(a - b) for a, b in values if not math.isnan(a)), default=0.0)
    return off / largest if off else 0.0


def check_tables(here, there):
    """The largest difference of all columns."""
    expect(here[0] == there[0] and len(here) == len(there), f"{len(here)} rows here, {len(there)} there")
    return max(check_column(*column) for column in zip(here[0], zip(*here[1:]), zip(*there[1:])))


def check_summaries(here, there, relative, path=""):
    if isinstance(here, dict):
        expect(isinstance(there, dict) and here.keys() == there.keys(), f"{path}: not the same keys")
        for key in here.keys() - ELSEWHERE:
            check_summaries(here[key], there[key], relative, f"{path}.{key}")
    elif isinstance(here, float) and isinstance(there, float):
        expect(math.isclose(here, there, rel_tol=relative), f"{path}: {here!r} here, {there!r} there")
    else:
        expect(here == there, f"{path}: {here!r} here, {there!r} there")


def compare(label, document, recording=()):
    config, inexact = write_config(document), may_differ(document)
    here, summary = replay(host_program(), HOST / "fmus", config, recording)
    there, other = replay(PROGRAM, FMUS, config, recording)
    expect(len(here) > 100, f"{label}: only {len(here)} rows")
    same = here == there
    off = 0.0 if same else check_tables(here, there)
    what = "the same bits" if same else f"{off:.2g} apart"
    print(f"    {label}: {len(here) - 1} steps, {what}{'; libm in ' + ', '.join(inexact) if inexact else ''}")
    expect(same or inexact, f"{label}: {off:.2g} apart, although no model calls libm")
    expect(off <= RELATIVE, f"{label}: {off:.2g} apart, more than {RELATIVE:g}")
    check_summaries(summary, other, RELATIVE if inexact else 0.0)


# ---- configurations ----

def absolute(path):
    """A configuration that can be used from another folder."""
    document = read_config(path)
    recording = document.get("recording", {})
    if "file" in recording:
        recording["file"] = str((path.parent / recording["file"]).resolve())
    return document


@functools.cache
def box_recording():
    """What the box's emulated plant does."""
    path = scratch() / "box.csv"
    done = subprocess.run([host_program(), "plant", SOURCE / "config" / "motor" / "box_plant.json", "--record", path],
                          capture_output=True, text=True, check=False,
                          env={**environment(scratch()), "TWINLOCK_FMU_PATH": str(HOST / "fmus")})
    expect(done.returncode == 0, done.stderr)
    return path


def emps_recording():
    """The force of a set-point that goes back and forth, and a position that is roughly right: its own recording is not part
    of the product."""
    path = scratch() / "emps.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "position", "velocity_est", "force"])
        for i in range(1001):
            writer.writerow([i / 100, 0.1 * math.sin(i / 100), 0.1 * math.cos(i / 100), 60.0 * math.cos(i / 100)])
    return path


def test_which_models_call_libm():
    """The list is not empty, and not everything: otherwise it would prove nothing."""
    calls = {path.stem: libm_calls(path) for path in sorted(FMUS.glob("*.fmu"))}
    for model, (binaries, found) in calls.items():
        print(f"    {model}: {', '.join(found) or 'nothing'}")
        expect(binaries == 3, f"{model}.fmu has {binaries} binaries, not one for each of three machines")
    expect([model for model, (_, found) in calls.items() if found] == ["cylinder"], f"not only the cylinder: {calls}")


def test_the_host_packs_the_same_bytes():
    host_program()
    for path in sorted(FMUS.glob("*.fmu")):
        expect(path.read_bytes() == (HOST / "fmus" / path.name).read_bytes(), f"{path.name} is not that of build/host")


def recording_of(path):
    """Where a configuration names none that is part of the project, one is made."""
    if path.parent.name == "emps":
        return "--recording", emps_recording()
    return ("--recording", box_recording()) if path.name == "box.json" else ()


def test_configurations():
    paths = [path for path in sorted((SOURCE / "config").glob("*/*.json")) if path.parent.name != "schema"]
    for path in paths:
        compare(f"{path.parent.name}/{path.name}", absolute(path), recording_of(path))


def test_solvers():
    """Nelder-Mead, BOBYQA and L-BFGS are NLopt's, and take another way as soon as one bit differs."""
    for letter in motor_bench.SCENARIOS:
        for solver in motor_bench.SOLVERS[1:]:
            compare(f"scenario {letter}, {solver}", motor_bench.scenario(letter, solver))


def test_the_comparison_bites():
    """One bit in one value of one step, and one evaluation more, are noticed."""
    table, summary = replay(host_program(), HOST / "fmus", SOURCE / "config" / "motor" / "lock.json", ())
    changed = [list(row) for row in table]
    column = next(i for i, name in enumerate(table[0]) if name == "motor.omega")
    changed[700][column] = repr(math.nextafter(float(changed[700][column]), math.inf))
    expect(0.0 < check_tables(table, changed) < RELATIVE, "a last bit is not seen")
    changed[700][column] = repr(float(table[700][column]) * (1 + 1e-9))
    expect(check_tables(table, changed) > RELATIVE, "1e-9 is not seen")
    changed[700][column] = ""
    for bad in (lambda: check_tables(table, changed), lambda: check_tables(table, table[:-1]),
                lambda: check_summaries(summary, {**summary, "steps": summary["steps"] + 1}, 0.0)):
        try:
            bad()
        except Failure:
            continue
        raise Failure("a difference is not seen")


main()
