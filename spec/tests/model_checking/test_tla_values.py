"""The parser of TLA+ values."""

import copy
import pickle

import pytest

from automcm_spec.model_checking.tla_values import Function, Record, Value, parse, parse_state


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
        ("(5 :> 1 @@ <<1>> :> {})", Function({5: 1, (1,): frozenset()})),
        ('("a b" :> 1 @@ 2 :> 2)', Function({"a b": 1, 2: 2})),
        ("(TRUE :> 1 @@ 2 :> 2)", Function({True: 1, 2: 2})),
        ('"\\n\\t Ω /\\\\ >>"', "\n\t Ω /\\ >>"),
        ("{<<>>, a_1, 2b, -10}", frozenset({(), "a_1", "2b", -10})),
    ],
)
def test_what_tlc_prints(text: str, value: Value) -> None:
    parsed = parse(text)
    assert parsed == value
    assert isinstance(parsed, type(value))
    hash(parsed)


@pytest.mark.parametrize(
    "text",
    [
        *("", "<<1, 2", "<<1 2>>", "[a |> 1]", "[a |-> 1", "{1,}", "1 2", "=", "[1 |-> 2]"),
        *('"abc', "(1 :> 2", "1..TRUE ]", '1.."a"'),
    ],
)
def test_what_is_no_value(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected .*, found "):
        parse(text)


def test_a_state() -> None:
    assert parse_state("/\\ net = {}\n/\\ st = << [a |-> 1],\n  2 >>\n") == {
        "net": frozenset(),
        "st": (Record(a=1), 2),
    }
    assert parse_state("x = 0\n") == {"x": 0}
    stations = "/\\ st = (a :> 1 @@ p :> 2)\n/\\ at = {p}\n"  # model values, as in one_by_three
    assert parse_state(stations) == {"st": Record(a=1, p=2), "at": frozenset({"p"})}
    with pytest.raises(ValueError, match="expected the end, found y"):
        parse_state("/\\ x = 1 y = 2")


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
