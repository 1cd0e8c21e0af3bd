"""The lines of an exchange in words."""

from __future__ import annotations

from itertools import pairwise

from pydantic_core import to_json

from automcm_conformance.adapter.protocol import Object, ProtocolError, read_answer
from automcm_conformance.exchange.armed_timers import UNKNOWN
from automcm_conformance.exchange.exchange import Step
from automcm_conformance.exchange.results import Line
from automcm_conformance.exchange.wire import SOON_MS, Required
from automcm_traces.checker.finding import Finding


def finding(found: Finding) -> str:
    """A finding in one line; empty for none."""
    about = found.property or found.at.file
    return f"{about}: {found.observed}" if about else found.observed


def message(m: object) -> str:
    """A message in one line."""
    if not isinstance(m, dict) or not isinstance(m.get("type"), str):
        return to_json(m).decode()
    if m["type"] == "CAM":
        return f"CAM of {m.get('src')}, {m.get('generation_ms')} ms, marks {_text(m.get('marks'))}"
    parts = [m["type"]]
    if "dst" in m:
        parts.append(f"to {_text(m['dst'])}")
    parts.append(f"session {_session(m.get('session'))} seq {_text(m.get('seq'))}")
    if "proposal" in m:
        parts.append(f"proposal {_text(m['proposal'])}")
    if "accepted" in m:
        parts.append("accepted" if m["accepted"] is True else "refused")
    parts += [_text(m["reason"])] if "reason" in m else []
    if isinstance(m.get("of"), dict):
        parts.append(f"of {_text(m['of'].get('type'))} seq {_text(m['of'].get('seq'))}")
    return " ".join(parts)


def _text(value: object) -> str:
    return value if isinstance(value, str) else to_json(value).decode()


def _session(s: object) -> str:
    if isinstance(s, list) and len(s) == 2:
        return f"{_text(s[0])}/{'new' if s[1] is None else _text(s[1])}"
    return _text(s)


def said(c: Object) -> str:
    """A command of the kit in words."""
    match c["cmd"]:
        case "receive":
            m = c["message"]
            src = m.get("src")
            more = ", concerned" if "planned" in c else ""
            return f"receive from {_text(src)}: {message(m)}{more}"
        case "command":
            command = dict(c["command"])
            name = command.pop("name")
            keep = {k: v for k, v in command.items() if k in ("session", "proposal", "target")}
            fields = (f"{k} {_session(v) if k == 'session' else _text(v)}" for k, v in keep.items())
            return f"command {name} {' '.join(fields)}".strip()
        case "durations":
            pairs = (f"{name} {ms} ms" for name, ms in c["durations"].items())
            return f"timers armed from now on last: {', '.join(pairs)}"
        case "reset":
            return f"reset: a new station {c['station']}"
        case "advance":
            return "time passes"
    return str(c["cmd"])


def answered(line: bytes) -> str:
    """An answer of the station in words."""
    try:
        a = read_answer(line)
    except ProtocolError:
        return line[:400].decode(errors="replace")
    parts = [message(m) for m in a.messages]
    parts += [f"indicates {_indication(i)}" for i in a.indications]
    parts += [message(m) for m in a.cams]
    parts += [a.phase] if a.phase is not None else []
    parts.append(f"next deadline {_text(a.deadline)}")
    return "; ".join(parts)


def _indication(i: Object) -> str:
    more = [_text(i[name]) for name in ("reason",) if name in i]
    return " ".join([_text(i["name"]), *more])


def allowed(expected: Required) -> list[str]:
    """The answers that the specification allows, in words."""
    wanted = expected.messages
    begins = sorted({0, *expected.begins, len(wanted)})
    groups = [[message(m) for m in wanted[a:b]] for a, b in pairwise(begins)]
    sent = [" and ".join(each) + " (in any order)" * (len(each) > 1) for each in groups]
    parts = [", then ".join(sent) or "nothing is sent"]
    parts += [f"indicates {_indication(i)}" for i in expected.indications]
    parts.append(expected.phase)
    if expected.deadline != UNKNOWN:
        parts.append(f"next deadline {_text(expected.deadline)}")
    return ["; ".join(parts)]


def answerable(found: Finding) -> list[str]:
    """The expected effects that an answer can hold: an adapter does not report its timers."""
    return [w for w in found.expected if not w.startswith(("arm ", "stop "))]


def exchange(steps: list[Step], *, complete: bool = False) -> list[Line]:
    """Both sides, line by line; unless ``complete``, without the first reset and lines that only
    keep timers long."""
    lines = []
    for n, step in enumerate(steps):
        lasting = step.command.get("durations", {}).values()
        resets = n == 0 and step.command["cmd"] == "reset"
        prepares = resets or (lasting and min(lasting) >= SOON_MS)
        if prepares and not complete and step is not steps[-1]:
            continue
        fault = f"; malformed: {step.fault}" if step.fault else ""
        lines.append(Line(step.now, "kit", f"{said(step.command)}{fault}"))
        silent = step.command["cmd"] in ("durations", "reset") and step is not steps[-1]
        if step.answer and not silent:
            lines.append(Line(step.now, "station", answered(step.answer)))
    return lines
