"""Reports of runs that never were, and texts that a station may say to break them."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_conformance.exchange import results

HOSTILE = [
    "<script>alert(1)</script><img src=x onerror=alert(2)>",
    "\"'><b onclick='x'>&amp;&lt;",
    "]]><!-- --> <![CDATA[",
    "{{ 7 * 7 }} {% raw %} [bold red]not markup[/] [/nothing] :smile:",
    "\x00\x07\x1b[2J\x1b]0;title\x07\x7f\x9b31m\r\n\tConforms: 9 of 9 MUST cases pass",
    "\u202egnol\u202c \u200b\ufeff\u2028\u2066 \ud800 \ufffe",
    "y" * 1_000_000,
]
ALL = " | ".join(HOSTILE[:-1])


def case(
    name: str = "AMCM/RCV/NEG/BV-01",
    verdict: results.Verdict = "PASS",
    level: results.Level = "MUST",
    text: str = "text",
    **more: Any,
) -> results.CaseResult:
    return results.CaseResult(
        name, verdict, ["NEG-4"], level, text, text, text, f"bug {text}", f"cost {text}", **more
    )


def failure(text: str = "text") -> results.Failure:
    return results.Failure(
        rule="NEG-4",
        rule_text=f"rule {text}",
        operator="OnForeignPrescription",
        line=321,
        what=f"what {text}",
        allowed=[f"allowed {text}", "or that"],
        came=[f"came {text}"],
        exchange=[
            results.Line(1000, "kit", f"said {text}"),
            results.Line(1000, "station", f"answered {text}"),
        ],
        replay="replay/1.json",
        command=f"automcm conform replay {text}",
    )


def run(*cases: results.CaseResult, text: str = "text", **more: Any) -> results.Report:
    who = results.Implementation(
        text, "1.0", text, ["receiver", text], ["lane_change"], {text: 1}, ["run", text]
    )
    coverage = {"transitions": [1999, 2000], "refusals": [5, 5], "rules": [0, 0]}
    graphs = {text: {"transitions": [1, 2]}, "one_peer": {"transitions": [1, 2]}}
    given: dict[str, Any] = {"started": "2026-01-02T03:04:05Z", "seconds": 1.5, **more}
    return results.Report(who, list(cases), coverage, graphs, "ab" * 32, 1, [], **given)


@pytest.fixture(params=[*HOSTILE, ALL], ids=range(len(HOSTILE) + 1))
def hostile(request: pytest.FixtureRequest) -> results.Report:
    text = request.param
    bad = [case(f"AMCM/RCV/{text[:40]}/BI-01", "FAIL", text=text, failures=[failure(text)])]
    bad += [case(f"AMCM/STA/END/BI-{n}", v, reason=text) for n, v in enumerate(("ERROR", "SKIP"))]
    bad += [case("AMCM/SYS/REL/TI-01", "FAIL", wanted="FAIL", because=text)]
    return run(case(), *bad, text=text, problems=[text])
