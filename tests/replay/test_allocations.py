#!/usr/bin/env python3
"""The cycle allocates no memory: a twin with four times as many steps has the same number of allocations.

Runs whole twins, with FMUs of several sizes and with each rollback method."""
import functools
import json
import os
import struct
from contextlib import contextmanager

import keeper_fmu
import hostile_fmu
import sized_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, SKIPPED, SOURCE, at_least, edited_config, expect, main, run, scratch, write_config

if SANITIZER:
    print("skipped: a sanitizer replaces the allocator")
    raise SystemExit(SKIPPED)

# As in allocations/count_allocations.c.
SLOT = struct.Struct("qq112s")
SLOTS = 64


@functools.cache
def counter():
    library = scratch() / "count_allocations.so"
    hostile_fmu.compile_shared(library, [SOURCE / "tests" / "replay" / "allocations" / "count_allocations.c"], {})
    return library


@contextmanager
def surroundings(**variables):
    os.environ.update({name: str(value) for name, value in variables.items()})
    try:
        yield
    finally:
        for name in variables:
            del os.environ[name]


def allocations(config):
    """(allocations of the FMU process, executions) of a replay; unconfined, so the process has our environment."""
    counts = scratch() / "counts"
    counts.write_bytes(bytes(SLOTS * SLOT.size))
    with surroundings(LD_PRELOAD=counter(), TL_TEST_ALLOCATIONS=counts):
        code, out, err = run(["replay", config, "--json", "--unconfined"])
    expect(code in (0, NOT_LOCKED), f"{code}\n{out}{err}")
    found = [times for _, times, title in SLOT.iter_unpack(counts.read_bytes()) if title.startswith(b"twinlock: twin ")]
    expect(len(found) == 1, f"{len(found)} twins")
    return found[0], json.loads(out)["executions"]["total"]


def expect_none(what, short, long):
    (few, little), (many, much) = allocations(short), allocations(long)
    at_least(much, 2 * little, f"{what}: executions, in four times as many steps")
    expect(few == many and few > 0, f"{what}: {few} in {little} executions, {many} in {much}")


def test_ours():
    for name, length in ("motor/lock.json", 14), ("cylinder/lock.json", 8):
        expect_none(name, edited_config(name, {"duration_s": length / 4}), edited_config(name, {"duration_s": length}))


def keeper(fmu, method, length, algorithm="secant"):
    """A configuration with that rollback method and `length` s."""
    content = json.loads(keeper_fmu.config(fmu, method).read_text(encoding="utf-8"))
    content["synchronise"]["algorithm"] = algorithm
    content["duration_s"] = length
    return write_config(content)


def test_rollback_methods():
    """Copies of some kB, copies of pages, copies instead of slow states, and replay. Own states are in the FMU's heap, so they do
    not count."""
    fmus = (("16 kB", sized_fmu.make(16000), "memory"), ("1 MB", sized_fmu.make(1000000), "memory"),
            ("slow states", keeper_fmu.make_slow(), None), ("replay", keeper_fmu.make_slow(), "replay"))
    for what, fmu, method in fmus:
        expect_none(what, keeper(fmu, method, 0.25), keeper(fmu, method, 1))


def test_allocations_are_counted():
    """NLopt's solvers allocate in each search."""
    few, many = (allocations(keeper(sized_fmu.make(16000), "memory", length, "nelder-mead"))[0] for length in (0.25, 1))
    at_least(many - few, 75, "in 75 steps")


if __name__ == "__main__":
    main()
