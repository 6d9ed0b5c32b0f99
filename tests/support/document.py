"""Documents whose commands are tested: each block ```console is typed into one shell, and its output is compared."""
import re
import subprocess

from twinlock_test import HUNG_S, FMUS, PROGRAM, SOURCE, scratch

END = "=== end of the command ==="


def commands(page):
    """(command, lines of its output)"""
    for block in re.findall(r"^```console\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
        for command, output in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.M):
            yield command, output.splitlines()


def fits(found, wanted):
    """True if the lines are as wanted: "…" is any text, and as a whole line any lines."""
    pattern = "".join("(?:.*\n)*" if line == "…" else ".*".join(map(re.escape, line.split("…"))) + "\n" for line in wanted)
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in found)) is not None


class Shell:
    """A shell with its own folder and background jobs."""

    def __init__(self):
        self.folder = scratch()
        tools = self.folder / "bin"
        tools.mkdir()
        (tools / "twinlock").symlink_to(PROGRAM)
        environment = {"PATH": f"{tools}:/usr/bin:/bin", "TWINLOCK_FMU_PATH": str(FMUS), "TWINLOCK": str(SOURCE),
                       "examples": str(SOURCE / "config"), "TMPDIR": str(scratch()), "LC_ALL": "C.UTF-8"}
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
