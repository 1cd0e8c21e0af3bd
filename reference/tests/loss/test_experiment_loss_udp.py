"""Packet loss over real sockets: decisions and counts, and no leftovers."""

from __future__ import annotations

import socket
from functools import partial
from typing import Any

import pytest

from automcm.links import udp_link
from automcm.links.udp_link import bind
from automcm_evaluation.loss import loss_udp
from automcm_evaluation.loss.loss_udp import over_udp
from automcm_simulation.radio import relay
from automcm_spec.vocabulary.parameters import Parameters


class Sockets:
    """Every socket that is opened."""

    def __init__(self) -> None:
        self.opened: list[socket.socket] = []

    def bind(self, *args: Any, **more: Any) -> socket.socket:
        self.opened.append(sock := bind(*args, **more))
        return sock

    @property
    def open(self) -> int:
        return sum(sock.fileno() != -1 for sock in self.opened)


@pytest.fixture
def sockets(monkeypatch: pytest.MonkeyPatch) -> Sockets:
    made = Sockets()
    for module in (udp_link, relay):
        monkeypatch.setattr(module, "bind", made.bind)
    return made


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A message that is sent once has a second for its way, however busy the host."""
    monkeypatch.setattr(loss_udp, "Parameters", partial(Parameters, t_resend=1000))


@pytest.mark.usefixtures("patient")
def test_without_loss_all_agree_though_nothing_is_sent_again(sockets: Sockets) -> None:
    got = over_udp(0, 0.0, 3, 1)
    assert (got["trials"], got["agreed"], got["undecided"]) == (3, 3, 0)
    once = dict.fromkeys(("Advertisement", "Intention", "Prescription", "Acceptance"), 3)
    assert got["sent"].pop("CAM") > 0
    assert got["sent"] == once | {"Ack": 9}
    times = got["signal_to_agreement_ms"]
    assert len(times) == 3 and times == sorted(times)
    assert min(times) >= 1000 + 2 * loss_udp.THINK_MS  # t_advertise, choosing, verifying
    assert (len(sockets.opened), sockets.open) == (9, 0)


def test_with_all_lost_none_agrees(sockets: Sockets) -> None:
    got = over_udp(300, 1.0, 3, 1)
    assert (got["agreed"], got["undecided"]) == (0, 0)
    assert got["signal_to_agreement_ms"] == []
    assert set(got["sent"]) == {"Advertisement", "CAM"}
    assert got["sent"]["Advertisement"] > 3
    assert sockets.open == 0


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_one_that_acts_alone_has_not_agreed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The receiver has accepted, but its prescriber cannot know."""
    passed = relay.SimulatedLink.send

    def send(self: Any, data: bytes, to: int, tx: str) -> None:
        if b'"Acceptance"' not in data:
            passed(self, data, to, tx)

    monkeypatch.setattr(relay.SimulatedLink, "send", send)
    got = over_udp(0, 0.0, 1, 1)
    assert (got["agreed"], got["undecided"]) == (0, 0)
    assert got["sent"]["Acceptance"] == 1


def test_what_is_not_decided_in_time_is_left(
    sockets: Sockets, monkeypatch: pytest.MonkeyPatch
) -> None:
    t_timeout = 60_000
    monkeypatch.setattr(loss_udp, "LATE_MS", 200 - Parameters(t_timeout=t_timeout).t_hold)
    got = over_udp(t_timeout, 0.0, 2, 1)
    assert (got["agreed"], got["undecided"], got["signal_to_agreement_ms"]) == (0, 2, [])
    assert (len(sockets.opened), sockets.open) == (6, 0)


def test_the_seed_gives_each_relay_draws_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[float, int]] = []

    def relay_of(**more: Any) -> relay.Relay:
        made.append((more["channel"].loss, more["seed"]))
        return relay.Relay(**more)

    monkeypatch.setattr(loss_udp, "Relay", relay_of)
    for seed in (1, 1, 2):
        over_udp(0, 1.0, 2, seed)
    assert {loss for loss, _ in made} == {1.0}
    assert made[:2] == made[2:4] and len({seed for _, seed in made}) == 4
