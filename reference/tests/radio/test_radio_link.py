"""Services over a ``Radio``, and congestion control."""

from __future__ import annotations

import pytest

from automcm.links.clock import VirtualClock
from automcm_evaluation.radio import radio_sessions
from automcm_simulation.radio import radio_link
from automcm_simulation.radio.radio import LARGEST_BYTES
from automcm_simulation.radio.table_radio import TableRadio
from automcm_spec.vocabulary.messages import BROADCAST

PLACES = {1: (0.0, 0.0), 2: (20.0, 0.0), 3: (20.0, 3.5)}


def joined(
    places: dict[int, tuple[float, float]] | None = None, *, control: bool = False
) -> tuple[VirtualClock, radio_link.RadioLinks, list[tuple[int, int, bytes]]]:
    clock = VirtualClock()
    now = PLACES if places is None else places
    links = radio_link.RadioLinks(clock, TableRadio(1), lambda: now, congestion_control=control)
    received: list[tuple[int, int, bytes]] = []
    for station in PLACES:

        def receive(data: bytes, tx: str | None, station: int = station) -> None:
            received.append((clock.now(), station, data))

        links.link(station).open(receive)
    clock.run(0)
    return clock, links, received


def test_a_broadcast_reaches_all_and_a_message_its_addressee() -> None:
    clock, links, received = joined()
    links._send(links_frame(1, BROADCAST, b"all"))
    clock.run(20)
    assert {(station, data) for _, station, data in received} == {(2, b"all"), (3, b"all")}
    received.clear()
    links._send(links_frame(1, 3, b"one"))
    clock.run(40)
    assert [(station, data) for _, station, data in received] == [(3, b"one")]
    assert all(20 < at <= 30 for at, _, _ in received)
    assert links.received == 3 and 1 <= links.longest_ms <= 10


def links_frame(src: int, to: int, data: bytes) -> object:
    from automcm_simulation.radio.radio_link import _Frame

    return _Frame(src, to, "1:1", data)


def test_what_no_frame_holds_and_who_has_no_place_is_lost_and_counted() -> None:
    places = dict(PLACES)
    clock, links, received = joined(places)
    links._send(links_frame(1, BROADCAST, bytes(LARGEST_BYTES + 1)))
    del places[1]
    clock.run(100)
    links._send(links_frame(1, BROADCAST, b"gone"))
    clock.run(200)
    assert links.lost == {"too_long": 1, "no_place": 1} and received == [] and not links.sent


def test_without_a_callback_the_caller_places_the_stations() -> None:
    clock, received = VirtualClock(), []
    links = radio_link.RadioLinks(clock, TableRadio(1))
    for station in PLACES:
        links.link(station).open(lambda data, tx, station=station: received.append(station))  # type: ignore[misc]
    for left_out in (2, 3, 1):
        links.move({station: at for station, at in PLACES.items() if station != left_out})
        links._send(links_frame(1, BROADCAST, b"x"))
        clock.run(clock.now() + 200)
    assert received == [3, 2] and links.lost == {"no_place": 1}


def test_a_station_has_one_link_and_none_after_closing_it() -> None:
    _, links, _ = joined()
    with pytest.raises(ValueError, match="station_id 1 has a link already"):
        links.link(1)
    clock = VirtualClock()
    links = radio_link.RadioLinks(clock, TableRadio(1), lambda: PLACES)
    one = links.link(1)
    one.close()
    one.send(b"late", BROADCAST, "1:1")
    clock.run(50)
    assert not links.sent


def test_a_share_changes_by_limited_steps() -> None:
    falls, grows = radio_link.GateKeeper(), radio_link.GateKeeper()
    before = falls.share * (1 - radio_link.ALPHA)
    falls.update(1.0, 0)
    grows.update(0.0, 0)
    assert falls.share == pytest.approx(before + radio_link.DOWN)
    assert grows.share == pytest.approx(before + radio_link.UP)


def test_the_gate_is_closed_for_at_least_25_ms_and_at_most_a_second() -> None:
    gate = radio_link.GateKeeper()
    gate.sent(1.0, 100)
    assert gate.opens_ms() == 100 + radio_link.SHORTEST_MS
    gate.share = 0.0006
    gate.sent(2000.0, 200)
    assert gate.opens_ms() == 200 + radio_link.LONGEST_MS
    gate.share = 0.01
    gate.sent(500.0, 2000)
    assert gate.opens_ms() == pytest.approx(2050)


@pytest.mark.parametrize("busy", [-0.1, 1.1])
def test_another_busy_ratio_is_refused(busy: float) -> None:
    with pytest.raises(ValueError, match="the channel busy ratio must be from 0 to 1"):
        radio_link.GateKeeper().update(busy, 0)


def test_the_models_are_those_of_even_loss_where_nothing_varies() -> None:
    near = radio_sessions.models(1000, 1, apart_m=10.0, load=0.0)
    assert near["three_even"] == pytest.approx(near["three_lasting"], abs=0.002)
    far = radio_sessions.models(1000, 1, apart_m=400.0, load=0.0)
    assert far["loss"] > 0.4 and far["three_even"] > far["three_lasting"] + 0.05


def test_a_frame_whose_sender_leaves_while_it_waits_is_not_sent() -> None:
    places = dict(PLACES)
    clock, links, _ = joined(places, control=True)
    for _ in range(2):
        links._send(links_frame(1, 2, b"x"))
    del places[1]
    clock.run(500)
    assert links.sent[1] == 1
