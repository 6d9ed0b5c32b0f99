#!/usr/bin/env python3
"""The ledger: executions that the graph predicts against those that were done, in the JSON object, in the table
and in the database; what is said where they differ."""
import filecmp
import sqlite3
from contextlib import closing

from twinlock_test import edited_config, expect, main, replay_json, run, run_well, scratch

ALGORITHMS = ("secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx")


def config(components=None, **synchronise):
    """lock.json by a solver that does not depend on what is best at present, with other edits."""
    edits = {"synchronise": {"algorithm": "nelder-mead", **synchronise}, "components": components or {}}
    return edited_config("motor/lock.json", edits)


def horizon(prediction, shape="static"):
    return {"prediction": prediction, "shape": shape}


def expect_as_predicted(told, behind=()):
    """`behind`: components that only feel what the motor makes of u. Where two u differ by rounding, that may be
    the same to the bit, and they are executed less often than predicted."""
    ledger = told["ledger"]
    expect(ledger["complete"], f"{ledger}")
    for name, entry in ledger["components"].items():
        least = -0.01 * entry["predicted"] if name in behind else 0
        expect(least <= entry["difference"] <= 0, f"{name} was executed otherwise than predicted: {entry}")
    for name, entry in {**ledger["components"], "total": ledger["total"]}.items():
        expect(entry["predicted"] + entry["repeated"] + entry["difference"] == entry["executions"], f"{entry}")
        expect(entry["saved"] == entry["plain"] - entry["executions"], f"{name}: {entry}")
        expect(entry["executions"] == told["executions"][name], f"{name}: {entry}, {told['executions']}")
    return ledger


def test_what_is_done_is_what_is_predicted():
    for algorithm in ALGORITHMS:
        for prediction in (1, 2, 3):
            chosen = config(algorithm=algorithm, horizon=horizon(prediction))
            told, plain = replay_json(chosen), replay_json(chosen, "--plain")
            ledger = expect_as_predicted(told, ("drive",) if prediction > 2 else ())
            without = expect_as_predicted(plain)
            expect(told["evaluations"] == plain["evaluations"], f"{algorithm}: saving changes the search")
            expect(ledger["total"]["plain"] == without["total"]["executions"], f"{ledger}, {without}")
            expect(without["total"]["saved"] == plain["cache"]["saved"] == 0, f"--plain saves: {without}")
            expect(ledger["total"]["saved"] == told["cache"]["saved"] > 0, f"nothing is saved: {ledger}")


def test_free():
    ledger = expect_as_predicted(replay_json("motor/free.json"))
    expect(ledger["total"]["saved"] == 0, f"{ledger}")
    expect("ledger" not in run_well(["replay", edited_config("motor/free.json")]), "a free run tells its ledger")


def steps(chosen, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", chosen, "--csv", path, *options])
    return path


def test_catching_up():
    """Outputs of all, states now and then: the same results, and what is done again is accounted for."""
    chosen = config({"motor": {"keep": "outputs"}}, horizon=horizon(3), free_twin=False)
    ledger = expect_as_predicted(replay_json(chosen), ("drive",))
    motor = ledger["components"]["motor"]
    expect(motor["repeated"] > 0, f"{motor}")
    expect(ledger["components"]["drive"]["repeated"] == 0, f"{ledger}")
    expect(filecmp.cmp(steps(chosen), steps(chosen, "--plain"), False), "results depend on what is kept")
    out = run_well(["replay", chosen])
    expect(f"{motor['repeated']} caught up, 0 results found no room" in out, out)


def test_no_room():
    """More is executed than predicted: a warning in the log and in the database, and no other result."""
    chosen, database = config(horizon=horizon(3), saving={"nodes": 2}), scratch() / "run.db"
    told = replay_json(chosen)
    motor = told["ledger"]["components"]["motor"]
    expect(motor["difference"] > 0 and motor["uncached"] > 0, f"{motor}")
    expect(told["cache"]["full"] == told["ledger"]["total"]["uncached"], f"{told['cache']}")
    code, _, err = run(["replay", chosen, "--db", database])
    words = f"motor: {motor['difference']} executions more than predicted: results found no room ({motor['uncached']}, see"
    expect(code == 0 and f"warning: {words}" in err, f"it ended with {code}\n{err}")
    with closing(sqlite3.connect(database)) as connection:
        found = connection.execute("SELECT severity, source FROM v_events WHERE text LIKE ?", (f"{words}%",))
        expect(found.fetchall() == [("warning", "twin")], "the database has no such event")
        found = connection.execute("SELECT difference, uncached FROM v_ledger WHERE component = 'motor'").fetchall()
        expect(found == [(motor["difference"], motor["uncached"])], f"the database has {found}")
    expect(filecmp.cmp(steps(chosen), steps(chosen, "--plain"), False), "results depend on the room")


def test_no_word_where_all_is_well():
    code, out, err = run(["replay", config()])
    expect(code == 0 and err == "", f"it ended with {code}\n{err}")
    total = replay_json(config())["ledger"]["total"]
    line = f"  ledger       predicted {total['predicted']}, without saving {total['plain']}, saved {total['saved']}\n"
    expect(line in out, out)


if __name__ == "__main__":
    main()
