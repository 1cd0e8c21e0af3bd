"""ns-3's radio: a committed measurement again, its airtime, and its rules; ``make test-foreign``.

    python reference/tests/foreign_radio.py

Needs ns-3 (automcm[radio]); without it it is skipped, and says so.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from foreign_checks import run

from automcm_evaluation.radio.radio_traffic import measured, ns3_measured
from automcm_simulation.radio.ns3_radio import SEEDS, Ns3Radio
from automcm_simulation.radio.propagation import airtime_us
from automcm_spec.support.extras import missing

NAME = "25 per km"


def a_committed_measurement_is_repeated() -> None:
    known = next(m for m in ns3_measured() if m.traffic.name == NAME)
    radio = Ns3Radio(known.traffic.seed)
    try:
        found = measured(radio, known.traffic)
    finally:
        radio.close()
    assert found == known, [
        (a, b) for a, b in zip(found.rows, known.rows, strict=True) if a != b
    ] or (found.busy, known.busy)


def a_frame_takes_our_airtime() -> None:
    for size in (31, 150, 1300):
        radio = Ns3Radio(1)
        try:
            radio.move({1: (0.0, 0.0), 2: (10.0, 0.0)})
            for n in range(20):
                radio.transmit(1, size, n * 50, n)
            radio.advance(1000)
            busy = [radio.channel_busy_ratio(station) for station in (1, 2)]
        finally:
            radio.close()
        assert all(abs(share - 20 * airtime_us(size) / 1e6) < 1e-9 for share in busy), (size, busy)


def every_seed_is_valid() -> None:
    for seed in (0, SEEDS - 1, SEEDS, 2**32 - 1, 2**70):
        radio = Ns3Radio(seed)
        radio.move({1: (0.0, 0.0), 2: (10.0, 0.0)})
        radio.transmit(1, 150, 0, 1)
        assert [a.receivers for a in radio.advance(50)] == [[2]], seed
        radio.close()


def bad_calls_are_refused() -> None:
    radio = Ns3Radio(1)
    try:
        radio.move({1: (0.0, 0.0)})
        radio.advance(5)
        for call in (
            lambda: radio.transmit(2, 150, 5, 1),
            lambda: radio.transmit(1, 5000, 5, 1),
            lambda: radio.transmit(1, 150, 4, 1),
            lambda: radio.advance(4),
        ):
            try:
                call()
            except ValueError:
                continue
            raise AssertionError("accepted")
        try:
            Ns3Radio(2)
        except RuntimeError as error:
            assert "close the other" in str(error)
        else:
            raise AssertionError("two at a time")
    finally:
        radio.close()


def stations_come_and_go() -> None:
    radio = Ns3Radio(1)
    try:
        radio.move({1: (0.0, 0.0), 2: (10.0, 0.0)})
        radio.transmit(1, 150, 0, 1)
        assert [a.receivers for a in radio.advance(50)] == [[2]]
        radio.move({1: (0.0, 0.0), 3: (10.0, 0.0), 4: (0.0, 10.0)})
        radio.transmit(1, 150, 50, 2)
        assert [s for a in radio.advance(100) for s in a.receivers] == [3, 4]
    finally:
        radio.close()


CHECKS: tuple[Callable[[], None], ...] = (
    a_frame_takes_our_airtime,
    every_seed_is_valid,
    bad_calls_are_refused,
    stations_come_and_go,
    a_committed_measurement_is_repeated,
)


def main() -> int:
    reason = missing("radio")
    return run("the comparison with ns-3", CHECKS, None if reason is None else f"it {reason}")


if __name__ == "__main__":
    sys.exit(main())
