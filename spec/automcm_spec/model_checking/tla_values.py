"""TLA+ values as Python values, from the text that TLC prints.

    3, -1          int          <<1, 2>>            tuple
    "a"            str          {1, 2}, 1..2        frozenset
    a              str          a model value
    TRUE, FALSE    bool         [a |-> 1]           Record
                                (1 :> 2 @@ 3 :> 4)  Function

All of them are hashable. As in TLA+, a function on 1..n is a tuple and a function on names is a
record; the parser converts them. Python treats TRUE and 1 as equal; TLA+ cannot compare them.
"""

import re
from collections.abc import Iterator
from typing import Any, NoReturn, TypeAlias


class _Frozen(dict[Any, Any]):
    """An immutable, hashable dict."""

    __slots__ = ("_hash",)
    _hash: int

    def __hash__(self) -> int:  # type: ignore[override]
        try:
            return self._hash
        except AttributeError:
            self._hash = hash(frozenset(self.items()))
            return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({dict(self)!r})"

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} is immutable")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


class Record(_Frozen):
    """A TLA+ record: a mapping from field names to values."""

    __slots__ = ()


class Function(_Frozen):
    """A TLA+ function that is neither a tuple nor a record."""

    __slots__ = ()


Value: TypeAlias = "int | str | tuple[Value, ...] | frozenset[Value] | Record | Function"

_NAME = re.compile(r"[A-Za-z0-9_]*[A-Za-z][A-Za-z0-9_]*\Z")
_TOKEN = re.compile(
    r"""-?\d+(?![A-Za-z0-9_]) | \w+ | "(?:[^"\\]|\\.)*"
      | <<|>> | \|-> | :> | @@ | \.\. | /\\ | \S""",
    re.VERBOSE | re.DOTALL,
)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "f": "\f"}
_END = ""


def parse(text: str) -> Value:
    """The value that the text denotes. Raises ValueError."""
    reader = _Reader(text)
    value = reader.value()
    reader.expect(_END)
    return value


def parse_state(text: str) -> dict[str, Value]:
    """The variables of a state as printed by TLC: "/\\ x = 1", and so on for each variable.

    A state with one variable may omit the "/\\". Raises ValueError.
    """
    reader = _Reader(text)
    state: dict[str, Value] = {}
    reader.skip("/\\")
    while True:
        name = reader.name()
        reader.expect("=")
        state[name] = reader.value()
        if not reader.skip("/\\"):
            reader.expect(_END)
            return state


class _Reader:
    """A recursive-descent parser; token is the next token, "" at the end."""

    def __init__(self, text: str) -> None:
        self._tokens = iter([*_TOKEN.findall(text), _END])
        self.token: str = next(self._tokens)

    def _take(self) -> str:
        token, self.token = self.token, next(self._tokens, _END)
        return token

    def _fail(self, expected: str, found: str) -> NoReturn:
        raise ValueError(f"expected {expected or 'the end'}, found {found or 'the end'}")

    def skip(self, token: str) -> bool:
        if self.token != token:
            return False
        self._take()
        return True

    def expect(self, token: str) -> None:
        if not self.skip(token):
            self._fail(token, self.token)

    def name(self, expected: str = "a name") -> str:
        name = self._take()
        if not _NAME.match(name):
            self._fail(expected, name)
        return name

    def value(self) -> Value:
        token = self.token
        if token.startswith('"') and len(token) > 1:
            return _unquoted(self._take())
        if token[-1:].isdecimal() and token.lstrip("-").isdecimal():
            self._take()
            if not self.skip(".."):
                return int(token)
            last = self.value()
            if not isinstance(last, int):
                self._fail("an integer", repr(last))
            return frozenset(range(int(token), last + 1))
        match token:
            case "<<":
                return tuple(self._values(">>"))
            case "{":
                return frozenset(self._values("}"))
            case "[":
                return self._record()
            case "(":
                return self._function()
            case "TRUE" | "FALSE":
                return self._take() == "TRUE"
        return self.name("a value")  # a model value

    def _values(self, close: str) -> Iterator[Value]:
        self._take()
        if self.skip(close):
            return
        yield self.value()
        while self.skip(","):
            yield self.value()
        self.expect(close)

    def _record(self) -> Value:
        fields: dict[str, Value] = {}
        while True:
            self._take()
            name = self.name()
            self.expect("|->")
            fields[name] = self.value()
            if self.token != ",":
                self.expect("]")
                return Record(fields)

    def _function(self) -> Value:
        pairs: dict[Value, Value] = {}
        while True:
            self._take()
            key = self.value()
            self.expect(":>")
            pairs.setdefault(key, self.value())  # in f @@ g, f wins
            if self.token != "@@":
                self.expect(")")
                return function(pairs)


def function(pairs: dict[Value, Value]) -> Value:
    """The function with these pairs: a tuple on 1..n, a record on names, otherwise a Function."""
    if all(type(key) is int for key in pairs) and set(pairs) == set(range(1, len(pairs) + 1)):
        return tuple(pairs[i] for i in range(1, len(pairs) + 1))
    names = {
        key: value for key, value in pairs.items() if isinstance(key, str) and _NAME.match(key)
    }
    return Record(names) if len(names) == len(pairs) else Function(pairs)


def _unquoted(token: str) -> str:
    if "\\" not in token:
        return token[1:-1]
    return re.sub(
        r"\\(.)", lambda m: _ESCAPES.get(m.group(1), m.group(1)), token[1:-1], flags=re.DOTALL
    )
