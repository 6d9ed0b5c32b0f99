#!/usr/bin/env python3
"""docs/tutorial.md: runs each command in one shell, and compares its output with the page."""
from document import Shell, commands, fits
from live_test import free_port
from twinlock_test import SOURCE, expect, main

PAGE = SOURCE / "docs/tutorial.md"
PORT = "1502"  # of the page; tests run in parallel


def test_the_page():
    shell, port = Shell(), str(free_port())
    try:
        for command, wanted in commands(PAGE):
            found = shell.type(command.replace(f":{PORT}", f":{port}"))
            print(f"    $ {command[:100]}")
            expect(fits(found, wanted), f"$ {command}\n" + "\n".join(found) + "\n--- the page says:\n" + "\n".join(wanted))
    finally:
        shell.close()


if __name__ == "__main__":
    main()
