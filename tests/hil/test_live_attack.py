#!/usr/bin/env python3
"""Attacks by FMUs in `run`: confined FMUs reach nothing.

Each attack of tests/support/attacks.py first succeeds with --unconfined. The test checks the
effect, not the attacker's report.
"""
import os

import attacks
from attacks import ATTACKS, LONE, Ground, users
from live_test import count_lines
from twinlock_test import expect, main

# Attacks on other processes. The kernel refuses them, and the run continues.
PROCESSES = tuple(attack for attack in LONE if attack.calls and attack.function not in ("processes",))
SUPERVISOR = tuple(attack for attack in LONE if attack.function in ("send_kill", "trace") and attack.label.endswith("of its parent"))


def carried_out(user, where, confined, table, *options):
    ground = Ground(user, where, confined, "run")
    for attack in table:
        ground.order(attack, attack.at if isinstance(attack, attacks.Lone) else None)
    return ground.run(*options)


def expect_all_reached(ground, table):
    told = ground.reports()
    missed = [attack.label for attack in table if attack.only(ground) and not ground.evidence[attack]()]
    expect(not missed, f"{ground}: did not succeed: {', '.join(f'{label} ({told.get(label)})' for label in missed)}\n{ground.said()}")


def expect_held(ground, table):
    """Checks that all attacks were tried and had no effect, and that the run ended in order.

    Each refused call must be logged and recorded once.
    """
    told, said = ground.reports(), ground.refusals()
    tried = [attack.label for attack in table if attack.label not in told]
    reached = [attack.label for attack in table if ground.evidence[attack]() or told.get(attack.label) == "succeeded"]
    silent = [attack.label for attack in table if attack.calls and not set(attack.calls) & set(said)]
    expect(not tried, f"{ground}: were not even tried: {', '.join(tried)}\n{ground.said()}")
    expect(not reached, f"{ground}: reached something: {', '.join(reached)}\n{ground.said()}")
    expect(not silent, f"{ground}: nothing was said of {', '.join(silent)}; said were {', '.join(said)}\n{ground.said()}")
    expect(len(said) == len(set(said)), f"{ground}: said more than once: {said}\n{ground.said()}")
    events = [attacks.REFUSAL.search(text)[2] for text in ground.events()]
    expect(sorted(events) == sorted(said), f"{ground}: said {said}, events {events}")
    expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")
    expect(not ground.left_files(), f"{ground}: has left files: {ground.left_files()}")
    print(f"    {ground}: {len(table)} attacks, none")


def test_attacks():
    for user in users():
        for where in ("load", "fmi2DoStep", "fmi2DoStep@thread"):
            with carried_out(user, where, False, ATTACKS) as ground:
                expect_all_reached(ground, ATTACKS)
            with carried_out(user, where, True, ATTACKS) as ground:
                expect_held(ground, ATTACKS)


def test_other_processes():
    for attack in PROCESSES:
        with carried_out(users()[0], "fmi2DoStep", False, (attack,)) as ground:
            expect_all_reached(ground, (attack,))
    for user in users():
        with carried_out(user, "fmi2DoStep", True, PROCESSES) as ground:
            expect_held(ground, PROCESSES)


def test_its_own_pipe():
    """An FMU reads the pipe of its own output. The messages of others still arrive."""
    for user in users():
        with carried_out(user, "fmi2DoStep", True, (attacks.OWN_PIPE,)) as ground:
            expect_held(ground, (attacks.OWN_PIPE,))


def test_the_supervisor():
    for user in users():
        for confined in (False, True):
            for attack in SUPERVISOR:
                ground = Ground(user, "fmi2DoStep", confined, "run")
                with ground:
                    ground.order(attack)
                    ground.run("--supervise", "--state", ground.home / "state")
                    if confined:
                        expect_held(ground, (attack,))
                    else:
                        expect_all_reached(ground, (attack,))


def test_one_component_makes_it_unconfined():
    """An unconfined component makes the run unconfined, and the log reports it as for the
    option."""
    with Ground(os.geteuid(), "fmi2DoStep", True, "run") as ground:
        attack = next(attack for attack in ATTACKS if attack.label == "write")
        ground.changes = {"components": {"hostile": {"unconfined": True}}}
        ground.order(attack)
        ground.run()
        expect_all_reached(ground, (attack,))
        expect(count_lines(ground.log, "warning|unconfined|FMUs") == 1, ground.said())


main()
