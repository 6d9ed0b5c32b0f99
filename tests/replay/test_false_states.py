#!/usr/bin/env python3
"""States that are wrong, each in a way of its own: found before the first step, and called by its name."""
import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, expect, main, run, run_well, scratch

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


def test_by_another_way():
    """The values are those of that way from the beginning."""
    for lie, word in WORDS.items():
        fmu = keeper_fmu.make_false(lie)
        way = "replay" if SANITIZER else "memory"
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        said = "" if SANITIZER and lie != "late" else f" ({word}: "
        expect(code == 0 and f"does not come back to where it was {'otherwise' if SANITIZER else 'by its own states'}{said}" in err, f"{lie}: {code}\n{out}{err}")
        chosen = steps_of(keeper_fmu.config(fmu))
        expect(chosen == steps_of(keeper_fmu.config(fmu, way)), f"{lie}: other values than by {way} from the beginning")
        expect(chosen == steps_of(keeper_fmu.config(fmu), "--plain"), f"{lie}: other values with what is saved")


if __name__ == "__main__":
    main()
