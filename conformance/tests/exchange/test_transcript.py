"""An exchange in words."""

from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.answers import Required
from automcm_conformance.exchange.exchange import Step


def test_a_station_that_gave_no_answer_says_nothing() -> None:
    step = Step(5, b'{"cmd":"restart"}', Required())
    assert [line.who for line in transcript.exchange([step])] == ["kit"]
    step.answer = b'{"phase":"STANDALONE"}'
    assert [line.who for line in transcript.exchange([step])] == ["kit", "station"]
