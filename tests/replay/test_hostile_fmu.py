#!/usr/bin/env python3
"""FMUs that harm their process, with the four verbs that call FMUs.

They need a thread with enough stack, never return from a call, end the process by exit() or a crash, or leave work for its end."""
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import time
import zipfile
from contextlib import closing

import keeper_fmu
from hostile_fmu import LOCKED, config, make
from twinlock_test import (NOT_LOCKED, PATIENCE, SANITIZER, at_least, at_most, describe, expect, expect_line, finish, has_line, main, merge, read_table,
                           run, scratch, start)

FUNCTIONS = ("load", "fmi2Instantiate", "fmi2SetupExperiment", "fmi2EnterInitializationMode", "fmi2ExitInitializationMode",
             "fmi2SetReal", "fmi2GetReal", "fmi2DoStep")
ENDS = ("fmi2Terminate", "fmi2FreeInstance")  # when the results are complete
STATES = ("fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate", "fmi2SerializedFMUstateSize", "fmi2SerializeFMUstate")
CRASH = "*(volatile int *)8 = 0;"


def verbs(path):
    """Short command lines that call all functions of an FMU."""
    return (("check", path), ("replay", path), ("run", path, "--duration", "0.2"),
            ("plant", path, "--record", scratch() / "rows.csv"))


def end_of(args, timeout=60):
    """(exit code, log, standard output); the program may crash."""
    process = start(args)
    try:
        out, log = process.communicate(timeout=timeout * PATIENCE)
    finally:
        process.kill()
    return process.returncode, log, out


def named(function):
    """(FMU, function) in the log. Before there is an instance, the FMU has the name of its description."""
    return ("lag", "library") if function == "load" else ("hostile", function)


# ---- one thread ----

