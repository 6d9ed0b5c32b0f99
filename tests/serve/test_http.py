#!/usr/bin/env python3
"""HTTP interface of twinlock-serve: statuses, rights, and that no other request reaches a plant."""
import base64
import contextlib
import hashlib
import os
import random
import re
import shutil
import socket
import subprocess
import time
from pathlib import Path

from served import FIRST, MOTOR, SERVE, Box, said_by, tag, wait_for
from twinlock_test import PROGRAM, SANITIZER, Skip, expect, expect_line, has_line, main, scratch

SECOND = b'{"synchronise": {"margin": 2}}\n'
LARGE_BODY = 1024 * 1024  # bytes that the server reads of a refused request's body


def expect_status(answer, status, result=None):
    expect(answer.status == status, f"found {answer.status}, wanted {status}: {answer.body[:300]}")
    if result is not None:
        expect(answer.end["result"] == result, f"found {answer.end}, wanted {result}")


def test_plants_and_their_state():
    with Box(plants=("motor", "belt")) as box:
        answer = box.ask("GET", "/api/v1/plants", "read")
        expect(answer.status == 200 and answer.lines == [{"plants": ["belt", "motor"]}], f"{answer.body}")
        state = box.ask("GET", MOTOR, "read").lines
        expect(len(state) == 1 and state[0]["lock"] == "locked" and state[0]["ticks"] == 4000000000, f"{state}")
        expect(state[0]["line"] == "locked, \\x1B[31mred\\x1B[0m and \\xFF", f"not cleaned: {state[0]['line']!r}")
        expect_status(box.ask("GET", "/api/v1/plants/pump", "read"), 404, "absent")


def test_a_configuration_goes_round():
    with Box() as box:
        answer = box.ask("GET", f"{MOTOR}/configuration", "read")
        expect(answer.status == 200 and answer.body == FIRST and answer.headers["ETag"] == tag(FIRST), f"{answer.body}")
        expect(answer.headers["Twinlock-Version"] == "1", f"{answer.headers}")
        answer = box.put(SECOND, "?why=the%20seal%20is%20new&probation=60&shadow=30&require_lock=95", "retune", answer.headers["ETag"])
        expect_status(answer, 200, "done")
        expect([line.get("step") for line in answer.lines] == ["authorise", "validate", None, "try", "activate", None],
               f"{answer.lines}")
        expect(answer.lines[2]["path"] == "synchronise.match[0].tolerance" and answer.lines[2]["kind"] == "in place",
               f"{answer.lines[2]}")
        asked = box.requests()[-1]
        expect(asked == {"verb": "3", "right": "1", "flags": "0", "probation": "60", "shadow": "30", "lock": "95", "version": "0",
                         "who": "retune", "why": "the seal is new"}, f"{asked}")
        expect(box.ask("GET", f"{MOTOR}/configuration", "read").body == SECOND, "the first one is still active")
        expect_status(box.put(FIRST, match=tag(FIRST)), 412, "changed")
        expect_status(box.put(SECOND, match=tag(SECOND)), 200, "same")


def test_versions_and_rollback():
    with Box() as box:
        expect_status(box.put(SECOND), 200, "done")
        answer = box.ask("GET", f"{MOTOR}/versions", "read")
        found = [(one["version"], one["parent"], one["is_active"]) for one in answer.lines]
        expect(answer.status == 200 and found == [(2, 1, True), (1, 0, False)], f"{found}")
        old = box.ask("GET", f"{MOTOR}/versions/1", "read")
        expect(old.body == FIRST and old.headers["ETag"] == tag(FIRST), f"{old.body}")
        expect_status(box.ask("GET", f"{MOTOR}/versions/9", "read"), 404, "absent")
        expect_status(box.ask("POST", f"{MOTOR}/return?version=1", "retune"), 200, "done")
        expect(box.ask("GET", f"{MOTOR}/configuration").body == FIRST, "not returned")
        expect_status(box.ask("POST", f"{MOTOR}/return?version=9", "retune"), 404, "absent")


