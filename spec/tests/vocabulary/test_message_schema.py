"""The JSON Schema of a message agrees with the decoder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import jsonschema
import pytest
from automcm_stage import advertisement, cancel, no, prescription
from hypothesis import given, settings
from test_messages import BY_TYPE, ONE_OF_EACH, REFUSED, changed, without

from automcm_spec.vocabulary import json_schema, messages
from automcm_spec.vocabulary.messages import (
    LIMIT,
    Cam,
    Message,
    MessageError,
    MessageType,
    decode,
    to_dict,
)

VALIDATOR = jsonschema.Draft202012Validator(json_schema.messages())


def test_the_committed_schema_is_what_is_generated() -> None:
    committed = Path(messages.__file__).with_name("messages.schema.json")
    assert committed.read_text() == json_schema.text(json_schema.messages())
    jsonschema.Draft202012Validator.check_schema(json_schema.messages())


@pytest.mark.parametrize("type_", BY_TYPE)
def test_every_message_fits_the_schema(type_: str) -> None:
    @settings(derandomize=True, max_examples=30, deadline=None, database=None)
    @given(BY_TYPE[type_])
    def fits(message: Message | Cam) -> None:
        VALIDATOR.validate(to_dict(message))

    fits()


SWAPS = [None, 0, -1, 1, "1", 1.5, True, [], {}, "busy", "closed", "unsafe", 2**32, LIMIT + 1]


@pytest.mark.slow
def test_the_schema_and_decode_agree_on_changed_messages() -> None:
    """Each field of each message left out, and given each of some values."""
    seen = {True: 0, False: 0}
    more: list[Message | Cam] = [no(reason="busy"), cancel("closed"), advertisement(planned=None)]
    for message in [*ONE_OF_EACH, *more]:
        names = {*to_dict(message), "dst", "reason", "selected", "planned", "extra"}
        inputs = [without(message, name) for name in to_dict(message)]
        inputs += [changed(message, **{name: value}) for name in names for value in SWAPS]
        inputs += [changed(message, type=type_) for type_ in get_args(MessageType)]
        for data in inputs:
            try:
                decode(data)
                accepted = True
            except MessageError:
                accepted = False
            assert VALIDATOR.is_valid(json.loads(data)) == accepted, data
            seen[accepted] += 1
    assert seen[True] > 50 and seen[False] > 500


def test_what_breaks_the_grammar_does_not_fit_the_schema() -> None:
    """But for 1.0, which JSON Schema takes for an integer."""
    more = [{}, to_dict(prescription()) | {"type": "CAM"}]
    more += [to_dict(advertisement()) | {"details": {"a": a}} for a in (None, {"b": [1.5]})]
    wrong = [json.loads(data) for data, _ in REFUSED if b".0" not in data]
    for value in wrong + more:
        assert not VALIDATOR.is_valid(value), value
        with pytest.raises(MessageError):
            decode(json.dumps(value))
