#!/usr/bin/env python3
"""Configurations that are put into a folder (`twinlock inbox`), for a run that goes on: taken when they are complete, once, and never waited for."""
import os
import signal
from contextlib import contextmanager

from live_test import Device, Program, query, wait_until
from retuned import Retuned, events, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA
from twinlock_test import BAD_DATA, expect, main, run, scratch


@contextmanager
def boxed(*, before=None):
    """A run, and an inbox for it: (run, inbox, folder)"""
    folder = scratch() / "inbox"
    folder.mkdir()
    with Device(OMEGA) as device, Retuned(device.port) as live:
        wait_for_run(live, live.database, 1)
        if before:
            before(live, folder)
        with Program("inbox", folder, "--control", live.socket) as inbox:
            yield live, inbox, folder
            if inbox.process.poll() is None:
                inbox.end(signal.SIGTERM)
        end_orderly(live)


def put(folder, name, file):
    """As an SFTP client does: whole under another name first."""
    part = folder / (name + ".part")
    part.write_bytes(file.read_bytes())
    part.rename(folder / name)


def link(folder, name, file):
    """As an SFTP server renames that must not replace anything."""
    part = folder / (name + ".part")
    part.write_bytes(file.read_bytes())
    os.link(part, folder / name)
    part.unlink()


def result(folder, name, text, inbox):
    file = folder / (name + ".result.txt")
    wait_until(lambda: file.exists() and text in file.read_text(encoding="utf-8"), f"{file.name} says \"{text}\"",
               lambda: inbox.log() + (file.read_text(encoding="utf-8") if file.exists() else "no result"), every=0.1)
    expect((folder / (name + ".taken")).exists() and not (folder / name).exists(), f"{os.listdir(folder)}")
    return file.read_text(encoding="utf-8")


def test_a_page_that_grows():
    """Who has put it there sees each step, also beside a shadow that takes a minute; and that nobody goes on writing it, if so."""
    def longer(document):
        document["synchronise"]["horizon"].update(prediction=2)

    with boxed() as (live, inbox, folder):
        put(folder, "motor.json", live.edited(longer))
        text = result(folder, "motor.json", "live: ", inbox)
        expect("authorise   retune" in text and text.endswith("… it goes on; this page grows with it\n"), text)
        expect(live.reload(None, "--rollback")[0] == 0, "not cancelled")
        text = result(folder, "motor.json", "cancelled: by ", inbox)
        expect("it goes on" not in text, text)
        put(folder, "again.json", live.edited(longer))
        result(folder, "again.json", "it goes on", inbox)
        inbox.kill()
        with Program("inbox", folder, "--control", live.socket) as another:
            result(folder, "again.json", "interrupted: ", another)
            expect("cancelled: by " in result(folder, "motor.json", "cancelled", another), "a page that was whole")
            another.end(signal.SIGTERM)


def test_taken():
    """Renamed or linked into place; who, why and by which way are kept; the next one takes the place of the one on probation."""
    with boxed() as (live, inbox, folder):
        put(folder, "motor.json", live.edited(tolerance(0.5)))
        text = result(folder, "motor.json", "probation ", inbox)
        expect("authorise   retune" in text and "(in place)" in text, text)
        link(folder, "again.json", live.edited(tolerance(0.6)))
        result(folder, "again.json", "probation ", inbox)
        expect("took its place" in result(folder, "motor.json", "undone", inbox), "the first one is not told")
        code, out, err = live.reload(None, "--versions")
        expect(code == 0 and ", inbox, in place" in out and "again.json" in out and live.active() == 3, f"{out}{err}")
        code, out, err = live.reload(None, "--confirm")
        expect(code == 0, f"{out}{err}")
        result(folder, "again.json", "version 3 is kept", inbox)
        wait_until(lambda: query(live.database, "SELECT origin FROM tunings") == [("inbox",)] * 2, "the database knows", live.log)


