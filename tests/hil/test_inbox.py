#!/usr/bin/env python3
"""Configurations in a folder, as by SFTP, for a run that goes on: what twinlock-inbox@.service starts (board/debian/inbox) sends them with the right to retune."""
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
from twinlock_test import FMUS, HUNG_S, PROGRAM, SOURCE, expect, main, scratch

INBOX = SOURCE / "board/debian/inbox"


class Inbox:
    """A folder, and what its unit starts while a file is there (the .path unit does that on a box)."""

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
        """As an SFTP client does: whole under another name first."""
        part = self.folder / f"{name}.part"
        part.write_bytes(data)
        part.rename(self.folder / name)

    def said(self, name):
        file = self.folder / f"{name}.result.txt"
        return file.read_text(encoding="utf-8") if file.exists() else ""

    def wait_for(self, name, text):
        wait_until(lambda: text in self.said(name), f"\"{text}\" of {name}", lambda: f"{self.said(name)}{os.listdir(self.folder)}", every=0.1)
        names = os.listdir(self.folder)
        expect(f"{name}.taken" in names and name not in names, f"{names}")
        return self.said(name)

    def take_all(self):
        """Until there is nothing to do: its standard error."""
        process = self.start()
        return process.communicate(timeout=HUNG_S)[1]


@contextmanager
def boxed():
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        yield live, Inbox(live.socket)
        end_orderly(live)


def test_taken():
    """Who waits sees each step; the next file ends the probation of the one before; who sent it and by which way is kept."""
    with boxed() as (live, inbox):
        inbox.put("motor.json", live.edited(tolerance(0.5)).read_bytes())
        with inbox.running() as process:
            text = inbox.wait_for("motor.json", "probation ")
            expect("authorise   retune" in text and "(in place)" in text, text)
            inbox.put("-f again.json", live.edited(tolerance(0.6)).read_bytes())
            inbox.wait_for("-f again.json", "probation ")
            inbox.wait_for("motor.json", "undone: version 3 took its place")
            expect(live.reload(None, "--confirm")[0] == 0, "not confirmed")
            inbox.wait_for("-f again.json", "version 3 is kept")
            wait_until(lambda: process.poll() == 0, "its end", lambda: f"{os.listdir(inbox.folder)}")
        out = live.reload(None, "--versions")[1]
        expect(f"-f again.json of {pwd.getpwuid(os.geteuid()).pw_name}" in out and live.active() == 3, out)
        wait_until(lambda: query(live.database, "SELECT origin FROM tunings") == [("limited",)] * 2, "the database knows", live.log)


def test_only_retune():
    """What takes more is refused, though `twinlock reload` on the box may do it; so is what is wrong, with all problems."""
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
        expect(complaint == "", f"it complains: {complaint}")
        for change in unconfined, library, host:
            inbox.wait_for(f"{change.__name__}.json", "forbidden: ")
        text = inbox.wait_for("wrong.json", "invalid: ")
        expect("standard input: line " in text and "step_s" in text and "nothing" in text and live.active() == 1, text)


def test_what_is_no_configuration():
    """Each is put aside with a word why; nothing waits for one, nothing is read or written through a link; the next good one is taken."""
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
            inbox.wait_for("motor.json", "probation ")
            for name, wanted in (("fifo", "is empty"), ("folder", "Is a directory"), ("link", "symbolic link"), ("nowhere", "symbolic link"),
                                 ("big", "is too large"), ("empty", "is empty"), ("half", "invalid: ")):
                inbox.wait_for(f"{name}.json", wanted)
        expect(secret.read_bytes() == good and live.active() == 2, f"{live.versions()}")
        expect({".hidden.json", "other.json.part"} <= set(os.listdir(inbox.folder)), f"{os.listdir(inbox.folder)}")


def test_a_run_that_is_away():
    """A file waits where it is until the run is there. What cannot be renamed is left, and a loop of starts is avoided."""
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        inbox = Inbox(scratch() / "later")
        inbox.put("motor.json", live.edited(tolerance(0.5)).read_bytes())
        with inbox.running() as process:
            time.sleep(2)
            expect(process.poll() is None and os.listdir(inbox.folder) == ["motor.json"], f"{os.listdir(inbox.folder)}")
            inbox.socket.symlink_to(live.socket)
            inbox.wait_for("motor.json", "probation ")
        inbox.put("x" * 245 + ".json", b"{}")
        with inbox.running() as process:
            time.sleep(2)
            expect(process.poll() is None, "it ended, and would be started again at once")
        end_orderly(live)


if __name__ == "__main__":
    main()
