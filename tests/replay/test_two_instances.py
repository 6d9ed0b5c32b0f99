#!/usr/bin/env python3
"""`check` says whether two instances of an FMU have the same values, and of one that cannot be twice in a process what happens then."""
import copied_fmu
import hostile_fmu
import keeper_fmu
from twinlock_test import SANITIZER, config_path, expect, main, run, run_well

SAME = "two instances have the same values in"


def check(config, *options):
    """(its words, its log); whatever is found, it is no error."""
    code, out, err = run(["check", config, *options])
    expect(code == 0, f"{code}\n{out}{err}")
    return " ".join(out.split()), err


def expect_told(config, *words, warnings="1 warning", options=()):
    out, err = check(config, *options)
    expect(all(word in out for word in (*words, f"no problem found, {warnings}")) and SAME not in out, f"{out}\n{err}")
    expect("crashed" not in err, err)
    return out


def expect_one_per_process(config, component, *words, options=()):
    return expect_told(config, f"components.{component}: one per process: ", "use it in one component only", *words, options=options)


# ---- the same ----

def test_ours():
    for name in ("motor/lock.json", "motor/free.json", "emps/ahead.json"):
        out = run_well(["check", config_path(name)])
        expect("determinism\n  two instances have the same values in 100 steps\nno problem found\n" in out, out)


def test_globals_of_a_library_are_not_shared():
    """Of the one it is not even wrong that it says to be for one per process: each has its own library."""
    for fmu in (copied_fmu.make(), copied_fmu.make("once", once=True)):
        out, _ = check(copied_fmu.config([fmu]))
        expect(f"{SAME} 100 steps" in out, out)


def test_states_that_are_wrong_are_no_difference():
    """Both twins find that out, and lead it back in another way: of lost events only a copy of its memory does, which a sanitizer has not."""
    for lie in ("parameters",) if SANITIZER else ("parameters", "events"):
        out, err = check(keeper_fmu.config(keeper_fmu.make_false(lie)))
        expect(f"{SAME} " in out and "does not come back to where it was by its " in err, out + err)


# ---- not the same ----

def test_one_that_differs_beside_another():
    """After step 3, in which the offset is not there yet."""
    for config in (keeper_fmu.config(keeper_fmu.make_met(FROM=3)), keeper_fmu.config(keeper_fmu.make_met(FROM=3), components=2)):
        expect_one_per_process(config, "keeper0", "in step 3 its y is ")


def test_one_that_differs_each_time():
    """The other warning is of its states, which another process does not go on with."""
    out = expect_told(keeper_fmu.config(keeper_fmu.make_met(FROM=0, SEED=True)), "components.keeper0: not deterministic: in step 0 its y is ", "neither replaying a run",
                      warnings="2 warnings")
    expect("one per process" not in out, out)


# ---- not twice ----

def once(how, at="fmi2DoStep"):
    return hostile_fmu.config(hostile_fmu.make("once", HOW=how, AT=at))


def test_one_that_crashes():
    for function in ("fmi2DoStep", "fmi2Instantiate"):
        expect_one_per_process(once("crashes", function), "hostile", f"was ended by signal 6 (Aborted), in {function} of FMU hostile")


def test_one_that_hangs():
    expect_one_per_process(once("hangs"), "hostile", "FMU hostile has not returned from fmi2DoStep for 2 s", options=("--call-limit", "2"))


def test_one_that_refuses():
    expect_one_per_process(once("refuses", "fmi2Instantiate"), "hostile", "fmi2Instantiate refused;")
    expect_one_per_process(once("refuses", "fmi2ExitInitializationMode"), "hostile", "fmi2ExitInitializationMode failed (fmi2Error)")
    expect_one_per_process(once("refuses"), "hostile", "fmi2DoStep failed (fmi2Error)")


if __name__ == "__main__":
    main()