def test_thread_local_memory_is_the_same_in_every_call():
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
    """An entry of an archive may be larger than the limit for files that FMUs write."""
    fmu = shutil.copy(make("good"), scratch() / "large.fmu")
    with zipfile.ZipFile(fmu, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/table.bin", os.urandom(2 << 20))  # keeps the compression ratio plausible
        with archive.open("resources/zeroes.bin", "w") as entry:
            for _ in range(270):
                entry.write(bytes(1 << 20))
    code, _, log = run(("check", config(fmu)))
    expect(code == 0, f"ended with {code}\n{log}")


# ---- crashes ----

FMU_FAILED = 70


def expect_failure(args, parts):
    """The FMU process fails; the program ends in order, and one line of the log has `parts`."""
    code, log, _ = end_of(args)
    expect(code == FMU_FAILED, f"{args[0]} ended with {code}\n{log}")
    count = sum(has_line(line, f"error|{parts}") for line in log.splitlines())
    expect(count == 1, f"{args[0]}: {count} lines with {parts}\n{log}")


def test_a_crash_in_each_function_is_logged():
    for function in FUNCTIONS:
        for args in verbs(config(make("end", AT=function, HOW=CRASH))):
            name, where = named(function)
            expect_failure(args, f"FMU {name}|crashed|{where}|Segmentation fault")


def test_a_crash_after_the_results_is_a_warning():
    for function in ENDS:
        for how, name in ((CRASH, "Segmentation fault"), ("abort();", "Aborted")):
            for args in verbs(config(make("end", AT=function, HOW=how))):
                code, log, _ = end_of(args)
                expect(code == 0, f"{args[0]} ended with {code}\n{log}")
                expect_line(log, f"warning|FMU hostile|crashed|{function}|{name}|complete")


def test_a_crash_in_a_state_function_is_a_warning():
    """Another rollback method is used; a twin that runs free needs none."""
    ways = {way: merge(LOCKED, {"components": {"hostile": {"rollback": way}}}) for way in ("auto", "state")}
    for function in STATES:
        for call in (1, 3) if function in STATES[:2] else (1,):
            fmu = make("end", AT=function, HOW=CRASH, CALL=call)
            for changes in (None, ways["auto"]):
                for args in (("check", config(fmu, changes)), ("replay", config(fmu, changes)),
                             ("run", config(fmu, changes), "--duration", "0.2", "--db", scratch() / "twin.db")):
                    code, log, _ = end_of(args)
                    expect(code in (0, NOT_LOCKED) and "error: FMU" not in log, f"{function}, {args[0]} ended with {code}\n{log}")
                    expect(call > 1 or changes is None or function not in STATES[:3] or has_warning(log, function), f"{args[0]}\n{log}")
    for function in STATES[:2]:
        code, log, _ = end_of(("replay", config(make("end", AT=function, HOW=CRASH), ways["state"])))
        expect(code == FMU_FAILED and has_warning(log, function), f"ended with {code}\n{log}")
        expect_line(log, f"error|hostile|{function}|fmi2Error")


def has_warning(log, function):
    return any(has_line(line, f"warning|hostile|crashed|{function}|Segmentation fault") for line in log.splitlines())


def test_each_kind_of_crash():
    for how, name in (("abort();", "Aborted"), ("raise(SIGBUS);", "Bus error"), ("raise(SIGFPE);", "Floating point exception"),
                      ("raise(SIGILL);", "Illegal instruction"), ("__builtin_trap();", "Illegal instruction")):
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_failure(args, f'FMU hostile|crashed|fmi2DoStep|{name}|"rollback"|"replay"')


def test_endless_recursion():
    for function in ("load", "fmi2Instantiate", "fmi2DoStep"):
        for args in verbs(config(make("stack", AT=function, BYTES=0))):
            name, where = named(function)
            expect_failure(args, f"FMU {name}|crashed|{where}|stack|8 MiB")


def test_a_crash_in_a_thread_of_the_fmu():
    """The run is long, because threads in real time may keep that thread waiting."""
    expect_failure(("run", config(make("left_thread", HOW=f"{CRASH}")), "--duration", "20"), "thread|crashed|Segmentation fault")


def test_a_crash_outside_of_fmus():
    process = start(("replay", config(make("thread_local")), "--realtime"))
    time.sleep(0.3)
    process.send_signal(signal.SIGSEGV)
    _, log = process.communicate(timeout=60)
    expect_line(log, "twinlock crashed|outside|Segmentation fault|bug")


def test_signal_handlers_of_an_fmu():
    """A handler that repairs the fault prevents the crash. One that calls its predecessor does not."""
    for args in verbs(config(make("displaced"))):
        code, _, log = run(args)
        expect(code == 0 and "the FMU's own handler" in log and "crashed" not in log, f"{args[0]} ended with {code}\n{log}")
    for args in verbs(config(make("displaced", CALLS_PREVIOUS=True))):
        expect_failure(args, "FMU hostile|crashed|fmi2DoStep|Floating point exception")


def test_a_sent_signal_with_the_code_of_a_fault():
    """Unlike a fault, such a signal is not raised again when the handler returns."""
    for code in ("SI_KERNEL", "ILL_ILLOPC"):
        how = f"siginfo_t told = {{.si_signo = SIGILL, .si_code = {code}}}; (void)syscall(SYS_rt_tgsigqueueinfo, getpid(), gettid(), SIGILL, &told);"
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_failure(args, "FMU hostile|crashed|fmi2DoStep|Illegal instruction")


def test_signals_that_end_a_process_and_are_no_crash():
    for how, number in (("(void)kill(getpid(), SIGKILL);", 9), ("(void)raise(SIGALRM);", 14)):
        for args in verbs(config(make("end", AT="fmi2DoStep", HOW=how))):
            expect_failure(args, f"signal {number}")


# ---- exit() ----

def test_an_fmu_that_ends_the_process():
    for function in FUNCTIONS:
        for args in verbs(config(make("end", AT=function, HOW="exit(0);"))):
            name, where = named(function)
            code, _, log = run(args)
            expect(code == 70, f"{args[0]} ended with {code}\n{log}")
            expect_line(log, f"error|FMU {name}|exit(0)|{where}")
    for function in ENDS:
        for args in verbs(config(make("end", AT=function, HOW="exit(3);"))):
            code, _, log = run(args)
            expect(code == 0, f"{args[0]} ended with {code}\n{log}")
            expect_line(log, f"warning|FMU hostile|exit(3)|{function}|complete")


def test_a_thread_of_the_fmu_that_ends_the_process():
    code, _, log = run(("run", config(make("left_thread", HOW="exit(3);")), "--duration", "5"))
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, "error|FMU|exit(3)|thread")


# ---- the end of the process ----

def test_threads_and_exit_handlers_do_not_disturb_the_end():
    for fmu in (make("left_thread"), make("bad_end"), make("bad_end", AT_EXIT=True)):
        for args in verbs(config(fmu)):
            code, _, log = run(args)
            expect(code == 0, f"{args[0]} with {fmu.name} ended with {code}\n{log}")
        code, out, log = run(("replay", config(fmu), "--json"))
        expect(code == 0 and json.loads(out)["steps"], f"no result\n{log}")


