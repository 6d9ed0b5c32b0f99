#!/usr/bin/env python3
"""Components do not share memory: FMUs with state in a global compute the same as alone, also if they share a file or a library.

If the program cannot ensure that, it warns."""
import os

from copied_fmu import FOLDER, config, library, make
from twinlock_test import SANITIZER, Skip, expect, expect_line, has_line, main, read_table, run, scratch

INTEGRAL = FOLDER / "integral.c"


def outcome(fmus):
    """(exit code, {component: all values of its output}, log) of a replay."""
    path = scratch() / "steps.csv"
    code, _, log = run(("replay", config(fmus), "--csv", path))
    table = read_table(path) if code == 0 else {}
    return code, {name.removesuffix(".y"): values for name, values in table.items() if name.endswith(".y")}, log


def values(fmus, parts=None):
    """{component: values}; a line of the log has `parts`, or the log is empty."""
    code, rows, log = outcome(fmus)
    expect(code == 0 and (has_line(log, parts) if parts else log == ""), f"ended with {code}\n{log}")
    return rows


def expect_their_own(fmus, parts=None):
    """The values have the bits of FMUs that share nothing, which are separate files without companions. The inputs are 1, 2, 3, …"""
    apart = values([make(f"apart{i}") for i in range(len(fmus))])
    expect(len({tuple(row) for row in apart.values()}) == len(fmus), "the inputs make no difference")
    found = values(fmus, parts)
    for name, row in apart.items():
        expect(found[name] == row, f"{name} ends with {found[name][-1]}, alone with {row[-1]}")


# ---- one file, one name ----

def test_one_file_in_several_components():
    expect_their_own([make()] * 3)


def test_one_that_can_be_instantiated_once_per_process():
    """Its description says so because of its globals; each component gets copies of these."""
    expect_their_own([make("once", once=True)] * 2)


def test_companions_of_one_name():
    companion = library("libintegral.so", INTEGRAL)
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two", "three")])


def test_one_file_with_a_companion():
    expect_their_own([make(sources=(), companions=(library("libintegral.so", INTEGRAL),))] * 2)


def test_a_companion_of_a_companion():
    """Two libraries: the binary needs the first one, which needs the second one with the global."""
    inner = library("libinner.so", INTEGRAL)
    outer = library("libouter.so", FOLDER / "outer.c", needs=(inner,))
    expect_their_own([make(name, sources=("asking.c",), companions=(outer,), others=(inner,)) for name in ("one", "two")])


def test_companions_with_versions_of_symbols():
    """A required version names its library. The loader ends the process if no library has this name."""
    companion = library("libintegral.so", INTEGRAL, flags=(f"-Wl,--version-script={FOLDER / 'versions.map'}",))
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


def test_a_companion_without_a_soname():
    companion = library("", INTEGRAL, name="libnameless.so")
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


def test_symbols_that_are_unique_in_a_process():
    expect_their_own([make(name, flags=("-DUNIQUE",)) for name in ("one", "two")])
    companion = library("libintegral.so", INTEGRAL, flags=("-DUNIQUE",))
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


# ---- what an FMU opens itself ----

def test_opened_by_its_path():
    fmu = make(sources=("opened.c",), others=(library("libintegral.so", INTEGRAL),), flags=('-DOPENED="/libintegral.so"', "-ldl"))
    expect_their_own([fmu, fmu], "warning|lag.fmu|dlopen")


def test_opened_by_its_name_causes_a_warning():
    """The loader has a library of this name already, and the file does not show which name dlopen() will get."""
    if SANITIZER == "address":
        raise Skip("AddressSanitizer wraps dlopen(), so it does not search beside the FMU")
    fmu = make(sources=("opened.c",), others=(library("libintegral.so", INTEGRAL),), flags=('-DOPENED="libintegral.so"', "-ldl"))
    values([fmu])
    code, _, log = outcome([fmu, fmu])
    expect(code == 0, log)
    expect_line(log, "warning|lag.fmu|dlopen|libintegral.so|variables")


# ---- a missing library ----

def test_a_companion_that_only_the_other_one_has():
    companion = library("libintegral.so", INTEGRAL)
    complete, bare = make("complete", sources=(), companions=(companion,)), make("bare", sources=(), needed=(companion,))
    code, _, log = outcome([bare])
    expect(code == 65, f"ended with {code}\n{log}")
    expect_line(log, f"error|line 6|components.a0|{bare}|libintegral.so|No such file")
    values([complete, bare], "warning|bare.fmu|libintegral.so|missing|variables")


# ---- names that cannot be changed ----

def test_a_symbol_version_with_the_librarys_name():
    companion = library("libintegral.so", INTEGRAL, flags=("-Wl,--default-symver",))
    fmus = [make(name, sources=(), companions=(companion,)) for name in ("one", "two")]
    values(fmus[:1])
    code, _, log = outcome(fmus)
    expect(code == 65, f"ended with {code}\n{log}")
    expect_line(log, "error|line 10|components.a1|two.fmu|libintegral.so|lag.so|rename")


# ---- memory of threads ----

def test_static_memory_of_threads_that_runs_out():
    """Each copy of an FMU needs its share of this memory, and a process has little."""
    fmu = make("thread", flags=("-DTLS=256",))
    code, _, log = outcome([fmu] * 12)
    expect(code == 65, f"ended with {code}\n{log}")
    setting = "GLIBC_TUNABLES=glibc.rtld.optional_static_tls=65536"
    expect_line(log, f"error|line 50|components.a11|thread.fmu|static TLS block|{setting}")
    name, _, value = setting.partition("=")
    os.environ[name] = value
    try:
        for verb in (("replay",), ("run", "--duration", "0.2")):
            code, _, log = run((*verb, config([fmu] * 12)))
            expect(code == 0, f"{verb[0]} ended with {code}\n{log}")
    finally:
        del os.environ[name]


main()
