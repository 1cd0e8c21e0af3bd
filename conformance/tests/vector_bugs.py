"""The bugs that the vectors name, each as an edit of exact_kernels.py or exact_geometry.py."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.vectors import vectors
from automcm_maintenance.exact_vectors import exact_clocks, exact_geometry, exact_kernels

CASES = [case for path in vectors.paths() for case in vectors.load(path)]
SUCCESS = (VECTORS / "success.json").read_text()
SHARE = "share = min(max(share, Fraction(0)), Fraction(1))"
LEAST = "share = min(max(-dot(apart, change) / dot(change, change), Fraction(0)), Fraction(1))"
KEPT = '"kept": kept,'
MOST = '(given["budget"] - overhead) // each'
ALLOWED = "if dot(minus(drive.xy[n], here), minus(drive.xy[n], here)) > position**2:"
TIMES = ("if after <= before:", "if False:")
WIDER = "(greatest(a) + greatest(b)) * clock_error"
IN_FRONT = 'if ahead > 0 or (ahead == 0 and one["station_id"] < leader["station_id"]):'
ZONE = 'if not inside(zone, place(one["xy"])):'
ANSWER = "None if leader is None else"
SLOW = "slow = max(v - delta_v, v_min)"
LONG = "gain / (v - slow)"
STEPS = 'for step in steps(prescribed, planned, limits["reaction"]):'
FOLLOWS = 'if not follows(prescribed, planned, limits["path"] + limits["position_error"]):'
LATERAL = 'if any(each > limits["lateral"] for each in lateral(prescribed)):'
PASSED = "if any(distance(xy, projection(part, xy)[1]) > limit for xy in passed):"
AHEAD = "return between(ORIGIN, minus(drive.xy[n + 1], drive.xy[n]), 1 / length)"
MIDDLES = "return [speed(when + reaction) - speed(when) for when in middles]"
OTHERS = 'for name in ("leader", "follower"):'
RETURN = 'return {"t": t, "xy": [list(each) for each in xy]}'
EXCHANGE = "exchange = 1 - (1 - both) ** sendings"

MUTATIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "convert": {
        "sum-from-zero": (
            "    v = speed[first]\n",
            "    v = speed[first]\n    now += distance(path[0], path[1]) / v\n",
        ),
        "term-without-k": (
            "            now += length / v\n",
            "",
            "            t.append(now)\n            xy",
            "            t.append(now + len(t) * length / v)\n            xy",
        ),
        "speed-of-the-end": ("now += length / v", "now += length / speed[n]"),
        "mean-speed": ("now += length / v", "now += 2 * length / (v + speed[n])"),
        "forgets-t0": ('now = number(given["t0"])', "now = Fraction(0)"),
        "nearest-corner": (SHARE, SHARE + "\n        share = Fraction(round(share))"),
        "endless-line": (SHARE, "share = share + 0"),
        "whole-path": (
            'first, here = projection(path, place(given["position"]))',
            "first, here = 0, path[0]",
        ),
        "later-on-tie": ("away < best", "away <= best"),
        "along-x": ("length = distance(here, path[n])", "length = abs(path[n][0] - here[0])"),
        "sum-of-sides": (
            "length = distance(here, path[n])",
            "length = sum(map(abs, minus(path[n], here)))",
        ),
        "keeps-zero-length": ("        if length:\n", "        if True:\n"),
        "speed-of-the-part-before": (
            "(n + (share == 1), point)",
            "(n, point)",
            "        here, v = path[n], speed[n]",
            "        here, v = path[n], speed[n] if length else v",
        ),
        "forgets-stop": ("Trajectory(t, xy, v < v_eps)", "Trajectory(t, xy, False)"),
        "always-stops": ("Trajectory(t, xy, v < v_eps)", "Trajectory(t, xy, True)"),
        "drives-through-stop": (
            "        if v < v_eps:\n            break",
            "        v = max(v, v_eps)",
        ),
        "stops-at-v-eps": ("        if v < v_eps:", "        if v <= v_eps:"),
        "stops-only-at-zero": ("        if v < v_eps:", "        if v == 0:"),
        "fixed-v-eps": ('v_eps = number(given["v_eps"])', 'v_eps = Fraction("0.1")'),
        "speed-after-projection": ("v = speed[first]", "v = speed[first + 1]"),
        "takes-any-speeds": ("if len(speed) != len(path):", "if False:"),
        "takes-negative-speed": ("if v < 0:", "if False:"),
        "takes-empty-path": ("if not path:", "if False:"),
    },
    "thin": {
        "forgets-last": (KEPT, '"kept": kept[:-1],'),
        "forgets-first": (KEPT, '"kept": kept[1:],'),
        "ends-twice": (KEPT, '"kept": [*kept, len(drive.t) - 1],'),
        "every-fifth": (KEPT, '"kept": sorted({*range(0, len(drive.t), 5), len(drive.t) - 1}),'),
        "step-of-the-start": (
            KEPT,
            '"kept": sorted({*range(0, len(drive.t), kept[1]), len(drive.t) - 1}),',
        ),
        "only-the-middle": ("for n in range(begin, end):", "for n in (begin, (begin + end) // 2):"),
        "thins-nothing": (KEPT, '"kept": list(range(len(drive.t))),'),
        "forgets-speed": ("if abs(v - even) > speed:", "if False:"),
        "across-only": (
            "if abs(v - even) > speed:",
            "if False:",
            ALLOWED,
            "if distance(projection([a, b], drive.xy[n])[1], drive.xy[n]) > position:",
        ),
        "along-only": (
            "even = distance(a, b) / span",
            "even = sum(map(distance, drive.xy[begin:end], drive.xy[begin + 1 : end + 1])) / span",
            ALLOWED,
            "if False:",
        ),
        "velocity-for-speed": (
            "if abs(v - even) > speed:",
            "step = Fraction(1) / (drive.t[n + 1] - drive.t[n])\n"
            "        if distance(between((0, 0), minus(drive.xy[n + 1], drive.xy[n]), step), "
            "between((0, 0), minus(b, a), 1 / span)) > speed:",
        ),
        "step-is-a-speed": (
            "even = distance(a, b) / span",
            "even = distance(drive.xy[begin], drive.xy[begin + 1])",
            " / (drive.t[n + 1] - drive.t[n])\n        if",
            "\n        if",
        ),
        "fixed-bounds": (
            'position, speed = number(given["position"]), number(given["speed"])',
            "position, speed = Fraction(1, 10), Fraction(1, 10)",
        ),
        "one-bound": ("if abs(v - even) > speed:", "if abs(v - even) > position:"),
        "budget-excluded": (MOST, MOST.replace("overhead", "overhead - 1")),
        "ignores-budget": ("while len(kept) > most:", "while False:"),
        "forgets-overhead": (MOST, MOST.replace("overhead", "0")),
        "sends-what-cannot-fit": (
            "if most < min(len(drive.t), 2):",
            "if False:",
            "while len(kept) > most:",
            "while False:",
        ),
        "takes-any-times": TIMES,
        "takes-any-places": ("if len(xy) != len(t):", "if False:"),
        "takes-any-bound": ("if bound <= 0:", "if False:"),
    },
    "collide": {
        "only-at-samples": (LEAST, "share = Fraction(0)"),
        "grid-of-a": ("for when in (*a.t, *b.t)", "for when in a.t"),
        "grid-of-b": ("for when in (*a.t, *b.t)", "for when in b.t"),
        "aligns-starts": (
            "    found = closest(a, b)\n",
            "    b.t[:] = [t - b.t[0] + a.t[0] for t in b.t]\n    found = closest(a, b)\n",
        ),
        "goes-on-forever": ("return None if self.stopped else self.t[-1]", "return None"),
        "open-interval": ("if low <= high else []", "if low < high else []"),
        "forgets-stop": ("return None if self.stopped else self.t[-1]", "return self.t[-1]"),
        "divides-by-zero": ("if dot(change, change):", "if True:"),
        "at-threshold": (
            "if square < limit * limit else",
            "if square <= limit * limit else",
            "if under <= 0 or",
            "if under < 0 or",
        ),
        "ignores-clock-error": (WIDER, "0"),
        "relative-speed": (WIDER, "abs(greatest(a) - greatest(b)) * clock_error"),
        "speed-of-one": (WIDER, "greatest(a) * clock_error"),
        "mean-speed": (
            "return max(drive.speeds(), default=Fraction(0))",
            "return sum(drive.speeds()) / len(drive.speeds())",
        ),
        "clock-error-always": (
            '"distance": root(square)',
            '"distance": root(square) - limit + threshold',
        ),
        "later-on-tie": ("dot(least, least) < best[1]", "dot(least, least) <= best[1]"),
        "first-is-closest": (
            '{"time": since, **places(a, b, since)}',
            '{"time": when, **places(a, b, when)}',
        ),
        "first-is-a-sample": ("return begin + share * (end - begin)", "return begin"),
        "along-x": (
            'xy = [place(each) for each in value["xy"]]',
            'xy = [(number(x), Fraction(0)) for x, _ in value["xy"]]',
        ),
        "takes-any-times": TIMES,
        "takes-any-threshold": ("if threshold < 0:", "if False:"),
        "takes-negative-clock-error": ("if clock_error < 0:", "if False:"),
    },
    "extents": {
        "compares-middles": (
            "return [half * (2 * n + 1 - count) for n in range(count)], radius,",
            "return [Fraction(0)], Fraction(0),",
        ),
        "one-disc-each": ("count = -(-length // width)", "length, count = width, 1"),
        "one-disc-around": ("count = -(-length // width)", "count = 1"),
        "along-x": (AHEAD, "return Fraction(1), Fraction(0)"),
        "only-at-samples": (LEAST, "share = Fraction(0)"),
        "heading-before": ("[*range(now, -1, -1), *range", "[0, *range"),
        "standing-points-east": (
            "[*range(now, -1, -1), *range(max(now, 0), len(drive.t) - 1)]",
            "[now]",
            "    return ORIGIN\n",
            "    return Fraction(1), Fraction(0)\n",
            "now = min(sum(t <= since for t in drive.t), len(drive.t) - 1) - 1",
            "now = sum(t <= since for t in drive.t) - 1\n"
            "    if now == len(drive.t) - 1:\n        return Fraction(1), Fraction(0)",
        ),
        "never-moves-points-east": (
            "if all(xy == drive.xy[0] for xy in drive.xy):",
            "if False:",
            "    return ORIGIN\n",
            "    return Fraction(1), Fraction(0)\n",
        ),
        "length-to-each-side": (
            'length, width = number(extent["length"]),',
            'length, width = 2 * number(extent["length"]),',
        ),
        "forgets-width": ("radius = root(half**2 + side**2)", "radius = half"),
        "rounds-down": ("count = -(-length // width)", "count = length // width"),
        "error-at-the-sides": (
            "for n in range(count)], radius, radius - min(half, side)",
            "for n in range(count)], radius, radius - side",
        ),
        "since-is-closest": ('        "since": since,', '        "since": best[0],'),
        "ignores-margin": (
            "first_below(moving, origin, margin + radii)",
            "first_below(moving, origin, radii)",
        ),
        "later-on-tie": ("(found[1], found[0]) < (best[1], best[0])", "found[1] <= best[1]"),
        "goes-on-forever": ("return None if self.stopped else self.t[-1]", "return None"),
        "takes-any-extent": ("if size <= 0:", "if False:"),
        "takes-any-margin": ("if margin < 0:", "if False:"),
    },
    "discover": {
        "first-of-list": (IN_FRONT, "if False:"),
        "last-of-list": (IN_FRONT, "if True:"),
        "rearmost": (IN_FRONT, "if ahead < 0:"),
        "greatest-x": (IN_FRONT, IN_FRONT.replace("ahead > 0", 'one["xy"][0] > leader["xy"][0]')),
        "greatest-id": (IN_FRONT, 'if one["station_id"] > leader["station_id"]:'),
        "lowest-id": (IN_FRONT, 'if one["station_id"] < leader["station_id"]:'),
        "leader-before-zone": (
            ZONE,
            "if False:",
            ANSWER,
            'None if leader is None or not inside(zone, place(leader["xy"])) else',
        ),
        "ignores-zone": (ZONE, "if False:"),
        "needs-one": (ANSWER, ""),
        "needs-two": (ANSWER, 'None if len(given["candidates"]) < 2 else'),
        "boundary-outside": ("            return True\n", "            return False\n"),
        "tie-by-order": (IN_FRONT, "if ahead > 0:"),
        "tie-by-greater-id": (IN_FRONT, IN_FRONT.replace("<", ">")),
        "bounding-box": (
            "    inside = False\n",
            "    if True:\n"
            "        return all(\n"
            "            min(c[k] for c in zone) <= point[k] <= max(c[k] for c in zone)\n"
            "            for k in (0, 1)\n"
            "        )\n"
            "    inside = False\n",
        ),
        "one-orientation": (
            "inside ^= point[0] < crossing",
            "inside |= along[1] > 0 and point[0] < crossing",
        ),
        "ray-through-corner": (
            "if (a[1] > point[1]) != (b[1] > point[1]):",
            "if along[1] and min(a[1], b[1]) <= point[1] <= max(a[1], b[1]):",
        ),
        "counts-closing-corner": ("if zone[:1] == zone[1:][-1:]:", "if False:"),
        "takes-any-zone": ("if len(zone) < 3:", "if False:"),
    },
    "prescribe": {
        "gain-by-speed": (LONG, "gain / v"),
        "fixed-delta": (
            'delta_v, v_min = number(given["delta_v"])',
            "delta_v, v_min = Fraction(50, 9)",
        ),
        "starts-at-once": ("action = start + hold", "action = start"),
        "stays-slow": ("(over, end, v)", "(over, end, slow)"),
        "factor-for-difference": (SLOW, "slow = v * Fraction(3, 5)"),
        "cuts-corners": (
            RETURN,
            "    kept = [n for n, when in enumerate(t) if when in (start, action, over, end)]\n"
            '    return {"t": [t[n] for n in kept], "xy": [list(xy[n]) for n in kept]}',
        ),
        "gains-place": (
            SLOW,
            "slow = v + delta_v",
            "if slow >= v:",
            "if False:",
            LONG,
            "gain / delta_v",
        ),
        "no-lowest-speed": (SLOW, "slow = v - delta_v"),
        "clamped-too-short": (LONG, "gain / delta_v"),
        "loses-the-stand": ("        if not speed:\n", "        if False:\n"),
        "fixed-gain": (LONG, "20 / (v - slow)"),
        "from-planned-begin": ("action = start + hold", "action = planned.t[0] + hold"),
        "sends-too-short": ("if over > end:", "if False:"),
        "refuses-just-long": ("if over > end:", "if over >= end:"),
        "gains-nothing": ("if slow >= v:", "if False:"),
        "takes-any-delta": ("if delta_v <= 0:", "if False:"),
        "takes-negative-hold": ("if hold < 0:", "if False:"),
        "takes-any-start": ("if not planned.t[0] <= start <= planned.t[-1]:", "if False:"),
    },
    "verify": {
        "refuses-steps": (STEPS, 'limits["reaction"] = Fraction(1, 10)\n    ' + STEPS),
        "same-time-same-place": (
            FOLLOWS,
            "if any(distance(planned.at(t), x) > limits['path'] "
            "for t, x in zip(prescribed.t, prescribed.xy)):",
        ),
        "takes-old": ('if now - prescribed.t[0] > limits["age"]:', "if False:"),
        "takes-ended": ("if prescribed.end is not None and now >= prescribed.end:", "if False:"),
        "refuses-begun": ('if now - prescribed.t[0] > limits["age"]:', "if now > prescribed.t[0]:"),
        "takes-any-start": ("if not there or distance(", "if 0 * distance("),
        "starts-now": ("planned.at(since)) >", "planned.at(now)) >"),
        "takes-any-path": (FOLLOWS, "if False:"),
        "path-at-samples": (PASSED, "if False:"),
        "path-exactly": ("if distance(here, foot) > limit:", "if here != foot:"),
        "goes-back": ("if feet[n] < max(feet) - limit:", "if False:"),
        "ignores-thinning": (FOLLOWS, 'if not follows(prescribed, planned, limits["path"]):'),
        "thinning-twice": (FOLLOWS, FOLLOWS.replace('limits["pos', '2 * limits["pos')),
        "skips-a-part": (PASSED, "if False:"),
        "ignores-speed-error": ('limits["v_max"] + limits["speed_error"]', 'limits["v_max"]'),
        "speed-error-once": (
            'if step < -limits["deceleration"] * limits["reaction"] - 2 * ',
            'if step < -limits["deceleration"] * limits["reaction"] - ',
        ),
        "takes-any-lateral": (LATERAL, "if False:"),
        "braking-is-lateral": (
            "across = abs(along[0] * bend[1] - along[1] * bend[0])",
            "across = distance((0, 0), bend) * distance(a, c)",
        ),
        "lateral-without-speed": (
            "/ distance(a, c) / TURN**2",
            "/ distance(a, c) * 576 / dot(along, along)",
        ),
        "lateral-in-the-mean": (
            LATERAL,
            'if (across := lateral(prescribed)) and sum(across) / len(across) > limits["lateral"]:',
        ),
        "lateral-to-the-left": ("across = abs(along[0] *", "across = (along[0] *"),
        "lateral-at-one-step": ("TURN = Fraction(1)", "TURN = Fraction(1, 100)"),
        "takes-any-speed": ("slowest <= v <= fastest", "slowest <= v"),
        "takes-any-slowness": ("slowest <= v <= fastest", "v <= fastest"),
        "speed-of-the-whole": (
            "<= fastest for v in prescribed.speeds()):",
            "<= fastest for v in [sum(map(distance, prescribed.xy, prescribed.xy[1:]))"
            " / (prescribed.t[-1] - prescribed.t[0])]):",
        ),
        "speed-at-limit": ("slowest <= v <= fastest", "slowest <= v < fastest"),
        "takes-any-acceleration": (STEPS, "for step in ():"),
        "one-bound": ('if step > limits["acceleration"]', 'if step > limits["deceleration"]'),
        "each-step-alone": (MIDDLES, "return [b - a for a, b in pairwise(speeds)]"),
        "sums-all-steps": (MIDDLES, "return [speeds[-1] - speeds[0]]"),
        "forgets-speed-before": (
            "planned.speeds()[n - 1] if 0 < n < len(planned.t) else speeds[0]",
            "speeds[0]",
        ),
        "forgets-stop": ("Fraction(0) if prescribed.stopped else speeds[-1]", "speeds[-1]"),
        "takes-any-leader": (OTHERS, 'for name in ("follower",):'),
        "takes-any-follower": (OTHERS, 'for name in ("leader",):'),
        "gap-of-the-plan": ("if near(prescribed, trajectory", "if near(planned, trajectory"),
        "gap-at-own-samples": (
            "found = closest(rest, other)",
            "found = min((0, distance(rest.at(t), other.at(t)) ** 2) for t in rest.t)",
        ),
        "gap-in-the-past": ("since, limits[f", "prescribed.t[0], limits[f"),
        "gap-at-limit": ("found[1] < gap * gap", "found[1] <= gap * gap"),
        "leader-never-stands": ("return None if self.stopped else self.t[-1]", "return self.t[-1]"),
        "gaps-exchanged": (
            'limits[f"{name}_gap"]',
            'limits["follower_gap" if name == "leader" else "leader_gap"]',
        ),
        "first-reason": ("sorted(reasons)", "sorted(reasons)[:1]"),
        "takes-any-times": TIMES,
        "takes-any-limits": ("if value < 0:", "if False:"),
    },
    "success": {
        "no-first-sending": ("1 + t_timeout // t_resend", "t_timeout // t_resend"),
        "fractional-exponent": ("1 + t_timeout // t_resend", "1 + t_timeout / t_resend"),
        "rounds-up": ("1 + t_timeout // t_resend", "1 - (-t_timeout // t_resend)"),
        "one-way": (EXCHANGE, "exchange = 1 - loss**sendings"),
        "success-of-loss": ("both = (1 - loss) ** 2", "both = 1 - loss**2"),
        "swaps-loss": ('loss = number(given["loss"])', 'loss = 1 - number(given["loss"])'),
        "one-exchange": ("exchange**3", "exchange"),
        "two-exchanges": ("exchange**3", "exchange**2"),
        "power-of-loss": (EXCHANGE, "exchange = (1 - loss**sendings) ** 2"),
        "takes-any-loss": ("if not 0 <= loss <= 1:", "if False:"),
        "takes-no-resend": ("if t_resend <= 0:", "if False:"),
        "takes-negative-timeout": ("if t_timeout < 0:", "if False:"),
    },
    "clock": {
        "takes-no-cam": ("if least is None:", "if False:"),
        "sign-error": (
            "low = generated - received - rounded_up(age * drift)",
            "low = received - generated - rounded_up(age * drift)",
            "high = generated - received + delay",
            "high = received - generated + delay",
        ),
        "no-delay": ("received + delay +", "received +"),
        "delay-both-ways": ("low = generated - received", "low = generated - received - delay"),
        "no-intersection": ('cams = given["cams"]', 'cams = given["cams"][-1:]'),
        "no-drift": ("(hundredths + 99) // 100", "0"),
        "drift-rounds-down": ("(hundredths + 99) // 100", "hundredths // 100"),
        "drift-narrows": ("(hundredths + 99) // 100", "-(hundredths + 99) // 100"),
        "late-cam-counts": ("late = high < least", "late = False"),
        "no-late-boundary": ("late = high < least", "late = high <= least"),
        "no-window": (
            "if age <= 2000 and not late:",
            "if not late:",
            "if age <= 2000:",
            "if True:",
        ),
        "window-exclusive": (
            "if age <= 2000 and",
            "if age < 2000 and",
            "if age <= 2000:",
            "if age < 2000:",
        ),
        "boundary-exclusive": (
            "least <= 100 and greatest >= -100",
            "least < 100 and greatest > -100",
        ),
        "one-sided": ("least <= 100 and greatest >= -100", "least <= 100"),
        "middle-decides": (
            "in_step = least <= 100 and greatest >= -100",
            "in_step = abs(least + greatest) <= 200",
        ),
    },
}
"""By kernel and name: an old text and the new one, and so on."""


IMPORT = re.compile(
    r"from automcm_maintenance.exact_vectors.exact_\w+ import (\(.*?\)|[^(]*?)\n", re.DOTALL
)


def mutated(kernel: str, bug: str) -> vectors.Call:
    """The exact implementation with this bug."""
    first, *others = (
        Path(module.__file__).read_text()
        for module in (exact_geometry, exact_clocks, exact_kernels)
    )
    more = IMPORT.sub("", "".join(others)).replace("from __future__", "# from __future__")
    source = first + more
    texts = MUTATIONS[kernel][bug]
    for old, new in zip(texts[::2], texts[1::2], strict=True):
        assert source.count(old) == 1, f"{kernel}: {bug}: {source.count(old)} times {old!r}"
        source = source.replace(old, new)
    module: dict[str, Any] = {"__name__": exact_kernels.__name__}
    exec(compile(source, f"<exact with {bug}>", "exec"), module)
    call: Callable[[str, Any], Any] = module["call"]
    return call
