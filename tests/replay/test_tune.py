#!/usr/bin/env python3
"""`twinlock tune`: the candidates that it keeps, how it continues, and what the recommended one does on another recording."""
import importlib.util
import json
import os
import signal
import sys
import time

from twinlock_test import (BAD_DATA, BAD_USAGE, EMULATED, PROGRAM, SOURCE, Skip, at_most, expect, expect_line, finish, main, run,
                           run_well, scratch, start)

if EMULATED or importlib.util.find_spec("optuna") is None:
    raise Skip("Optuna is missing, or the program is emulated: script/bootstrap installs Optuna for tests")
sys.path.insert(0, str(SOURCE / "script"))
import tune  # noqa: E402

TRY_AGAIN = 75


def example():
    """A folder with tclab.json as `init` writes it, and two recordings; the twin has three times the heat capacity."""
    folder = scratch()
    for seed in (1, 2):
        run_well(["plant", SOURCE / "config/tclab/plant.json", "--record", folder / f"{seed}.csv", "--seed", seed])
    run_well(["init", "tclab.fmu", "--recording", folder / "1.csv", "--output", folder / "tclab.json"])
    document = json.loads((folder / "tclab.json").read_text(encoding="utf-8"))
    document["components"]["tclab"]["set"] = {"mCp": 6, "T1_start": 294.0, "T2_start": 293.1}
    (folder / "tclab.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


FOLDER = example()


def search(name, *args, code=0):
    """(rows of the results, standard output and error)."""
    ended, out, err = run(["tune", FOLDER / "tclab.json", "--results", FOLDER / f"{name}.jsonl", *args], cwd=FOLDER)
    expect(ended == code, f"ended with {ended}, wanted {code}: {err}")
    return rows_of(name), out + err


def rows_of(name):
    path = FOLDER / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[1:]] if path.exists() else []


def keys(rows):
    return [json.dumps(row["settings"], sort_keys=True) for row in rows]


def by_number(rows):
    return {row["number"]: (row["settings"], row["values"]) for row in rows}


def test_the_table_and_the_recommended_one():
    rows, out = search("whole", "--trials", "24", "--output", "sub.json")
    expect(len(rows) == 24 and len(set(keys(rows))) == 24, f"{len(rows)} candidates, {len(set(keys(rows)))} different")
    good = [row for row in rows if row["values"]]
    expect(len(good) >= 12, f"{len(rows) - len(good)} failed")
    kept = tune.pareto(good)
    for row in kept:
        beaten = [other["number"] for other in good if other["values"] != row["values"]
                  and all(a <= b for a, b in zip(other["values"], row["values"]))]
        expect(not beaten, f"{row['number']} is beaten by {beaten}")
    expect(all(row in kept or any(all(a <= b for a, b in zip(other["values"], row["values"])) for other in kept) for row in good),
           "a candidate that no other beats is not kept")
    expect(max(map(len, out.splitlines())) <= 80 or not out.isascii(), "wider than 80 columns")
    expect_line(out, "24 candidates")
    run_well(["check", FOLDER / "sub.json"])


def test_an_unseen_recording():
    """Both released error and executions, against the configuration that the search started from."""
    figures = []
    for name in ("tclab.json", "sub.json"):
        path, folder = FOLDER / name, scratch()
        worker = tune.Worker(folder, 600)
        worker.program = PROGRAM
        document = tune.moved(tune.read_config(path), FOLDER, folder)
        document["synchronise"]["release_s"] = 74
        recording = ("--recording", str(FOLDER / "2.csv"))
        reference = tune.Reference(worker, document, tune.find_starts(worker, path), recording, 37)
        units = {name: entry["step"] for name, entry in document["synchronise"]["adjust"].items()}
        figures.append(tune.Trial(worker, [reference], units).of(document)["values"])
    at_most(figures[1][0], 1.03 * figures[0][0], "released error")
    at_most(figures[1][1], 1.1 * figures[0][1], "executions")


