"""An adapter behind a WebSocket: as good as a process, and whatever it does, one clear error."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_stage import REFERENCE, automcm
from websockets.sync.server import ServerConnection
from websockets.sync.server import serve as listening

from automcm.adapters.adapter_lines import Kit, answered
from automcm_conformance.adapter import websocket
from automcm_conformance.adapter.connect import connect
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.websocket import AHEAD, WebSocket

CASE = "AMCM/STA/END/BI-19"
LINE = b'{"cmd":"hello","protocol":1}\n'
STOP = "stop"
LIMIT = 0.3
"""A time limit that the test waits for."""
Does = Callable[[ServerConnection], None]


@contextmanager
def server(does: Does) -> Iterator[str]:
    """Where each connection is handled like this."""
    with listening(does, "127.0.0.1", 0, close_timeout=0.2) as listener:
        thread = threading.Thread(target=listener.serve_forever)
        thread.start()
        host, port = listener.socket.getsockname()
        try:
            yield f"ws://{host}:{port}/adapter"
        finally:
            listener.shutdown()
            thread.join()


@pytest.fixture(scope="module")
def reference() -> Iterator[str]:
    """The address of ``automcm adapter --websocket``."""
    command = [*REFERENCE, "--websocket", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        try:
            yield json.loads(child.stdout.readline())["uri"]
        finally:
            child.terminate()
    assert child.returncode == 0


def echo(connection: ServerConnection) -> None:
    for line in connection:
        if STOP in line:
            return
        connection.send(line)


def failure(
    does: Does, lines: int = 1, limit_s: float = 5, max_line: int = 1 << 20
) -> AdapterError:
    with (
        server(does) as address,
        WebSocket(address, limit_s=limit_s, max_line=max_line) as there,
        pytest.raises(AdapterError) as caught,
    ):
        there.exchange([LINE] * lines)
    return caught.value


def test_lines_come_back_in_order_however_many_are_written() -> None:
    lines = [b'{"n":%d,"more":"%s"}\n' % (n, b"x" * (n % 7 * 20_000)) for n in range(4 * AHEAD)]
    with server(echo) as address, WebSocket(address) as there:
        assert there.exchange(lines) == [line.rstrip() for line in lines]
        assert there.exchange([]) == []
        assert there.stop() is None


def test_an_answer_may_end_in_a_line_feed() -> None:
    def does(connection: ServerConnection) -> None:
        for line in connection:
            connection.send(f"{line}\r\n")

    with server(does) as address, WebSocket(address) as there:
        assert there.exchange([LINE]) == [LINE.rstrip()]


@pytest.mark.slow
def test_no_answer() -> None:
    def does(connection: ServerConnection) -> None:
        connection.send(connection.recv())
        time.sleep(3 * LIMIT)

    error = failure(does, 2, limit_s=LIMIT)
    assert (error.kind, len(error.answers)) == ("hang", 1)
    assert str(error) == "no answer within 0.3 s after 1 of 2 answers"


@pytest.mark.slow
def test_a_server_that_does_not_even_read() -> None:
    def does(connection: ServerConnection) -> None:
        time.sleep(2 * LIMIT)

    long = b'"%s"\n' % (b"x" * 60_000)
    with (
        server(does) as address,
        WebSocket(address, limit_s=LIMIT) as there,
        pytest.raises(AdapterError, match="no answer within") as caught,
    ):
        there.exchange([long] * 100)
    assert caught.value.kind == "hang"


def test_it_closes() -> None:
    error = failure(lambda connection: connection.send(connection.recv()), 3)
    assert (error.kind, len(error.answers)) == ("closed", 1)
    assert str(error).startswith("the adapter closed the connection after 1 of 3 answers: ")


def test_what_was_answered_before_a_close_is_read() -> None:
    closed = threading.Event()

    def does(connection: ServerConnection) -> None:
        connection.send(connection.recv())
        connection.send(connection.recv())
        connection.close()
        closed.set()

    with server(does) as address, WebSocket(address) as there:
        assert there.exchange([LINE]) == [LINE.rstrip()]
        with pytest.raises(AdapterError) as caught:
            there.exchange([LINE] * 10 * AHEAD)
        assert closed.wait(5)
    assert (caught.value.kind, caught.value.answers) == ("closed", [LINE.rstrip()])


def test_the_connection_breaks() -> None:
    error = failure(lambda connection: connection.socket.shutdown(socket.SHUT_RDWR))
    assert error.kind == "closed"


def test_a_binary_answer() -> None:
    def does(connection: ServerConnection) -> None:
        for line in connection:
            connection.send(line.encode())

    error = failure(does)
    assert (error.kind, error.answers) == ("line", [])
    assert str(error) == "the adapter sent a binary message; expected text"


def test_a_text_that_is_no_utf_8() -> None:
    def does(connection: ServerConnection) -> None:
        connection.recv()
        connection.send(b"\xff", text=True)
        connection.recv()

    error = failure(does)
    assert (error.kind, str(error)) == (
        "line",
        "the adapter sent an invalid WebSocket message after 0 of 1 answers",
    )


def test_an_answer_that_is_too_long() -> None:
    error = failure(echo, max_line=10)
    assert (error.kind, str(error)) == ("line", "the adapter sent a message of more than 10 bytes")


def test_answers_that_are_too_long_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket, "TOTAL_FACTOR", 2)
    error = failure(echo, 5, max_line=len(LINE))
    assert (error.kind, len(error.answers)) == ("output", 3)


def test_more_messages_than_lines() -> None:
    def does(connection: ServerConnection) -> None:
        for line in connection:
            connection.send(line)
            connection.send(line)

    with server(does) as address, WebSocket(address) as there:
        with pytest.raises(AdapterError) as caught:
            for _ in range(100):
                there.exchange([LINE])
        assert caught.value.kind == "output"
        with pytest.raises(AdapterError, match="already ended"):
            there.exchange([LINE])


def test_stop() -> None:
    def deaf(connection: ServerConnection) -> None:
        time.sleep(2 * LIMIT)

    def loud(connection: ServerConnection) -> None:
        connection.send(connection.recv())

    def bad(connection: ServerConnection) -> None:
        connection.recv()
        connection.close(1011)

    said = []
    for does in (deaf, loud, bad):
        with server(does) as address, WebSocket(address, limit_s=LIMIT) as there:
            said.append(there.stop() or "")
            assert there.stop() is None
    assert said[0] == "the adapter did not close the connection within 0.3 s of stop"
    assert said[1] == "the adapter sent a message that answers no command"
    assert said[2].startswith("the adapter closed with an error: received 1011")


def test_the_end_of_input_is_a_close() -> None:
    with server(echo) as address, WebSocket(address) as there:
        assert there.stop(b"") is None


@contextmanager
def mute() -> Iterator[str]:
    """A port that is listened on, where nothing answers."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"ws://127.0.0.1:{listener.getsockname()[1]}"


