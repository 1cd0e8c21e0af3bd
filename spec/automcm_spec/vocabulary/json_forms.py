"""The JSON form of the specification's values, and back (docs/oracle.md).

A NamedTuple or a tuple becomes a list, a set becomes a sorted list. The annotations of
automcm_spec.vocabulary.station determine the class of a list when reading. A mapping, such as a
record that TLC printed, is read like the list of the values that the class has.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

from automcm_spec.vocabulary import station
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.tla_names import snake

Json = Any


def canonical(value: Any) -> str:
    """The text by which values are printed and sorted: for JSON and for values of the
    specification."""
    return json.dumps(value, separators=(",", ":"), default=lambda s: sorted(s, key=canonical))


def to_json(value: Any) -> Json:
    """The JSON form of a state, a message, an input, a timer, or a set of them."""
    return json.loads(canonical(value))


def open_station(constants: Mapping[str, Json]) -> spec.OpenStation:
    """The compiled station with these constants of OpenStation, in the form of a graph."""
    given: dict[str, Any] = {
        snake(name): frozenset(value) if isinstance(value, list) else value
        for name, value in constants.items()
    }
    return spec.OpenStation(**given)


def state(value: Json) -> spec.State:
    """The state with this JSON form, or in this record."""
    made: spec.State = _reader(spec.State)(value)
    return made


def message(value: Json) -> spec.Message:
    """The message with this JSON form."""
    made: spec.Message = _reader(spec.Message)(value)
    return made


def sessions(value: Json) -> frozenset[spec.Session]:
    """The set of the sessions in a list."""
    return frozenset(map(tuple, value))


def timer(value: Json) -> spec.Timer:
    """The timer with this JSON form."""
    name, *about = value
    if not about:
        return (name,)
    (of,) = about
    station_or_entry: Any = of if isinstance(of, int | str) else _reader(spec.Entry)(of)
    return name, station_or_entry


def input_of(value: Json) -> spec.Input:
    """The input with this JSON form. Raises KeyError for an unknown kind."""
    kind = value["kind"] if isinstance(value, Mapping) else value[0]
    made: spec.Input = _reader(_inputs()[kind])(value)
    return made


@cache
def _inputs() -> dict[str, Any]:
    """The class of each kind of input."""
    return {get_args(get_type_hints(one)["kind"])[0]: one for one in get_args(spec.Input)}


@cache
def _reader(annotation: Any) -> Callable[[Json], Any]:
    """A function that reads values with this annotation."""
    if annotation == spec.Timer:
        return timer
    args = get_args(annotation)
    if get_origin(annotation) is frozenset:
        (item,) = map(_reader, args)
        # Equal sets of a graph share one object.
        kept: dict[frozenset[Any], frozenset[Any]] = {}

        def of(value: Json) -> Any:
            made = frozenset(map(item, value))
            return kept.setdefault(made, made)

        return of
    if get_origin(annotation) is tuple:
        return tuple
    if isinstance(annotation, type) and issubclass(annotation, tuple):
        hints = get_type_hints(annotation, vars(station))
        fields = [_reader(hint) for hint in hints.values()]

        def made(value: Json) -> Any:
            if isinstance(value, Mapping):
                value = [value[name] for name in hints]
            return annotation(*(read(item) for read, item in zip(fields, value, strict=True)))

        return made
    return lambda value: value
