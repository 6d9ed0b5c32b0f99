#!/usr/bin/env python3
"""Attacks by FMUs: each attack of tests/support/attacks.py succeeds in an unconfined process and fails in a confined one.

Runs check, replay and plant, as root and as a plain user. The test observes the target of each attack."""
import os
import re
import subprocess

import attacks
from attacks import ATTACKS, BOMBS, INSIDE, LONE, ON_TERMINAL, PRINTS, RESULTS, Ground, untouched, users
from twinlock_test import SANITIZER, Skip, expect, has_line, main


def carried_out(user, where, verb, confined, table=ATTACKS):
    """A ground after a run with all attacks of the table, one after the other."""
    ground = Ground(user, where, confined, verb)
    for attack in table:
        ground.order(attack)
    return ground.run()


def expect_all_reached(ground, table=ATTACKS):
    expected = [attack for attack in table if attack.only(ground)]
    missed = [attack.label for attack in expected if not ground.evidence[attack]()]
    told = ground.reports()
    expect(not missed, f"{ground}: did not succeed: {', '.join(f'{label} ({told.get(label)})' for label in missed)}\n{ground.said()}")
    return len(expected)


def expect_nothing_reached(ground, table=ATTACKS):
    told = ground.reports()
    tried = [attack.label for attack in table if attack.label not in told]
    expect(not tried, f"{ground}: were not tried: {', '.join(tried)}\n{ground.said()}")
    reached = [attack.label for attack in table if ground.evidence[attack]()]
    expect(not reached, f"{ground}: reached something: {', '.join(reached)}\n{ground.said()}")
    believed = [attack.label for attack in table if told[attack.label] == "succeeded"]
    expect(not believed, f"{ground}: report success: {', '.join(believed)}\n{ground.said()}")


def expect_refusals_logged(ground, table=ATTACKS):
    said = ground.refusals()
    expect(len(said) == len(set(said)), f"{ground}: logged more than once: {said}\n{ground.said()}")
    silent = [attack.label for attack in table if attack.calls and not set(attack.calls) & set(said)]
    expect(not silent, f"{ground}: not logged: {', '.join(silent)}; logged: {', '.join(said)}\n{ground.said()}")


def expect_nothing_left(ground):
    left = [f"{attacks.comm(pid)} ({pid})" for pid in ground.left()]
    expect(not left, f"{ground}: has left processes: {', '.join(left)}")
    expect(not ground.left_files(), f"{ground}: has left files: {ground.left_files()[:5]}")


def expect_went_on(ground, rows):
    expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")
    expect(ground.rows() == rows, f"{ground}: other values than without attacks")


PLACES = (("load", "replay"), ("fmi2Instantiate", "replay"), ("fmi2DoStep", "replay"), ("fmi2DoStep@thread", "replay"),
          ("fmi2DoStep", "check"), ("load", "plant"), ("fmi2DoStep", "plant"), ("fmi2DoStep@thread", "plant"))


def try_all(table, places, user):
    for where, verb in places:
        with carried_out(user, where, verb, False, table) as ground:
            count = expect_all_reached(ground, table)
            print(f"    {ground}: {count} of {len(table)} attacks succeeded")
        rows = untouched(user, verb)
        with carried_out(user, where, verb, True, table) as ground:
            expect_nothing_reached(ground, table)
            expect_refusals_logged(ground, table)
            expect_went_on(ground, rows)
            expect_nothing_left(ground)
            print(f"    {ground}: none")


def test_attacks_by_this_user():
    try_all(ATTACKS, PLACES, users()[0])


def test_attacks_by_a_plain_user():
    if os.geteuid() != 0:
        raise Skip("only root can become another user")
    try_all(ATTACKS, PLACES, users()[1])


