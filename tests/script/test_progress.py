#!/usr/bin/env python3
"""script/shared/with_progress keeps the output and the exit code of a command, and prints progress
every few seconds."""
import os
import pty
import subprocess
import time

from twinlock_test import SOURCE, at_most, expect, main, scratch

WITH_PROGRESS = SOURCE / "script" / "shared" / "with_progress"
PATIENCE_S = 5.5  # one second above the limit, for a loaded machine


def start(log, command, stdout=subprocess.PIPE):
    return subprocess.Popen([WITH_PROGRESS, "name", log, "sh", "-c", command], stdin=subprocess.PIPE, stdout=stdout, stderr=subprocess.PIPE)


def test_output_and_exit_code():
    log = scratch() / "log"
    log.write_text("before\n", encoding="utf-8")
    process = start(log, "echo out; echo err >&2; cat; exit 7")
    _, err = process.communicate(b"of the caller", timeout=30)
    expect(process.returncode == 7 and not err, f"{process.returncode}: {err}")
    expect(log.read_text(encoding="utf-8") == "before\nout\nerr\n", log.read_text(encoding="utf-8"))


def test_many_short_commands():
    """Progress appears although each command is short. It shows the printable part of the last line
    of the log."""
    log = scratch() / "log"
    log.write_text("first\n\033[1m[3/5] über " + 100 * "x" + "\r\n\n", encoding="utf-8")
    command = f"for i in 1 2 3 4 5 6; do '{WITH_PROGRESS}' name '{log}' sleep 1.4; done"
    lines, last, worst = [], time.monotonic(), 0.0
    with subprocess.Popen(["sh", "-c", command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, encoding="utf-8") as process:
        for line in process.stdout:
            worst, last = max(worst, time.monotonic() - last), time.monotonic()
            lines.append(line)
    expect(len(lines) >= 2 and process.returncode == 0, f"{lines}")
    at_most(max(worst, time.monotonic() - last), PATIENCE_S, "s of silence")
    for line in lines:
        expect(line.startswith("name: ") and "s: [1m[3/5] ber xxx" in line and len(line) < 80, repr(line))


def test_a_terminal_has_one_line_and_it_goes():
    log = scratch() / "log"
    main_end, terminal = pty.openpty()
    process = start(log, "echo working; sleep 2.5", stdout=terminal)
    os.close(terminal)
    expect(process.wait(timeout=30) == 0, "it failed")
    shown = os.read(main_end, 4096).decode()
    os.close(main_end)
    parts = shown.split("\r\033[K")
    expect(len(parts) >= 4 and parts[0] == "" and parts[-1] == "" and "\n" not in shown, repr(shown))
    expect(all("name: " in part and part.endswith("s: working") for part in parts[1:-1]), repr(shown))


def test_nothing_is_left_behind():
    """If with_progress is killed, no child process keeps its output open."""
    process = start(scratch() / "log", "exec sleep 3")
    time.sleep(0.3)
    process.kill()
    begun = time.monotonic()
    process.stdout.read()
    at_most(time.monotonic() - begun, 2, "s until its output ended")
    process.wait()


def test_usage():
    for arguments, code in ((["--help"], 0), ([], 2), (["name", "log"], 2)):
        done = subprocess.run([WITH_PROGRESS, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        expect(done.returncode == code and b"usage: script/shared/with_progress" in done.stdout, f"{arguments}: {done.returncode}")


main()
