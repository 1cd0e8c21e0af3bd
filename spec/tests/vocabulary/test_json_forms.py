"""Values of the compiled station as JSON, and back."""

from __future__ import annotations

import json

import pytest

from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Cam, Entry, Expire, Message, OpenStation


def test_what_is_read_is_written_again(one_peer: oracle.Oracle) -> None:
    file = json.loads(oracle.content(oracle_generation.ONE_PEER.path))
    for name in ("states", "inputs", "marks", "effects"):
        values = getattr(one_peer, name)
        assert canonical(values) == canonical(json_forms.to_json(values)) == canonical(file[name])


def test_the_classes() -> None:
    entry = ["Fin", 2, [1, 1], 1, False]
    assert json_forms.input_of(["expire", ["giveup", entry]]) == Expire(
        "expire", ("giveup", Entry("Fin", 2, (1, 1), 1, False))
    )
    assert json_forms.timer(["forget", 7]) == ("forget", 7)
    cam = json_forms.input_of(["cam", 3, [[1, 1]], True])
    assert isinstance(cam, Cam) and cam.marks == {(1, 1)}
    message = ["Ack", 2, 1, [1, 1], 0, 0, False, "none", ["Fin", 1]]
    assert isinstance(json_forms.message(message), Message)
    assert json_forms.message(message).of == ("Fin", 1)


def test_what_has_another_form_is_refused() -> None:
    with pytest.raises(KeyError):
        json_forms.input_of(["telepathy"])
    with pytest.raises(ValueError, match="zip"):
        json_forms.message(["Ack", 2])


def test_the_alphabet_on_other_ids() -> None:
    constants = oracle_generation.ONE_PEER.constants | {"Peers": [815, 4711]}
    station = json_forms.open_station(constants | {"Me": 99, "Stranger": 100})
    of_peer = {i.message.src for i in station.alphabet if i.kind == "receive"}
    assert of_peer == {815, 4711, 99}
    assert all(station.offered(station.initial, i) for i in station.alphabet if i.kind == "cam")


def test_each_peer_may_have_its_own_sessions() -> None:
    class OfLog(OpenStation):
        def peer_ids(self, p: int) -> frozenset[tuple[int, int]]:
            return frozenset({(p, p + 1)})

    station = OfLog(3, 32, 64, 64, frozenset({815, 4711}), frozenset({3}), frozenset(), me=99)
    assert station.sessions == {(99, 3), (815, 816), (4711, 4712), (9, 1)}
    prescribed = {
        i.message.session
        for i in station.alphabet
        if i.kind == "receive" and i.message.type == "Prescription" and i.message.proposal == 2
    }
    assert prescribed == {(815, 816), (4711, 4712)}
