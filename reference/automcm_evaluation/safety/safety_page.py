"""The safety experiment's claims and page; every number is from the report."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_evaluation.framework.experiment import PAGES, Claim, Values, beyond
from automcm_evaluation.framework.intervals import wilson
from automcm_evaluation.safety.ablations import BY_NAME, WHOLE
from automcm_evaluation.safety.safety_road import LOOKS, NEAR_M, UNCOORDINATED, WINDOWS_MS
from automcm_evaluation.safety.safety_tables import HARD
from automcm_spec.support import markdown

REACHED = 0.95
"""A hazard of this share of B shows that B is nearly minimal."""
SILENT, PLAIN = "silent CAM-loss fallback", "plain CAMs count"


def claims(report: Values) -> list[Claim]:
    """The claims beyond the paper; a claim that contradicts the figures is not reproduced."""
    s = report["summary"]
    whole, b = s["all"], s["bound_ms"]
    own = [row for row in s["classes"] if row["ablation"] == WHOLE.name]
    within = sum(row["longest_ms"] <= row["bound_ms"] for row in own)
    drives = f"{whole['hazards']} hazards in {whole['drives']} drives"
    return [
        beyond(
            "No hazard lasts longer than B = D + L (T-2)",
            f"longest {whole['longest_ms']} ms of {drives}; B = {b} ms",
            whole["beyond"] == 0 and whole["hazards"] > 0,
            f"{whole['beyond']} were longer",
        ),
        beyond(
            "B is reached: no smaller bound holds",
            f"longest {whole['longest_ms']} of {b} ms",
            whole["longest_ms"] >= REACHED * b,
            "a target that goes silent just after a CAM",
        ),
        beyond(
            "Without an abort, CAM loss, restart or crash of the target there is no hazard (S-5)",
            f"{whole['unexcused']} of {drives}",
            whole["unexcused"] == 0 and whole["hazards"] > 0,
            "whatever the radio and the prescriber do",
        ),
        beyond(
            "With a perfect radio each fault class keeps its own bound",
            f"{within} of {len(own)} classes",
            within == len(own),
            "verification.md, section 4",
        ),
        _class_claim(
            s, "The Cancel on CAM loss shortens a one-way cut (ACT-2)", "cut forth", SILENT
        ),
        _class_claim(
            s, "The marks of CAMs shorten a restart of the target (ACT-5)", "target restarts", PLAIN
        ),
        _mechanism_claim(s),
        _road_claim(
            s,
            "Under faults from the first Advertisement on, counting answers leaves room",
            WHOLE.name,
        ),
        _road_claim(
            s, "Under the same faults, looking as well leaves room (APP-1 to APP-5)", LOOKS
        ),
    ]


def _class_claim(s: Values, claim: str, fault: str, without: str) -> Claim:
    row, other = (
        next(r for r in s["classes"] if (r["ablation"], r["fault"]) == (name, fault))
        for name in (WHOLE.name, without)
    )
    return beyond(
        claim,
        f"longest {row['longest_ms']} ms with it, {other['longest_ms']} ms without",
        row["longest_ms"] <= row["bound_ms"] < other["longest_ms"],
        f"bounds {row['formula']} and {other['formula']}",
    )


def _mechanism_claim(s: Values) -> Claim:
    rows = [row for row in s["mechanisms"] if row["rule"]]
    bad = [row for row in rows if row["unexcused"] or row["beyond"]]
    seen = [row for row in rows if row["shows"]]
    return beyond(
        "Mechanisms whose removal leads to hazards that S-5 or T-2 forbid, under random faults",
        f"{len(bad)} of {len(rows)}; {len(seen)} of {len(rows)} show some effect",
        len(bad) > 0,
        "; ".join(row["ablation"] for row in bad) or "none occurred",
    )


def _road_claim(s: Values, claim: str, name: str) -> Claim:
    sums = {begins: road_sum(s["road"], name, begins) for begins in WINDOWS_MS}
    alone = [road_sum(s["road"], UNCOORDINATED, begins) for begins in WINDOWS_MS]
    near, moved = (sum(row[n] for row in alone) for n in ("near", "moved"))
    texts = [
        f"{row['near']} of {row['moved']} (fault in the {begins})" for begins, row in sums.items()
    ]
    return beyond(
        claim,
        f"lane changes with less than {NEAR_M:g} m of room: {', '.join(texts)}; "
        f"without coordination {near} of {moved}",
        all(row["moved"] and not row["near"] for row in sums.values()),
        f"receivers brake harder than {HARD:g} m/s² in "
        + " and ".join(f"{row['hard']} of {row['drives']}" for row in sums.values())
        + " drives",
    )


def road_sum(rows: Sequence[Values], name: str, begins: str) -> Values:
    """The counts of a protocol for a window of faults, at all speeds."""
    some = [row for row in rows if (row["ablation"], row["begins"]) == (name, begins)]
    return {n: sum(row[n] for row in some) for n in ("drives", "moved", "near", "hard")}


# -- the page


def page(report: Values) -> str:
    """The page: the runs, the tables, explanations, and limits."""
    s = report["summary"]
    names = list(dict.fromkeys(row["ablation"] for row in s["classes"]))
    classes: dict[str, list[Values]] = {}
    for row in sorted(s["classes"], key=lambda row: names.index(row["ablation"])):
        classes.setdefault(row["fault"], []).append(row)
    return markdown.page(
        PAGES / "safety.md.j2",
        wilson=wilson,
        s=s,
        settings=report["settings"],
        class_names=names,
        classes=classes,
        ablations=BY_NAME,
        hard=HARD,
    )
