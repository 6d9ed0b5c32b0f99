#!/usr/bin/env python3
"""Makes the seeds of fuzz_elf: small shared libraries of both classes and byte orders, with the older table of hashes, the younger one, and none. The
build runs it: tests/fuzz/elf_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

BASE, DYNAMIC, HASHES, NEEDS, DEFINES, SYMBOLS, STRINGS = 0x4000, 0x100, 0x240, 0x2C0, 0x300, 0x380, 0x480
NAMES = b"\0our_libtable.so\0libmain.so\0libc.so.6\0TABLE_1\0$ORIGIN\0dlopen\0_ZN1a1bE\0"
UNDEFINED_FUNCTION, UNIQUE_OBJECT = 0x12, 0xA1  # of a symbol: how it is bound, and what it is


def at(name):
    """Where the name begins: also one that is the end of another."""
    return NAMES.index(name.encode() + b"\0")


class Library:
    def __init__(self, wide, big):
        self.wide, self.order = wide, ">" if big else "<"
        self.bytes, self.entries = bytearray(2048), 0

    def put(self, offset, layout, *values):
        """`layout` as in struct; a word of the class is W."""
        struct.pack_into(self.order + layout.replace("W", "Q" if self.wide else "I"), self.bytes, offset, *values)

    def entry(self, tag, value):
        self.put(DYNAMIC + self.entries * (16 if self.wide else 8), "WW", tag, value)
        self.entries += 1

    def headers(self, size):
        self.bytes[:7] = b"\x7fELF" + bytes((2 if self.wide else 1, 2 if self.order == ">" else 1, 1))
        table = 64 if self.wide else 52
        self.put(16, "HHIWWWIHHHHHH", 3, 183 if self.wide else 40, 0, 0, table, 0, 0, 0, 56 if self.wide else 32, 2, 0, 0, 0)
        if self.wide:  # type, flags, offset, address, physical one, bytes in the file, in memory, alignment
            self.put(table, "IIQQQQQQ", 1, 0, 0, BASE, 0, size, 0, 0)
            self.put(table + 56, "IIQQQQQQ", 2, 0, DYNAMIC, BASE + DYNAMIC, 0, HASHES - DYNAMIC, 0, 0)
        else:
            self.put(table, "IIIIIIII", 1, 0, BASE, 0, size, 0, 0, 0)
            self.put(table + 32, "IIIIIIII", 2, DYNAMIC, BASE + DYNAMIC, 0, HASHES - DYNAMIC, 0, 0, 0)

    def symbol(self, number, name, info, section):
        if self.wide:
            self.put(SYMBOLS + 24 * number, "IBBHQQ", at(name), info, 0, section, 0, 0)
        else:
            self.put(SYMBOLS + 16 * number, "IIIBBH", at(name), 0, 0, info, 0, section)

    def old_hashes(self):
        self.put(HASHES, "II", 1, 3)
        self.entry(4, BASE + HASHES)

    def new_hashes(self):
        words = 8 if self.wide else 4
        self.put(HASHES, "III", 1, 2, 1)
        self.put(HASHES + 16 + words, "II", 2, 1)
        self.entry(0x6FFFFEF5, BASE + HASHES)

    def versions(self):
        self.put(NEEDS, "HHIII", 0, 1, at("libtable.so"), 16, 0)
        self.put(NEEDS + 16, "IHHII", 0, 0, 0, at("TABLE_1"), 0)
        self.entry(0x6FFFFFFE, BASE + NEEDS)
        self.entry(0x6FFFFFFF, 1)
        for i, name in enumerate(("libmain.so", "TABLE_1")):
            self.put(DEFINES + 28 * i, "HHHHIII", 0, 1 - i, 0, 1, 0, 20, 28 * (1 - i))
            self.put(DEFINES + 28 * i + 20, "II", at(name), 0)
        self.entry(0x6FFFFFFC, BASE + DEFINES)
        self.entry(0x6FFFFFFD, 2)


def library(wide, hashes, big=False, needed="libtable.so"):
    made = Library(wide, big)
    strings = STRINGS if hashes else SYMBOLS + 3 * (24 if wide else 16)
    size = strings + len(NAMES)
    made.headers(size)
    made.symbol(1, "dlopen", UNDEFINED_FUNCTION, 0)
    made.symbol(2, "_ZN1a1bE", UNIQUE_OBJECT, 1)
    for tag, name in ((14, "libmain.so"), (1, needed), (1, "libc.so.6"), (29, "$ORIGIN")):
        made.entry(tag, at(name))
    for tag, value in ((5, BASE + strings), (10, len(NAMES)), (6, BASE + SYMBOLS)):
        made.entry(tag, value)
    if hashes:
        hashes(made)
    made.versions()
    made.bytes[strings:size] = NAMES
    return bytes(made.bytes[:size])


def main():
    folder = Path(sys.argv[1])
    (folder / "old_hashes_64").write_bytes(library(True, Library.old_hashes))
    (folder / "old_hashes_32").write_bytes(library(False, Library.old_hashes))
    (folder / "new_hashes_32_big").write_bytes(library(False, Library.new_hashes, big=True))
    (folder / "no_hashes_64").write_bytes(library(True, None, needed="our_libtable.so"))


main()
