#!/usr/bin/env python3
"""Cuts the power of a box while it records, and while the configuration of its run changes.

A few cuts here, more of them by tests/hil/power_cuts. script/test --all runs the single ones only.
See power_cuts.py and activation_cuts.py in tests/support.
"""
import json
import sys
import time

import activation_cuts
from power_cuts import PATIENCE_S, check_accounts, cuts, cuts_in_a_row, need_rig
from twinlock_test import Failure, expect, main, scratch

CUTS = 2


def show(number, figures):
    print(f"    cut {number}, {figures['after_s']:.2f} s after the first commit: {figures['steps']} steps are there, "
          f"{figures['missing']} samples missing; configuration {figures['behind']} behind, {figures['kept']} accounts kept",
          flush=True)


def show_late(number, why):
    print(f"    cut {number}: {why}", flush=True)


def test_single_power_cuts():
    need_rig()
    cuts(CUTS, time.time_ns(), show, show_late)


def show_in_a_row(number, figures):
    missing = "no sample of its run is there yet" if figures["missing"] is None else f"{figures['missing']} samples missing"
    back = "not in lock yet" if figures["back_s"] is None else f"in lock after {figures['back_s']:.1f} s"
    print(f"    boot {number}, start {figures['starts']}: {back}, {figures['locked']} steps in lock, {missing}; "
          + (f"cut {figures['after_s']:.1f} s after its start" if figures["after_s"] > 0 else "came back"), flush=True)


def test_power_cuts_in_a_row():
    """Five cuts. Five failures would be a restart loop, so cuts must not count as failures."""
    need_rig()
    cuts_in_a_row(5, time.time_ns(), show_in_a_row)


def show_change(number, cut):
    print(f"    cut {number}, in phase {cut.phase} ({cut.after_s:.1f} s after the awaited one): candidate {cut.active} of {cut.sent} is active"
          f"{' on probation' if cut.on_probation else ''}, {cut.runs} runs", flush=True)


def test_power_cuts_while_it_is_retuned():
    need_rig()
    activation_cuts.cuts(2, time.time_ns(), show_change, show_late)


def test_a_box_that_boots_late_costs_one_cut():
    """One box that gets no time, and one that does."""
    need_rig()
    late = []
    table = cuts(2, time.time_ns(), show, lambda number, why: late.append((number, why)), lambda number: 0.5 if number == 1 else PATIENCE_S)
    expect([number for number, _ in late] == [1] and "0.5 s" in late[0][1] and len(table) == 1, f"late {late}, {table}")


def accounts(probe, state):
    """The files of a disk with these two accounts; None for no account."""
    files = scratch()
    for name, account in ("account", probe), ("state", state):
        (files / name).mkdir()
        if account is not None:
            (files / name / "supervisor.json").write_text(json.dumps(account), encoding="utf-8")
    return files


def refused(files, told):
    try:
        check_accounts(files, told)
    except Failure:
        return True
    return False


def test_accounts_of_a_slow_box():
    first = {"starts": 1, "restarts": 0, "failures": 0, "running": True}
    second = {"starts": 2, "restarts": 1, "failures": 1, "running": True}
    check_accounts(accounts(None, first), {"committed": 1})  # cut before the probe's first output
    check_accounts(accounts({"starts": 8}, second), {"starts": 8, "begun": 2})  # its twin was restarted
    check_accounts(accounts({"starts": 8}, second), {"starts": 8, "begun": 1})
    expect(refused(accounts({"starts": 7}, first), {"starts": 8, "begun": 1}), "a lost account of the probe")
    expect(refused(accounts({"starts": 8}, first), {"starts": 8, "begun": 2}), "a lost account of the supervisor")
    expect(refused(accounts({"starts": 8}, {**first, "running": False}), {"starts": 8}), "an orderly end")


def by_hand(count, seed):
    table = cuts(count, seed, show, show_late, most_missing=100)
    missing = sorted(figures["missing"] for figures in table)
    print(f"{len(table)} of {count} cuts (seed {seed}; the others were late): integrity ok, file system without a fault and replay to the bit each time; samples "
          f"missing: median {missing[len(missing) // 2]}, most {missing[-1]} of 100; configuration as of the newest replacement "
          f"{sum(figures['behind'] == 0 for figures in table)} times, of the one before it "
          f"{sum(figures['behind'] == 1 for figures in table)} times, neither 0 times")


def in_a_row_by_hand(count, seed):
    table = cuts_in_a_row(count, seed, show_in_a_row, most_missing=50)
    missing = sorted(figures["missing"] for figures in table if figures["missing"] is not None)
    back = sorted(figures["back_s"] for figures in table if figures["back_s"] is not None)
    print(f"{len(table) - 1} cuts of one disk (seed {seed}): each start was counted, none was a failure, none was safe hold, and the last boot was in lock. {len(back)} boots "
          f"were in lock, {back[0]:.1f} to {back[-1]:.1f} s after their start (the first one {table[0]['back_s'] or 0:.1f} s; median {back[len(back) // 2]:.1f} s). Samples of 10 ms "
          f"missing: median {missing[len(missing) // 2] if missing else 0:.0f}, most {max(missing, default=0):.0f}")


def retuned_by_hand(count, seed):
    table = activation_cuts.cuts(count, seed, show_change, show_late)
    fell = ", ".join(f"{sum(cut.phase == phase for cut in table)} on {phase}" for phase in (*activation_cuts.PHASES, "active", "sent"))
    print(f"{len(table)} of {count} cuts (seed {seed}; the others were late): {fell}; the newest candidate was active {sum(cut.active == cut.sent for cut in table)} times, an older "
          f"one {sum(cut.active < cut.sent for cut in table)} times, {sum(cut.on_probation for cut in table)} times on probation; none of them was damaged, and a run began with each")


if sys.argv[1:2] == ["--cuts"]:
    by_hand(int(sys.argv[2]), int(sys.argv[4]))
elif sys.argv[1:2] == ["--in-a-row"]:
    in_a_row_by_hand(int(sys.argv[2]), int(sys.argv[4]))
elif sys.argv[1:2] == ["--retuned"]:
    retuned_by_hand(int(sys.argv[2]), int(sys.argv[4]))
else:
    main()
