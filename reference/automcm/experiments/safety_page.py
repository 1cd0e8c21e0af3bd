"""The safety experiment's claims and page; every number is from the report."""

from __future__ import annotations

from collections.abc import Sequence

from automcm.experiments.ablations import BY_NAME, WHOLE
from automcm.experiments.experiment import Claim, Values
from automcm.experiments.intervals import wilson
from automcm.experiments.safety_road import UNCOORDINATED
from automcm.experiments.safety_tables import HARD

REACHED = 0.95
"""A hazard of this share of B shows that B is about as small as it can be."""
SILENT, PLAIN = "silent CAM-loss fallback", "plain CAMs count"


def claims(report: Values) -> list[Claim]:
    """What holds beyond the paper; a claim whose figures are against it is not reproduced."""
    s = report["summary"]
    whole, b = s["all"], s["bound_ms"]
    own = [row for row in s["classes"] if row["ablation"] == WHOLE.name]
    within = sum(row["longest_ms"] <= row["bound_ms"] for row in own)
    drives = f"{whole['hazards']} hazards in {whole['drives']} drives"
    found = [
        _claim(
            "No hazard lasts longer than B = D + L (T-2)",
            f"longest {whole['longest_ms']} ms of {drives}; B = {b} ms",
            whole["beyond"] == 0 and whole["hazards"] > 0,
            f"{whole['beyond']} were longer",
        ),
        _claim(
            "B is reached, so that no smaller bound could be claimed",
            f"longest {whole['longest_ms']} of {b} ms",
            whole["longest_ms"] >= REACHED * b,
            "a target that goes silent just after a CAM",
        ),
        _claim(
            "Without an abort, CAM loss, restart or crash of the target there is no hazard (S-5)",
            f"{whole['unexcused']} of {drives}",
            whole["unexcused"] == 0 and whole["hazards"] > 0,
            "whatever the radio and the prescriber do",
        ),
        _claim(
            "With a perfect radio each fault class keeps to a bound of its own",
            f"{within} of {len(own)} classes",
            within == len(own),
            "the table of verification.md, section 4",
        ),
        _class_claim(
            s, "The Cancel on CAM loss shortens a one-way cut (ACT-2)", "cut forth", SILENT
        ),
        _class_claim(
            s, "The marks of CAMs shorten a restart of the target (ACT-5)", "target restarts", PLAIN
        ),
    ]
    return [*found, *_mechanism_claim(s), *_road_claim(s)]


def _claim(claim: str, here: str, holds: bool, why: str) -> Claim:
    return Claim(claim, "-", here, "beyond the paper" if holds else "not reproduced", why)


def _class_claim(s: Values, claim: str, fault: str, without: str) -> Claim:
    row, other = (
        next(r for r in s["classes"] if (r["ablation"], r["fault"]) == (name, fault))
        for name in (WHOLE.name, without)
    )
    return _claim(
        claim,
        f"longest {row['longest_ms']} ms with it, {other['longest_ms']} ms without",
        row["longest_ms"] <= row["bound_ms"] < other["longest_ms"],
        f"bounds {row['formula']} and {other['formula']}",
    )


def _mechanism_claim(s: Values) -> list[Claim]:
    rows = [row for row in s["mechanisms"] if row["rule"]]
    bad = [row for row in rows if row["unexcused"] or row["beyond"]]
    seen = [row for row in rows if row["shows"]]
    return [
        _claim(
            "Mechanisms without which random faults lead to hazards that S-5 or T-2 forbid",
            f"{len(bad)} of {len(rows)}; {len(seen)} of {len(rows)} show some effect",
            len(bad) > 0,
            "; ".join(row["ablation"] for row in bad) or "none was met",
        )
    ]


def _road_claim(s: Values) -> list[Claim]:
    whole = _road_sum(s["road"], WHOLE.name)
    alone = _road_sum(s["road"], UNCOORDINATED)
    return [
        _claim(
            "With faults, too, a prescriber moves over only where there is room",
            f"{whole['near']} of {whole['moved']} with less than 2 m; "
            f"without coordination {alone['near']} of {alone['moved']}",
            whole["moved"] > 0 and whole["near"] * alone["moved"] < alone["near"] * whole["moved"],
            f"receivers brake harder than {HARD:g} m/s² in {whole['hard']} of "
            f"{whole['drives']} and {alone['hard']} of {alone['drives']} drives",
        )
    ]


def _road_sum(rows: Sequence[Values], name: str) -> Values:
    some = [row for row in rows if row["ablation"] == name]
    return {n: sum(row[n] for row in some) for n in ("drives", "moved", "near", "hard")}


# -- the page


def page(report: Values) -> list[str]:
    """What was run, the tables, what explains them, and doubts."""
    s = report["summary"]
    return [
        *_model(report),
        *_faults(s),
        *_classes(s),
        *_mechanisms(s),
        *_road(s),
        *_doubts(),
    ]


