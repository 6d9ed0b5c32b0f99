#!/usr/bin/env python3
"""twinlock push: what it tells people and programs, whom it talks to, and how it ends."""
import hashlib
import json
import os
import signal
import socket
import ssl
import subprocess
import threading
from pathlib import Path

from pushed import expect_push, push, pushing
from served import FIRST, Box, begin, said_by, wait_for
from twinlock_test import PROGRAM, expect, main, scratch

SECOND = b'{"synchronise": {"margin": 2}}\n'


def test_a_change_is_told_step_by_step():
    with Box() as box:
        found = push(box, "--why", "the seal & more", "--wait", "--probation", "60", "--require-lock", "95", config=SECOND)
        lines = found[1].splitlines()
        expect(found[0] == 0 and lines == [
            "authorise", "validate", "  synchronise.match[0].tolerance: 1 → 2 (in place)", "try: motor, load", "activate: in place",
            "probation", "kept", "done (version 2 is active): it is kept"], f"{found}")
        asked = box.requests()[-1]
        expect(asked["why"] == "the seal & more" and asked["flags"] == "8" and asked["probation"] == "60" and asked["lock"] == "95",
               f"{asked}")


def test_exit_codes():
    with Box() as box:
        expect_push(push(box, config=SECOND), 0, "done (version 2 is active)")
        expect_push(push(box, config=SECOND), 0, "same")
        found = push(box, config=b'{"invalid": 1}')
        expect_push(found, 65, "new.json:7: synchronise.margin: found -1", "new.json:9: ", "\\x1B[2J", "invalid")
        expect("\x1b" not in found[1], "a terminal could be commanded")
        expect_push(push(box, config=b'{"restart": 1}'), 2, "needs a restart")
        expect_push(push(box, "--restart", config=b'{"restart": 1}'), 0)
        expect_push(push(box, config=b'{"returns": 1}'), 0)
        expect_push(push(box, "--wait", config=b'{"returns": 2}'), 3, "returned", "undone", "71 %")
        expect_push(push(box, config=b'{"busy": 1}'), 75, "busy")
        expect_push(push(box, config=b'{"fails": 1}'), 75, "failed")
        expect_push(push(box, config=b'{"dies": 1}'), 69, "hung up")
        expect_push(push(box, config=b'{"commission": 1}'), 77, "forbidden", "commission")
        expect_push(push(box, config=SECOND, role="read"), 77, "this token may read")
        expect_push(push(box, "--state", role="0" * 64), 77, "no such token")
        expect_push(push(box, "--state", plant="pump"), 69, "no plant pump")


def test_what_it_can_ask():
    with Box() as box:
        expect_push(push(box, config=SECOND), 0)
        expect_push(push(box, "--state", role="read"), 0, "motor: locked, version 2 (", "locked, \\x1B[31mred")
        found = push(box, "--versions", role="read")
        lines = found[1].splitlines()
        expect(found[0] == 0 and len(lines) == 2 and lines[0].startswith("*    2") and "retune" in lines[0] and lines[1].startswith("     1"),
               f"{found}")
        expect(push(box, "--get", role="read") == (0, SECOND.decode(), ""), "another text")
        expect(push(box, "--get", "--version", "1", role="read") == (0, FIRST.decode(), ""), "another text")
        expect_push(push(box, "--get", "--version", "7", role="read"), 69, "no such version")
        expect_push(push(box, "--rollback"), 0, "it is active")
        expect(push(box, "--get")[1] == FIRST.decode(), "not returned")
        expect_push(push(box, "--rollback", "--version", "2", "--why", "it was better"), 0)
        expect(push(box, "--get")[1] == SECOND.decode(), "not returned")
        expect_push(push(box, "--confirm"), 0, "it is kept")
        expect_push(push(box, "--confirm"), 69, "nothing is on probation")
        expect_push(push(box, "--cancel"), 69, "nothing is under way")
        expect_push(push(box, "--activate", "--shadow", "20", config=b'{"other": 1}'), 0)
        expect(box.requests()[-1]["shadow"] == "20", f"{box.requests()[-1]}")
        expect_push(push(box, "--cancel"), 0, "it is active")
        expect(push(box, "--get")[1] == SECOND.decode(), "not cancelled")
        expect_push(push(box, "--until-confirmed", config=FIRST), 0)
        expect(box.requests()[-1]["flags"] == "4", f"{box.requests()[-1]}")
        expect_push(push(box, "--confirm"), 0, "it is kept")
        expect_push(push(box, "--accept-worse", config=SECOND), 0)
        expect(box.requests()[-1]["flags"] == "32", f"{box.requests()[-1]}")


