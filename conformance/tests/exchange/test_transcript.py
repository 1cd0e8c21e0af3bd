"""An exchange in words."""

from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.answers import Required
from automcm_conformance.exchange.exchange import Step


def test_an_order_that_counts_is_said() -> None:
    sent = [{"type": name, "session": [1, 2], "seq": 3} for name in ("Fin", "Ack", "Cancel")]
    (text,) = transcript.allowed(Required(messages=sent, begins=[0, 1], phase="WAITING"))
    fin, ack, cancel = map(transcript.message, sent)
    assert text.startswith(f"{fin}, then {ack} and {cancel} (in any order); WAITING; ")


def test_a_station_that_gave_no_answer_says_nothing() -> None:
    step = Step(5, b'{"cmd":"restart"}', Required())
    assert [line.who for line in transcript.exchange([step])] == ["kit"]
    step.answer = b'{"phase":"STANDALONE"}'
    assert [line.who for line in transcript.exchange([step])] == ["kit", "station"]