def test_refusals_have_their_status():
    with Box() as box:
        answer = box.put(b'{"invalid": 1}')
        expect_status(answer, 422, "invalid")
        problems = [line for line in answer.lines if line["reply"] == "problem"]
        expect([one["line"] for one in problems] == [7, 9] and "\\x1B" in problems[1]["text"], f"{problems}")
        expect_status(box.put(b'{"commission": 1}', role="retune"), 403, "forbidden")
        expect_status(box.put(b'{"commission": 1}', role="commission"), 200, "done")
        expect_status(box.put(b'{"restart": 1}'), 409, "needs a restart")
        expect_status(box.put(b'{"restart": 1}', "?restart=1"), 200, "done")
        expect_status(box.put(b'{"worse": 1}', "?accept_worse=1"), 200, "done")
        expect(box.requests()[-1]["flags"] == "32", f"{box.requests()[-1]}")
        expect_status(box.put(b'{"busy": 1}'), 409, "busy")
        expect_status(box.put(b'{"dies": 1}'), 503, "failed")
        expect_status(box.put(b'{"fails": 1}'), 200, "failed")
        expect_status(box.ask("POST", f"{MOTOR}/return?version=99"), 404, "absent")


def test_a_check_changes_nothing():
    with Box() as box:
        expect_status(box.put(SECOND, "?check=1"), 200, "done")
        expect(box.requests()[-1]["flags"] == "1", f"{box.requests()[-1]}")
        expect(box.ask("GET", f"{MOTOR}/configuration").body == FIRST, "it is active")


def test_steps_are_seen_while_they_run():
    """The head and the first lines arrive before the operation ends."""
    with Box() as box:
        connection = box.connect()
        begun = time.monotonic()
        connection.request("PUT", f"{MOTOR}/configuration?wait=1", body=b'{"waits": 1}',
                           headers={"Authorization": f"Bearer {box.tokens['retune']}", "If-Match": "*"})
        response = connection.getresponse()
        lines = [response.readline() for _ in range(6)]
        early = time.monotonic() - begun
        rest = response.read()
        late = time.monotonic() - begun
        expect(b"probation" in lines[-1] and b'"kept"' in rest and b'"done"' in rest, f"{lines} {rest}")
        expect(early < 1.5 < 1.9 < late, f"the first lines came after {early:.2f} s, the end after {late:.2f} s")


def test_the_end_of_a_probation():
    with Box() as box:
        answer = box.put(b'{"returns": 1}', "?wait=1")
        expect_status(answer, 200, "undone")
        expect(answer.lines[-2]["step"] == "returned" and "71 %" in answer.end["text"], f"{answer.lines[-2:]}")
        expect_status(box.put(SECOND), 200, "done")
        expect_status(box.ask("POST", f"{MOTOR}/confirm", "retune"), 200, "done")
        expect_status(box.ask("POST", f"{MOTOR}/confirm", "retune"), 404, "absent")
        expect_status(box.ask("DELETE", f"{MOTOR}/change", "retune"), 404, "absent")
        expect_status(box.put(FIRST, "?confirm=1"), 200, "done")
        expect(box.requests()[-1]["flags"] == "4", f"{box.requests()[-1]}")
        expect_status(box.ask("DELETE", f"{MOTOR}/change", "retune"), 200, "done")
        expect(box.ask("GET", f"{MOTOR}/configuration").body == SECOND, "the change was not cancelled")


