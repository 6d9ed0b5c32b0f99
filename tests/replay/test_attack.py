#!/usr/bin/env python3
"""What FMUs can reach: each attack of tests/support/attacks.py first succeeds in a process that is not confined, and then reaches nothing in
one that is, in check, replay and plant, as root and as a plain user. What was reached is seen at the other end."""
import os

import attacks
from attacks import ATTACKS, Ground, users
from twinlock_test import Skip, expect, main


def carried_out(user, where, verb, confined, table=ATTACKS):
    """A ground after the run in which all attacks of the table were tried, one behind the other."""
    ground = Ground(user, where, confined, verb)
    for attack in table:
        ground.order(attack)
    return ground.run()


def baseline(user, verb):
    """The rows of a run in which nobody is attacked."""
    with Ground(user, verb=verb).run() as ground:
        expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.log}")
        return ground.rows()


def expect_all_reached(ground, table=ATTACKS):
    expected = [attack for attack in table if attack.only(ground)]
    missed = [attack.label for attack in expected if not ground.evidence[attack]()]
    told = ground.reports()
    expect(not missed, f"{ground}: did not succeed: {', '.join(f'{label} ({told.get(label)})' for label in missed)}\n{ground.log}")
    return len(expected)


def expect_nothing_reached(ground, table=ATTACKS):
    told = ground.reports()
    tried = [attack.label for attack in table if attack.label not in told]
    expect(not tried, f"{ground}: were not even tried: {', '.join(tried)}\n{ground.log}")
    reached = [attack.label for attack in table if ground.evidence[attack]()]
    expect(not reached, f"{ground}: reached something: {', '.join(reached)}\n{ground.log}")
    believed = [attack.label for attack in table if told[attack.label] == "succeeded"]
    expect(not believed, f"{ground}: were told that they succeeded: {', '.join(believed)}\n{ground.log}")


def expect_refusals_said(ground, table=ATTACKS):
    said = ground.refusals()
    expect(len(said) == len(set(said)), f"{ground}: said more than once: {said}\n{ground.log}")
    silent = [attack.label for attack in table if attack.calls and not set(attack.calls) & set(said)]
    expect(not silent, f"{ground}: nothing was said of {', '.join(silent)}; said were {', '.join(said)}\n{ground.log}")


def expect_nothing_left(ground):
    left = [f"{attacks.comm(pid)} ({pid})" for pid in ground.left()]
    expect(not left, f"{ground}: has left processes: {', '.join(left)}")
    expect(not ground.left_files(), f"{ground}: has left files: {ground.left_files()[:5]}")


def expect_went_on(ground, rows):
    expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.log}")
    expect(ground.rows() == rows, f"{ground}: other values than without attacks")


PLACES = (("load", "replay"), ("fmi2Instantiate", "replay"), ("fmi2DoStep", "replay"), ("fmi2DoStep@thread", "replay"),
          ("fmi2DoStep", "check"), ("fmi2DoStep", "plant"))


def hold_against(table, places, user):
    for where, verb in places:
        with carried_out(user, where, verb, False, table) as ground:
            count = expect_all_reached(ground, table)
            print(f"    {ground}: {count} of {len(table)} attacks reached what they wanted")
        if not attacks.CONFINES:
            continue
        rows = baseline(user, verb)
        with carried_out(user, where, verb, True, table) as ground:
            expect_nothing_reached(ground, table)
            expect_refusals_said(ground, table)
            expect_went_on(ground, rows)
            expect_nothing_left(ground)
            print(f"    {ground}: none")


def test_attacks_by_whoever_this_is():
    hold_against(ATTACKS, PLACES, users()[0])


def test_attacks_by_a_plain_user():
    if os.geteuid() != 0:
        raise Skip("only root can become another user")
    hold_against(ATTACKS, PLACES, users()[1])


def test_that_it_confines():
    if not attacks.CONFINES:
        raise Skip("this program has no --unconfined: only that the attacks succeed was tested")


main()
