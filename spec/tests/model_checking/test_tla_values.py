"""The parser of TLA+ values."""

import copy
import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automcm_spec.model_checking.tla_values import (
    Function,
    Record,
    Value,
    ValueSyntaxError,
    function,
    parse,
    parse_state,
    show,
)

NAMES = st.from_regex(r"[A-Za-z_]{0,3}[A-Za-z][A-Za-z0-9_]{0,3}", fullmatch=True)
LEAVES = st.integers() | st.booleans() | st.text() | NAMES


VALUES: st.SearchStrategy[Value] = st.deferred(
    lambda: (
        LEAVES
        | st.lists(VALUES, max_size=3).map(tuple)
        | st.frozensets(VALUES, max_size=3)
        | st.dictionaries(NAMES, VALUES, min_size=1, max_size=3).map(Record)
        | st.dictionaries(VALUES, VALUES, min_size=1, max_size=3).map(function)
    )
)


@settings(deadline=None)
@given(VALUES)
def test_what_is_shown_is_parsed_again(value: Value) -> None:
    text = show(value)
    assert parse(text) == value
    assert show(parse(text)) == text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-3", -3),
        ('"a \\"b\\" \\\\"', 'a "b" \\'),
        ("<< >>", ()),
        ("{}", frozenset()),
        ("2..4", frozenset({2, 3, 4})),
        ("{TRUE, FALSE}", frozenset({True, False})),
        (
            "[a |-> <<1, {2}>>,\n  b |-> [c |-> FALSE]]",
            {"a": (1, frozenset({2})), "b": {"c": False}},
        ),
        ("(1 :> 2 @@ 5 :> <<>>)", {1: 2, 5: ()}),
        ("(2 :> 8 @@ 1 :> 7)", (7, 8)),
        ('("a" :> 1 @@ "b" :> 2)', Record(a=1, b=2)),
        ("(3 :> 1 @@ 3 :> 2)", {3: 1}),
    ],
)
def test_what_tlc_prints(text: str, value: Value) -> None:
    parsed = parse(text)
    assert parsed == value
    assert isinstance(parsed, type(value))
    hash(parsed)


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("", 0),
        ("<<1, 2", 6),
        ("<<1 2>>", 4),
        ("[a |> 1]", 3),
        ("[a |-> 1", 8),
        ("{1,}", 3),
        ("1 2", 2),
        ("=", 0),
        ("[1 |-> 2]", 1),
        ('"abc', 0),
        ("(1 :> 2", 7),
        ("1..TRUE ]", 8),
        ('1.."a"', 6),
    ],
)
def test_what_is_no_value(text: str, offset: int) -> None:
    with pytest.raises(ValueSyntaxError) as caught:
        parse(text)
    assert caught.value.offset == offset
    assert f"at offset {offset}" in str(caught.value)


def test_a_state() -> None:
    assert parse_state("/\\ net = {}\n/\\ st = << [a |-> 1],\n  2 >>\n") == {
        "net": frozenset(),
        "st": (Record(a=1), 2),
    }
    assert parse_state("x = 0\n") == {"x": 0}
    stations = "/\\ st = (a :> 1 @@ p :> 2)\n/\\ at = {p}\n"  # model values, as in one_by_three
    assert parse_state(stations) == {"st": Record(a=1, p=2), "at": frozenset({"p"})}
    with pytest.raises(ValueSyntaxError):
        parse_state("/\\ x = 1 y = 2")


def test_sets_and_fields_are_shown_in_order() -> None:
    assert show(frozenset({10, 9, "a"})) == '{9, 10, "a"}'
    assert show(Record(b=1, a=2)) == "[a |-> 2, b |-> 1]"
    assert show(Function({5: 1, (1,): 2})) == "(5 :> 1 @@ <<1>> :> 2)"
    assert show(Function()) == "<<>>"


def test_records_do_not_change() -> None:
    record = Record(a=1)
    assert {record: 1}[Record(a=1)] == 1
    with pytest.raises(TypeError, match="is immutable"):
        record["a"] = 2
    with pytest.raises(TypeError, match="is immutable"):
        record.update(a=2)
    for twin in (copy.deepcopy(record), pickle.loads(pickle.dumps(record))):
        assert twin == record
        assert isinstance(twin, Record)
    assert repr(record) == "Record({'a': 1})"
