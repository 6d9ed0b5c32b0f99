"""Attacks on twinlock-serve, with or without a token. Each is a context; meanwhile an honest client
at another address sends requests."""
import contextlib
import socket
import ssl
import threading
import time

from served import MOTOR
from twinlock_test import expect

HONEST = "127.0.0.2"
MANY = 1000


def _connect(box, address):
    line = socket.socket()
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.bind((address, 0))
    line.settimeout(5)
    line.connect(("127.0.0.1", box.port))
    return line


def _context():
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def _hello():
    """The first message of a TLS handshake."""
    outgoing = ssl.MemoryBIO()
    client = _context().wrap_bio(ssl.MemoryBIO(), outgoing)
    try:
        client.do_handshake()
    except ssl.SSLWantReadError:
        pass
    return outgoing.read()


@contextlib.contextmanager
def lines(box, count, begin=lambda line: line, addresses=("127.0.0.1",)):
    """Opens `count` connections and runs `begin` on each. Skips those that the server refuses."""
    held, stop = [], threading.Event()

    def open_all():
        for number in range(count):
            if stop.is_set():
                return
            try:
                held.append(begin(_connect(box, addresses[number % len(addresses)])))
            except OSError:
                pass

    thread = threading.Thread(target=open_all)
    thread.start()
    try:
        yield held
    finally:
        stop.set()
        thread.join()
        for line in held:
            line.close()


def silent(box):
    return lines(box, MANY)


def from_everywhere(box):
    """More addresses than the server accepts connections."""
    return lines(box, MANY, addresses=[f"127.0.1.{i}" for i in range(1, 201)])


def half_handshakes(box):
    hello = _hello()

    def begin(line):
        line.sendall(hello[:100])
        return line
    return lines(box, MANY, begin)


def whole_hellos(box):
    """The server computes an answer for each; no client continues the handshake."""
    hello = _hello()

    def begin(line):
        line.sendall(hello)
        return line
    return lines(box, MANY, begin)


def half_requests(box):
    def begin(line):
        secure = _context().wrap_socket(line)
        secure.sendall(b"GET /api/v1/plants/motor HTTP/1.1\r\nHost: loc")
        return secure
    return lines(box, MANY, begin)


@contextlib.contextmanager
def drips(box, head=b"", count=20, addresses=("127.0.0.1",)):
    """Each connection sends a byte every 0.2 s, and never completes its request."""
    stop = threading.Event()

    def begin(line):
        secure = _context().wrap_socket(line)
        secure.sendall(head)
        return secure
    with lines(box, count, begin, addresses) as held:
        def drip():
            while not stop.wait(0.2):
                for line in list(held):
                    with contextlib.suppress(OSError):
                        line.send(b"G")
        thread = threading.Thread(target=drip)
        thread.start()
        try:
            yield held
        finally:
            stop.set()
            thread.join()


def dripping_bodies(box):
    """Bodies of refused requests, from enough addresses to use all connections."""
    return drips(box, _put(1000000), 64, [f"127.0.1.{i}" for i in range(1, 9)])


def _put(length):
    return f"PUT {MOTOR}/configuration HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n".encode("ascii")


def _ask(box, target, token):
    return (f"GET {target} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n").encode("ascii")


@contextlib.contextmanager
def slow_readers(box, count=20):
    """With a token: each reads its large answer at a byte per second."""
    stop = threading.Event()

    def begin(line):
        secure = _context().wrap_socket(line)
        secure.sendall(_ask(box, f"{MOTOR}/configuration", box.tokens["read"]))
        return secure
    with lines(box, count, begin) as held:
        def read():
            while not stop.wait(1):
                for line in list(held):
                    with contextlib.suppress(OSError):
                        line.recv(1)
        thread = threading.Thread(target=read)
        thread.start()
        try:
            yield held
        finally:
            stop.set()
            thread.join()


@contextlib.contextmanager
def wrong_tokens(box, count=10000, clients=4):
    """Requests at full speed, each client on one connection."""
    stop = threading.Event()
    told = []

    def guess(first):
        connection = box.connect()
        for number in range(first, count, clients):
            if stop.is_set():
                break
            try:
                connection.request("GET", MOTOR, headers={"Authorization": f"Bearer {number:064x}"})
                response = connection.getresponse()
                response.read()
                told.append(response.status)
            except OSError:
                connection.close()
    threads = [threading.Thread(target=guess, args=(first,)) for first in range(clients)]
    for thread in threads:
        thread.start()
    try:
        yield told
        for thread in threads:
            thread.join()
        expect(len(told) >= 0.99 * count and set(told) <= {401, 429} and told.count(401) < 100,
               f"{len(told)} answers: {sorted(set(told))}, {told.count(401)} tokens were looked at")
    finally:
        stop.set()
        for thread in threads:
            thread.join()


@contextlib.contextmanager
def _endless(box, clients, head, more):
    """Each client sends `head`, and then `more` until the server closes the connection."""
    stop = threading.Event()

    def send():
        while not stop.is_set():
            with contextlib.suppress(OSError):
                secure = _context().wrap_socket(_connect(box, "127.0.0.1"))
                secure.sendall(head)
                while not stop.is_set():
                    secure.sendall(more)
                secure.close()
    threads = [threading.Thread(target=send) for _ in range(clients)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def large_bodies(box, clients=4):
    """Without a token: as many bytes as the server reads."""
    return _endless(box, clients, _put(100000000), 65536 * b"x")


def long_heads(box, clients=4):
    """Headers without end."""
    return _endless(box, clients, b"GET / HTTP/1.1\r\n", b"X-Long: " + 1000 * b"x" + b"\r\n")


ATTACKS = (silent, from_everywhere, half_handshakes, whole_hellos, half_requests, drips, dripping_bodies, slow_readers, wrong_tokens,
           large_bodies, long_heads)


def longest_wait(box, attack, seconds=2.0):
    """The longest time in s until an honest client got its answer during the attack. It retries if
    the server refuses its connection."""
    waits = []
    with attack(box):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            begun = time.monotonic()
            while True:
                try:
                    answer = box.ask("GET", MOTOR, "read", address=HONEST)
                    break
                except OSError:
                    expect(time.monotonic() - begun < 30, f"{attack.__name__}: the honest client gets no answer")
            expect(answer.status == 200, f"{attack.__name__}: the honest client gets {answer.status}")
            waits.append(time.monotonic() - begun)
            time.sleep(0.1)
    return max(waits)