def test_attacks_by_root_of_a_container():
    """A container prevents some attacks also without confinement."""
    if os.geteuid() != 0 or subprocess.run([*attacks.IN_CONTAINER, "true"], check=False, stderr=subprocess.DEVNULL).returncode != 0:
        raise Skip("no user namespace can be made here")
    attacks.in_container = True
    try:
        with carried_out(0, "fmi2DoStep", "replay", False) as ground:
            reached = sum(ground.evidence[attack]() for attack in ATTACKS)
            print(f"    {ground}: {reached} of {len(ATTACKS)} attacks succeeded")
            expect(reached > len(ATTACKS) // 2, f"only {reached} succeeded without confinement\n{ground.said()}")
        for verb in ("replay", "check", "plant"):
            with carried_out(0, "fmi2DoStep", verb, True) as ground:
                expect_nothing_reached(ground)
                expect_refusals_logged(ground)
                expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")
                expect_nothing_left(ground)
    finally:
        attacks.in_container = False


def alone(attack, user, verb, confined, *options):
    ground = Ground(user, attack.at or "fmi2DoStep", confined, verb)
    ground.order(attack)
    return ground.run(*options)


ERROR = re.compile(r"^twinlock: error: .*FMU", re.M)


def expect_bounded(ground, attack, rows):
    """Confined: the attack fails. The run has the same values, or it ends with 70 and an error message."""
    told = ground.reports().get(attack.label)
    ended = ground.code == 70 and attack.may_end
    expect(attack.believed or not ground.evidence[attack](), f"{ground}: {attack.label} reached something\n{ground.said()}")
    expect(attack.believed or told != "succeeded", f"{ground}: {attack.label} reports success\n{ground.said()}")
    expect(ended or told or attack.own_values, f"{ground}: {attack.label} was not tried\n{ground.said()}")
    expect(not ground.is_obeyed(), f"{ground}: {attack.label}: unescaped output\n{ground.said()}")
    expect(not ground.faults(), f"{ground}: {attack.label}: {ground.faults()}\n{ground.said()}")
    if ended:
        expect(ERROR.search(ground.log), f"{ground}: {attack.label} ended it without an error\n{ground.said()}")
    else:
        expect("crashed" not in ground.log, f"{ground}: {attack.label}: a logged crash, but the run went on\n{ground.said()}")
        expect_went_on(ground, ground.rows() if attack.own_values else rows)
        expect_refusals_logged(ground, (attack,))
    expect_nothing_left(ground)
    print(f"    {ground}, {attack.label}: {told}, ended with {ground.code}")


def hold_alone(table, places, verb="replay", options=()):
    """Each attack alone: unconfined by this user, then confined with `options` at all places (user, verb)."""
    for attack in table:
        with alone(attack, users()[0], verb, False) as ground:
            if attack.only(ground):
                expect_all_reached(ground, (attack,))
                print(f"    {attack.label}: {ground.reports().get(attack.label, 'no report')}")
            else:
                print(f"    {attack.label}: impossible here ({ground.reports().get(attack.label)})")
    for user, verb in places:
        rows = untouched(user, verb)
        for attack in table:
            with alone(attack, user, verb, True, *options) as ground:
                expect_bounded(ground, attack, rows)


def test_attacks_that_may_end_the_run():
    """Without ptrace if there is a sanitizer, which traces its own process to find leaks."""
    table = [attack for attack in LONE if not (SANITIZER and attack.label.startswith("ptrace"))]
    hold_alone(table, [(users()[-1], verb) for verb in ("replay", "check", "plant")] + [(user, "replay") for user in users()[:-1]])


def test_bombs():
    if SANITIZER:
        raise Skip("a sanitizer needs the memory itself")
    if not attacks.enough_memory(attacks.BOMB_MEBIBYTES):
        raise Skip(f"needs twice {attacks.BOMB_MEBIBYTES} MiB of free memory")
    # The limits are the same for each user.
    hold_alone(BOMBS, [(users()[-1], "replay")], options=("--memory-limit", attacks.LIMIT_MEBIBYTES))


def test_removed_files_by_root():
    """A supervisor that may inspect open files of FMUs ends the run before the disk is full."""
    if os.geteuid() != 0:
        raise Skip("only root can count the files of a confined process")
    bomb = attacks.Lone("bytes in removed files", "fill_removed", attacks.told(2000))
    with alone(bomb, 0, "replay", True) as ground:
        expect(ground.code == 70 and has_line(ground.log, "error|FMUs|removed|open"), ground.said())
        expect_nothing_left(ground)


def test_bombs_on_a_plant():
    """One of each kind."""
    if SANITIZER:
        raise Skip("a sanitizer needs the memory itself")
    for attack in BOMBS:
        if attack.label in ("heap", "bytes in its folder", "files in its folder"):
            with alone(attack, users()[-1], "plant", True, "--memory-limit", attacks.LIMIT_MEBIBYTES) as ground:
                expect_bounded(ground, attack, untouched(users()[-1], "plant"))


def test_output():
    hold_alone(PRINTS, [(user, "replay") for user in users()] + [(users()[-1], verb) for verb in ("check", "plant")])


def test_results_of_the_run():
    for verb, table in RESULTS.items():
        hold_alone(table, [(user, verb) for user in users()], verb)


def test_its_own_resources():
    """Closing or overwriting its own resources harms an unconfined process, too. Shared memory exists only in a confined one."""
    places = [(user, verb) for user in users() for verb in ("replay", "check", "plant")]
    hold_alone(INSIDE[:1], places, "plant")
    for attack in INSIDE[1:3]:
        with alone(attack, users()[0], "plant", False) as ground:
            print(f"    {attack.label}: {ground.reports().get(attack.label, 'no report')}, ended with {ground.code}")
    for user, verb in places:
        for attack in INSIDE[1:]:
            with alone(attack, user, verb, True) as ground:
                expect_bounded(ground, attack, untouched(user, verb))


def test_the_terminal():
    for user in users():
        with Ground(user) as ground:
            for attack in ON_TERMINAL:
                ground.order(attack)
            expect_all_reached(ground.on_terminal(), ON_TERMINAL)
            print(f"    {ground}: {ground.reports()}")
        for verb in ("replay", "check", "plant"):
            with Ground(user, "fmi2DoStep", True, verb) as ground:
                for attack in ON_TERMINAL:
                    ground.order(attack)
                ground.on_terminal()
                obeyed = attacks.OBEYED.search(ground.screen.replace(attacks.ERASE_LINE, b""))
                expect(not obeyed, f"{ground}: reached the terminal: {obeyed}\n{ground.said()}")
                expect(not ground.typed, f"{ground}: typed: {ground.typed}")
                expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")


def test_refusals_are_events():
    with carried_out(users()[0], "fmi2DoStep", "replay", True) as ground:
        said = [match[0] for match in attacks.REFUSAL.finditer(ground.log)]
        expect(said and said == ground.events(), f"logged {said}, events {ground.events()}")


main()
