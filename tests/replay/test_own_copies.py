#!/usr/bin/env python3
"""Each component is its own: FMUs that keep their state in a global compute what they compute alone, whatever file or library they share, and
what cannot be seen to is told."""
import os

from copied_fmu import FOLDER, config, library, make
from twinlock_test import SANITIZER, Skip, expect, main, read_table, run, scratch

INTEGRAL = FOLDER / "integral.c"


def outcome(fmus):
    """(exit code, {component: all values of its output}, log) of a replay."""
    path = scratch() / "steps.csv"
    code, _, log = run(("replay", config(fmus), "--csv", path))
    table = read_table(path) if code == 0 else {}
    return code, {name.removesuffix(".y"): values for name, values in table.items() if name.endswith(".y")}, log


def values(fmus, said=""):
    code, rows, log = outcome(fmus)
    expect(code == 0 and (said in log if said else log == ""), f"ended with {code}\n{log}")
    return rows


def expect_their_own(fmus, said=""):
    """To the bit what FMUs compute that share nothing: files of their own, without a companion. The inputs are 1, 2, 3, …"""
    apart = values([make(f"apart{i}") for i in range(len(fmus))])
    expect(len({tuple(row) for row in apart.values()}) == len(fmus), "the inputs make no difference")
    found = values(fmus, said)
    for name, row in apart.items():
        expect(found[name] == row, f"{name} ends with {found[name][-1]}, alone with {row[-1]}")


# ---- one file, one name ----

def test_one_file_in_several_components():
    expect_their_own([make()] * 3)


def test_one_that_a_process_can_have_once():
    """It says so because of its globals; each component has its own."""
    expect_their_own([make("once", once=True)] * 2)


def test_companions_of_one_name():
    companion = library("libintegral.so", INTEGRAL)
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two", "three")])


def test_one_file_with_a_companion():
    expect_their_own([make(sources=(), companions=(library("libintegral.so", INTEGRAL),))] * 2)


def test_a_companion_of_a_companion():
    """The global is in the last of two, and only the binary is in the first one."""
    inner = library("libinner.so", INTEGRAL)
    outer = library("libouter.so", FOLDER / "outer.c", needs=(inner,))
    expect_their_own([make(name, sources=("asking.c",), companions=(outer,), others=(inner,)) for name in ("one", "two")])


def test_companions_with_versions_of_symbols():
    """Who needs a version says of which library: the loader ends the process if that is not there by this name."""
    companion = library("libintegral.so", INTEGRAL, flags=(f"-Wl,--version-script={FOLDER / 'versions.map'}",))
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


def test_a_companion_without_a_name_of_its_own():
    companion = library("", INTEGRAL, name="libnameless.so")
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


def test_symbols_that_are_one_for_the_whole_process():
    expect_their_own([make(name, flags=("-DUNIQUE",)) for name in ("one", "two")])
    companion = library("libintegral.so", INTEGRAL, flags=("-DUNIQUE",))
    expect_their_own([make(name, sources=(), companions=(companion,)) for name in ("one", "two")])


# ---- what an FMU opens itself ----

def test_opened_by_its_path():
    fmu = make(sources=("opened.c",), others=(library("libintegral.so", INTEGRAL),), flags=('-DOPENED="/libintegral.so"', "-ldl"))
    expect_their_own([fmu, fmu], "can open libraries while it runs")


def test_opened_by_its_name_is_told():
    """The loader has one of that name already, and nothing in the file tells what will be asked for."""
    if SANITIZER == "address":
        raise Skip("AddressSanitizer stands between an FMU and dlopen(), so that nothing is found beside the FMU")
    fmu = make(sources=("opened.c",), others=(library("libintegral.so", INTEGRAL),), flags=('-DOPENED="libintegral.so"', "-ldl"))
    values([fmu])
    code, _, log = outcome([fmu, fmu])
    expect(code == 0, log)
    expect("can open libraries while it runs (dlopen), and has a libintegral.so as another FMU has: if it opens that by its bare name, "
           "both share its variables" in log, log)


# ---- what is not there ----

def test_a_companion_that_only_the_other_one_has():
    companion = library("libintegral.so", INTEGRAL)
    complete, bare = make("complete", sources=(), companions=(companion,)), make("bare", sources=(), needed=(companion,))
    code, _, log = outcome([bare])
    expect(code == 65 and "libintegral.so: cannot open shared object file" in log, f"ended with {code}\n{log}")
    values([complete, bare], "bare.fmu needs libintegral.so, which is not in it: it gets that of another FMU, and both share its variables")


# ---- names that cannot be changed ----

def test_a_version_of_the_librarys_name():
    companion = library("libintegral.so", INTEGRAL, flags=("-Wl,--default-symver",))
    fmus = [make(name, sources=(), companions=(companion,)) for name in ("one", "two")]
    values(fmus[:1])
    code, _, log = outcome(fmus)
    expect(code == 65, f"ended with {code}\n{log}")
    expect("two.fmu: its libraries have names that another FMU's have, such as libintegral.so" in log, log)
    expect("rename the libraries of one of the FMUs" in log, log)


# ---- memory of threads ----

def test_static_memory_of_threads_that_runs_out():
    """What an FMU takes of it is taken anew by each copy, and a process has little."""
    fmu = make("thread", flags=("-DTLS=256",))
    code, _, log = outcome([fmu] * 12)
    expect(code == 65, f"ended with {code}\n{log}")
    expect("cannot allocate memory in static TLS block" in log, log)
    setting = "GLIBC_TUNABLES=glibc.rtld.optional_static_tls=65536"
    expect(f"start twinlock with {setting}" in log, log)
    name, _, value = setting.partition("=")
    os.environ[name] = value
    try:
        for verb in (("replay",), ("run", "--duration", "0.2")):
            code, _, log = run((*verb, config([fmu] * 12)))
            expect(code == 0, f"{verb[0]} ended with {code}\n{log}")
    finally:
        del os.environ[name]


main()
