#!/usr/bin/env python3
"""`check` tests whether two instances of an FMU have the same values, and what happens if a process cannot have two."""
import copied_fmu
import hostile_fmu
import keeper_fmu
from twinlock_test import SANITIZER, config_path, expect, expect_line, expect_no_line, has_line, main, run, run_well

SAME = "two instances"
DIFFERENT = "one per process"


def check(config, *options):
    """(last line of the page, section "determinism" in one line, log). The result is no error."""
    code, out, err = run(["check", config, *options])
    expect(code == 0, f"{code}\n{out}{err}")
    *section, last = out.partition("\ndeterminism\n")[2].splitlines()
    return last, " ".join(" ".join(section).split()), err


def expect_warning(config, parts, warnings="1 warning", options=()):
    last, section, err = check(config, *options)
    expect_line(last, f"no problem found|{warnings}")
    expect_line(section, parts)
    expect_no_line(section, SAME)
    expect("crashed" not in err, err)
    return section


def expect_one_per_process(config, component, parts, options=()):
    expect_warning(config, f"components.{component}|{DIFFERENT}|{parts}", options=options)


# ---- the same ----

def test_ours():
    for name in ("motor/lock.json", "motor/free.json", "emps/ahead.json"):
        out = run_well(["check", config_path(name)])
        expect_line(out.partition("\ndeterminism\n")[2], f"{SAME}|100 steps")
        last = out.splitlines()[-1]
        expect(has_line(last, "no problem found") and "warning" not in last, out)


def test_globals_of_a_library_are_not_shared():
    """Each component has a copy of the library, also if the FMU says that a process can have one instance only."""
    for fmu in (copied_fmu.make(), copied_fmu.make("once", once=True)):
        expect_line(check(copied_fmu.config([fmu]))[1], f"{SAME}|100 steps")


def test_wrong_states_are_no_difference():
    """Both twins find the error and use another rollback method. For lost events these are copies of memory, which a sanitizer
    prevents."""
    for lie in ("parameters",) if SANITIZER else ("parameters", "events"):
        _, section, err = check(keeper_fmu.config(keeper_fmu.make_false(lie)))
        expect_line(section, f"{SAME}|steps")
        expect_line(err, "notice|FMU lag|own states")


# ---- not the same ----

def test_one_that_differs_beside_another():
    """From step 3 on the second instance has an offset."""
    for config in (keeper_fmu.config(keeper_fmu.make_met(FROM=3)), keeper_fmu.config(keeper_fmu.make_met(FROM=3), components=2)):
        expect_one_per_process(config, "keeper0", "step 3|y|0.304998279")


def test_one_that_differs_each_time():
    """The second warning is about its states in another process."""
    section = expect_warning(keeper_fmu.config(keeper_fmu.make_met(FROM=0, SEED=True)), "components.keeper0|not deterministic|step 0|y", warnings="2 warnings")
    expect_no_line(section, DIFFERENT)


# ---- no second instance ----

def once(how, at="fmi2DoStep"):
    return hostile_fmu.config(hostile_fmu.make("once", HOW=how, AT=at))


def test_one_that_crashes():
    for function in ("fmi2DoStep", "fmi2Instantiate"):
        expect_one_per_process(once("crashes", function), "hostile", f"signal 6|Aborted|{function}|FMU hostile")


def test_one_that_hangs():
    expect_one_per_process(once("hangs"), "hostile", "FMU hostile|fmi2DoStep|2 s|--call-limit", options=("--call-limit", "2"))


def test_one_that_refuses():
    expect_one_per_process(once("refuses", "fmi2Instantiate"), "hostile", "fmi2Instantiate")
    expect_one_per_process(once("refuses", "fmi2ExitInitializationMode"), "hostile", "fmi2ExitInitializationMode|fmi2Error")
    expect_one_per_process(once("refuses"), "hostile", "fmi2DoStep|fmi2Error")


if __name__ == "__main__":
    main()