def test_a_check_changes_nothing():
    with Box() as box:
        expect_push(push(box, "--no-activate", config=SECOND), 0, "it is good")
        expect(push(box, "--get")[1] == FIRST.decode(), "it is active")


def test_json_is_what_the_box_says():
    with Box() as box:
        code, out, _ = push(box, "--json", config=SECOND)
        lines = [json.loads(line) for line in out.splitlines()]
        expect(code == 0 and lines[-1]["reply"] == "end" and lines[-1]["result"] == "done", f"{lines}")
        code, out, _ = push(box, "--json", config=b'{"invalid": 2}')
        expect(code == 65 and [json.loads(line)["reply"] for line in out.splitlines()][-3:] == ["problem", "problem", "end"], out)


def test_whoever_was_quicker_is_not_overwritten():
    with Box() as box:
        mine = scratch() / "base.json"
        mine.write_bytes(FIRST)
        expect_push(push(box, "--base", mine, config=SECOND), 0)
        expect_push(push(box, "--base", mine, config=b"{}"), 75, "changed")
        expect(push(box, "--get")[1] == SECOND.decode(), "overwritten")


def test_only_the_box_that_is_meant():
    with Box() as box:
        expect_push(push(box, "--state", pin=None), 77, box.pin, "twinlock serve --fingerprint")
        other = "sha256//" + "A" * 43 + "="
        expect_push(push(box, "--state", pin=other), 77, "is not the box that you mean", box.pin, other)
        fingerprint = hashlib.sha256(subprocess.run(
            ["openssl", "x509", "-outform", "DER", "-in", box.folder / "state/server.pem"], capture_output=True, check=True).stdout)
        text = fingerprint.hexdigest()
        expect_push(push(box, "--state", pin=text), 0)
        expect_push(push(box, "--state", pin=":".join(text[i:i + 2] for i in range(0, 64, 2)).upper()), 0)
        for word in text[:-1], "sha256//short", "none":
            expect_push(push(box, "--state", pin=word), 2, "is no pin")
        expect(len(box.requests()) == 2, f"something was sent: {box.requests()}")
        expect("wrong token" not in box.log(), "a token was sent")


def test_the_token_comes_from_a_file_or_the_environment():
    with Box() as box:
        path = scratch() / "token"
        path.write_text(box.tokens["read"] + "\n", encoding="ascii")
        bare = {name: value for name, value in os.environ.items() if name != "TWINLOCK_TOKEN"}
        expect_push(push(box, "--state", "--token-file", path, env=bare), 0)
        expect_push(push(box, "--state", env=bare), 2, "a token is missing")
        path.write_text("\x1b[2J\n", encoding="ascii")
        expect_push(push(box, "--state", "--token-file", path, env=bare), 2, "no token")
        expect_push(push(box, "--state", "--token-file", path / "none", env=bare), 65, "cannot be read")


def test_nobody_there():
    with Box() as box:
        pass
    expect_push(push(box, "--state"), 69, str(box.port))


def test_a_box_that_answers_nonsense():
    """Another server, with the same key: lines that are none, a line without an end, and an end of the connection."""
    with Box() as box:
        pem = box.folder / "state/server.pem"
        for said, code, word in ((b"hello\n", 75, "none of twinlock's answers"), (100000 * b"x", 75, "none of twinlock's answers"),
                                 (b'{"reply":"end","result":"do', 75, "did not say how it ended"),
                                 (b'{"reply":"news"}\n{"reply":"end","result":"done","version":1,"hash":"","text":""}\n', 0, "done")):
            answers(pem, said, lambda port, code=code, word=word: expect_push(
                push(Other(box, port), "--base", pem, config=SECOND), code, word))


class Other:
    """A server that is not ours at another port."""

    def __init__(self, box, port):
        self.port, self.pin, self.tokens = port, box.pin, box.tokens


