#!/usr/bin/env python3
"""docs/retune.md: runs each command in one shell, and compares its output with the page."""
import re
import shutil
import subprocess
from pathlib import Path

from live_test import free_port
from twinlock_test import HUNG_S, FMUS, PROGRAM, SOURCE, Skip, expect, main, scratch

PAGE = SOURCE / "docs/retune.md"
END = "=== end of the command ==="


def commands():
    """(command, lines of its output)"""
    for block in re.findall(r"^```console\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S):
        for command, output in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.M):
            yield command, output.splitlines()


# Beginnings of the commands that need a build with TL_SERVE.
NETWORK = "twinlock token", "twinlock serve", "curl", "sed -n", "pin=", "mkdir -p run", "ln -s", "kill %4"


def page(ports):
    """As commands(), with other ports, because tests run in parallel, and without NETWORK if
    TL_SERVE is off."""
    for command, wanted in commands():
        if command.startswith(NETWORK) and not (Path(PROGRAM).parent / "twinlock-serve").exists():
            continue
        for usual, port in ports.items():
            command = command.replace(f":{usual}", f":{port}")
            wanted = [line.replace(f":{usual}", f":{port}") for line in wanted]
        if command.startswith("sed -e '/\"duration_s\"/d"):
            command = command.replace("live.json >", f"live.json | sed 's/1502/{ports['1502']}/' >")
        yield command, wanted


def fits(line, pattern):
    return re.fullmatch(".*".join(map(re.escape, pattern.split("…"))), line) is not None


class Shell:
    """A shell with its own folder and background jobs."""

    def __init__(self):
        self.folder = scratch()
        tools = self.folder / "bin"
        tools.mkdir()
        (tools / "twinlock").symlink_to(PROGRAM)
        environment = {"PATH": f"{tools}:/usr/bin:/bin", "TWINLOCK_FMU_PATH": str(FMUS), "TWINLOCK": str(SOURCE),
                       "TMPDIR": str(scratch()), "LC_ALL": "C.UTF-8"}
        self.process = subprocess.Popen(["bash", "-m"], cwd=self.folder, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True)
        self.type(":")  # skips bash's warning about a missing terminal

    def type(self, command):
        self.process.stdin.write(f"{command}\necho '{END}'\n")
        self.process.stdin.flush()
        lines = []
        while (line := self.process.stdout.readline().rstrip("\n")) != END:
            lines.append(line)
        return lines

    def close(self):
        self.process.stdin.write("kill $(jobs -p) 2>/dev/null; wait\n")
        self.process.communicate(timeout=HUNG_S)


def said(folder):
    return "".join(path.read_text(encoding="utf-8") for path in (Path(folder) / "plant.log", Path(folder) / "run.log") if path.exists())


def test_the_page():
    if not shutil.which("curl", path="/usr/bin:/bin"):
        raise Skip("curl is missing: script/bootstrap")
    ports = {usual: free_port() for usual in ("1502", "8443")}
    shell = Shell()
    try:
        for command, wanted in page(ports):
            found = shell.type(command)
            print(f"    $ {command[:100]}")
            right = len(found) == len(wanted) and all(map(fits, found, wanted))
            expect(right, f"$ {command}\n" + "\n".join(found) + "\n--- the page says:\n" + "\n".join(wanted) + "\n" + said(shell.folder))
    finally:
        shell.close()


if __name__ == "__main__":
    main()