def test_exit_handlers_of_an_interpreter():
    """They run if the configuration names libraries. A crash there, or an endless handler, does not disturb the result."""
    libraries = {"components": {"hostile": {"libraries": ["libm.so.6"]}}}
    for fmu, text in ((make("bad_end", AT_EXIT=True), "ending"), (make("bad_end", AT_EXIT=True, HANGS=True), "ending")):
        code, out, log = run(("replay", config(fmu, libraries), "--json"))
        expect(code == 0 and text in log and json.loads(out)["steps"], f"ended with {code}\n{log}")


def test_results_outlive_a_crash_in_freeing():
    fmu = make("stack", AT="fmi2FreeInstance", BYTES=0)
    code, log, out = end_of(("replay", config(fmu), "--json"))
    expect(code == 0, f"ended with {code}\n{log}")
    expect_line(log, "warning|FMU hostile|crashed|fmi2FreeInstance|stack")
    expect(json.loads(out)["steps"], "no result")


# ---- calls that fail ----

def test_a_check_fails_if_an_fmu_cannot_start_or_step():
    """With what the FMU said, the call, the step and its time."""
    for at, call, step, remedy in (("fmi2SetupExperiment", 1, "step 0, at 0 s", "initial"),
                                   ("fmi2EnterInitializationMode", 1, "step 0, at 0 s", "initial"),
                                   ("fmi2ExitInitializationMode", 1, "step 0, at 0 s", "initial"),
                                   ("fmi2DoStep", 1, "step 0, at 0 s", "initial"),
                                   ("fmi2DoStep", 161, "step 160, at 1.6 s", "stop time")):
        for changes in (None, LOCKED):
            code, page, log = run(("check", config(make("refuse", AT=at, CALL=call), changes)))
            expect(code == 70 and page == "", f"{at}, call {call}: ended with {code}\n{page}{log}")
            expect_line(log, f"error|components.hostile|{step}|{at}|fmi2Error|refused: {at}, call {call}|{remedy}")


def test_outputs_that_cannot_be_read_in_initialisation_mode():
    """As those of ControlBuild: they are read after it, with the same values."""
    for changes in (None, LOCKED, merge(LOCKED, {"components": {"hostile": {"rollback": "replay"}}})):
        tables = []
        for fmu in (make("good"), *(make("refuse", AT="fmi2GetReal", UNTIL="fmi2ExitInitializationMode", **more) for more in ({}, {"SPOILS": True}))):
            code, page, log = run(("check", config(fmu, changes)))
            expect(code == 0, f"check of {fmu.name} ended with {code}\n{log}")
            expect(has_line(page, "outputs|after initialisation") == (fmu.stem == "refuse"), page)
            steps = scratch() / "steps.csv"
            code, _, log = run(("replay", config(fmu, changes), "--csv", steps))
            expect(code in (0, NOT_LOCKED), f"replay of {fmu.name} ended with {code}\n{log}")
            tables.append(steps.read_text(encoding="utf-8"))
        expect(tables[0] == tables[1] == tables[2], "other values than those of an FMU that permits it")


# ---- states that cannot be saved ----

def test_a_state_that_cannot_be_saved_is_an_error_of_the_fmu():
    """It is an error with "rollback": "state" only; else the program reports and uses another method."""
    only, any_way = (config(make("refuse", AT="fmi2GetFMUstate"), merge(LOCKED, {"components": {"hostile": {"rollback": way}}})) for way in ("state", "auto"))
    for verb in ("check", "replay"):
        code, log, _ = end_of((verb, only))
        expect(code == 70, f"{verb} ended with {code}\n{log}")
        expect_line(log, "error|hostile|fmi2GetFMUstate")
        code, log, _ = end_of((verb, any_way))
        expect(code in (0, NOT_LOCKED), f"{verb} ended with {code}\n{log}")
        expect_line(log, "notice|FMU lag|own states|memory")


# ---- calls that never return ----

def test_a_call_that_never_returns():
    """The program ends after --call-limit and keeps the results so far."""
    path = config(make("hang", AT="fmi2DoStep", CALL=60, IGNORE=True))
    steps, database = scratch() / "steps.csv", scratch() / "twin.db"
    hangs = "FMU hostile|fmi2DoStep|1.5 s|--call-limit"
    for verb, *options in (("check",), ("replay", "--csv", steps, "--db", database, "--report", scratch() / "page.html"),
                           ("plant", "--record", scratch() / "rows.csv")):
        begun = time.monotonic()
        code, _, log = run((verb, path, "--call-limit", "1.5", *options))
        expect(code == 70 and sum(has_line(line, hangs) for line in log.splitlines()) == 1, f"{verb} ended with {code}\n{log}")
        at_least(time.monotonic() - begun, 1.5, f"seconds until {verb} has ended")
    at_least(len(read_table(steps)["step"]), 58, "steps in the CSV file")
    with closing(sqlite3.connect(database)) as connection:
        at_least(connection.execute("SELECT count(*) FROM steps").fetchone()[0], 58, "steps in the database")
        events = [text for text, in connection.execute("SELECT text FROM events WHERE source = 'twin'")]
    expect(len(events) == 1 and has_line(events[0], hangs), f"{events}")


