#!/usr/bin/env python3
"""What an FMU may do to the process that it is in, and what the four verbs that call FMUs make of it: one thread with enough stack,
a call that never returns, an end by exit() or by a crash, and what an FMU leaves behind for the end."""
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import time
import zipfile
from contextlib import closing

from hostile_fmu import LOCKED, config, make
from twinlock_test import NOT_LOCKED, PATIENCE, SANITIZER, at_least, at_most, describe, expect, finish, main, merge, read_table, run, scratch, start

FUNCTIONS = ("load", "fmi2Instantiate", "fmi2SetupExperiment", "fmi2EnterInitializationMode", "fmi2ExitInitializationMode",
             "fmi2SetReal", "fmi2GetReal", "fmi2DoStep", "fmi2Terminate", "fmi2FreeInstance")
STATES = ("fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate")
CRASH = "*(volatile int *)8 = 0;"


def verbs(path):
    """The command lines that call an FMU in all its life, each by itself short."""
    return (("check", path), ("replay", path), ("run", path, "--duration", "0.2"),
            ("plant", path, "--record", scratch() / "rows.csv"))


def end_of(args, timeout=60):
    """(exit code, log, standard output), whatever the end."""
    process = start(args)
    try:
        out, log = process.communicate(timeout=timeout * PATIENCE)
    finally:
        process.kill()
    return process.returncode, log, out


def named(function):
    """How the log calls it: an FMU has the component's name once there is an instance of it."""
    return ("lag", "the loading of the library") if function == "load" else ("hostile", function)


# ---- one thread ----

def test_what_is_kept_for_a_thread_is_there_in_every_call():
    for args in verbs(config(make("thread_local"))):
        code, _, log = run(args)
        expect(code == 0, f"{args[0]} ended with {code}\n{log}")


def test_as_much_stack_as_a_main_thread_has():
    for mebibytes in (2, 6):
        for function in ("load", "fmi2Instantiate", "fmi2DoStep"):
            for args in verbs(config(make("stack", AT=function, BYTES=mebibytes << 20))):
                code, _, log = run(args)
                expect(code == 0, f"{args[0]} ended with {code} by {mebibytes} MiB of stack in {function}\n{log}")


# ---- files ----

