#!/usr/bin/env python3
"""Results on another machine equal those on this one.

The program of this build, in its emulator, and that of build/host replay each configuration that has a recording, and each
solver on each scenario of the dissertation. The test compares all output. Steps agree to 1e-12 of the largest value of their
column, and to the bit if no model calls an inexact function of libm. Counts of executions and evaluations are always equal.

The test reads from the binaries of all machines which models call such a function.
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
# IEEE 754 defines the results of these to the bit.
EXACT = set("ceil copysign fabs floor fma fmax fmin fmod frexp ldexp llrint llround lrint lround modf nearbyint nextafter "
            "remainder rint round scalbln scalbn sqrt trunc".split())
ELSEWHERE = {"wall_s"}  # depends on the speed of the machine
SHORTER = {"tennessee/lock.json": 900}  # s: longer ones take a quarter of an hour in the emulator


# ---- the two programs ----

def host_program():
    program = HOST / "bin" / "twinlock"
    if program.exists():
        return program
    why = f"{program} is missing: run script/build first"
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


# ---- calls of libm ----

def names(library, which):
    """Dynamic symbols of an ELF file of any machine, without their versions."""
    done = subprocess.run(["nm", "--dynamic", which, library], capture_output=True, text=True, check=True)
    return {line.split()[-1].split("@")[0] for line in done.stdout.splitlines()}


@functools.cache
def libm():
    """The functions of libm except the exact ones."""
    done = subprocess.run(["gcc", "-print-file-name=libm.so.6"], capture_output=True, text=True, check=True)
    return names(done.stdout.strip(), "--defined-only") - EXACT


@functools.cache
def libm_calls(fmu):
    """(number of binaries, inexact functions of libm that any of them calls)."""
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
    """The largest difference divided by the largest value."""
    values = [(number(a), number(b)) for a, b in zip(here, there)]
    if any(a is None or b is None for a, b in values):
        expect(here == there, f"column {name}: other texts")
        return 0.0
    expect(all(math.isnan(a) == math.isnan(b) for a, b in values), f"column {name}: other gaps")
    largest = max((abs(a) for a, _ in values if not math.isnan(a)), default=0.0)
    off = max((abs(a - b) for a, b in values if not math.isnan(a)), default=0.0)
    return off / largest if off else 0.0


def check_tables(here, there):
    """The largest difference of all columns."""
    expect(here[0] == there[0] and len(here) == len(there), f"{len(here)} rows here, {len(there)} there")
    return max(check_column(*column) for column in zip(here[0], zip(*here[1:]), zip(*there[1:])))


def check_summaries(here, there, relative, path=""):
    if isinstance(here, dict):
        expect(isinstance(there, dict) and here.keys() == there.keys(), f"{path}: other keys")
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
    duration = SHORTER.get(f"{path.parent.name}/{path.name}")
    return {**document, "duration_s": duration} if duration else document


@functools.cache
def made_recording(plant):
    """A recording of an emulated plant of config/."""
    path = scratch() / "made.csv"
    done = subprocess.run([host_program(), "plant", SOURCE / "config" / plant, "--record", path],
                          capture_output=True, text=True, check=False,
                          env={**environment(scratch()), "TWINLOCK_FMU_PATH": str(HOST / "fmus")})
    expect(done.returncode == 0, done.stderr)
    return path


def emps_recording():
    """An approximate recording of config/emps, because its real recording is not part of the product."""
    path = scratch() / "emps.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "position", "velocity_est", "force"])
        for i in range(1001):
            writer.writerow([i / 100, 0.1 * math.sin(i / 100), 0.1 * math.cos(i / 100), 60.0 * math.cos(i / 100)])
    return path


def test_which_models_call_libm():
    """Only the cylinder. With none or all models, the comparison would prove nothing."""
    calls = {path.stem: libm_calls(path) for path in sorted(FMUS.glob("*.fmu"))}
    for model, (binaries, found) in calls.items():
        print(f"    {model}: {', '.join(found) or 'nothing'}")
        expect(binaries == 3, f"{model}.fmu has {binaries} binaries, not one for each of three machines")
    expect([model for model, (_, found) in calls.items() if found] == ["cylinder"], f"not only the cylinder: {calls}")


def test_the_host_packs_the_same_bytes():
    host_program()
    for path in sorted(FMUS.glob("*.fmu")):
        expect(path.read_bytes() == (HOST / "fmus" / path.name).read_bytes(), f"{path.name} differs from build/host")


def recording_of(path):
    """Options with a made recording, if that of the configuration is not part of the project."""
    if path.parent.name == "emps":
        return "--recording", emps_recording()
    plants = {"motor/box.json": "motor/box_plant.json", "tennessee/lock.json": "tennessee/plant.json", "vessels/live.json": "vessels/plant.json"}
    plant = plants.get(f"{path.parent.name}/{path.name}")
    return ("--recording", made_recording(plant)) if plant else ()


def test_configurations():
    paths = [path for path in sorted((SOURCE / "config").glob("*/*.json")) if path.parent.name != "schema"]
    for path in paths:
        compare(f"{path.parent.name}/{path.name}", absolute(path), recording_of(path))


def test_solvers():
    """Nelder-Mead, BOBYQA and L-BFGS are NLopt's. Their search changes if one bit differs."""
    for letter in motor_bench.SCENARIOS:
        for solver in motor_bench.SOLVERS[1:]:
            compare(f"scenario {letter}, {solver}", motor_bench.scenario(letter, solver))


def test_the_comparison_finds_differences():
    """One bit in one value of one step, a missing row and a changed count are found."""
    table, summary = replay(host_program(), HOST / "fmus", SOURCE / "config" / "motor" / "lock.json", ())
    changed = [list(row) for row in table]
    column = next(i for i, name in enumerate(table[0]) if name == "motor.omega simulated")
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
