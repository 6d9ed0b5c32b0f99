#!/usr/bin/env python3
"""The examples of docs/reference: each configuration is valid, each query of the database and each command of a replay runs."""
import json
import re
import shlex
import shutil
import sqlite3

from twinlock_test import SOURCE, edited_config, expect, main, run, run_well, scratch

PAGES = SOURCE / "docs" / "reference"
# Commands that change a running twin, or ask other programs: tests/hil and tests/serve run these.
LIVE = ("twinlock reload", "twinlock run", "twinlock plant", "twinlock probe", "twinlock serve", "twinlock token", "curl ", "systemctl ", "sftp ")


def blocks(page):
    """(heading, language, text) of each block of a page."""
    heading = ""
    for match in re.finditer(r"^#+ ([^\n]+)$|^```(\w*)\n(.*?)^```$", (PAGES / page).read_text(encoding="utf-8"), re.M | re.S):
        if match[1]:
            heading = match[1]
        else:
            yield heading, match[2], match[3]


def sections(page):
    """Headings below the first, with the first line that is no blank below each."""
    text = (PAGES / page).read_text(encoding="utf-8")
    return re.findall(r"^##+ (.*)\n+(.*)$", text, re.M)


def test_each_section_begins_with_an_example():
    for page in sorted(path.name for path in PAGES.glob("*.md")):
        without = [heading for heading, first in sections(page) if not first.startswith("```")]
        expect(not without, f"{page}: no example below {without}")


def test_configurations_are_valid():
    found, wrong = 0, []
    for heading, language, text in blocks("configuration.md"):
        if language == "json":
            found += 1
            code, out, err = run(["check", edited_config("cylinder/lock.json" if "event" in heading else "motor/lock.json", json.loads(text))])
            wrong.append(f"{heading}: check ends with {code}\n{text}{out}{err}") if code != 0 else None
    expect(found >= 20 and not wrong, f"{found} examples\n" + "\n".join(wrong))


def bench():
    """A folder as the commands expect it: config, motor.json, recording.csv, and run.db with replays of it."""
    folder = scratch()
    (folder / "config").symlink_to(SOURCE / "config")
    shutil.copy(SOURCE / "config/motor/recording.csv", folder / "recording.csv")
    config = json.loads((SOURCE / "config/motor/lock.json").read_text(encoding="utf-8"))
    (folder / "motor.json").write_text(json.dumps(config), encoding="utf-8")
    for _ in range(3):  # examples name run 3
        run_well(["replay", folder / "motor.json", "--db", folder / "run.db"])
    return folder


def test_queries_run():
    connection = sqlite3.connect(bench() / "run.db")
    found = 0
    for heading, language, text in blocks("database.md"):
        for statement in text.split(";") if language == "sql" else ():
            if statement.strip():
                found += 1
                rows = connection.execute(statement).fetchall()
                expect(rows or "WHERE" in statement, f"{heading}: no row\n{statement}")
    expect(found >= 3, f"{found} queries")


def test_commands_run():
    folder = bench()
    found = 0
    for page in "configuration.md", "database.md", "files.md":
        for heading, language, text in blocks(page):
            for line in text.splitlines() if language in ("shell", "sh") else ():
                if not line.startswith("twinlock ") or line.startswith(LIVE):
                    expect(line.startswith((*LIVE, "sqlite3 ", "cat ", "ls ")), f"{heading}: what is this? {line}")
                    continue
                found += 1
                words = shlex.split(line.split("#")[0].split(";")[0])[1:]
                code, _, err = run(words, cwd=folder)
                expect(code == 0, f"{heading}: {line}: {code}\n{err}")
    expect(found >= 5, f"{found} commands")


if __name__ == "__main__":
    main()
