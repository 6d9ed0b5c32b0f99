#!/usr/bin/env python3
"""script/fmus --twins and --public: our FMUs are exact, a difference is found, and FMUs are fetched from a git repository."""
import hashlib
import json
import shutil
import subprocess
import sys

import keeper_fmu
from twinlock_test import BAD_DATA, BUILD, FMUS, PATIENCE, PROGRAM, SANITIZER, SKIPPED, SOURCE, expect, expect_line, has_line, main, scratch

if SANITIZER:
    print("skipped: the studies use build/host")
    sys.exit(SKIPPED)

PROBE = BUILD / "tests" / "fmu" / "rollback_probe"
STUDY = [sys.executable, SOURCE / "script" / "studies" / "fmus.py", "--probe", PROBE, "--limit", 60 * PATIENCE]

# twinlock with --plain and a wrong value in the table.
LIAR = r"""#!/bin/sh
"{program}" "$@"
code=$?
case "$*" in *--plain*) sed -i '9s/,[^,]*,\([^,]*\)$/,0.125,\1/' twin-plain.table ;; esac
exit $code
"""


def study(*options, program=PROGRAM, steps=40):
    """(exit code, figures, standard error) of script/studies/fmus.py, without its shell script."""
    command = [*STUDY, "--program", program, "--steps", steps, "--json", *options]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=500 * PATIENCE, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else None, done.stderr


def folder_of(*fmus):
    folder = scratch()
    for fmu in fmus:
        shutil.copy(fmu, folder)
    return folder


def git(repository, *arguments):
    return subprocess.run(["git", "-C", repository, "-c", "user.name=test", "-c", "user.email=test@localhost", *arguments], check=True,
                          capture_output=True, text=True).stdout.strip()


def commit(repository, message):
    git(repository, "add", "--all")
    git(repository, "commit", "--quiet", "--message", message)
    return git(repository, "rev-parse", "HEAD")


def hash_of(file):
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_our_fmus():
    """Locked by an input, by a tunable parameter, or free; each with its method."""
    code, figures, err = study("--twins", "--fmus", folder_of(*(FMUS / f"{name}.fmu" for name in ("lag", "motor", "second_order", "belt", "setpoint"))))
    found = {result["fmu"].partition(".")[0]: result for result in figures["fmus"]}
    expect(code == 0 and set(figures["classes"]) == {"exact"} and len(found) == 5, f"{code} {figures}\n{err}")
    for name, result in found.items():
        expect(not any(result["differ"].values()), f"{name}: {result}")
    expect(found["lag"]["method"] in ("memory", "state") and found["lag"]["values"] > 10 and found["lag"]["steps"] >= 30, f"{found['lag']}")
    expect_line(err, "fmus: [5/5]")


def test_a_difference_is_found():
    program = scratch() / "twinlock"
    program.write_text(LIAR.format(program=PROGRAM), encoding="utf-8")
    program.chmod(0o755)
    code, figures, err = study("--twins", "--fmus", folder_of(FMUS / "lag.fmu"), program=program)
    expect(code == 1 and figures["classes"] == {"wrong in silence": 1} and figures["fmus"][0]["differ"] == {"plain": 1, "straight": 0}, f"{code} {figures}\n{err}")


def test_why_one_does_not_run():
    folder = folder_of(keeper_fmu.make())
    (folder / "broken.fmu").write_bytes(b"PK")
    code, figures, _ = study("--twins", "--fmus", folder)
    broken, good = figures["fmus"]
    expect(code == 0 and broken["class"] == "does not run" and broken["why"] and broken["fmpy"] and good["class"] == "exact", f"{code} {figures}")


def test_public_fmus():
    """Fetched at their commits and checked, also from an older commit; the second time nothing is fetched or computed."""
    upstream, cache, listed = scratch() / "upstream", scratch() / "cache", scratch() / "list.txt"
    upstream.mkdir()
    git(upstream, "init", "--quiet")
    (upstream / "some models").mkdir()
    old, new = upstream / "old.fmu", upstream / "some models" / "new one.fmu"
    shutil.copy(FMUS / "lag.fmu", old)
    first = commit(upstream, "old")
    hashes = {"old": hash_of(old)}
    old.unlink()
    shutil.copy(FMUS / "setpoint.fmu", new)
    second = commit(upstream, "new")
    hashes["new"] = hash_of(new)
    url = upstream.as_uri()
    lines = [f"{url} {first} {hashes['old']} old.fmu", f"{url} {second} {hashes['new']} some models/new one.fmu", "# a comment", "",
             f"{url} {second} {hashes['old']} some models/new one.fmu", f"{url} {second} {'0' * 64} missing.fmu", f"{url}-none {second} {'1' * 64} a.fmu"]
    listed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    code, figures, err = study("--public", cache, "--list", listed)
    names = [result["fmu"] for result in figures["fmus"]]
    expect(code == 0 and figures["classes"] == {"exact": 3} and figures["not_fetched"] == 2, f"{code} {figures}\n{err}")
    expect([name.partition("upstream")[2] for name in names] == [f"@{first[:7]}: old.fmu", *2 * [f"@{second[:7]}: some models/new one.fmu"]], f"{names}")
    expect(has_line(err, "new one.fmu|SHA-256") and has_line(err, "missing.fmu|exist") and has_line(err, "upstream-none"), err)
    expect({file.stem for file in (cache / "fmus").iterdir()} == set(hashes.values()), "wrong files")
    shutil.rmtree(upstream)
    listed.write_text("\n".join(lines[:2]) + "\n", encoding="utf-8")
    again, recalled, err = study("--public", cache, "--list", listed, "--only", "old")
    expect(again == 0 and recalled["fmus"] == figures["fmus"][:1] and "file:" not in err, f"{again} {recalled}\n{err}")


def test_bad_arguments():
    listed = scratch() / "list.txt"
    listed.write_text("https://localhost/a abc def a.fmu\n", encoding="utf-8")
    code, _, err = study("--public", scratch() / "cache", "--list", listed)
    expect(code == BAD_DATA and has_line(err, "line 1|SHA-256"), err)
    listed.write_text("", encoding="utf-8")
    code, _, err = study("--public", scratch() / "cache", "--list", listed)
    expect(code == BAD_DATA and has_line(err, "list.txt|fetched"), err)
    code, _, err = study()
    expect(code == 2 and "--public" in err, err)


main()