def _model(report: Values) -> list[str]:
    s = report["summary"]
    settings = report["settings"]
    speeds = " and ".join(str(v) for v in settings["speeds_kmh"])
    return [
        "A **hazard**: a prescriber acts while its target is not committed to that session and",
        "proposal. It is measured in the simulated stations' states, to the millisecond. S-5",
        "allows it only if the target itself aborted, lost CAMs, restarted or crashed; T-2 bounds",
        f"it by B = D + L = {s['delay_ms']} + {s['bound_ms'] - s['delay_ms']} ms"
        f" = {s['bound_ms']} ms.",
        "",
        "Two harnesses. *The protocol alone*: a prescriber and a target that agree to everything.",
        "*The road*: the four vehicles of Fig. 6 with their lane change.",
        "",
        "| what | value | where from |",
        "|---|---|---|",
        "| t_timeout, t_resend, CAMs | 2000 ms, 100 ms, 10 Hz | *paper*, Table I |",
        "| t_cam_loss | 1500 ms | *assumed* (docs/protocol.md, section 3) |",
        f"| delay of a copy | 2 to {settings['delay_ms']} ms, evenly | *assumed* |",
        "| loss | 0 to 60 % of all copies; one in ten is doubled | *assumed* |",
        "| clocks | run alike, so a lease has no margin (ACT-4, `clock_drift` 0) | *assumed* |",
        "| a fault begins | evenly from the request to 12.5 s later; on the road from the"
        " agreement to the end of the lane change | *assumed* |",
        "| a cut or crash lasts | 0.5 to 6 s | *assumed* |",
        "| maneuver, lease (protocol alone) | 2 to 12 s, one in twenty never ends; 10 s |"
        " *assumed* |",
        "| refusals (protocol alone) | one first proposal in five | *assumed* |",
        f"| speeds | {speeds} km/h | *paper* |",
        "| road: the target begins | 0 to 4 m behind the prescriber | *assumed* |",
        "| road: width of a vehicle | 1.8 m | *assumed* |",
        "| road: who is not committed notices late, brakes to a stop | road.py, `Late` |"
        " *assumed* |",
    ]