def test_tokens():
    with Box() as box:
        expect_status(box.ask("GET", MOTOR, None), 401, "forbidden")
        expect_status(box.ask("GET", MOTOR, None, Authorization="Basic YTpi"), 401, "forbidden")
        expect_status(box.ask("GET", MOTOR, None, Authorization="Bearer " + 64 * "0"), 401, "forbidden")
        expect_status(box.put(SECOND, role="read"), 403, "forbidden")
        expect_status(box.ask("POST", f"{MOTOR}/confirm", "read"), 403, "forbidden")
        expect(len(box.requests()) == 0, f"a plant was asked: {box.requests()}")
        tokens = (box.folder / "tokens").read_text("ascii")
        expect(oct(os.stat(box.folder / "tokens").st_mode & 0o777) == "0o640", "other people may read the tokens")
        expect(not any(secret in tokens for secret in box.tokens.values()), "a token itself is kept")


def test_tokens_change_while_the_server_runs():
    with Box() as box:
        tokens = ["--tokens", str(box.folder / "tokens")]
        box.tokens["anna"] = box.add_token("anna", "retune")
        expect_status(box.ask("GET", MOTOR, "anna"), 200)
        listed = subprocess.run([SERVE, "token", "list", *tokens], capture_output=True, encoding="utf-8", check=True).stdout
        expect(re.search(r"^anna +retune +\d{4}-", listed, re.M), listed)
        subprocess.run([SERVE, "token", "revoke", "anna", *tokens], check=True)
        expect_status(box.ask("GET", MOTOR, "anna"), 401)
        for words in (["add", "read", "--role", "read"], ["add", "b", "--role", "king"], ["add", "a/b", "--role", "read"],
                      ["add", "b"], ["revoke", "nobody"], ["lists"], []):
            done = subprocess.run([SERVE, "token", *words, *tokens], capture_output=True, check=False)
            expect(done.returncode == 2 and done.stderr, f"{words}: {done.returncode}")
        (box.folder / "tokens").write_text("anna king x y\n", encoding="ascii")
        expect_status(box.ask("GET", MOTOR, "read"), 401)
        wait_for(lambda: has_line(box.log(), f"warning|{box.folder}/tokens|1|SHA256"), "a warning about the file", 5)


def test_invalid_requests():
    with Box() as box:
        put = f"{MOTOR}/configuration"
        for status, method, target, headers in (
                (404, "GET", "/", {}), (404, "GET", "/api/v1/plantsx", {}), (404, "GET", "/api/v1/plants/../x", {}),
                (404, "GET", "/api/v1/plants/.hidden", {}), (404, "GET", "/api/v1/plants/a%2Fb", {}),
                (404, "GET", "/api/v1/plants/" + 64 * "x", {}), (404, "GET", f"{MOTOR}/versions/x", {}),
                (404, "GET", f"{MOTOR}/versions/0", {}), (404, "GET", f"{MOTOR}/else", {}), (405, "DELETE", MOTOR, {}),
                (405, "POST", "/api/v1/plants", {}), (405, "PUT", f"{MOTOR}/versions/1", {}), (400, "GET", f"{MOTOR}?x=1", {}),
                (400, "POST", f"{MOTOR}/return?version=-1", {}), (400, "POST", f"{MOTOR}/return?version=1x", {}),
                (400, "POST", f"{MOTOR}/confirm?why=%1b%5b2J", {}), (400, "POST", f"{MOTOR}/confirm?why=%ff", {}),
                (400, "POST", f"{MOTOR}/confirm?why={300 * 'x'}", {}), (400, "POST", f"{MOTOR}/confirm?why=%00", {}),
                (400, "POST", f"{MOTOR}/confirm?why=%2", {}), (414, "GET", f"{MOTOR}?{2000 * 'x'}", {}),
                (411, "PUT", put, {"If-Match": "*", "Transfer-Encoding": "chunked"}),
                (411, "PUT", put, {"If-Match": "*", "Content-Encoding": "gzip", "Content-Length": "3"}),
                (428, "PUT", put, {"Content-Length": "3"}), (412, "PUT", put, {"If-Match": '"abc"', "Content-Length": "3"}),
                (413, "PUT", put, {"If-Match": "*", "Content-Length": "262145"}),
                (413, "PUT", put, {"If-Match": "*", "Content-Length": "99999999999"}),
                (400, "PUT", put, {"If-Match": "*", "Content-Length": "0"}),
                (400, "PUT", f"{put}?check=2", {"If-Match": "*", "Content-Length": "3"}),
                (400, "PUT", f"{put}?require_lock=nan", {"If-Match": "*", "Content-Length": "3"}),
                (400, "PUT", f"{put}?shadow=3601", {"If-Match": "*", "Content-Length": "3"}),
                (400, "PUT", f"{put}?shadow=", {"If-Match": "*", "Content-Length": "3"}),
                (405, "POST", f"{MOTOR}/change", {}), (400, "DELETE", f"{MOTOR}/change?version=1", {}),
                (400, "PUT", f"{put}?probation=1e9", {"If-Match": "*", "Content-Length": "3"}),
                (400, "PUT", f"{put}?version=1", {"If-Match": "*", "Content-Length": "3"})):
            connection = box.connect()
            connection.putrequest(method, target, skip_accept_encoding=True)
            for name, word in {"Authorization": f"Bearer {box.tokens['commission']}", **headers}.items():
                connection.putheader(name, word)
            size = int(headers.get("Content-Length", 0))
            connection.endheaders(size * b"x" if 0 < size <= LARGE_BODY else None)  # send nothing of a large body
            response = connection.getresponse()
            expect(response.status == status, f"{method} {target} {headers}: {response.status}, wanted {status}: {response.read()}")
            connection.close()
        expect(len(box.requests()) == 0, f"a plant was asked: {box.requests()}")
        expect_status(box.ask("GET", MOTOR), 200)