def test_a_large_file_of_an_honest_fmu_is_unpacked():
    """An entry of an archive may be larger than all that FMUs may write by themselves."""
    fmu = shutil.copy(make("good"), scratch() / "large.fmu")
    with zipfile.ZipFile(fmu, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/table.bin", os.urandom(2 << 20))  # else it would grow by too large a factor
        with archive.open("resources/zeroes.bin", "w") as entry:
            for _ in range(270):
                entry.write(bytes(1 << 20))
    code, _, log = run(("check", config(fmu)))
    expect(code == 0, f"ended with {code}\n{log}")


# ---- crashes ----

FMU_FAILED = 70


def expect_crash(args, said):
    """It is the process of the FMUs that crashes."""
    code, log, _ = end_of(args)
    expect(code == FMU_FAILED, f"{args[0]} ended with {code}\n{log}")
    expect(log.count(said) == 1, f"{args[0]} did not say \"{said}\"\n{log}")


def test_a_crash_in_each_function_is_told():
    for function in FUNCTIONS:
        for args in verbs(config(make("end", AT=function, HOW=CRASH))):
            name, where = named(function)
            expect_crash(args, f"twinlock: error: FMU {name} crashed in {where}: Segmentation fault; ")


def test_a_crash_in_saving_a_state_is_told():
    for function in STATES:
        path = config(make("end", AT=function, HOW=CRASH), LOCKED)
        expect_crash(("replay", path), f"FMU hostile crashed in {function}: Segmentation fault")


def test_each_kind_of_crash():
    for how, name in (("abort();", "Aborted"), ("raise(SIGBUS);", "Bus error"), ("raise(SIGFPE);", "Floating point exception"),
                      ("raise(SIGILL);", "Illegal instruction"), ("__builtin_trap();", "Illegal instruction")):
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_crash(args, f"FMU hostile crashed in fmi2DoStep: {name}; ")


def test_a_stack_without_end():
    for function in ("load", "fmi2Instantiate", "fmi2DoStep", "fmi2FreeInstance"):
        for args in verbs(config(make("stack", AT=function, BYTES=0))):
            name, where = named(function)
            expect_crash(args, f"FMU {name} crashed in {where}: it needs more stack than its thread has (8 MiB); ")


def test_a_crash_in_a_thread_of_the_fmus_own():
    for args in verbs(config(make("left_thread", HOW=f"{CRASH}"))):
        if args[0] == "run":
            expect_crash(args, "a thread that an FMU has begun crashed: Segmentation fault; ")


def test_a_crash_that_is_no_fmus():
    process = start(("replay", config(make("thread_local")), "--realtime"))
    time.sleep(0.3)
    process.send_signal(signal.SIGSEGV)
    _, log = process.communicate(timeout=60)
    expect("twinlock crashed outside of its FMUs: Segmentation fault; a bug of twinlock" in log, log)


def test_handlers_of_the_fmus_own():
    """One that puts right what has happened is no crash; one that gives the signal to its predecessor is."""
    for args in verbs(config(make("displaced"))):
        code, _, log = run(args)
        expect(code == 0 and "the FMU's own handler" in log and "crashed" not in log, f"{args[0]} ended with {code}\n{log}")
    for args in verbs(config(make("displaced", CALLS_PREVIOUS=True))):
        expect_crash(args, "FMU hostile crashed in fmi2DoStep: Floating point exception; ")


def test_a_signal_with_a_code_of_its_own():
    """As the kernel gives one to a fault, which comes back by itself, and this does not."""
    for code in ("SI_KERNEL", "ILL_ILLOPC"):
        how = f"siginfo_t told = {{.si_signo = SIGILL, .si_code = {code}}}; (void)syscall(SYS_rt_tgsigqueueinfo, getpid(), gettid(), SIGILL, &told);"
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_crash(args, "FMU hostile crashed in fmi2DoStep: Illegal instruction; ")


def test_signals_that_end_a_process_and_are_no_crash():
    for how, number in (("(void)kill(getpid(), SIGKILL);", 9), ("(void)raise(SIGALRM);", 14)):
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_crash(args, f"was ended by signal {number}")


# ---- exit() ----

def test_an_fmu_that_ends_the_process():
    for function in FUNCTIONS:
        for args in verbs(config(make("end", AT=function, HOW="exit(0);"))):
            name, where = named(function)
            code, _, log = run(args)
            expect(code == 70 and f"FMU {name} called exit(0) in {where}, " in log, f"{args[0]} ended with {code}\n{log}")


def test_a_thread_of_the_fmus_own_that_ends_the_process():
    code, _, log = run(("run", config(make("left_thread", HOW="exit(3);")), "--duration", "5"))
    expect(code == 70 and "called exit(3)" in log, f"ended with {code}\n{log}")


# ---- what is left for the end ----

def test_what_is_left_behind_costs_nothing():
    for fmu in (make("left_thread"), make("bad_end"), make("bad_end", AT_EXIT=True)):
        for args in verbs(config(fmu)):
            code, _, log = run(args)
            expect(code == 0, f"{args[0]} with {fmu.name} ended with {code}\n{log}")
        code, out, log = run(("replay", config(fmu), "--json"))
        expect(code == 0 and json.loads(out)["steps"], f"no result\n{log}")


def test_exit_handlers_of_an_interpreter():
    """Where a library is named they run; a crash there costs nothing, nor does one that never returns."""
    libraries = {"components": {"hostile": {"libraries": ["libm.so.6"]}}}
    for fmu, text in ((make("bad_end", AT_EXIT=True), "ending"), (make("bad_end", AT_EXIT=True, HANGS=True), "ending")):
        code, out, log = run(("replay", config(fmu, libraries), "--json"))
        expect(code == 0 and text in log and json.loads(out)["steps"], f"ended with {code}\n{log}")


def test_results_outlive_a_crash_in_freeing():
    code, log, out = end_of(("replay", config(make("end", AT="fmi2FreeInstance", HOW="abort();")), "--json"))
    expect(code == FMU_FAILED, f"ended with {code}\n{log}")
    expect(json.loads(out)["steps"], "no result")


# ---- states that are none ----

def test_a_state_that_cannot_be_saved_is_an_error_of_the_fmu():
    """If nothing else may be tried; else it is led back otherwise, which is said."""
    only, any_way = (config(make("no_state"), merge(LOCKED, {"components": {"hostile": {"rollback": way}}})) for way in ("state", "auto"))
    for verb in ("check", "replay"):
        code, log, _ = end_of((verb, only))
        expect(code == 70 and "hostile: fmi2GetFMUstate failed" in log, f"{verb} ended with {code}\n{log}")
        code, log, _ = end_of((verb, any_way))
        expect(code in (0, NOT_LOCKED) and "does not come back to where it was" in log, f"{verb} ended with {code}\n{log}")


# ---- calls that never return ----

def test_a_call_that_never_returns():
    """Where nobody watches, the program does, and keeps what there is."""
    path = config(make("hang", AT="fmi2DoStep", CALL=60, IGNORE=True))
    steps, database = scratch() / "steps.csv", scratch() / "twin.db"
    said = "FMU hostile has not returned from fmi2DoStep for 1.5 s: it hangs, or needs longer; --call-limit S permits that"
    for verb, *options in (("check",), ("replay", "--csv", steps, "--db", database, "--report", scratch() / "page.html"),
                           ("plant", "--record", scratch() / "rows.csv")):
        begun = time.monotonic()
        code, _, log = run((verb, path, "--call-limit", "1.5", *options))
        expect(code == 70 and log.count(said) == 1, f"{verb} ended with {code}\n{log}")
        at_least(time.monotonic() - begun, 1.5, f"seconds until {verb} has ended")
    at_least(len(read_table(steps)["step"]), 58, "steps in the CSV file")
    with closing(sqlite3.connect(database)) as connection:
        at_least(connection.execute("SELECT count(*) FROM steps").fetchone()[0], 58, "steps in the database")
        expect(connection.execute("SELECT text FROM events WHERE source = 'twin'").fetchall() == [(said,)], "no event")


def test_a_thread_that_ends_itself():
    """That of the FMUs: it never returns. AddressSanitizer would free its signal stack in a frame that pthread_exit() has unwound."""
    before = os.environ.get("ASAN_OPTIONS", "")
    os.environ["ASAN_OPTIONS"] = before + ":use_sigaltstack=0"
    for how, verb in (("pthread_exit(NULL);", "plant"), ("(void)syscall(SYS_exit, 0);", "replay")):
        path = config(make("end", AT="fmi2DoStep", HOW=how))
        options = ("--record", scratch() / "rows.csv") if verb == "plant" else ()
        code, _, log = run((verb, path, "--call-limit", "1", *options))
        expect(code == 70 and "FMU hostile has not returned from fmi2DoStep for 1 s" in log, f"{verb} ended with {code}\n{log}")
    os.environ["ASAN_OPTIONS"] = before


def test_limits_that_are_none():
    for verb in ("check", "replay", "plant"):
        for text in ("0", "-1", "x", "1e9", "", "nan"):
            code, _, log = run((verb, "config.json", "--call-limit", text))
            expect(code == 2 and f"twinlock {verb}: --call-limit: found \"{text}\", expected seconds" in log, f"{code}\n{log}")


def wait_until_it_hangs(process, log):
    until = time.monotonic() + 60 * PATIENCE
    while "hanging" not in log.read_text(encoding="utf-8"):
        expect(time.monotonic() < until and process.poll() is None, f"{describe(process)} does not hang\n{log.read_text()}")
        time.sleep(0.001)


class Hanging:
    """A program in an FMU that does not return, and what it has said."""

    def __init__(self, args):
        self.log = scratch() / "log"
        self.args = args
        with open(self.log, "wb") as file:
            self.process = start(args, stderr=file, stdout=subprocess.DEVNULL)

    def end(self, timeout):
        code, _, _ = finish(self.process, timeout)
        return code, self.log.read_text(encoding="utf-8")


def hanging_programs(*functions):
    for i, function in enumerate(functions):
        for k in range(4):
            deafness = ("IGNORE", "BLOCK", "HANDLE")[(i + k) % 3]
            yield function, Hanging(verbs(config(make("hang", AT=function, **{deafness: True})))[k])


def test_a_hanging_fmu_does_not_keep_the_program_from_ending():
    """Five seconds after it was asked to, as soon as it hangs; whether the FMU ignores the signal, blocks it, or takes it."""
    programs = list(hanging_programs("load", "fmi2Instantiate", "fmi2DoStep", "fmi2FreeInstance"))
    for i, (_, program) in enumerate(programs):
        wait_until_it_hangs(program.process, program.log)
        program.process.send_signal((signal.SIGTERM, signal.SIGINT, signal.SIGHUP)[i % 3])
    begun = time.monotonic()
    for i, (function, program) in enumerate(programs):
        code, log = program.end(30)
        name, where = named(function)
        asked = ("SIGTERM", "SIGINT", "SIGHUP")[i % 3]
        said = f"{asked} asked to end, and FMU {name} has not returned from {where} for "
        expect(code == 70 and said in log, f"{program.args[0]} ended with {code}\n{log}")
    at_least(time.monotonic() - begun, 4.5, "seconds until all have ended")
    if not SANITIZER:
        at_most(time.monotonic() - begun, 25 * PATIENCE, "seconds until all have ended")


def test_a_call_that_returns_in_time_ends_in_order():
    """`run` has then done what it was told, `check` and `replay` have not."""
    for args, wanted in zip(verbs(config(make("hang", AT="load", SECONDS=3, IGNORE=True))), (75, 75, 0)):
        program = Hanging(args)
        wait_until_it_hangs(program.process, program.log)
        time.sleep(0.2)
        program.process.send_signal(signal.SIGTERM)
        time.sleep(0.2)
        program.process.send_signal(signal.SIGTERM)  # a supervisor's, at the same time
        code, log = program.end(30)
        expect(code == wanted, f"{args[0]} ended with {code}\n{log}")


def test_asked_twice():
    for function, program in hanging_programs("fmi2DoStep"):
        wait_until_it_hangs(program.process, program.log)
        time.sleep(0.2)
        begun = time.monotonic()
        for _ in range(100):
            if program.process.poll() is not None:
                break
            program.process.send_signal(signal.SIGINT)
            time.sleep(0.1)
        code, log = program.end(30)
        name, where = named(function)
        expect(code == 70 and f"asked twice to end, by SIGINT: ended at once, in FMU {name}'s {where}" in log,
               f"{program.args[0]} ended with {code}\n{log}")
        expect(time.monotonic() - begun < 9 * PATIENCE, "it was not at once")


main()
