"""Counterexamples go into ITF and come back as they were."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from automcm_spec.model_checking.tla_values import Function, Record
from automcm_traces.export.itf import (
    LARGEST,
    ItfError,
    ItfState,
    decode,
    dumps,
    encode,
    from_itf,
    to_itf,
)


@pytest.mark.parametrize(
    ("value", "itf"),
    [
        (True, True),
        (0, 0),
        ("a", "a"),
        (LARGEST, LARGEST),
        (-LARGEST, -LARGEST),
        (LARGEST + 1, {"#bigint": "9007199254740992"}),
        (-LARGEST - 1, {"#bigint": "-9007199254740992"}),
        ((1, "b"), {"#tup": [1, "b"]}),
        ((), {"#tup": []}),
        (frozenset({10, 9, 2}), {"#set": [10, 2, 9]}),
        (frozenset({Record({"a": 1}), (1,), "z"}), {"#set": ["z", {"#tup": [1]}, {"a": 1}]}),
        (Record({"b": 1, "a": frozenset()}), {"a": {"#set": []}, "b": 1}),
        (Record({}), {}),
        (Function({2: "x", 0: (3,)}), {"#map": [[0, {"#tup": [3]}], [2, "x"]]}),
        (Function({(1, "a"): True}), {"#map": [[{"#tup": [1, "a"]}, True]]}),
        (Function({"a": 1, 2: 3}), {"#map": [["a", 1], [2, 3]]}),
    ],
)
def test_a_value_and_its_itf(value: object, itf: object) -> None:
    assert repr(encode(value)) == repr(itf) or encode(value) == itf
    assert decode(itf) == value
    assert type(decode(itf)) is type(value)


@pytest.mark.parametrize(("value", "text"), [(None, "None"), (1.5, "1.5"), ({1}, "{1}")])
def test_what_itf_cannot_hold_becomes_text(value: object, text: str) -> None:
    assert encode([value]) == [{"#unserializable": text}]


@pytest.mark.parametrize("value", [{"#set": 1}, {"#meta": []}, {"a": {"#b": 1}}])
def test_refuses_a_record_that_looks_like_itf(value: object) -> None:
    with pytest.raises(ItfError, match="must not start with '#'"):
        encode(value)


@pytest.mark.parametrize(
    "itf",
    [
        None,
        1.5,
        [None],
        {"a": None},
        {"#bigint": "1.5"},
        {"#bigint": "9" * 5000},
        {"#bigint": 3},
        {"#set": {}},
        {"#set": [], "a": 1},
        {"#map": [[1]]},
        {"#map": [[1, 2], [1, 3]]},
        {"#set": [1, True]},
        {"#set": [[1], {"#tup": [1]}]},
        {"#unknown": 1},
        {"#unserializable": "Nat"},
    ],
)
def test_refuses_what_is_not_itf(itf: object) -> None:
    with pytest.raises(ItfError):
        decode(itf)


def test_a_repeated_element_of_a_set_counts_once() -> None:
    assert decode({"#set": [1, 1, [2], [2]]}) == frozenset({1, (2,)})


STATES = [
    ItfState({"phase": "STANDALONE", "net": frozenset()}),
    ItfState(
        {"net": frozenset({Record({"type": "Fin", "src": 1})}), "phase": "ACTUATING"},
        {
            "action": "Send",
            "args": {"s": 1, "to": [2, 3]},
            "rule": "ACT-2",
            "location": {"module": "Station", "line": 12},
        },
    ),
]


def test_the_trace_object() -> None:
    itf = to_itf(STATES, {"description": "S-1 violated", "source": "System.tla"}, loop=0)
    assert itf == {
        "#meta": {
            "format": "ITF",
            "format-description": "https://apalache-mc.org/docs/adr/015adr-trace.html",
            "description": "S-1 violated",
            "source": "System.tla",
        },
        "vars": ["net", "phase"],
        "states": [
            {"#meta": {"index": 0}, "net": {"#set": []}, "phase": "STANDALONE"},
            {
                "#meta": {
                    "index": 1,
                    "action": "Send",
                    "args": {"s": 1, "to": [2, 3]},
                    "rule": "ACT-2",
                    "location": {"module": "Station", "line": 12},
                },
                "net": {"#set": [{"type": "Fin", "src": 1}]},
                "phase": "ACTUATING",
            },
        ],
        "loop": 0,
    }
    assert from_itf(itf) == STATES


def test_dumps_is_one_state_a_line() -> None:
    itf = to_itf(STATES[:1] * 2, {"source": "é"})
    assert dumps(itf) == (
        '{"#meta":{"format":"ITF","format-description":'
        '"https://apalache-mc.org/docs/adr/015adr-trace.html","source":"\\u00e9"},\n'
        '"states":[\n'
        '{"#meta":{"index":0},"net":{"#set":[]},"phase":"STANDALONE"},\n'
        '{"#meta":{"index":1},"net":{"#set":[]},"phase":"STANDALONE"}\n'
        "],\n"
        '"vars":["net","phase"]}\n'
    )


def test_a_trace_may_be_empty_and_all_states_have_the_same_variables() -> None:
    itf = json.loads(dumps(to_itf([], {})))
    assert itf["vars"] == itf["states"] == from_itf(itf) == []
    with pytest.raises(ItfError, match="state 1 has variables"):
        to_itf([ItfState({"a": 1}), ItfState({"b": 1})], {})
    for loop in (-1, 2):
        with pytest.raises(ItfError, match="loop"):
            to_itf(STATES, {}, loop=loop)


@pytest.mark.parametrize(
    ("itf", "problem"),
    [
        ({}, "'vars'"),
        ({"vars": [1], "states": []}, "'vars'"),
        ({"vars": []}, "'states'"),
        ({"vars": ["a"], "states": [3]}, "state 0 must be an object"),
        ({"vars": ["a"], "states": [{"a": 1}, {}]}, "state 1 must have the variables"),
        ({"vars": ["a"], "states": [{"a": 1, "b": 1}]}, "state 0 must have the variables"),
        ({"vars": ["a"], "states": [{"a": None}]}, "state 0: not an ITF value: None"),
        ({"vars": [], "states": [{"#meta": 1}]}, "#meta of state 0"),
    ],
)
def test_refuses_a_trace_that_is_not_itf(itf: dict[str, Any], problem: str) -> None:
    with pytest.raises(ItfError, match=problem):
        from_itf(itf)


def test_keeps_what_other_tools_write_beside() -> None:
    state = {"#meta": {"index": 4, "seconds": 1.5, "n": {"#bigint": "5"}}, "a": 1}
    assert from_itf({"vars": ["a"], "states": [state], "loop": None}) == [
        ItfState({"a": 1}, {"seconds": 1.5, "n": {"#bigint": "5"}})
    ]


NAMES = st.text(max_size=4).filter(lambda name: not name.startswith("#"))
LEAVES = st.booleans() | st.integers() | st.text(max_size=4)


def containers(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    keys = inner.filter(lambda key: not isinstance(key, str))
    return (
        st.lists(inner, max_size=3).map(tuple)
        | st.frozensets(inner, max_size=4)
        | st.dictionaries(NAMES, inner, max_size=3).map(Record)
        | st.dictionaries(keys, inner, max_size=3).map(Function)
    )


VALUES = st.recursive(LEAVES, containers, max_leaves=6)


@given(st.lists(st.fixed_dictionaries({"x": VALUES, "net": VALUES}), max_size=3))
def test_states_come_back_as_they_were(values: list[dict[str, object]]) -> None:
    states = [ItfState(state, {"args": ["a", 1]}) for state in values]
    text = dumps(to_itf(states, {}))
    back = from_itf(json.loads(text))
    assert back == states
    assert dumps(to_itf(back, {})) == text
