"""The test vectors: that they are as generated, what they catch, and what a bad file says."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import jsonschema
import mpmath
import pytest
import shapely
from typer.testing import CliRunner

from automcm import vector_adapter
from automcm_cli import vectors as command
from automcm_conformance import exact, vectors

Replacements = tuple[tuple[str, str], ...]
CASES = [case for path in vectors.paths() for case in vectors.load(path)]
BUGS = {
    vector["id"]: vector["bug"]
    for path in vectors.paths()
    for vector in json.loads(path.read_text())["vectors"]
}
SUCCESS = (vectors.FOLDER / "success.json").read_text()
SHARE = "share = min(max(share, Fraction(0)), Fraction(1))"
LEAST = "share = min(max(-dot(apart, change) / dot(change, change), Fraction(0)), Fraction(1))"
KEPT = "sorted({*range(0, last + 1, every), 0, last, *changes(drive)})"
CHANGES = "return [n for n in range(1, len(drive.t) - 1) if speeds[n - 1] != speeds[n]]"
TIMES = ("if after <= before:", "if False:")
WIDER = "(greatest(a) + greatest(b)) * clock_error"
IN_FRONT = 'if ahead > 0 or (ahead == 0 and one["station_id"] < leader["station_id"]):'
ZONE = 'if not inside(zone, place(one["xy"])):'
ANSWER = "None if leader is None else"
SLOW = "slow = max(v - delta_v, v_min)"
LONG = "gain / (v - slow)"
STEPS = 'for step in steps(prescribed, planned, limits["reaction"]):'
FOLLOWS = 'if not follows(prescribed, planned, limits["path"]):'
MIDDLES = "return [speed(when + reaction) - speed(when) for when in middles]"
OTHERS = 'for name in ("leader", "follower"):'
RETURN = 'return {"t": t, "xy": [list(each) for each in xy]}'
EXCHANGE = "exchange = 1 - (1 - both) ** sendings"

MUTATIONS: dict[str, dict[str, Replacements]] = {
    "convert": {
        "sum-from-zero": (
            (
                "    v = speed[first]\n",
                "    v = speed[first]\n    now += distance(path[0], path[1]) / v\n",
            ),
        ),
        "term-without-k": (
            ("            now += length / v\n", ""),
            (
                "            t.append(now)\n            xy",
                "            t.append(now + len(t) * length / v)\n            xy",
            ),
        ),
        "speed-of-the-end": (("now += length / v", "now += length / speed[n]"),),
        "mean-speed": (("now += length / v", "now += 2 * length / (v + speed[n])"),),
        "forgets-t0": (('now = number(given["t0"])', "now = Fraction(0)"),),
        "nearest-corner": ((SHARE, SHARE + "\n        share = Fraction(round(share))"),),
        "endless-line": ((SHARE, "share = share + 0"),),
        "whole-path": (
            (
                'first, here = projection(path, place(given["position"]))',
                "first, here = 0, path[0]",
            ),
        ),
        "later-on-tie": (("away < best", "away <= best"),),
        "along-x": (("length = distance(here, path[n])", "length = abs(path[n][0] - here[0])"),),
        "sum-of-sides": (
            ("length = distance(here, path[n])", "length = sum(map(abs, minus(path[n], here)))"),
        ),
        "keeps-zero-length": (("        if length:\n", "        if True:\n"),),
        "speed-of-the-part-before": (
            ("(n + (share == 1), point)", "(n, point)"),
            (
                "        here, v = path[n], speed[n]",
                "        here, v = path[n], speed[n] if length else v",
            ),
        ),
        "forgets-stop": (("Trajectory(t, xy, v < v_eps)", "Trajectory(t, xy, False)"),),
        "always-stops": (("Trajectory(t, xy, v < v_eps)", "Trajectory(t, xy, True)"),),
        "drives-through-stop": (
            ("        if v < v_eps:\n            break", "        v = max(v, v_eps)"),
        ),
        "stops-at-v-eps": (("        if v < v_eps:", "        if v <= v_eps:"),),
        "stops-only-at-zero": (("        if v < v_eps:", "        if v == 0:"),),
        "fixed-v-eps": (('v_eps = number(given["v_eps"])', 'v_eps = Fraction("0.1")'),),
        "speed-after-projection": (("v = speed[first]", "v = speed[first + 1]"),),
        "takes-any-speeds": (("if len(speed) != len(path):", "if False:"),),
        "takes-negative-speed": (("if v < 0:", "if False:"),),
        "takes-empty-path": (("if not path:", "if False:"),),
    },
    "thin": {
        "forgets-last": ((KEPT, "sorted({*range(0, last + 1, every), *changes(drive)})"),),
        "forgets-first": ((KEPT, "sorted({*range(every, last + 1, every), last})"),),
        "ends-twice": ((KEPT, "sorted([*range(0, last + 1, every), last])"),),
        "counts-from-one": ((KEPT, "sorted({*range(every - 1, last + 1, every), 0, last})"),),
        "forgets-speed-change": ((KEPT, "sorted({*range(0, last + 1, every), 0, last})"),),
        "fixed-ratio": (('every, budget = given["every"]', "every, budget = 5"),),
        "budget-excluded": (("if len(kept) <= most:", "if len(kept) < most:"),),
        "ignores-budget": (("if len(kept) <= most:", "if True:"),),
        "forgets-overhead": (("(budget - overhead) // each", "budget // each"),),
        "sends-what-cannot-fit": (("if most < len({0, last}):", "if False:"),),
        "turn-is-a-change": (
            (
                CHANGES,
                "return [n for n in range(1, len(drive.t) - 1) if minus(drive.xy[n], "
                "drive.xy[n - 1]) != minus(drive.xy[n + 1], drive.xy[n])]",
            ),
        ),
        "step-is-a-speed": (
            (
                "speeds = drive.speeds()\n",
                "speeds = [distance(a, b) for a, b in pairwise(drive.xy)]\n",
            ),
        ),
        "takes-any-times": (TIMES,),
        "takes-any-places": (("if len(xy) != len(t):", "if False:"),),
        "every-zero": (("if every < 1:", "if False:"),),
    },
    "collide": {
        "only-at-samples": ((LEAST, "share = Fraction(0)"),),
        "grid-of-a": (("for when in (*a.t, *b.t)", "for when in a.t"),),
        "grid-of-b": (("for when in (*a.t, *b.t)", "for when in b.t"),),
        "aligns-starts": (
            (
                "    found = closest(a, b)\n",
                "    b.t[:] = [t - b.t[0] + a.t[0] for t in b.t]\n    found = closest(a, b)\n",
            ),
        ),
        "goes-on-forever": (("return None if self.stopped else self.t[-1]", "return None"),),
        "open-interval": (("if low <= high else []", "if low < high else []"),),
        "forgets-stop": (("return None if self.stopped else self.t[-1]", "return self.t[-1]"),),
        "divides-by-zero": (("if dot(change, change):", "if True:"),),
        "at-threshold": (
            ("if square < limit * limit else", "if square <= limit * limit else"),
            ("if under <= 0 or", "if under < 0 or"),
        ),
        "ignores-clock-error": ((WIDER, "0"),),
        "relative-speed": ((WIDER, "abs(greatest(a) - greatest(b)) * clock_error"),),
        "speed-of-one": ((WIDER, "greatest(a) * clock_error"),),
        "mean-speed": (
            (
                "return max(drive.speeds(), default=Fraction(0))",
                "return sum(drive.speeds()) / len(drive.speeds())",
            ),
        ),
        "clock-error-always": (
            ('"distance": root(square)', '"distance": root(square) - limit + threshold'),
        ),
        "later-on-tie": (("dot(least, least) < best[1]", "dot(least, least) <= best[1]"),),
        "first-is-closest": (
            (
                '{"time": since, **places(a, b, since)}',
                '{"time": when, **places(a, b, when)}',
            ),
        ),
        "first-is-a-sample": (("return begin + share * (end - begin)", "return begin"),),
        "along-x": (
            (
                'xy = [place(each) for each in value["xy"]]',
                'xy = [(number(x), Fraction(0)) for x, _ in value["xy"]]',
            ),
        ),
        "takes-any-times": (TIMES,),
        "takes-any-threshold": (("if threshold < 0:", "if False:"),),
        "takes-negative-clock-error": (("if clock_error < 0:", "if False:"),),
    },
    "discover": {
        "first-of-list": ((IN_FRONT, "if False:"),),
        "last-of-list": ((IN_FRONT, "if True:"),),
        "rearmost": ((IN_FRONT, "if ahead < 0:"),),
        "greatest-x": (
            (IN_FRONT, IN_FRONT.replace("ahead > 0", 'one["xy"][0] > leader["xy"][0]')),
        ),
        "greatest-id": ((IN_FRONT, 'if one["station_id"] > leader["station_id"]:'),),
        "lowest-id": ((IN_FRONT, 'if one["station_id"] < leader["station_id"]:'),),
        "leader-before-zone": (
            (ZONE, "if False:"),
            (ANSWER, 'None if leader is None or not inside(zone, place(leader["xy"])) else'),
        ),
        "ignores-zone": ((ZONE, "if False:"),),
        "needs-one": ((ANSWER, ""),),
        "needs-two": ((ANSWER, 'None if len(given["candidates"]) < 2 else'),),
        "boundary-outside": (("            return True\n", "            return False\n"),),
        "tie-by-order": ((IN_FRONT, "if ahead > 0:"),),
        "tie-by-greater-id": ((IN_FRONT, IN_FRONT.replace("<", ">")),),
        "bounding-box": (
            (
                "    odd = False\n",
                "    if True:\n"
                "        return all(\n"
                "            min(c[k] for c in zone) <= point[k] <= max(c[k] for c in zone)\n"
                "            for k in (0, 1)\n"
                "        )\n"
                "    odd = False\n",
            ),
        ),
        "one-orientation": (
            ("odd ^= point[0] < crossing", "odd |= along[1] > 0 and point[0] < crossing"),
        ),
        "ray-through-corner": (
            (
                "if (a[1] > point[1]) != (b[1] > point[1]):",
                "if along[1] and min(a[1], b[1]) <= point[1] <= max(a[1], b[1]):",
            ),
        ),
        "counts-closing-corner": (("if zone[:1] == zone[1:][-1:]:", "if False:"),),
        "takes-any-zone": (("if len(zone) < 3:", "if False:"),),
    },
    "prescribe": {
        "gain-by-speed": ((LONG, "gain / v"),),
        "fixed-delta": (
            ('delta_v, v_min = number(given["delta_v"])', "delta_v, v_min = Fraction(50, 9)"),
        ),
        "starts-at-once": (("action = start + hold", "action = start"),),
        "stays-slow": (("(over, end, v)", "(over, end, slow)"),),
        "factor-for-difference": ((SLOW, "slow = v * Fraction(3, 5)"),),
        "cuts-corners": (
            (
                RETURN,
                "    kept = [n for n, when in enumerate(t) if when in (start, action, over, end)]\n"
                '    return {"t": [t[n] for n in kept], "xy": [list(xy[n]) for n in kept]}',
            ),
        ),
        "gains-place": (
            (SLOW, "slow = v + delta_v"),
            ("if slow >= v:", "if False:"),
            (LONG, "gain / delta_v"),
        ),
        "no-lowest-speed": ((SLOW, "slow = v - delta_v"),),
        "clamped-too-short": ((LONG, "gain / delta_v"),),
        "loses-the-stand": (("        if not speed:\n", "        if False:\n"),),
        "fixed-gain": ((LONG, "20 / (v - slow)"),),
        "from-planned-begin": (("action = start + hold", "action = planned.t[0] + hold"),),
        "sends-too-short": (("if over > end:", "if False:"),),
        "refuses-just-long": (("if over > end:", "if over >= end:"),),
        "gains-nothing": (("if slow >= v:", "if False:"),),
        "takes-any-delta": (("if delta_v <= 0:", "if False:"),),
        "takes-negative-hold": (("if hold < 0:", "if False:"),),
        "takes-any-start": (("if not planned.t[0] <= start <= planned.t[-1]:", "if False:"),),
    },
    "verify": {
        "refuses-steps": ((STEPS, 'limits["reaction"] = Fraction(1, 10)\n    ' + STEPS),),
        "same-time-same-place": (
            (
                FOLLOWS,
                "if any(distance(planned.at(t), x) > limits['path'] "
                "for t, x in zip(prescribed.t, prescribed.xy)):",
            ),
        ),
        "takes-old": (('if now - prescribed.t[0] > limits["age"]:', "if False:"),),
        "takes-ended": (("if prescribed.end is not None and now >= prescribed.end:", "if False:"),),
        "refuses-begun": (
            ('if now - prescribed.t[0] > limits["age"]:', "if now > prescribed.t[0]:"),
        ),
        "takes-any-start": (("if not there or distance(", "if 0 * distance("),),
        "starts-now": (("planned.at(since)) >", "planned.at(now)) >"),),
        "takes-any-path": ((FOLLOWS, "if False:"),),
        "path-at-samples": (("for part in range(PARTS + 1):", "for part in (0, PARTS):"),),
        "path-exactly": (("if distance(here, foot) > limit:", "if here != foot:"),),
        "goes-back": (("if way < furthest - limit:", "if False:"),),
        "takes-any-speed": ((' <= v <= limits["v_max"]', " <= v"),),
        "takes-any-slowness": (('limits["v_min"] <= v <= ', "v <= "),),
        "speed-of-the-whole": (
            (
                'limits["v_max"] for v in prescribed.speeds()):',
                'limits["v_max"] for v in [sum(map(distance, prescribed.xy, prescribed.xy[1:]))'
                " / (prescribed.t[-1] - prescribed.t[0])]):",
            ),
        ),
        "speed-at-limit": ((' <= v <= limits["v_max"]', ' <= v < limits["v_max"]'),),
        "takes-any-acceleration": ((STEPS, "for step in ():"),),
        "one-bound": (('if step > limits["acceleration"]', 'if step > limits["deceleration"]'),),
        "each-step-alone": ((MIDDLES, "return [b - a for a, b in pairwise(speeds)]"),),
        "sums-all-steps": ((MIDDLES, "return [speeds[-1] - speeds[0]]"),),
        "forgets-speed-before": (
            ("planned.speeds()[n - 1] if 0 < n < len(planned.t) else speeds[0]", "speeds[0]"),
        ),
        "forgets-stop": (("Fraction(0) if prescribed.stopped else speeds[-1]", "speeds[-1]"),),
        "takes-any-leader": ((OTHERS, 'for name in ("follower",):'),),
        "takes-any-follower": ((OTHERS, 'for name in ("leader",):'),),
        "gap-of-the-plan": (("if near(prescribed, trajectory", "if near(planned, trajectory"),),
        "gap-at-own-samples": (
            (
                "found = closest(rest, other)",
                "found = min((0, distance(rest.at(t), other.at(t)) ** 2) for t in rest.t)",
            ),
        ),
        "gap-in-the-past": (("since, limits[f", "prescribed.t[0], limits[f"),),
        "gap-at-limit": (("found[1] < gap * gap", "found[1] <= gap * gap"),),
        "leader-never-stands": (
            ("return None if self.stopped else self.t[-1]", "return self.t[-1]"),
        ),
        "gaps-exchanged": (
            (
                'limits[f"{name}_gap"]',
                'limits["follower_gap" if name == "leader" else "leader_gap"]',
            ),
        ),
        "first-reason": (("sorted(reasons)", "sorted(reasons)[:1]"),),
        "takes-any-times": (TIMES,),
        "takes-any-limits": (("if value < 0:", "if False:"),),
    },
    "success": {
        "no-first-sending": (("1 + t_timeout // t_resend", "t_timeout // t_resend"),),
        "fractional-exponent": (("1 + t_timeout // t_resend", "1 + t_timeout / t_resend"),),
        "rounds-up": (("1 + t_timeout // t_resend", "1 - (-t_timeout // t_resend)"),),
        "one-way": ((EXCHANGE, "exchange = 1 - loss**sendings"),),
        "success-of-loss": (("both = (1 - loss) ** 2", "both = 1 - loss**2"),),
        "swaps-loss": (('loss = number(given["loss"])', 'loss = 1 - number(given["loss"])'),),
        "one-exchange": (("exchange**3", "exchange"),),
        "two-exchanges": (("exchange**3", "exchange**2"),),
        "power-of-loss": ((EXCHANGE, "exchange = (1 - loss**sendings) ** 2"),),
        "takes-any-loss": (("if not 0 <= loss <= 1:", "if False:"),),
        "takes-no-resend": (("if t_resend <= 0:", "if False:"),),
        "takes-negative-timeout": (("if t_timeout < 0:", "if False:"),),
    },
}


def mutated(kernel: str, bug: str) -> vectors.Call:
    """The exact implementation with this bug."""
    source = Path(exact.__file__).read_text()
    for old, new in MUTATIONS[kernel][bug]:
        assert source.count(old) == 1, f"{kernel}: {bug}: {source.count(old)} times {old!r}"
        source = source.replace(old, new)
    module: dict[str, Any] = {"__name__": exact.__name__}
    exec(compile(source, f"exact with {bug}", "exec"), module)
    call: Callable[[str, Any], Any] = module["call"]
    return call


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_every_vector_catches_the_bug_it_names(case: vectors.Case) -> None:
    [result] = vectors.check(mutated(case.kernel, BUGS[case.id]), [case])
    assert not result.ok


def test_no_mutation_is_left_without_a_vector() -> None:
    for kernel, bugs in MUTATIONS.items():
        assert set(bugs) == {BUGS[case.id] for case in CASES if case.kernel == kernel}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_the_reference_agrees(case: vectors.Case) -> None:
    [result] = vectors.check(vector_adapter.call, [case])
    assert result.ok, result.problem


def test_at_least_fifteen_of_each_kernel_with_errors_among_them() -> None:
    for kernel in vectors.KERNELS:
        mine = [case for case in CASES if case.kernel == kernel]
        assert len(mine) >= 15
        assert any("error" in case.expected for case in mine)


def test_the_files_are_what_would_be_generated() -> None:
    for path, text in vectors.texts().items():
        assert path.read_text() == text, f"{path.name}: run automcm generate"


def test_what_is_expected_is_filled_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(vectors.FOLDER, tmp_path, dirs_exist_ok=True)
    right = vectors.texts()[vectors.FOLDER / "success.json"]
    monkeypatch.setattr(vectors, "FOLDER", tmp_path)
    path = written(tmp_path, lambda file: [each.pop("expected") for each in file["vectors"]])
    assert vectors.texts()[path] == right
    for change in (lambda file: file.pop("vectors"), lambda file: file["vectors"].append(7)):
        with pytest.raises(vectors.VectorError, match=r"success\.json: vectors"):
            written(tmp_path, change)
            vectors.texts()


def test_the_schema_fits_the_files() -> None:
    schema = json.loads((vectors.FOLDER / vectors.SCHEMA).read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in vectors.paths():
        file = json.loads(path.read_text())
        jsonschema.validate(file, schema)
        del file["vectors"][0]["purpose"]
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(file, schema)


def test_the_folder_holds_nothing_else() -> None:
    found = {path for path in vectors.FOLDER.iterdir() if path.suffix == ".json"}
    assert found == {*vectors.paths(), vectors.FOLDER / vectors.SCHEMA}


# -- the exact implementation against others


def test_figures_of_the_paper_and_of_the_design() -> None:
    loss = {(0, 0.1): 53, (1000, 0.5): 88, (1000, 0.6): 62}
    loss |= {(2000, 0.6): 92, (2000, 0.7): 64, (2000, 0.8): 19}
    for (t_timeout, share), per_cent in loss.items():
        given = {"t_timeout": t_timeout, "t_resend": 100, "loss": share}
        assert round(100 * exact.call("success", given)["session"]) == per_cent
    t = next(case for case in CASES if case.id == "prescribe-thirty").expected["t"]
    assert min(abs(when - (2 + 3.6)) for when in t) < 1e-9


def test_root_against_mpmath() -> None:
    draw = random.Random(1)
    with mpmath.workdps(80):
        for _ in range(200):
            value = Fraction(draw.randrange(10**9), draw.randrange(1, 10**6))
            right = mpmath.sqrt(mpmath.mpf(value.numerator) / value.denominator)
            mine = exact.root(value)
            assert (
                abs(mpmath.mpf(mine.numerator) / mine.denominator - right) < mpmath.mpf(10) ** -50
            )
    assert exact.root(Fraction(9, 4)) == Fraction(3, 2)


def test_inside_against_shapely() -> None:
    draw = random.Random(2)
    zone = [(0, 0), (40, 0), (40, 20), (20, 20), (20, 10), (0, 10)]
    polygon = shapely.Polygon(zone)
    corners = [exact.place(each) for each in zone]
    for _ in range(500):
        point = draw.randrange(-5, 46), draw.randrange(-5, 26)
        mine = exact.inside(corners, exact.place(point))
        assert mine == polygon.covers(shapely.Point(point)), point


def test_closest_against_a_fine_grid() -> None:
    for case in CASES:
        if case.kernel != "collide" or not case.expected.get("approach"):
            continue
        a, b = (exact.trajectory(case.inputs[name]) for name in "ab")
        grid = exact.common(a, b)
        least = case.expected["approach"]["distance"]
        for n in range(401):
            when = grid[0] + (grid[-1] - grid[0]) * Fraction(n, 400)
            assert float(exact.distance(a.at(when), b.at(when))) >= least - 1e-9


# -- bad files


def written(folder: Path, change: Callable[[Any], object]) -> Path:
    file = json.loads(SUCCESS)
    change(file)
    path = folder / "success.json"
    path.write_text(json.dumps(file))
    return path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: f.pop("schema"), "success.json: schema: Field required"),
        (lambda f: f.update(schema="automcm.vectors/2"), "success.json: schema: "),
        (lambda f: f.update(kernel="guess"), "success.json: "),
        (lambda f: f.update(vectors={}), "success.json: vectors: "),
        (lambda f: f["vectors"][2].pop("bug"), "success-one-second: bug: Field required"),
        (lambda f: f["vectors"][2].pop("id"), "success.json: vectors.2: id: Field required"),
        (lambda f: f["vectors"].append(7), "success.json: vectors.21: "),
        (lambda f: f["vectors"][0]["inputs"].update(loss="a"), "success-once: inputs.loss: "),
        (lambda f: f["vectors"][0]["inputs"].update(los=1), "success-once: inputs.los: Extra"),
        (lambda f: f["vectors"][0]["expected"].pop("session"), "success-once: expected"),
        (lambda f: f["vectors"][1].update(id="success-once"), "success-once: id: used twice"),
        (lambda f: f["vectors"][1].update(id="once"), "once: id: does not start with success-"),
        (lambda f: f["vectors"][1].update(bug="none"), "success-once-without-loss: bug: none is"),
        (lambda f: f["bugs"].update(other="x"), "success.json: bugs.other: no vector"),
        (lambda f: f["tolerance"].update(message=-1), "success.json: tolerance.message: "),
    ],
)
def test_a_bad_file_says_where(tmp_path: Path, change: Callable[[Any], object], says: str) -> None:
    with pytest.raises(vectors.VectorError) as error:
        vectors.load(written(tmp_path, change))
    assert says in str(error.value) and str(error.value).startswith("success.json: ")


def test_other_bad_files(tmp_path: Path) -> None:
    with pytest.raises(vectors.VectorError, match=r"none\.json: No such file"):
        vectors.load(tmp_path / "none.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(vectors.VectorError, match=r"bad\.json: no JSON"):
        vectors.load(tmp_path / "bad.json")
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(vectors.VectorError, match=r"list\.json: "):
        vectors.load(tmp_path / "list.json")
    (tmp_path / "thin.json").write_text((vectors.FOLDER / "success.json").read_text())
    with pytest.raises(vectors.VectorError, match=r"thin\.json: kernel: holds success"):
        vectors.load(tmp_path / "thin.json")


# -- comparison


def of(id_: str) -> vectors.Case:
    return next(case for case in CASES if case.id == id_)


@pytest.mark.parametrize(
    ("id_", "got", "says"),
    [
        ("success-once", None, "outputs: expected"),
        ("success-once", {"sendings": 1}, "outputs: expected"),
        ("success-no-resend", {"sendings": 1}, "error: expected for t_resend, got none"),
        ("success-no-resend", {"error": "t_resend"}, "error: expected for t_resend, got none"),
        ("success-no-resend", {"error": {"name": "loss"}}, "error: expected t_resend, got loss"),
        (
            "convert-negative-speed",
            {"error": {"name": "speed", "index": 1}},
            "error: expected speed[2], got speed[1]",
        ),
        ("success-once", {"error": {"name": "loss"}}, "error: expected none"),
        ("thin-one-byte-short", {"kept": "all"}, "kept: expected indices"),
        ("thin-one-byte-short", {"kept": [0, 8, 4, 16]}, "kept: expected indices that rise"),
        ("thin-one-byte-short", {"kept": [0, 1, 2, 3, 16]}, "kept: expected 4 points at most"),
        ("thin-one-byte-short", {"kept": [0, 5, 10]}, "kept: expected also [16]"),
        ("thin-one-byte-short", {"kept": [0, 5, 10, 16]}, ""),
        ("prescribe-even", {"t": [0]}, "outputs: no motion"),
        ("prescribe-even", {"t": [0, 0], "xy": [[0, 0], [1, 0]]}, "t: expected times that rise"),
        ("prescribe-even", {"t": [0, 9], "xy": [[0, 0], [1, 0]]}, "t: expected times from"),
        ("prescribe-even", {"t": [0, 20], "xy": [[0, 0], [180, 0]]}, "xy: expected"),
    ],
)
def test_what_a_difference_says(id_: str, got: Any, says: str) -> None:
    problem = vectors.difference(of(id_), got)
    assert problem.startswith(says) and bool(problem) == bool(says)


def test_within_the_tolerance_and_beyond_it() -> None:
    case = of("convert-slower")
    near = json.loads(json.dumps(case.expected))
    near["t"][2] += 0.5 * case.tolerance["t"]
    assert vectors.difference(case, near) == ""
    near["t"][2] += case.tolerance["t"]
    assert vectors.difference(case, near).startswith("t[2]: expected")
    near["t"][2] = float("nan")
    assert vectors.difference(case, near).startswith("t[2]: expected")
    assert vectors.difference(case, case.expected | {"stopped": 0}).startswith("stopped: expected")


def test_samples_of_a_motion_are_free() -> None:
    case = of("prescribe-even")
    t, xy = case.expected["t"], case.expected["xy"]
    middle = [(a + b) / 2 for a, b in zip(xy[1], xy[2], strict=True)]
    more = {
        "t": [t[0] - 1, *t[:2], (t[1] + t[2]) / 2, *t[2:], t[-1] + 1],
        "xy": [[-10.0, 0.0], *xy[:2], middle, *xy[2:], [190.0, 0.0]],
        "stopped": True,
    }
    assert vectors.difference(case, more) == ""


def test_an_implementation_that_falls_over_has_failed() -> None:
    def call(kernel: str, inputs: Any) -> Any:
        inputs.clear()
        raise ZeroDivisionError("by 0")

    [result] = vectors.check(call, [of("success-once")])
    assert result.problem == "raised ZeroDivisionError: by 0" and of("success-once").inputs


# -- the command

run = CliRunner()


def test_the_command_agrees_with_the_reference(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    answer = run.invoke(command.app, ["check", "--json", str(report)])
    assert answer.exit_code == 0, answer.output
    rows = json.loads(report.read_text())["vectors"]
    assert [row["id"] for row in rows] == [case.id for case in CASES]
    assert all(row.keys() == {"id", "kernel", "ok"} and row["ok"] for row in rows)
    assert all(kernel in answer.output for kernel in vectors.KERNELS)


def test_the_command_takes_one_kernel() -> None:
    answer = run.invoke(command.app, ["check", "--kernel", "success", "--json", "-"])
    rows = json.loads(answer.output)["vectors"]
    assert answer.exit_code == 0 and {row["kernel"] for row in rows} == {"success"}
    answer = run.invoke(command.app, ["check", "--kernel", "sucess"])
    assert answer.exit_code == 2 and "success" in answer.output


def test_the_command_shows_what_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vector_adapter, "call", mutated("success", "no-first-sending"))
    answer = run.invoke(command.app, ["check", "--kernel", "success"])
    assert answer.exit_code == 1
    case = of("success-once")
    for text in (case.id, case.purpose, case.bug, "sendings: expected 1, got 0"):
        assert text in answer.output
    answer = run.invoke(command.app, ["check", "--kernel", "success", "--json", "-"])
    assert answer.exit_code == 1 and not json.loads(answer.output)["vectors"][0]["ok"]


def test_the_command_names_a_file_it_cannot_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vectors, "FOLDER", tmp_path)
    answer = run.invoke(command.app, ["check"])
    assert answer.exit_code == 3 and "convert.json: No such file" in answer.output
