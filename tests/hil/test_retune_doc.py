#!/usr/bin/env python3
"""docs/retune.md: runs each command in one shell, and compares its output with the page."""
import shutil
from pathlib import Path

from document import Shell, commands, fits
from live_test import free_port
from twinlock_test import PROGRAM, SOURCE, Skip, expect, main

PAGE = SOURCE / "docs/retune.md"

# Beginnings of the commands that need a build with TL_SERVE.
NETWORK = "twinlock token", "twinlock serve", "curl", "sed -n", "pin=", "mkdir -p run", "ln -s", "kill %4"


def page(ports):
    """As commands(), with other ports, because tests run in parallel, and without NETWORK if
    TL_SERVE is off."""
    for command, wanted in commands(PAGE):
        if command.startswith(NETWORK) and not (Path(PROGRAM).parent / "twinlock-serve").exists():
            continue
        for usual, port in ports.items():
            command = command.replace(f":{usual}", f":{port}")
            wanted = [line.replace(f":{usual}", f":{port}") for line in wanted]
        if command.startswith("sed -e '/\"duration_s\"/d"):
            command = command.replace("live.json >", f"live.json | sed 's/1502/{ports['1502']}/' >")
        yield command, wanted


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
            expect(fits(found, wanted), f"$ {command}\n" + "\n".join(found) + "\n--- the page says:\n" + "\n".join(wanted) + "\n" + said(shell.folder))
    finally:
        shell.close()


if __name__ == "__main__":
    main()