def test_only_retune():
    """What takes more than the right to retune is refused, with an event; so is what is wrong, with all problems."""
    def host(document):
        document["sources"]["inverter"]["modbus_tcp"]["host"] = "192.0.2.1"

    def fmu(document):
        document["components"]["motor"]["fmu"] = "/tmp/other.fmu"

    with boxed() as (live, inbox, folder):
        for name, change in ("host.json", host), ("fmu.json", fmu):
            put(folder, name, live.edited(change))
            result(folder, name, "forbidden: ", inbox)
        put(folder, "wrong.json", live.edited(lambda document: document.update(step_s=0, nothing=1)))
        text = result(folder, "wrong.json", "invalid: ", inbox)
        expect("wrong.json: line " in text and "step_s" in text and "nothing" in text, text)
        expect(live.active() == 1, f"{live.versions()}")
        wait_until(lambda: events(live.database, "was refused") == 3, "the events", live.log)


def test_what_is_no_complete_file():
    """None of these is read, nothing waits for one, and the next good one is taken."""
    with boxed() as (live, inbox, folder):
        good = live.edited(tolerance(0.5))
        secret = scratch() / "secret.json"
        secret.write_bytes(good.read_bytes())
        os.mkfifo(folder / "fifo.part")
        (folder / "fifo.part").rename(folder / "fifo.json")
        (folder / "link.part").symlink_to(secret)
        (folder / "link.part").rename(folder / "link.json")
        (folder / "folder.part").mkdir()
        (folder / "folder.part").rename(folder / "folder.json")
        for name in ".hidden.json", "other.json.part", "motor.tmp", "motor.json~":
            (folder / "x").write_bytes(good.read_bytes())
            (folder / "x").rename(folder / name)
        for number in range(1000):
            (folder / "x").write_bytes(b"{}")
            (folder / "x").rename(folder / "gone.json")
            (folder / "gone.json").unlink(missing_ok=True)
        half = good.read_bytes()
        with (folder / "slow.json").open("wb", buffering=0) as slow:
            slow.write(half[:100])
            put(folder, "big.json", write(b" " * (256 * 1024 + 1)))
            result(folder, "big.json", "1 to 262144 bytes", inbox)
            os.link(secret, folder / "hard.json")
            result(folder, "hard.json", "another name elsewhere", inbox)
            (folder / "taken.json.taken").mkdir()
            put(folder, "taken.json", good)
            inbox.wait_for("taken.json.taken is a folder")
            slow.write(half[100:])
            expect((folder / "slow.json").exists() and live.active() == 1, "a file was taken that is being written")
        expect("rename it" in result(folder, "slow.json", "not taken", inbox), "nobody is told why")
        kept = secret.read_bytes()
        (folder / "motor.json.result.txt").symlink_to(secret)
        put(folder, "motor.json", good)
        result(folder, "motor.json", "probation ", inbox)
        expect(secret.read_bytes() == kept, "a link was written through")
        expect(live.active() == 2, f"{live.versions()}")
        left = set(os.listdir(folder))
        expect({"fifo.json", "link.json", "folder.json", ".hidden.json", "other.json.part", "motor.tmp", "motor.json~"} <= left, f"{left}")


def write(data):
    file = scratch() / "bytes"
    file.write_bytes(data)
    return file


def test_what_is_there_before():
    """Files that came while nobody looked; one that was taken when the inbox was interrupted; very many."""
    def fill(live, folder):
        for number in range(100):
            (folder / f"{number}.json").write_bytes(b"{")
        (folder / "left.json.taken").write_bytes(b"{}")

    with boxed(before=fill) as (live, inbox, folder):
        result(folder, "left.json", "interrupted: ", inbox)
        for number in range(0, 100, 20):
            result(folder, f"{number}.json", "invalid: ", inbox)
        wait_until(lambda: not [name for name in os.listdir(folder) if name.endswith(".json")], "all are taken", inbox.log)
        put(folder, "motor.json", live.edited(tolerance(0.5)))
        result(folder, "motor.json", "probation ", inbox)


def test_no_run():
    """A file waits where it is for a run, which takes it when it is there; an inbox without its folder ends."""
    folder = scratch() / "inbox"
    folder.mkdir()
    with Device(OMEGA) as device:
        with Retuned(device.port) as live:
            wait_for_run(live, live.database, 1)
            end_orderly(live)
        with Program("inbox", folder, "--control", live.socket) as inbox:
            put(folder, "motor.json", live.edited(tolerance(0.5)))
            inbox.wait_for("motor.json waits")
            expect((folder / "motor.json").exists(), "it did not wait")
    expect(run(["inbox", folder / "nowhere"])[0] == BAD_DATA, "there is no such folder")


if __name__ == "__main__":
    main()