def answers(pem, body, use):
    """Calls `use(port)` while a server answers whatever comes with `body`."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(pem)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        def serve():
            for _ in range(2):  # the first one comes to look at the certificate
                connection = listener.accept()[0]
                try:
                    with context.wrap_socket(connection, server_side=True) as stream:
                        if stream.recv(65536):
                            stream.sendall(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n" + body)
                            stream.unwrap()
                except OSError:
                    pass
        thread = threading.Thread(target=serve)
        thread.start()
        use(listener.getsockname()[1])
        thread.join(10)


def test_steps_are_told_while_they_run():
    with Box() as box:
        path = scratch() / "new.json"
        path.write_bytes(b'{"waits": 1}')
        process = begin([PROGRAM, "push", path, f"https://127.0.0.1:{box.port}/motor", "--pin", box.pin, "--wait"],
                        env={**os.environ, "TWINLOCK_TOKEN": box.tokens["retune"]})
        wait_for(lambda: "probation" in said_by(process), "the probation")
        expect(process.poll() is None, "it has ended")
        expect(process.wait(20) == 0 and "kept" in said_by(process), said_by(process))


def test_over_a_restart():
    """Who waits hears what came of it, although the answer has ended with the run."""
    with Box() as box:
        found = push(box, "--wait", config=b'{"anew": 1}')
        expect_push(found, 0, "begins anew", "activate: the run is waited for, for 60 s at most", "probation: the run is there again", "kept: in lock", "done (version 2 is active)")
        found = push(box, "--wait", config=b'{"anew": "returns"}')
        expect_push(found, 3, "returned: the lock was lost", "undone (version 2 is active): the lock was lost")
        expect_push(push(box, config=b'{"anew": 2}'), 0, "done (version 4 is active)")


def test_a_server_that_dies():
    """As if nobody was there, and what may go on is said."""
    with Box() as box, pushing(box, "--wait", config=b'{"waits": 2}') as process:
        expect("authorise" in process.stdout.readline(), "no step")
        box.process.kill()
        _, err = process.communicate(timeout=20)
        expect(process.returncode == 69 and "it goes on there" in err, f"{process.returncode} {err}")
        box.process.wait()
        box.start()


def test_interrupted():
    """Ctrl-C ends who looks on, and not the change: that is said."""
    with Box() as box, pushing(box, "--wait", config=b'{"waits": 2}') as process:
        expect("authorise" in process.stdout.readline(), "no step")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
        expect(process.returncode == -signal.SIGINT and "it goes on there" in err and "--cancel" in err, f"{process.returncode} {err}")


def test_wrong_usage():
    with Box() as box:
        for words in (["--state", "--versions"], [], ["--version", "1", "--state"], ["--rollback", "--version", "0"],
                      ["--state", "--probation", "x"], ["--state", "--require-lock", "101"], ["--states"],
                      ["--state", "--cancel"], ["--versions", "--wait"], ["--confirm", "--probation", "5"], ["--rollback", "--no-activate"], ["--get", "--why", "x"],
                      ["--state", "--shadow", "3601"], ["--state", "--activate", "--no-activate"], ["--sta", "x", "y"]):
            expect_push(push(box, *words), 2, "usage: ")
        for url in ("https://127.0.0.1", f"http://127.0.0.1:{box.port}/motor", f"https://127.0.0.1:{box.port}/a/b", "motor",
                    f"https://127.0.0.1:{box.port}/motor?x=1"):
            done = subprocess.run([PROGRAM, "push", "--state", url], capture_output=True, encoding="utf-8", check=False,
                                  env={**os.environ, "TWINLOCK_TOKEN": 64 * "0"})
            expect(done.returncode == 2 and "https://192.0.2.7:8443/motor" in done.stderr, f"{url}: {done.returncode} {done.stderr}")
        empty = push(box, config=b"")
        expect_push(empty, 65, "found nothing")
        expect_push(push(box, config=262145 * b"x"), 65, "found more")


def test_the_programs_are_found_beside_twinlock():
    """And if they are not there, that is said."""
    bare = scratch() / "twinlock"
    os.link(PROGRAM, bare) if Path(PROGRAM).stat().st_dev == bare.parent.stat().st_dev else bare.write_bytes(Path(PROGRAM).read_bytes())
    bare.chmod(0o755)
    for verb in ("serve", "push", "token"):
        done = subprocess.run([bare, verb, "--help"], capture_output=True, encoding="utf-8", check=False)
        expect(done.returncode == 2 and "install the package twinlock-serve" in done.stderr, f"{verb}: {done}")
        for words in ([verb, "--help"], ["help", verb]):
            done = subprocess.run([PROGRAM, *words], capture_output=True, encoding="utf-8", check=False)
            expect(done.returncode == 0 and done.stdout.startswith(f"usage: twinlock {verb} "), f"{words}: {done}")


main()
