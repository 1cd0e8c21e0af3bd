"""The statements of section VI-A of the paper on bandwidth, compared with the results."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_evaluation.bandwidth.bandwidth_air import CODECS, FORMS
from automcm_evaluation.bandwidth.bandwidth_summary import RIVALS, drive
from automcm_evaluation.framework.experiment import Claim, Values, beyond, graded

TEN, MANY = 10.0, 3.0
"""The paper's ratio of a message with a trajectory to a CAM; and what is still many times."""
SAME = 0.05
"""Amounts that differ by less than this share count as equal."""


def claims(report: Values) -> list[Claim]:
    """The paper's statements, then further claims."""
    s = report["summary"]
    two, four = drive(s, 2), drive(s, 4)
    return [
        _larger(s),
        _intentions(two, four),
        _equal(two, four),
        _cancels(two, four),
        _saves(s),
        _often(two, four),
        _lean(two, four),
        _lossy(s),
        _scaling(s),
        *_crowded(s),
    ]


def _larger(s: Values) -> Claim:
    etsi = s["etsi"]
    least = min(etsi["ratio"], *(r for name in CODECS for r in s["ratios"][name].values()))
    return Claim(
        "a message with a trajectory is far larger than a CAM",
        "more than 10 times (encoding and number of points not given)",
        f"with {s['points']['paper']} points: "
        + "; ".join(
            f"{name.upper()} {min(of.values()):.1f} to {max(of.values()):.1f} times our CAM"
            for name, of in s["ratios"].items()
        )
        + f"; in UPER {etsi['ratio']:.1f} times an ETSI CAM of {etsi['cam']} bytes",
        graded(least > TEN, least > MANY),
        "our UPER encodes a point as the step from the previous one, in "
        f"{etsi['here_per_point']:.1f} bytes; at "
        f"{etsi['needed_per_point']:.1f} the ratio would be 10",
    )


def _intentions(two: Values, four: Values) -> Claim:
    counts = _ratio(two["count"], four["count"], "Intention")
    amounts = [_ratio(two["bytes"][n], four["bytes"][n], "Intention") for n in CODECS]
    three = abs(counts - 3) < 1e-9 and all(abs(amount / 3 - 1) < SAME for amount in amounts)
    return Claim(
        "with four vehicles there are three times as many Intentions as with two",
        "3 times (VI-A says Fig. 7a; it must be 7b)",
        f"{counts:g} times as many messages; bytes: "
        + _each([f"{amount:.2f} times" for amount in amounts]),
        graded(three, min(amounts) > 1.5),
        "three receivers answer",
    )


def _equal(two: Values, four: Values) -> Claim:
    kinds = ("Prescription", "Acceptance", "Fin")
    counts = [_ratio(two["count"], four["count"], kind) for kind in kinds]
    amounts = [_ratio(two["bytes"][n], four["bytes"][n], kind) for n in CODECS for kind in kinds]
    same, alike = (all(abs(r - 1) < SAME for r in ratios) for ratios in (counts, amounts))
    return Claim(
        "Prescription, Acceptance and Fin take as many bytes with four vehicles as with two",
        "the same",
        ", ".join(
            f"{kind} {two['bytes']['json'].get(kind, 0):.0f} and "
            f"{four['bytes']['json'].get(kind, 0):.0f} bytes"
            for kind in kinds
        )
        + " (JSON)",
        graded(same and alike, same),
        "only the prescriber and its target exchange them",
    )


def _cancels(two: Values, four: Values) -> Claim:
    none = not two["cancelled"]
    names = {1: "the prescriber", 2: "A", 3: "B", 4: "C"}
    return Claim(
        "the receivers that are not chosen get a Cancel",
        "A and C; none with two vehicles",
        f"{_to([names[n] for n in four['cancelled']])}; "
        f"{_to(['the receiver' for _ in two['cancelled']])} with two vehicles",
        graded(none and four["cancelled"] == [2, 4], none and four["cancelled"]),
    )