def test_it_continues():
    """In parts, with another number of jobs: the same candidates and values, none twice."""
    first, _ = search("parts", "--trials", "8", "--jobs", "1")
    expect(len(first) == 8, f"{len(first)} candidates")
    with open(FOLDER / "parts.jsonl", "a", encoding="utf-8") as file:
        file.write('{"number": 8, "sett')  # as a kill leaves it
    both, _ = search("parts", "--trials", "24")
    expect(both[:8] == first and len(set(keys(both))) == 24, "a candidate was replayed again")
    expect(by_number(both) == by_number(rows_of("whole")), "another search than without the interruption")


def test_interrupted():
    path = FOLDER / "long.jsonl"
    process = start(["tune", FOLDER / "tclab.json", "--results", path, "--trials", "5000", "--output", FOLDER / "never.json"],
                    cwd=FOLDER)
    while process.poll() is None and len(rows_of("long")) < 10:
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    code, out, err = finish(process)
    expect(code == TRY_AGAIN, f"ended with {code}: {err}")
    expect_line(out, f"{len(rows_of('long'))} candidates")
    expect(not (FOLDER / "never.json").exists(), "written")


def test_other_variables():
    rows, _ = search("others", "--trials", "8", "--variables", "tclab.mCp", "--also", "step,algorithm")
    expect(all({"adjust tclab.mCp", "step", "algorithm"} <= set(row["settings"]) for row in rows), f"{rows[0]}")
    document = tune.read_config(FOLDER / "tclab.json")
    for values in (row["settings"] for row in rows):
        made = tune.settings_of(document, {"tclab.mCp": {"step": 0.6}}, {"tclab.Ta": 296}, values)
        adjusted, constants = made["synchronise"]["adjust"], made["components"]["tclab"]["set"]
        expect(("mCp" in constants) != ("tclab.mCp" in adjusted), "a constant that is adjusted, or neither")


def test_a_replay_that_dies_is_repeated_once():
    folder = scratch()
    worker = tune.Worker(folder, 600)
    worker.program = folder / "program"
    for ending, calls in (("kill -9 $$", 2), ("exit 70", 2), ("exit 65", 1), ("echo '{}'", 1)):
        worker.program.write_text(f"#!/bin/sh\necho call >>{folder}/calls\n{ending}\n", encoding="utf-8")
        worker.program.chmod(0o700)
        (folder / "calls").write_text("", encoding="utf-8")
        summary, _ = worker.replay({}, [])
        expect((summary is None) == (ending != "echo '{}'"), ending)
        found = len((folder / "calls").read_text(encoding="utf-8").splitlines())
        expect(found == calls, f"{ending}: {found} calls, wanted {calls}")
    worker.limit_s = 0.1
    worker.program.write_text("#!/bin/sh\nsleep 600\n", encoding="utf-8")
    expect(worker.replay({}, [])[0] is None, "a replay without an end has a result")


def test_usage():
    own = FOLDER / "tclab.json"
    for args in ([], [own, "--trials", "0"], [own, "--also", "x"], [own, "--seed", "x"], [own, own], [own, "--nonsense"],
                 [own, "--output", own], [own, "--variables", "tclab.nothing"]):
        code, out, err = run(["tune", *args], cwd=FOLDER)
        expect(code == BAD_USAGE and err.startswith("twinlock: error: "), f"{args}: {code}, {out}{err}")
    code, _, err = run(["tune", own, "--results", FOLDER / "whole.jsonl", "--seed", "2"], cwd=FOLDER)
    expect(code == BAD_USAGE, f"results of another search: {code}")
    expect_line(err, "whole.jsonl|--results")
    (FOLDER / "free.json").write_text('{"twinlock": 1}', encoding="utf-8")
    for name, what in (("nowhere.json", "nowhere.json"), ("free.json", "synchronise.adjust")):
        code, _, err = run(["tune", FOLDER / name], cwd=FOLDER)
        expect(code == BAD_DATA, f"{name}: {code}")
        expect_line(err, what)


if __name__ == "__main__":
    main()