def _faults(s: Values) -> list[str]:
    head = "drives | agreed | drives with a hazard, 95 % | without excuse | longer than B"
    lines = [
        "",
        "## Hazards by fault",
        "",
        "The whole protocol. A crash of the target counts from the moment it happens.",
        "",
        f"| fault | {head} | median, ms | longest, ms |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [f"| {row['fault']} | {_counts(row)} |" for row in s["faults"]]
    lines += [
        "",
        f"| loss, % | {head} | median, ms | longest, ms |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [f"| {row['loss'] * 100:.0f} | {_counts(row)} |" for row in s["losses"]]
    return [
        *lines,
        "",
        "![Lengths of hazards by fault, as cumulative shares, with the bound B](hazards.svg)",
        "",
        "An abort is told at once, so its hazard lasts for as long as the first Cancel needs to",
        "get through. A restart or a crash is told by nobody: the prescriber waits t_cam_loss from",
        "the last CAM that names the session. The prescriber's own faults make no hazard: what",
        "would be one is that it acts.",
    ]


def _counts(row: Values) -> str:
    return " | ".join(
        (
            str(row["drives"]),
            str(row["agreed"]),
            _share(row["with_hazard"], row["drives"]),
            str(row["unexcused"]),
            str(row["beyond"]),
            _text(row["median_ms"]),
            _text(row["longest_ms"]),
        )
    )


def _share(hits: int, trials: int) -> str:
    low, high = wilson(hits, trials)
    return f"{hits} ({low * 100:.1f} to {high * 100:.1f} %)"


def _text(value: float | str | None) -> str:
    return "-" if value is None else str(value)


def _classes(s: Values) -> list[str]:
    names = list(dict.fromkeys(row["ablation"] for row in s["classes"]))
    lines = [
        "",
        "## Fault classes with a perfect radio",
        "",
        "Longest hazard against the bound of docs/verification.md, section 4 (C: the CAM interval,",
        "D: the delay, L: t_cam_loss, E: the lease).",
        "",
        f"| fault | {' | '.join(names)} |",
        f"|---|{'---:|' * len(names)}",
    ]
    for fault in dict.fromkeys(row["fault"] for row in s["classes"]):
        cells = []
        for name in names:
            row = next(r for r in s["classes"] if (r["fault"], r["ablation"]) == (fault, name))
            mark = "" if row["longest_ms"] <= row["bound_ms"] else " **exceeded**"
            cells.append(
                f"{row['longest_ms']} of {row['formula']} = {row['bound_ms']} ms"
                f" ({row['hazards']} hazards){mark}"
            )
        lines.append(f"| {fault} | {' | '.join(cells)} |")
    return lines


def _mechanisms(s: Values) -> list[str]:
    lines = [
        "",
        "## Without each mechanism",
        "",
        "Faults of all kinds, none, one or two at a time, at any of the losses. *In vain*: the",
        "prescriber finished and the target never learnt it. *Stuck*: a station was still bound,",
        "or sent again, 50 s after the beginning. The last column is computed: hazards that no",
        "theorem allows, stuck stations, and shares whose 95 % intervals are apart from the whole",
        "protocol's.",
        "",
        "| without | rule | model checking breaks | drives | agreed | with a hazard, 95 % |"
        " longest, ms | without excuse | longer than B | completed | in vain | stuck |"
        " what random faults show |",
        f"|---|---|---|{'---:|' * 9}---|",
    ]
    for row in s["mechanisms"]:
        ablation = BY_NAME[row["ablation"]]
        shown = "; ".join(row["shows"])
        if row["rule"] and not shown:
            shown = f"nothing: {ablation.unseen}" if ablation.unseen else "nothing"
        breaks = f"{row['breaks']} (`{row['model']}`)" if row["rule"] else ""
        name = f"{row['ablation']}: {ablation.text}" if row["rule"] else f"*{row['ablation']}*"
        numbers = (
            *(row["drives"], row["agreed"], _share(row["with_hazard"], row["drives"])),
            _text(row["longest_ms"]),
            *(row["unexcused"], row["beyond"], row["completed"], row["in_vain"], row["stuck"]),
        )
        cells = (name, row["rule"], breaks, *(str(n) for n in numbers), shown)
        lines.append(f"| {' | '.join(cells)} |")
    return [
        *lines,
        "",
        "![Longest hazard and share of drives with forbidden hazards without each mechanism]"
        "(mechanisms.svg)",
        "",
        "That a mechanism shows nothing here does not make it superfluous: model checking searches",
        "for the schedule that needs it, and chance meets it rarely. Not tried, because no rule of",
        "a running station is all there is to it: another target after a refusal (NEG-7), no",
        "decide timer and no last round (the applications here always answer), answers with a real",
        "seq (they break nothing, docs/protocol.md, section 8).",
    ]


def _road(s: Values) -> list[str]:
    lines = [
        "",
        "## On the road",
        "",
        "In every drive a fault of the target or the radio, at a moment from the agreement to the",
        "end of the lane change, and a loss of 0, 30 or 60 %. *Room*: along the road, bumper to",
        "bumper, to the nearest vehicle of the other lane when the prescriber begins to move over;",
        "below 0 they are abreast. *Gap* and *time to collision* (TTC): from then on, to vehicles",
        f"whose sides overlap with its own. *Hard*: a receiver brakes harder than {HARD:g} m/s².",
        "*In a hazard*: it moved over while one lasted. *Unasked*: nobody had agreed.",
        "",
        "| protocol | km/h | drives | moved over | in a hazard | unasked | longest hazard, ms |"
        " least room, m | median room, m | room below 2 m, 95 % | abreast | least gap, m |"
        " collisions | least TTC, s | hard |",
        f"|---|{'---:|' * 14}",
    ]
    for row in s["road"]:
        numbers = (
            *(row["speed_kmh"], row["drives"], row["moved"], row["begun"], row["unasked"]),
            row["longest_ms"],
            *(row["least_room_m"], row["median_room_m"], _share(row["near"], row["moved"])),
            row["abreast"],
            *(row["least_gap_m"], row["collisions"], row["least_ttc_s"], row["hard"]),
        )
        lines.append(f"| {row['ablation']} | {' | '.join(_text(n) for n in numbers)} |")
    return [
        *lines,
        "",
        "![Room when the prescriber begins to move over, for each protocol](room.svg)",
        "",
        "A prescriber that is told of the fault before it begins to move over stays in its lane.",
        "One that is not told moves over before a target that has let go and drives on. Without",
        "retransmission the Intention of the vehicle beside it may be lost while others arrive:",
        "then nobody seems to be in the way (*unasked*).",
    ]


def _doubts() -> list[str]:
    return [
        "",
        "## Doubts",
        "",
        "- Loss is independent from copy to copy; a real channel loses in bursts. B does not",
        "  depend on it, how often hazards are does.",
        "- Clocks run alike, as T-2 supposes.",
        "- The road's drivers brake as soon as they notice and never slide, and a vehicle behind",
        "  is no faster than the prescriber. So room tells more than TTC, and that there are few",
        "  collisions or none says little.",
        "- A cut or crash that is over early leads to no fallback and so to no hazard; the shares",
        "  of drives with hazards depend on how long faults are assumed to last.",
    ]
