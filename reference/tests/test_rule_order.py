"""The rows of the reference stand in the order of Station.tla, rule by rule."""

from __future__ import annotations

import re
from collections.abc import Iterator

from automcm.core.rules import RULES
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.rules import cited, operators

COMMENT = re.compile(r"\(\*.*?\*\)|\\\*[^\n]*", re.DOTALL)
OTHER_RULE = re.compile(r"\w+\([\w, ]*\) EXCEPT !\.rule")
"""An operator whose own rule is replaced."""
BODY = {
    name: OTHER_RULE.sub("", COMMENT.sub("", text)).partition("==")[2]
    for name, (_, text) in operators(TLA).items()
}


def named(text: str) -> Iterator[str]:
    """The rules that a text names, and those of the operators that it mentions where it does."""
    for quoted, name in re.findall(r'"([^"]*)"|(\w+)', text):
        if cited(quoted):
            yield quoted
        elif name in BODY:
            yield from named(BODY[name])


def cases(operator: str, kind: str) -> dict[str, list[str]]:
    """For each arm of its CASE the rules, those before the CASE first."""
    first, _, arms = BODY[operator].partition("CASE")
    found = re.findall(r'= "(\w+)"\s*->(.*)', arms)
    return {f"{kind} {name}": [*named(first), *named(text)] for name, text in found}


def test_the_rules_for_each_input_are_in_the_order_of_the_specification() -> None:
    specified = {
        **cases("OnMessage", "receive"),
        **cases("OnCommand", "command"),
        **cases("OnExpiry", "expire"),
        "receive CAM": list(named(BODY["OnCam"])),
        "restart": list(named(BODY["OnRestart"])),
    }
    assert {kind: [row.rule for row in rows] for kind, rows in RULES.items()} == specified