def _saves(s: Values) -> Claim:
    texts, all_, with_cams = [], [], []
    for form, trajectories in zip(FORMS[:2], ("thinned (KIN-2)", FORMS[1]), strict=True):
        savings = [drive(s, n)["saving"][form][name] for n in (2, 4) for name in CODECS]
        with_cams += [saving["with_cams"] for saving in savings]
        parts = []
        for rival, text in RIVALS.items():
            factors = [saving[rival] for saving in savings]
            all_ += factors
            parts.append(f"{min(factors):.1f} to {max(factors):.1f} ({text})")
        texts.append(f"{trajectories}: {', '.join(parts)}")
    return Claim(
        "event-driven messages need less bandwidth than periodic Intentions of all vehicles",
        "effectively (no figure)",
        "over one lane change of 2 or 4 vehicles, in JSON or UPER, periodic Intentions take so "
        "many times the bytes: " + "; ".join(texts),
        graded(min(all_) > 1, max(all_) > 1),
        f"not more in {sum(factor <= 1 for factor in all_)} of {len(all_)} cases; CAMs not "
        f"counted; with CAMs at 10 Hz on both sides {min(with_cams):.1f} to "
        f"{max(with_cams):.1f} times (10 Hz)",
    )


def _often(two: Values, four: Values) -> Claim:
    return beyond(
        "rate of lane changes from which on event-driven messages save nothing against 10 Hz",
        " and ".join(
            f"{min(d['saving']['sent'][n]['break_even_per_min'] for n in CODECS):.0f} a minute "
            f"with {d['vehicles']} vehicles"
            for d in (two, four)
        )
        + f"; a lane change takes {four['s']:.1f} s, so at most "
        f"{60 / four['s']:.1f} a minute can follow one another",
    )


def _lean(two: Values, four: Values) -> Claim:
    part = max(
        d["bytes"][name]["Advertisement"] / d["event"]["sent"][name]
        for d in (two, four)
        for name in CODECS
    )
    form, lean = FORMS[1:]
    return beyond(
        "the repeated Advertisement takes most of the bytes",
        f"up to {part:.0%}; without its trajectory, which is optional, a lane change "
        f"of four takes {four['event'][lean]['json']:,.0f} instead of "
        f"{four['event'][form]['json']:,.0f} bytes (JSON) or {four['event'][lean]['uper']:,.0f} "
        f"instead of {four['event'][form]['uper']:,.0f} (UPER), with 52 points",
        why=f"it is broadcast {four['count']['Advertisement']:.0f} times (ADV-2)",
    )


def _lossy(s: Values) -> Claim:
    return beyond(
        "what packet loss adds to event-driven",
        "; ".join(
            f"{n} vehicles at {lossy['loss']:.0%} loss: "
            + _each(
                [
                    f"{lossy['event']['sent'][name] / drive(s, n)['event']['sent'][name] - 1:+.0%}"
                    for name in CODECS
                ]
            )
            for n in (2, 4)
            for lossy in [drive(s, n, lossy=True)]
        ),
        why="more Intentions, Acceptances, Fins and Acks are sent again; "
        "Advertisements are not more",
    )


def _scaling(s: Values) -> Claim:
    usual = min(each["participants"] for each in s["many"])
    last = max(
        (each for each in s["many"] if each["participants"] == usual),
        key=lambda each: each["vehicles"],
    )
    return beyond(
        f"share of a 6 Mbit/s channel with {last['vehicles']} vehicles in range",
        "; ".join(
            f"{name.upper()}: CAMs alone {of['cams']:.1%}, and one lane change "
            f"{of['maneuver']:.1%} (busiest half second {of['busiest']:.1%}), "
            f"and always-on {of['always']:.1%}"
            for name, of in last["channel"].items()
        ),
        why="CAMs at 10 Hz and the headers of each frame are counted; preambles, gaps and "
        "collisions are not",
    )


def _crowded(s: Values) -> list[Claim]:
    """The claim on a limit, only if there were more receivers than a prescriber records."""
    by = {(each["vehicles"], each["participants"]): each for each in s["many"]}
    usual = min(participants for _, participants in by)
    return [
        beyond(
            f"with {n} vehicles more want to take part than the {usual} a prescriber notes",
            f"{by[n, usual]['intentions']} Intentions are sent instead of "
            f"{by[n, most]['intentions']}, and {by[n, usual]['event']['json']:,.0f} instead of "
            f"{by[n, most]['event']['json']:,.0f} bytes (JSON)",
            why="beyond max_participants an Intention is ignored (section 3), so its sender "
            "repeats it until it gives up",
        )
        for n, most in sorted(by)
        if most > usual
    ]


def _ratio(two: Values, four: Values, kind: str) -> float:
    """The ratio of amounts of one kind; 0 if there is none with two vehicles."""
    return float(four.get(kind, 0) / two[kind]) if two.get(kind) else 0.0


def _each(values: Sequence[str]) -> str:
    """One for each codec."""
    return ", ".join(f"{v} ({name.upper()})" for name, v in zip(CODECS, values, strict=True))


def _to(names: Sequence[str]) -> str:
    return " and ".join(names) or "none"
