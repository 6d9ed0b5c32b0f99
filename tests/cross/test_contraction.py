#!/usr/bin/env python3
"""No instruction that multiplies and adds with one rounding is in the program, in what is linked into it, or in an FMU for any machine:
a compiler that makes one changes the last bit of a sum, and from there on all that follows."""
import re
import struct
import subprocess
import zipfile

from twinlock_test import BUILD, FMUS, expect, main, scratch

# ELF machine: GNU's name of it
TOOLS = {40: "arm-linux-gnueabihf", 62: "x86_64-linux-gnu", 183: "aarch64-linux-gnu"}
FUSED = re.compile(r"\t(?:fn?m(?:add|sub)|fml[as]|vfn?m[as]|vfn?m(?:add|sub)\w+)(?:\.\w+)*\s")

SOURCE = "double tl_f(double a, double b, double c) {\n    return a * b + c;\n}\n"


def machine_of(path):
    return struct.unpack_from("<H", path.read_bytes(), 18)[0]


def fused(path):
    """(lines of code, those that are fused)"""
    done = subprocess.run([f"{TOOLS[machine_of(path)]}-objdump", "--disassemble", "--no-show-raw-insn", path],
                          capture_output=True, text=True, check=True)
    lines = [line for line in done.stdout.splitlines() if re.match(r" *[0-9a-f]+:\t", line)]
    return len(lines), [line.strip() for line in lines if FUSED.search(line)]


def expect_none(path, what):
    count, found = fused(path)
    expect(count > 500, f"{what}: only {count} instructions were read")
    expect(not found, f"{what}: {len(found)} fused instructions of {count}, such as {found[:1]}")


def test_the_program():
    expect_none(BUILD / "bin" / "twinlock", "bin/twinlock")


def test_fmus():
    machines = set()
    for path in sorted(FMUS.glob("*.fmu")):
        folder = scratch()
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.startswith("binaries/"):
                    archive.extract(name, folder)
                    machines.add(machine_of(folder / name))
                    expect_none(folder / name, f"{path.name}: {name}")
    expect(machines == TOOLS.keys(), f"binaries for {sorted(machines)}")


def test_it_would_be_seen():
    """One of each machine, asked for."""
    options = {40: ["-mcpu=cortex-a15", "-mfpu=vfpv4"], 62: ["-mfma"], 183: []}
    for machine, tool in TOOLS.items():
        folder = scratch()
        (folder / "f.c").write_text(SOURCE, encoding="utf-8")
        for contract, wanted in (("fast", 1), ("off", 0)):
            subprocess.run([f"{tool}-gcc", "-O2", f"-ffp-contract={contract}", *options[machine], "-c", folder / "f.c", "-o",
                            folder / "f.o"], check=True)
            expect(len(fused(folder / "f.o")[1]) == wanted, f"{tool}: -ffp-contract={contract} shows otherwise")


main()
