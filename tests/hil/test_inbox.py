#!/usr/bin/env python3
"""The inbox, a folder for configurations of a run: board/debian/inbox sends each file with the
right to retune.

On a box twinlock-inbox@.service starts that script, and users copy files by SFTP.
"""
import os
import pwd
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

from live_test import Device, query, wait_until
from retuned import Retuned, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA
from twinlock_test import FMUS, HUNG_S, PROGRAM, SOURCE, expect, expect_line, has_line, main, scratch

INBOX = SOURCE / "board/debian/inbox"


class Inbox:
    """A folder, and the script that handles its files. On a box the .path unit starts the
    script."""

    def __init__(self, socket):
        self.folder = scratch()
        self.socket = socket
        self.path = f"{Path(PROGRAM).parent}:/usr/bin:/bin"

    def start(self):
        return subprocess.Popen([INBOX, self.socket], cwd=self.folder, env={"PATH": self.path, "TWINLOCK_FMU_PATH": str(FMUS)},
                                stderr=subprocess.PIPE, text=True, start_new_session=True)

    @contextmanager
    def running(self):
        process = self.start()
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
            process.communicate(timeout=HUNG_S)

    def put(self, name, data):
        """Writes the file under another name first, as an SFTP client does."""
        part = self.folder / f"{name}.part"
        part.write_bytes(data)
        part.rename(self.folder / name)

    def said(self, name):
        file = self.folder / f"{name}.result.txt"
        return file.read_text(encoding="utf-8") if file.exists() else ""

    def wait_for(self, name, parts):
        wait_until(lambda: has_line(self.said(name), parts), f"\"{parts}\" of {name}", lambda: f"{self.said(name)}{os.listdir(self.folder)}",
                   every=0.1)
        names = os.listdir(self.folder)
        expect(f"{name}.taken" in names and name not in names, f"{names}")
        return self.said(name)

    def take_all(self):
        """Runs the script until the folder has no more files for it. Returns its standard error."""
        process = self.start()
        return process.communicate(timeout=HUNG_S)[1]


@contextmanager
def boxed():
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        yield live, Inbox(live.socket)
        end_orderly(live)


def test_valid_files():
    """The result file shows each phase. The next file ends the probation before it. Sender and way
    are recorded."""
    with boxed() as (live, inbox):
        inbox.put("motor.json", live.edited(tolerance(0.5)).read_bytes())
        with inbox.running() as process:
            text = inbox.wait_for("motor.json", "probation")
            expect_line(text, "authorise|retune")
            expect_line(text, "synchronise.match.motor.omega.tolerance|0.5|in place")
            inbox.put("-f again.json", live.edited(tolerance(0.6)).read_bytes())
            inbox.wait_for("-f again.json", "probation")
            inbox.wait_for("motor.json", "error|version 3")
            expect(live.reload(None, "--confirm")[0] == 0, "not confirmed")
            inbox.wait_for("-f again.json", "version 3|kept")
            wait_until(lambda: process.poll() == 0, "its end", lambda: f"{os.listdir(inbox.folder)}")
        out = live.reload(None, "--versions")[1]
        expect_line(out, f"-f again.json|{pwd.getpwuid(os.geteuid()).pw_name}")
        expect(live.active() == 3, out)
        wait_until(lambda: query(live.database, "SELECT origin FROM tunings") == [("limited",)] * 2, "the database knows", live.log)


def test_only_retune():
    """Changes that need more rights are forbidden, and an invalid file is rejected with all its
    problems."""
    def unconfined(document):
        document["components"]["motor"]["unconfined"] = True

    def library(document):
        document["components"]["motor"]["libraries"] = ["/tmp/other.so"]

    def host(document):
        document["sources"]["inverter"]["modbus_tcp"]["host"] = "192.0.2.1"

    with boxed() as (live, inbox):
        for change in unconfined, library, host:
            inbox.put(f"{change.__name__}.json", live.edited(change).read_bytes())
        inbox.put("wrong.json", live.edited(lambda document: document.update(step_s=0, nothing=1)).read_bytes())
        complaint = inbox.take_all()
        expect(complaint == "", f"output: {complaint}")
        for change in unconfined, library, host:
            inbox.wait_for(f"{change.__name__}.json", "error|forbidden")
        text = inbox.wait_for("wrong.json", "error|invalid|2 problems")
        expect_line(text, "standard input|line|step_s|0")
        expect_line(text, "standard input|line|nothing")
        expect(live.active() == 1, text)


def test_invalid_files():
    """Each of them is set aside with a reason, and the next valid file is used.

    The script follows no link, neither to read nor to write, and waits for no other end of a FIFO.
    """
    with boxed() as (live, inbox):
        good = live.edited(tolerance(0.5)).read_bytes()
        secret = scratch() / "secret.json"
        secret.write_bytes(good)
        os.mkfifo(inbox.folder / "fifo.json")
        (inbox.folder / "folder.json").mkdir()
        (inbox.folder / "folder.json/within").touch()
        (inbox.folder / "link.json").symlink_to(secret)
        (inbox.folder / "nowhere.json").symlink_to("nowhere")
        inbox.put("big.json", b" " * (256 * 1024 + 1))
        inbox.put("empty.json", b"")
        inbox.put("half.json", good[:-2])
        (inbox.folder / "motor.json.result.txt").symlink_to(secret)
        (inbox.folder / "motor.json.taken").mkdir()
        (inbox.folder / "motor.json.taken/within").touch()
        for name in ".hidden.json", "other.json.part":
            (inbox.folder / name).write_bytes(good)
        inbox.put("motor.json", good)
        with inbox.running():
            inbox.wait_for("motor.json", "probation")
            for name, wanted in (("fifo", "empty"), ("folder", "directory"), ("link", "symbolic links"), ("nowhere", "symbolic links"),
                                 ("big", "large"), ("empty", "empty|262144 bytes"), ("half", "invalid|1 problem")):
                inbox.wait_for(f"{name}.json", wanted)
        expect(secret.read_bytes() == good and live.active() == 2, f"{live.versions()}")
        expect({".hidden.json", "other.json.part"} <= set(os.listdir(inbox.folder)), f"{os.listdir(inbox.folder)}")


def test_a_run_that_is_away():
    """A file stays in the folder until the run starts. A file that cannot be renamed stays, without
    a loop of starts."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        inbox = Inbox(scratch() / "later")
        inbox.put("motor.json", live.edited(tolerance(0.5)).read_bytes())
        with inbox.running() as process:
            time.sleep(2)
            expect(process.poll() is None and os.listdir(inbox.folder) == ["motor.json"], f"{os.listdir(inbox.folder)}")
            inbox.socket.symlink_to(live.socket)
            inbox.wait_for("motor.json", "probation")
        inbox.put("x" * 245 + ".json", b"{}")
        with inbox.running() as process:
            time.sleep(2)
            expect(process.poll() is None, "it ended, so the unit would start it at once")
        end_orderly(live)


if __name__ == "__main__":
    main()
