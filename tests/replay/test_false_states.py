#!/usr/bin/env python3
"""States that are wrong, each in a way of its own: found before the first step, and called by its name."""
import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, Skip, expect, main, run, run_well, scratch

FMU_FAILED = 70
WORDS = {"parameters": "parameters kept", "events": "events lost", "one": "one handle only", "late": "refuses late"}


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_by_its_states_alone():
    """Nothing is synchronised."""
    for lie in WORDS:
        for verb in "check", "replay":
            code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make_false(lie), "state")])
            expect(code == FMU_FAILED and ("does not come back to where it was" in err or "fmi2GetFMUstate" in err), f"{verb} {lie}: {code}\n{out}{err}")
            expect("no problem found" not in out, f"check {lie}: {out}")


def expect_same(fmu, way, what):
    chosen = steps_of(keeper_fmu.config(fmu))
    expect(chosen == steps_of(keeper_fmu.config(fmu, way)), f"{what}: other values than by {way} from the beginning")
    expect(chosen == steps_of(keeper_fmu.config(fmu), "--plain"), f"{what}: other values with what is saved")


def test_by_its_memory():
    """The values are those of that way from the beginning."""
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: there is no copy of an FMU's memory")
    for lie, word in WORDS.items():
        fmu = keeper_fmu.make_false(lie)
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        expect(code == 0 and f"does not come back to where it was by its own states ({word}: " in err and "rolled back by its memory" in out, f"{lie}: {code}\n{out}{err}")
        expect_same(fmu, "memory", lie)


def test_by_what_it_was_given():
    """There is no copy of its memory: what its states do not hold is set again; if they do not hold more than that, it is reset."""
    for lie in "parameters", "one", "late":
        fmu = keeper_fmu.make_false(lie, OPENS=15)
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        expect(code == 0, f"{lie}: {code}\n{out}{err}")
        is_set_again = "by its states alone (parameters kept): it is given again after each restore what it had been given" in err
        expect(is_set_again == (lie == "parameters") and is_set_again == ("given again what it had been given" in out), f"{lie}: {out}{err}")
        expect(is_set_again != ("rolled back by replay" in out), f"{lie}: {out}{err}")
        expect_same(fmu, "replay", lie)


def test_by_no_way():
    """Neither a reset nor another instance takes back what its library keeps, and what a test has brought about: that is seen, and nothing goes on from there."""
    for verb in "check", "replay":
        code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make_false("events", OPENS=15))])
        expect(code == FMU_FAILED and "is not the same after restoring" in err, f"{verb}: {code}\n{out}{err}")


if __name__ == "__main__":
    main()