def test_where_nobody_is() -> None:
    with mute() as address:
        pass
    with pytest.raises(AdapterError, match=f"^cannot connect to {address}: ") as caught:
        connect([address], 1)
    assert caught.value.kind == "start"


@pytest.mark.parametrize("address", ["ws://", "ws://127.0.0.1:port", "ws://127.0.0.1:99999"])
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(AdapterError, match="cannot connect to"):
        connect([address], 1)


def test_an_address_has_no_arguments() -> None:
    with pytest.raises(AdapterError, match="takes no arguments"):
        connect(["ws://127.0.0.1:1", "more"], 1)


def test_a_server_that_does_not_answer_the_handshake() -> None:
    with mute() as address, pytest.raises(AdapterError, match=r"no answer within 0\.3 s") as caught:
        connect([address], LIMIT)
    assert caught.value.kind == "start"


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.sync.client", None)
    with pytest.raises(AdapterError, match=r"pip install 'automcm\[ws\]'"):
        connect(["ws://127.0.0.1:1"], 1)


# -- the commands


def test_the_reference_passes_over_a_websocket(reference: str, tmp_path: Path) -> None:
    scenario = "AMCM/SYS/ACT/BV-01"
    done = automcm("conform", "run", CASE, scenario, "--out", tmp_path, "--", reference)
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert [case["verdict"] for case in report["cases"]] == ["PASS", "PASS"]
    assert report["implementation"]["name"] == "automcm reference"
    assert report["problems"] == []


def test_its_adapter_is_found_right(reference: str) -> None:
    done = automcm("conform", "check-adapter", "--json", "-", "--", reference)
    assert done.exit_code == 0, done.output
    assert {finding["level"] for finding in json.loads(done.output)} == {"ok"}


def test_the_reference_says_what_it_does_not_take(reference: str) -> None:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    with connect(reference, proxy=None) as there:
        there.send(b"{}")
        with pytest.raises(ConnectionClosed, match="each line must be a text message"):
            there.recv(timeout=5)
    taken, remote = (
        subprocess.run([*REFERENCE, "--websocket", where], capture_output=True, text=True)
        for where in (reference.removeprefix("ws://"), "192.0.2.1:1")
    )
    assert (taken.returncode, "cannot listen on" in taken.stderr) == (3, True)
    assert (remote.returncode, "not a loopback address" in remote.stderr) == (3, True)


def test_a_run_without_a_server_is_one_line(tmp_path: Path) -> None:
    done = automcm("conform", "run", CASE, "--out", tmp_path, "--", "ws://127.0.0.1:1")
    assert done.exit_code == 3
    assert done.stderr.startswith("conform: cannot connect to ws://127.0.0.1:1: ")


def _breaking(how: Does) -> Does:
    """The reference, which takes this action when the case begins."""

    def does(connection: ServerConnection) -> None:
        kit = Kit()
        for line in connection:
            if '"receive"' in line:
                how(connection)
                return
            answer = answered(kit, line)
            if answer is None:
                return
            connection.send(answer, text=True)

    return does


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("how", "said"),
    [
        (lambda c: time.sleep(2 * LIMIT), "no answer within 0.3 s"),
        (lambda c: None, "the adapter closed the connection"),
        (lambda c: c.send("rubbish"), "not JSON"),
        (lambda c: c.send(b"{}"), "a binary message"),
        (lambda c: c.send("x" * (2 << 20)), "more than 1048576 bytes"),
    ],
    ids=["hangs", "closes", "rubbish", "binary", "too long"],
)
def test_a_server_that_breaks_has_an_error_and_a_report(
    how: Does, said: str, tmp_path: Path
) -> None:
    with server(_breaking(how)) as address:
        arguments = ["conform", "run", CASE, "--out", str(tmp_path), "--limit", str(LIMIT)]
        done = automcm(*arguments, "--", address)
    assert done.exit_code == 3, done.output
    [case] = json.loads((tmp_path / "report.json").read_text())["cases"]
    assert case["verdict"] == "ERROR"
    assert said in case["failures"][0]["what"]
