#!/usr/bin/env python3
"""The ten scenarios of the dissertation's table 5.5, each with four solvers: saving executions changes no bit of y and u, the
ledger is exact, and the twin is locked. script/studies/scenarios prints the table."""
import filecmp
import json
import os
import signal
import subprocess
import sys
import time

import motor_bench
import scenarios
from twinlock_test import BUILD, PATIENCE, PROGRAM, SANITIZER, SOURCE, at_most, expect, main, run_well, scratch, write_config

WORST_MSE = 1.5  # (rad/s)², that of the dissertation's table 5.6

# Most executions relative to the fewest possible, with our own solver.
WORST_RATIO = {"b": 1.002, "c": 1.12, "d": 1.01, "e": 1.002, "g": 1.005, "h": 1.08, "i": 1.02, "j": 1.01}


def replay(config, *options):
    """(summary, CSV file of all steps) of one replay."""
    path = scratch() / "steps.csv"
    return json.loads(run_well(["replay", config, "--json", "--csv", path, *options])), path


def measure(document):
    """The figures of a configuration on its recording, with saving as configured and without any."""
    config = write_config(document)
    saved, steps = replay(config)
    plain, plain_steps = replay(config, "--plain")
    return motor_bench.figures(saved, plain, filecmp.cmp(steps, plain_steps, False))


def check_plain(name, result, prediction):
    """Without saving, every evaluation executes every component in all of its steps."""
    wanted = 3 * (result["steps"] + prediction * result["evaluations"])
    expect(result["without"] == wanted, f"{name}: {result['without']} executions without saving, wanted {wanted}")


def check_scenario(letter):
    for solver in motor_bench.SOLVERS:
        document, name = motor_bench.scenario(letter, solver), f"{letter}) {solver}"
        result = measure(document)
        print(f"    {name}: MSE {result['mse']:.3f}, ratio {result['ratio_with']:.4f} ({result['ratio_without']:.2f} plain)")
        expect(result["steps"] == 1401, f"{name}: {result['steps']} steps")
        expect(result["same"], f"{name}: saving changes y, u or the number of evaluations")
        expect(result["off"] == 0, f"{name}: {result['off']} executions more than the ledger predicts")
        check_plain(name, result, document["synchronise"]["horizon"]["prediction"])
        at_most(result["mse"], WORST_MSE, f"{name}: MSE, (rad/s)\u00b2")
        if solver == "secant" and letter in WORST_RATIO:
            at_most(result["ratio_with"], WORST_RATIO[letter], f"{name}: executions over the fewest")


def test_a_and_b():
    check_scenario("a")
    check_scenario("b")


def test_c():
    check_scenario("c")


def test_d():
    check_scenario("d")


def test_e():
    check_scenario("e")


def test_f_and_g():
    check_scenario("f")
    check_scenario("g")


def test_h():
    check_scenario("h")


def test_i():
    check_scenario("i")


def test_j():
    check_scenario("j")


# ---- the command ----

def start(*arguments):
    """script/studies/scenarios without its building."""
    return subprocess.Popen([sys.executable, SOURCE / "script" / "studies" / "scenarios.py", *arguments], text=True,
                            env={**os.environ, "TWINLOCK": PROGRAM, "TWINLOCK_FMU_PATH": str(BUILD / "fmus")},
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def command(*arguments):
    """(exit code, stdout, stderr) of it."""
    process = start(*arguments)
    out, err = process.communicate(timeout=120 * PATIENCE)
    return process.returncode, out, err


def test_the_table():
    """Each line fits into 100 columns. Without a terminal nothing is drawn."""
    code, out, err = command("--only", "eb")
    expect(code == 0 and err == "", f"ended with {code}\n{err}")
    lines = out.splitlines()
    expect(max(map(len, lines)) <= 100, f"{max(map(len, lines))} columns")
    for solver in motor_bench.SOLVERS:
        rows = [line for line in lines if line.split()[:1] == [solver] and "exact" in line]
        expect(len(rows) == 2, f"{len(rows)} lines of {solver}")
    expect("16096" in out and "9345" in out, "the figures of the thesis are not there")
    expect(out.index("b) friction") < out.index("e) friction"), "the scenarios are not in their order")


def test_the_json():
    code, out, err = command("--only", "b", "--json", "--seed", "7")
    results = json.loads(out)
    expect(code == 0 and err == "", f"ended with {code}\n{err}")
    expect(set(results) == {"free", "b"} and set(results["b"]) == set(motor_bench.SOLVERS), f"{results.keys()}")
    expect(results["free"]["with"] == 4203, f"{results['free']}")


def test_a_campaign():
    code, out, err = command("--campaign", "1")
    expect(code == 0 and err == "", f"ended with {code}\n{err}")
    expect(max(map(len, out.splitlines())) <= 100, "more than 100 columns")
    expect("MISSED" not in out, out)


def test_what_it_refuses():
    for arguments in (["--only", "x"], ["--campaign", "0"], ["--force", "0"], ["--seed", "-1"], ["--nonsense"],
                      ["--recording", "some.csv", "--seed", "2"]):
        code, out, err = command(*arguments)
        expect(code == 2 and out == "" and "scenarios" in err, f"{arguments}: {code}\n{out}{err}")
    code, out, err = command("--recording", scratch() / "none.csv")
    expect(code == 65 and out == "" and "none.csv" in err, f"{code}\n{out}{err}")


def test_wrong_results_are_an_error():
    right = {"same": True, "off": 0}
    for wrong in ({"same": False, "off": 0}, {"same": True, "off": 1}, {"same": True, "off": -1}):
        expect(not scenarios.are_sound({"free": right, "b": {"secant": wrong}}), f"{wrong} is taken for right")
    expect(scenarios.are_sound({"free": right, "b": {"secant": right}}), "what is right is not taken so")


def test_it_can_be_interrupted():
    process = start("--campaign", "1000")
    time.sleep(2.0 if SANITIZER else 0.7)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30 * PATIENCE)
    expect(process.returncode == 130 and out == "" and err == "scenarios: interrupted\n", f"{process.returncode}\n{err}")


main()
