#!/usr/bin/env python3
"""Completion of verbs, options and files at the end of a line, in a bash without other settings."""
import os
import re

from debian import output_of
from twinlock_test import PROGRAM, SOURCE, expect, main, run_well, scratch

# As bash does it if the user presses Tab at the end of a line.
PRESS = """
set -u
source "$1"
cd "$2"
shift 2
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
function=$(complete -p twinlock | sed 's/.*-F \\([^ ]*\\) .*/\\1/')
"$function" twinlock "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


def offered(*words, folder="."):
    """Completions for the last of `words`, which follow "twinlock"."""
    path = f"{os.path.dirname(PROGRAM)}:{os.environ['PATH']}"
    lines = output_of("bash", "--norc", "-c", PRESS, "bash", SOURCE / "board/debian/twinlock.bash", folder, "twinlock",
                      *words, env={**os.environ, "PATH": path})
    return [line for line in lines.splitlines() if line]


def folder_with(*names):
    folder = scratch()
    for name in names:
        (folder / name).mkdir() if name.endswith("/") else (folder / name).touch()
    return folder


def test_verbs():
    verbs = re.findall(r"^  ([a-z]+) ", run_well(["--help"]), re.M)
    expect(offered("") == [*verbs, "help", "--help", "--version"], f"{offered('')}")
    expect(offered("help", "") == verbs, f"{offered('help', '')}")
    expect(offered("r") == ["replay", "run", "reload"], f"{offered('r')}")
    expect(offered("--v") == ["--version"], f"{offered('--v')}")


def test_options_of_every_verb():
    for verb in re.findall(r"^  ([a-z]+) ", run_well(["--help"]), re.M):
        wanted = re.findall(r"^ +(--[a-z-]+)", run_well([verb, "--help"]), re.M)
        expect(offered(verb, "-") == wanted, f"{verb}: {offered(verb, '-')}, wanted {wanted}")
    found = offered("replay", "x.json", "--re")
    expect(sorted(found) == ["--realtime", "--recording", "--report", "--require-lock"], f"{found}")


def test_configurations_and_databases():
    folder = folder_with("a.json", "b c.json", "a.csv", "a.db", "sub/")
    expect(offered("check", "", folder=folder) == ["a.json", "b c.json", "sub"], f"{offered('check', '', folder=folder)}")
    expect(offered("run", "b", folder=folder) == ["b c.json"], f"{offered('run', 'b', folder=folder)}")
    expect(offered("show", "", folder=folder) == ["a.db", "sub"], f"{offered('show', '', folder=folder)}")


def test_values_of_options():
    folder = folder_with("a.json", "a.csv", "sub/")
    found = offered("replay", "a.json", "--recording", "a", folder=folder)
    expect(found == ["a.csv", "a.json"], f"{found}")
    found = offered("plant", "a.json", "--for", "", folder=folder)
    expect(found == ["a.csv", "a.json", "sub"], f"{found}")
    found = offered("show", "x.db", "--csv", "s")
    expect(found == ["samples", "steps"], f"{found}")
    expect(offered("run", "a.json", "--duration", "", folder=folder) == [], "files for a number")
    expect(offered("show", "x.db", "--run", "", folder=folder) == [], "files for a number or last")
    tables = re.search(r"--csv TABLE .*: (.*)", run_well(["show", "--help"]))[1]
    expect(sorted(re.split(r", | or ", tables)) == offered("show", "x.db", "--csv", ""), f"the help has {tables}")


def test_tokens():
    expect(offered("token", "") == ["add", "list", "revoke"], f"{offered('token', '')}")
    expect(offered("token", "add", "anna", "--role", "r") == ["read", "retune"], "other roles")


def test_without_the_program():
    lines = output_of("bash", "--norc", "-c", PRESS, "bash", SOURCE / "board/debian/twinlock.bash", scratch(), "twinlock",
                      "run", "--", env={"PATH": "/usr/bin:/bin"})
    expect(lines.strip() == "", lines)


main()
