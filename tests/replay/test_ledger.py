#!/usr/bin/env python3
"""The ledger: executions predicted by the graph compared with those done, in the JSON object, the table and the database.

If they differ, there is a warning."""
import filecmp
import sqlite3
from contextlib import closing

from twinlock_test import edited_config, expect, expect_line, has_line, main, replay_json, run, run_well, scratch

ALGORITHMS = ("secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx")


def config(components=None, **synchronise):
    """lock.json with other edits, and a solver whose number of executions the graph predicts."""
    edits = {"synchronise": {"algorithm": "nelder-mead", **synchronise}, "components": components or {}}
    return edited_config("motor/lock.json", edits)


def horizon(prediction, shape="static"):
    return {"prediction": prediction, "shape": shape}


def expect_as_predicted(told, behind=()):
    """`behind`: components whose inputs depend on u by the motor alone. If two u differ by rounding only, these inputs may be
    equal, and the components are executed less often than predicted."""
    ledger = told["ledger"]
    expect(ledger["complete"], f"{ledger}")
    for name, entry in ledger["components"].items():
        least = -0.01 * entry["predicted"] if name in behind else 0
        expect(least <= entry["difference"] <= 0, f"{name} differs from the prediction: {entry}")
    for name, entry in {**ledger["components"], "total": ledger["total"]}.items():
        expect(entry["predicted"] + entry["repeated"] + entry["difference"] == entry["executions"], f"{entry}")
        expect(entry["saved"] == entry["plain"] - entry["executions"], f"{name}: {entry}")
        expect(entry["executions"] == told["executions"][name], f"{name}: {entry}, {told['executions']}")
    return ledger


def test_executions_are_as_predicted():
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
    expect("ledger" not in run_well(["replay", edited_config("motor/free.json"), "--verbose"]), "a free run prints a ledger")


def steps(chosen, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", chosen, "--csv", path, *options])
    return path


def test_catching_up():
    """With "keep": "outputs" only some states are kept. Results are the same, and the ledger counts the repeated executions."""
    chosen = config({"motor": {"keep": "outputs"}}, horizon=horizon(3), free_twin=False)
    ledger = expect_as_predicted(replay_json(chosen), ("drive",))
    motor = ledger["components"]["motor"]
    expect(motor["repeated"] > 0, f"{motor}")
    expect(ledger["components"]["drive"]["repeated"] == 0, f"{ledger}")
    expect(filecmp.cmp(steps(chosen), steps(chosen, "--plain"), False), "results depend on what is kept")
    out = run_well(["replay", chosen, "--verbose"])
    expect_line(out, f"{motor['repeated']} repeated|0")


def test_nothing_kept():
    """With "keep": "none" a component executes in each evaluation. Results are the same, and the ledger knows the executions."""
    adaptable = {"horizon": horizon(3), "free_twin": False}
    kept, chosen = config(**adaptable), config({"motor": {"keep": "none"}, "drive": {"keep": "none"}}, **adaptable)
    ledger, before = expect_as_predicted(replay_json(chosen), ("drive", "motor")), replay_json(kept)["ledger"]
    for name in "drive", "motor":
        entry = ledger["components"][name]
        expect(entry["executions"] > before["components"][name]["executions"] and entry["repeated"] == 0, f"{entry}")
    expect(filecmp.cmp(steps(chosen), steps(kept, "--plain"), False), "results depend on what is kept")


def test_a_choice_is_repeated():
    """A run with "keep": "auto" records its choice, and a replay of the database repeats it without a measurement."""
    chosen, database = config({"motor": {"keep": "auto"}, "drive": {"keep": "auto"}}, horizon=horizon(3), free_twin=False), scratch() / "choice.db"
    run_well(["replay", chosen, "--db", database])
    executions = {}
    with closing(sqlite3.connect(database)) as connection:
        found = connection.execute("SELECT source, text FROM v_events WHERE text LIKE 'saving:%'").fetchall()
        expect(len(found) == 1 and found[0][0] == "twin", f"{found}")
        for keeps in [(motor, drive) for motor in ("states", "none") for drive in ("states", "none")]:
            connection.execute("UPDATE events SET text = ? WHERE text LIKE 'saving:%'", (f"saving: drive {keeps[1]}, motor {keeps[0]}",))
            connection.commit()
            again = scratch() / f"{'-'.join(keeps)}.db"
            told = replay_json(chosen, "--recording", database, "--db", again)
            executions[keeps] = [told["executions"][name] for name in ("motor", "drive")]
            pinned = config({"motor": {"keep": keeps[0]}, "drive": {"keep": keeps[1]}}, horizon=horizon(3), free_twin=False)
            expect(told["executions"] == replay_json(pinned)["executions"], f"{keeps}: {told['executions']}")
            with closing(sqlite3.connect(again)) as second:
                texts = [text for text, in second.execute("SELECT text FROM v_events WHERE text LIKE 'saving:%'")]
            expect(len(texts) == 1 and all(f"{name} {keep}" in texts[0] for name, keep in zip(("motor", "drive"), keeps)), f"{keeps}: {texts}")
    expect(len(set(map(tuple, executions.values()))) == 4, f"the choice has no effect: {executions}")


def test_no_room():
    """With too few nodes, more is executed than predicted. The log and the database have a warning; results are the same."""
    chosen, database = config(horizon=horizon(3), saving={"nodes": 2}), scratch() / "run.db"
    told = replay_json(chosen)
    motor = told["ledger"]["components"]["motor"]
    expect(motor["difference"] > 0 and motor["uncached"] > 0, f"{motor}")
    expect(told["cache"]["full"] == told["ledger"]["total"]["uncached"], f"{told['cache']}")
    code, _, err = run(["replay", chosen, "--db", database])
    parts = f"motor|{motor['difference']} executions|{motor['uncached']}|saving.nodes"
    expect(code == 0, f"it ended with {code}\n{err}")
    expect_line(err, f"warning|{parts}")
    with closing(sqlite3.connect(database)) as connection:
        events = connection.execute("SELECT severity, source, text FROM v_events").fetchall()
        expect([event[:2] for event in events if has_line(event[2], parts)] == [("warning", "twin")], f"{events}")
        found = connection.execute("SELECT difference, uncached FROM v_ledger WHERE component = 'motor'").fetchall()
        expect(found == [(motor["difference"], motor["uncached"])], f"the database has {found}")
    expect(filecmp.cmp(steps(chosen), steps(chosen, "--plain"), False), "results depend on the room")


def test_no_warning_if_all_is_as_predicted():
    code, out, err = run(["replay", config(), "--verbose"])
    expect(code == 0 and err == "", f"it ended with {code}\n{err}")
    total = replay_json(config())["ledger"]["total"]
    expect_line(out, f"ledger|predicted {total['predicted']}|{total['plain']}|saved {total['saved']}")


if __name__ == "__main__":
    main()