def statuses_of(box, data):
    """Sends these bytes in one TLS record. Returns the statuses of all answers, and whether the
    server closed the connection."""
    context = box.connect()._context  # pylint: disable=protected-access
    got, is_closed = b"", False
    with socket.create_connection(("127.0.0.1", box.port), 20) as line, context.wrap_socket(line) as secure:
        secure.sendall(data)
        with contextlib.suppress(TimeoutError):
            while not is_closed:
                piece = secure.recv(65536)
                got, is_closed = got + piece, piece == b""
                secure.settimeout(20 if got.count(b"HTTP/1.1 ") < 2 else 0.5)
    return [int(code) for code in re.findall(rb"HTTP/1.1 (\d+)", got)], is_closed


def test_a_malformed_head_is_refused_and_ends_the_connection():
    """A good request follows each head, so that a request smuggled in a body would be answered."""
    with Box() as box:
        host, token = b"Host: localhost\r\n", f"Authorization: Bearer {box.tokens['commission']}\r\n".encode("ascii")
        second = b"GET /api/v1/plants HTTP/1.1\r\n" + host + token + b"\r\n"
        get = f"GET {MOTOR} HTTP/1.1\r\n".encode("ascii")
        put = f"PUT {MOTOR}/configuration HTTP/1.1\r\n".encode("ascii") + host + token + b"If-Match: *\r\n"
        length = b"Content-Length: %d\r\n" % len(second)
        for good in (get + host + token + b"\r\n", get + b"Host:localhost\r\nX:\r\nY: \r\nZ: \t a b\r\nX: 2\r\nCookie: a=b; c\r\n" + token + b"\r\n",
                     put + b"Content-Length: 3\r\n\r\n{}\n", b"\r\n" + get + token + host + b"\r\n"):
            statuses, is_closed = statuses_of(box, good + second)
            expect(statuses == [200, 200] and not is_closed, f"{good}: {statuses}, closed: {is_closed}")
        asked = len(box.requests())
        for bad in (put + b"Content-Length: 3\r\nContent-Length: 3\r\n\r\n{}\n", get + host + token + b"Content-Length: 0\r\n" + length + b"\r\n",
                    get + host + b"Content-Length: 0\r\n" + length + b"\r\n", put + b"Content-Length: 3, 3\r\n\r\n{}\n",
                    put + b"Content-Length: +3\r\n\r\n{}\n", get + host + token + length.replace(b":", b" :") + b"\r\n",
                    get + host + token + length.replace(b" ", b"\r\n ") + b"\r\n", get + host + token + b"Transfer-Encoding : chunked\r\n\r\n",
                    get + host + b"Host: evil.example\r\n" + token + b"\r\n", get + b"host: evil.example\r\n" + host + token + b"\r\n",
                    get + host + token + token + b"\r\n", get + host + token + b"authorization: Bearer 0\r\n\r\n",
                    put + b"If-Match: *\r\nContent-Length: 3\r\n\r\n{}\n",
                    (get + host + token + b"\r\n").replace(b"\r\n", b"\n"), get[:-2] + b"\n" + host + token + b"\r\n",
                    get + b"Host:  localhost\n" + token + b"\r\n", get + host + token + b"\n", get + host + token + b"X: a\rHost: b\r\n\r\n",
                    get + b"Host: localhost\0.evil.example\r\n" + token + b"\r\n", get + b"X\0Y: a\r\n" + host + token + b"\r\n",
                    get + host + token + b"\0X: a\r\n\r\n", get + host + token + b"X: a\r\n b\r\n\r\n",
                    get + b" X: a\r\n" + host + token + b"\r\n", get + b"Host: local\r\n\thost\r\n" + token + b"\r\n",
                    get + host + token + b": a\r\n\r\n", get + host + token + b"X\r\n\r\n", get + host + token + b"X: a\x7f\r\n\r\n",
                    get + host + token + b"X\x01: a\r\n\r\n", get.replace(b" ", b"  ", 1) + host + token + b"\r\n"):
            statuses, is_closed = statuses_of(box, bad + second)
            expect(set(statuses) == {400} and is_closed, f"{bad}: {statuses}, closed: {is_closed}")
        # newer libmicrohttpd closes without an answer
        for bad in (b"GET /api/v1/plants\0/motor HTTP/1.1\r\n", b"GET\0 /api/v1/plants HTTP/1.1\r\n"):
            statuses, is_closed = statuses_of(box, bad + host + token + b"\r\n" + second)
            expect(statuses in ([400], []) and is_closed, f"{bad}: {statuses}, closed: {is_closed}")
        expect(len(box.requests()) == asked, f"a plant was asked: {box.requests()[asked:]}")