def test_an_fmu_that_ends_its_thread():
    """The thread that calls the FMUs never returns."""
    # AddressSanitizer would free its signal stack in a frame that pthread_exit() has unwound.
    before = os.environ.get("ASAN_OPTIONS", "")
    os.environ["ASAN_OPTIONS"] = before + ":use_sigaltstack=0"
    for how, verb in (("pthread_exit(NULL);", "plant"), ("(void)syscall(SYS_exit, 0);", "replay")):
        path = config(make("end", AT="fmi2DoStep", HOW=how))
        options = ("--record", scratch() / "rows.csv") if verb == "plant" else ()
        code, _, log = run((verb, path, "--call-limit", "1", *options))
        expect(code == 70, f"{verb} ended with {code}\n{log}")
        expect_line(log, "FMU hostile|fmi2DoStep|1 s|--call-limit")
    os.environ["ASAN_OPTIONS"] = before


def test_wrong_limits():
    for verb in ("check", "replay", "plant"):
        for text in ("0", "-1", "x", "1e9", "", "nan"):
            code, _, log = run((verb, "config.json", "--call-limit", text))
            expect(code == 2, f"{code}\n{log}")
            expect_line(log, f"twinlock {verb}|--call-limit|\"{text}\"|seconds|0|1e9")


def wait_until_it_hangs(process, log):
    until = time.monotonic() + 60 * PATIENCE
    while "hanging" not in log.read_text(encoding="utf-8"):
        expect(time.monotonic() < until and process.poll() is None, f"{describe(process)} does not hang\n{log.read_text()}")
        time.sleep(0.001)


class Hanging:
    """A program whose FMU does not return, and its log."""

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
    """The program ends five seconds after a signal, also if the FMU ignores, blocks or handles it."""
    programs = list(hanging_programs("load", "fmi2Instantiate", "fmi2DoStep", "fmi2FreeInstance"))
    for i, (_, program) in enumerate(programs):
        wait_until_it_hangs(program.process, program.log)
        program.process.send_signal((signal.SIGTERM, signal.SIGINT, signal.SIGHUP)[i % 3])
    begun = time.monotonic()
    for i, (function, program) in enumerate(programs):
        code, log = program.end(30)
        name, where = named(function)
        asked = ("SIGTERM", "SIGINT", "SIGHUP")[i % 3]
        expect(code == 70, f"{program.args[0]} ended with {code}\n{log}")
        expect_line(log, f"{asked}|FMU {name}|{where}")
    at_least(time.monotonic() - begun, 4.5, "seconds until all have ended")
    if not SANITIZER:
        at_most(time.monotonic() - begun, 25 * PATIENCE, "seconds until all have ended")


def test_a_call_that_returns_in_time_ends_in_order():
    """Then `run` is complete (exit code 0), `check` and `replay` are not (75)."""
    for args, wanted in zip(verbs(config(make("hang", AT="load", SECONDS=3, IGNORE=True))), (75, 75, 0)):
        program = Hanging(args)
        wait_until_it_hangs(program.process, program.log)
        time.sleep(0.2)
        program.process.send_signal(signal.SIGTERM)
        time.sleep(0.2)
        program.process.send_signal(signal.SIGTERM)  # the supervisor's and the user's may coincide
        code, log = program.end(30)
        expect(code == wanted, f"{args[0]} ended with {code}\n{log}")


def test_many_calls_do_not_keep_the_program_from_ending():
    """The rollback proof makes hundreds of calls, none of which takes long."""
    fmu = keeper_fmu.make_slow(PAUSE=400_000_000)
    for verb in "check", "replay":
        program = Hanging([verb, keeper_fmu.config(fmu, "state")])
        time.sleep(2)
        begun = time.monotonic()
        program.process.send_signal(signal.SIGTERM)
        code, log = program.end(60)
        expect(code == 75, f"{verb} ended with {code}\n{log}")
        expect_line(log, "interrupted|SIGTERM")
        expect(time.monotonic() - begun < 20 * PATIENCE, "not ended soon")


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
        expect(code == 70, f"{program.args[0]} ended with {code}\n{log}")
        expect_line(log, f"twice|SIGINT|FMU {name}|{where}")
        expect(time.monotonic() - begun < 9 * PATIENCE, "not ended at once")


main()
