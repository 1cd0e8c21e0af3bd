"""An adapter that works on one exchange while the kit is busy with another."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator

import pytest

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import ProtocolError

HELLO = {
    "protocol": 1,
    "name": "x",
    "version": "1",
    "issues": "x",
    "features": [],
    "scenarios": ["x"],
    "fixed": {},
}
STATION = f"""
import sys
for line in sys.stdin:
    if "crash" in line:
        sys.exit(3)
    print({json.dumps(json.dumps(HELLO))} if "hello" in line else line.strip(), flush=True)
"""


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    made = Adapter([sys.executable, "-c", STATION], 10)
    yield made
    made.renew()


def test_an_exchange_between_keeps_the_answers_to_what_was_sent(adapter: Adapter) -> None:
    adapter.send([b"one\n", b"two\n"])
    assert adapter.exchange([b"three\n"]) == [b"three"]
    assert adapter.exchange([b"four\n"]) == [b"four"]
    assert adapter.answers() == [b"one", b"two"]
    assert adapter.answers() == []


def test_a_crash_belongs_to_what_was_sent(adapter: Adapter) -> None:
    adapter.send([b"one\n", b"crash\n"])
    assert adapter.exchange([b"two\n"]) == [b"two"]
    with pytest.raises(AdapterError, match="exit code 3") as caught:
        adapter.answers()
    assert caught.value.answers == [b"one"]
    assert adapter.broken == 1


def test_a_fresh_process_knows_nothing_of_what_was_sent(adapter: Adapter) -> None:
    adapter.send([b"one\n"])
    adapter.renew()
    assert adapter.answers() == []
    assert adapter.exchange([b"two\n"]) == [b"two"]


def test_a_process_that_ended_between_two_exchanges_is_started_again(adapter: Adapter) -> None:
    adapter.exchange([b"one\n"])
    assert adapter._process is not None
    adapter._process.kill()
    adapter.send([b'{"cmd":"reset"}\n'])
    assert adapter.answers() == [b'{"cmd":"reset"}']


@pytest.mark.parametrize("waits", ["", "input()", "time.sleep(0.2)"])
def test_a_banner_before_hello_is_shown(waits: str) -> None:
    banner = f"import time; print('Ready', flush=True); {waits}\n"
    with pytest.raises((AdapterError, ProtocolError), match="Ready") as caught:
        Adapter([sys.executable, "-c", banner + STATION], 10)
    assert "standard error" in str(caught.value)