def test_the_answer_to_a_refused_body_arrives():
    """A slow client without a token gets its answer, and can send another request on the
    connection."""
    with Box() as box:
        body = 256 * 1024 * b"x"
        for _ in range(20):
            expect_status(box.ask("PUT", f"{MOTOR}/configuration", None, body, If_Match="*"), 401, "forbidden")
        for more in (1, LARGE_BODY - len(body)):
            expect_status(box.put(body + more * b"x"), 413, "bad request")
        connection = box.connect()
        connection.putrequest("PUT", f"{MOTOR}/configuration")
        connection.putheader("Content-Length", str(len(body)))
        connection.endheaders()
        for _ in range(16):
            connection.send(body[:len(body) // 16])
            time.sleep(0.15)
        response = connection.getresponse()
        expect(response.status == 401, f"{response.status}")
        response.read()
        expect_status(box.ask("GET", MOTOR, connection=connection), 200)
        expect_status(box.put(body), 200, "done")


def test_the_host_header():
    with Box("--host", "box.example") as box:
        for status, host in ((200, "localhost"), (200, f"127.0.0.1:{box.port}"), (200, "Box.Example:443"), (200, os.uname().nodename),
                             (421, "evil.example"), (421, "127.0.0.1.evil.example"), (421, "localhost:x"), (421, "[::1"), (421, "")):
            answer = box.ask("GET", MOTOR, Host=host)
            expect(answer.status == status, f"Host {host!r}: {answer.status}, wanted {status}")


def test_wrong_tokens_delay_their_address():
    with Box() as box:
        connection = box.connect()
        statuses = []
        while len(statuses) < 100 and statuses[-20:] != 20 * [429]:
            statuses.append(box.ask("GET", MOTOR, None, connection=connection, Authorization=f"Bearer {len(statuses):064x}").status)
        expect(statuses[:4] == 4 * [401] and set(statuses[4:]) <= {401, 429} and statuses[4:].count(401) <= 4, f"{statuses}")
        answer = box.ask("GET", MOTOR)
        expect_status(answer, 429)
        expect(1 <= int(answer.headers["Retry-After"]) <= 60, f"{answer.headers}")
        expect_status(box.ask("GET", MOTOR, address="127.0.0.2"), 200)
        warnings = [line for line in box.log().splitlines() if has_line(line, "token|127.0.0.1") and "audit:" not in line]
        expect(1 <= len(warnings) <= 6, f"{len(warnings)} warnings about wrong tokens:\n{box.log()}")


def test_a_right_token_resets_no_delay():
    with Box() as box:
        connection = box.connect()
        statuses = []
        for number in range(100):  # a round lasts as long as the delay, at most 64 s
            statuses.append(box.ask("GET", MOTOR, None, connection=connection, Authorization=f"Bearer {number:064x}").status)
            statuses.append(box.ask("GET", MOTOR, "read", connection=connection).status)
            if statuses[-1] == 429:
                break
        expect(statuses[:6] == 3 * [401, 200] and statuses[-1] == 429 and statuses.count(401) < 10, f"{statuses}")


def test_the_audit():
    with Box() as box:
        box.put(SECOND, "?why=a+new+seal", "retune")
        box.put(b'{"invalid": 1}', role="retune")
        box.put(SECOND, role="read")
        box.ask("GET", MOTOR)
        box.ask("POST", f"{MOTOR}/return", "commission")
        wait_for(lambda: box.log().count("audit: ") >= 4, "four entries")
        audit = re.findall(r"audit: (.*)", box.log())
        expect(len(audit) == 4, f"{audit}")
        expect(audit[0] == "token=retune role=retune from=127.0.0.1 verb=change plant=motor result=done version=2 why=a new seal",
               audit[0])
        expect("result=invalid" in audit[1] and "role=read" in audit[2] and "result=forbidden" in audit[2], f"{audit}")
        expect("verb=return" in audit[3] and "result=done version=1" in audit[3], audit[3])


def test_a_silent_plant_does_not_block_others():
    with Box(plants=("motor", "belt")) as box:
        slow = box.connect(timeout=90)
        slow.request("PUT", f"{MOTOR}/configuration", body=b'{"silent": 1}',
                     headers={"Authorization": f"Bearer {box.tokens['retune']}", "If-Match": "*"})
        wait_for(lambda: len(box.requests()) == 1, "the request at the plant")
        for _ in range(20):
            begun = time.monotonic()
            expect_status(box.ask("GET", "/api/v1/plants/belt"), 200)
            expect(time.monotonic() - begun < 5, "it waits for the other plant")
        slow.close()
        wait_for(lambda: has_line(box.log(), "audit:|token=retune|verb=change|plant=motor"), "the audit of the lost client")
        expect(not has_line(box.log(), "audit:|result=done"), box.log())


def test_the_server_has_no_privileges():
    """As the kernel reports them. All other tests show that the server works without them."""
    with Box() as box:
        status = dict(re.findall(r"^(\w+):\t(.*)$", Path(f"/proc/{box.process.pid}/status").read_text("ascii"), re.M))
        expect(status["Seccomp"] == "2" and status["NoNewPrivs"] == "1" and int(status["CapEff"], 16) == 0, f"{status}")
        limits = Path(f"/proc/{box.process.pid}/limits").read_text("ascii")
        expect(SANITIZER or re.search(r"Max data size +67108864 ", limits), limits)


def test_a_plant_ends_and_starts_again():
    with Box() as box:
        plant = box.plants["motor"]
        plant.kill()
        plant.wait()
        expect_status(box.ask("GET", MOTOR), 503, "failed")
        box.start_plant("motor")
        expect_status(box.ask("GET", MOTOR), 200)


def test_the_certificate_stays():
    with Box() as box:
        command = [SERVE, "--fingerprint", "--state", str(box.folder / "state")]
        said = subprocess.run(command, capture_output=True, encoding="utf-8", check=True).stdout
        def openssl(*words, data=None):
            return subprocess.run(["openssl", *words], input=data, capture_output=True, check=True).stdout

        pem = box.folder / "state/server.pem"
        key = openssl("pkey", "-pubin", "-outform", "DER", data=openssl("x509", "-noout", "-pubkey", "-in", pem))
        pin = "sha256//" + base64.b64encode(hashlib.sha256(key).digest()).decode("ascii")
        whole = hashlib.sha256(openssl("x509", "-outform", "DER", "-in", pem)).hexdigest().upper()
        whole = ":".join(whole[i:i + 2] for i in range(0, len(whole), 2))
        expect(said == f"pin          {pin}\ncertificate  {whole}\n" and box.pin == pin, f"{said}, not {pin} and {whole}")
        expect(oct(os.stat(box.folder / "state/server.pem").st_mode & 0o777) == "0o600", "others may read the key")
        text = subprocess.run(["openssl", "x509", "-noout", "-startdate", "-enddate", "-in", str(box.folder / "state/server.pem")],
                              capture_output=True, encoding="ascii", check=True).stdout
        expect("Jan  1 00:00:00 2020" in text and "9999" in text, text)


def test_curl_sends_nothing_to_another_key():
    """docs/retune.md uses -k, so curl does not check the certificate. A wrong pin closes the
    connection before the request."""
    if not shutil.which("curl"):
        raise Skip("curl is missing: script/bootstrap")
    with Box() as box:
        header = scratch() / "header"
        header.write_text(f"Authorization: Bearer {box.tokens['read']}\n", encoding="ascii")
        for pin, code in (box.pin, 0), ("sha256//" + 43 * "A" + "=", 90):
            done = subprocess.run(["curl", "-sS", "-k", "--pinnedpubkey", pin, "-H", f"@{header}", f"https://127.0.0.1:{box.port}{MOTOR}"],
                                  capture_output=True, encoding="utf-8", check=False)
            expect(done.returncode == code and ('"lock":"locked"' in done.stdout) == (code == 0), f"{done}")
        expect(len(box.requests()) == 1, f"a request was sent to another key: {box.requests()}")


def test_the_key_belongs_to_the_owner_of_its_folder():
    """Root prints the fingerprint before the first start of the server, which runs as another user.
    """
    if os.geteuid() != 0:
        raise Skip("only root can have another user's folder")
    folder = scratch()
    os.chown(folder, 12345, 12346)
    subprocess.run([SERVE, "--fingerprint", "--state", folder], capture_output=True, check=True)
    about = os.stat(folder / "server.pem")
    expect((about.st_uid, about.st_gid, about.st_mode & 0o777) == (12345, 12346, 0o600), f"{about}")


def test_damaged_requests():
    """Requests with random bytes replaced, each on its own connection. The server may answer or
    not, and keeps running."""
    chance = random.Random(16)
    with Box() as box:
        whole = (f"PUT {MOTOR}/configuration?check=1 HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {box.tokens['read']}\r\n"
                 "If-Match: *\r\nContent-Length: 3\r\nExpect: 100-continue\r\n\r\n{}\n").encode("ascii")
        context = box.connect()._context  # pylint: disable=protected-access
        for _ in range(120):
            request = bytearray(whole)
            for _ in range(chance.randint(1, 6)):
                place = chance.randrange(len(request))
                request[place:place + chance.randint(0, 3)] = chance.randbytes(chance.randint(0, 3))
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", box.port), 5) as line:
                with context.wrap_socket(line) as secure:
                    secure.sendall(request)
                    secure.settimeout(0.05)
                    secure.recv(4096)
        wait_for(lambda: box.ask("GET", MOTOR, address="127.0.0.2").status == 200, "the server")
        expect(len([one for one in box.requests() if one["verb"] != "0"]) == 0, f"a plant was asked: {box.requests()}")


def test_an_own_certificate():
    folder = scratch()
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=own", "-days", "9"]
    for name in ("own", "other"):
        subprocess.run([*make, "-keyout", folder / f"{name}.key", "-out", folder / f"{name}.pem"], capture_output=True, check=True)
    with Box("--certificate", folder / "own.pem", "--key", folder / "own.key") as box:
        expect_status(box.ask("GET", MOTOR), 200)
    for code, words in ((65, [folder / "own.pem", "--key", folder / "other.key"]), (65, [folder / "own.pem"]),
                        (75, [folder / "none.pem"])):
        done = subprocess.run([SERVE, "--certificate", *words, "--fingerprint"], capture_output=True, encoding="utf-8", check=False)
        expect(done.returncode == code and "twinlock: " in done.stderr, f"{words}: {done.returncode} {done.stderr}")


def test_only_modern_tls():
    with Box() as box:
        for option, ciphers, good in (("-tls1_1", "ALL", False), ("-tls1_2", "ALL", True), ("-tls1_3", "ALL", True), ("-tls1_2", "ECDHE+AESGCM", True),
                                      ("-tls1_2", "ALL:!AESGCM:!AESCCM:!CHACHA20", False), ("-tls1_2", "ECDHE-ECDSA-AES256-SHA", False)):
            done = subprocess.run(["openssl", "s_client", option, "-cipher", f"{ciphers}:@SECLEVEL=0", "-connect", f"127.0.0.1:{box.port}"],
                                  input=b"", capture_output=True, check=False)
            expect(b"Cipher is" in done.stdout, f"{option} {ciphers}: {done.stderr[-400:]}")
            expect((b"Cipher is (NONE)" not in done.stdout) == good, f"{option} {ciphers}: {done.stdout[-400:]}")


def test_the_program_is_found_beside_twinlock():
    """`twinlock serve` and `twinlock token` start twinlock-serve, and name the package if it is
    missing."""
    bare = scratch() / "twinlock"
    shutil.copy(PROGRAM, bare)
    for verb in ("serve", "token"):
        done = subprocess.run([bare, verb, "--help"], capture_output=True, encoding="utf-8", check=False)
        expect(done.returncode == 2, f"{verb}: {done}")
        expect_line(done.stderr, f"error|twinlock {verb}|package|twinlock-serve")
        for words in ([verb, "--help"], ["help", verb]):
            done = subprocess.run([PROGRAM, *words], capture_output=True, encoding="utf-8", check=False)
            expect(done.returncode == 0 and done.stdout.startswith(f"usage: twinlock {verb} "), f"{words}: {done}")


def test_wrong_usage():
    for words in (["--listen", "x"], ["--listen", "127.0.0.1"], ["--listen", "1.2.3.4:70000"], ["--key", "x"], ["--tokenz", "x"],
                  ["word"], ["--host"], 9 * ["--host", "a"]):
        done = subprocess.run([SERVE, "--state", scratch(), *words], capture_output=True, encoding="utf-8", check=False)
        expect(done.returncode == 2 and done.stderr, f"{words}: {done.returncode} {done.stderr}")
    absent = scratch() / "none"
    done = subprocess.run([SERVE, "--state", absent], capture_output=True, encoding="utf-8", check=False)
    expect(done.returncode == 65, f"{done.returncode} {done.stderr}")
    expect_line(done.stderr, f"error|--state|{absent}")


main()
