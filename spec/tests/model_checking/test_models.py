"""The list of models, and the comparison of what TLC finds with it."""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from model_stage import LISTED, judged

from automcm_cli.spec.model_output import chosen, kept
from automcm_maintenance.documents import attacker_table
from automcm_spec.model_checking import model_runs, models, tlc
from automcm_spec.model_checking.models import Model, ModelError, ModelVerdict
from automcm_spec.support.paths import MODELS, TLA
from automcm_spec.vocabulary import rules


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(MODELS, tmp_path / "models"))


def edit(folder: Path, old: str, new: str, name: str = models.LIST) -> None:
    path = folder / name
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def model(cfg: str, **changes: object) -> Model:
    return LISTED[cfg].model_copy(update=changes)


RUN = tlc.run


def test_every_property_is_shown_to_be_needed() -> None:
    broken = {m.property for m in models.load() if m.expect == "violates"}
    assert broken == set(models.PROPERTIES) - {"TypeInv"}


def checked(cfg: str) -> set[str]:
    return set(models.checked_in(model(cfg).config))


SAFETY = {models.PROPERTIES[id_] for id_ in (*models.SAFETY, "TypeInv")}
APART = {"TogetherInv", "CamLossInv", "LeftInv"}
"""Properties of time with models of their own: where all may be lost they say little."""
TIME = {name for id_, name in models.PROPERTIES.items() if id_.startswith("T-")} - APART
NEED_TWO = {"OneWordInv": "Prescribers", "N3Prop": "Peers", "OnceInv": "PeerSessions"}
"""Properties that say nothing with one of these."""


def test_models_that_hold_check_everything() -> None:
    for m in models.load():
        if m.expect == "holds" and m.module in ("System", "Refinement", "Symmetric"):
            assert checked(m.cfg) >= SAFETY, m.cfg
            assert ("PromiseProp" in checked(m.cfg)) == (m.module == "Refinement"), m.cfg
        if m.cfg.startswith("timed"):
            assert checked(m.cfg) >= TIME - {"OneWordInv"} | {"SettledHazardInv"}, m.cfg


def test_no_model_checks_what_it_cannot_break() -> None:
    for m in models.load():
        constants = dict(re.findall(r"^ +(\w+) = \{(.*)\}$", m.config, re.MULTILINE))
        for name in checked(m.cfg) & NEED_TWO.keys():
            assert len(constants[NEED_TWO[name]].split(",")) > 1, f"{m.cfg}: {name}"


def test_every_property_holds_in_a_quick_model() -> None:
    quick = [m for m in models.load() if m.profile == "quick" and m.expect == "holds"]
    assert set().union(*(checked(m.cfg) for m in quick)) >= set(models.PROPERTIES.values())


def test_s_5_is_found_under_its_name_with_time_too() -> None:
    names = {name for name, id_ in models.PROPERTY_IDS.items() if id_ == "S-5"}
    assert names == {"NoHazardInv", "SettledHazardInv"}
    wanted = {m.cfg for m in models.load() if names & checked(m.cfg)}
    for asked in ("S-5", *names):
        assert {m.cfg for m in chosen(models.load(), [], None, asked)} == wanted


def test_what_a_cfg_checks_and_the_rest_of_it() -> None:
    cfg = "\\* a PROPERTY\nCONSTANTS\n  A = 1 (* INVARIANT\n  X *)\nINVARIANTS A\n  B\nINIT Init\n"
    rest, listed = models.split(cfg + "PROPERTY C")
    assert listed == [("INVARIANTS", "A"), ("INVARIANTS", "B"), ("PROPERTY", "C")]
    assert rest.split() == ["CONSTANTS", "A", "=", "1", "INIT", "Init"]


def test_what_a_module_extends_and_what_it_reads() -> None:
    texts = {
        "A": "EXTENDS B, Naturals\nVARIABLE D",
        "B": "EXTENDS\n  C ,  B",
        "C": "Inner == INSTANCE D WITH x <- 1",
        "D": "\\* it EXTENDS E",
        "E": "",
        "G": "---- MODULE G ---- EXTENDS E, \\* D\n  (* A *) B",
    }
    assert models.extended("A", texts) == {"A", "B", "C"}
    assert models.extended("A", texts, instances=True) == {"A", "B", "C", "D"}
    assert models.extended("F", texts) == {"F"}
    assert models.extended("G", texts) == {"G", "E", "B", "C"}


def constants(cfg: str) -> dict[str, str]:
    return dict(re.findall(r"^  (\w+) (?:=|<-) (.+)$", model(cfg).config, re.MULTILINE))


def test_t_8_is_shown_at_its_limit() -> None:
    """T-8: t_cam_loss is above CAM interval and delay by one tick, or by none."""
    enough, short = constants("cam_loss"), constants("cam_loss_too_short")
    limit = int(enough["CamInterval"]) + int(enough["Delay"])
    assert (enough.pop("CamLoss"), short.pop("CamLoss")) == (str(limit + 1), str(limit))
    assert enough == short


def test_t_9_is_shown_at_its_limit() -> None:
    """T-9: its three must-fail models claim one tick less of one bound, in a case of left_alone."""
    whole = constants("left_alone")
    for name, less in (
        ("left_by_fin_less_one", {"MayActOn": "ActsOnOneLess", "Environments": "Finishing"}),
        ("left_by_abort_less_one", {"MayActOn": "ActsOnOneLess", "Environments": "Aborting"}),
        ("left_waiting_less_one", {"MayWaitOn": "WaitsOnOneLess", "Environments": "Aborting"}),
    ):
        assert constants(name) == whole | less


def test_the_models_of_one_station_are_those_that_extend_open_station() -> None:
    texts = {path.stem: path.read_text() for path in TLA.glob("*.tla")}
    alone = {name for name in texts if "OpenStation" in models.extended(name, texts)}
    assert alone == set(models.ALONE)
    assert {m.module for m in models.load()} >= alone - {"OpenStation"}


def test_the_attacked_models_are_those_that_extend_attacker() -> None:
    texts = {path.stem: path.read_text() for path in TLA.glob("*.tla")}
    extending = {name for name in texts if "Attacker" in models.extended(name, texts)}
    assert extending == set(models.ATTACKED)
    attacked = [m for m in models.load() if "Keys" in constants(m.cfg)]
    assert attacked == [m for m in models.load() if m.module in models.ATTACKED]


@pytest.mark.slow
def test_a_model_with_too_little_memory_is_an_error(folder: Path) -> None:
    """With it no session is opened, and everything holds (MEM-1)."""
    edit(folder, "OutboxLimit = 12", "OutboxLimit = 3", "one_by_two.cfg")
    verdict = models.check(next(m for m in models.load(folder) if m.cfg == "one_by_two"))
    assert verdict.outcome == "error" and "ssumption" in str(verdict.error)


def test_the_quick_models_break_each_property_and_each_rule_s_mechanism() -> None:
    """None is left to *full* alone; nor is a kind of attacker."""
    fails = [m for m in models.load() if m.expect == "violates"]
    quick = [m for m in fails if m.profile == "quick"]

    def rules_of(chosen: list[Model]) -> set[str]:
        return {rule for m in chosen for rule in re.findall(r"[A-Z]{3}-\d", m.why)}

    assert {m.property for m in quick} == {m.property for m in fails}
    assert rules_of(quick) == rules_of(fails) and not [m for m in fails if m.profile == "deep"]
    attacked = [m for m in models.of_profile(models.load(), "quick") if m.module in models.ATTACKED]
    assert {attacker_table._attacker(m.config) for m in attacked} == set(attacker_table.ATTACKERS)


def reached(cfg: str) -> set[str]:
    return set(model(cfg).reaches or ())


def test_probes_reach_every_rule_phase_type_and_refusal() -> None:
    one, closed = (
        reached("station_properties"),
        reached("probe_system") | reached("probe_two_prescribers"),
    )
    unseen = {"END-4"} | set(rules.NO_GRAPH)  # END-4 is a guard: SameSession, S-7
    assert {f"rule {rule}" for rule in rules.RULES if rule not in unseen} <= one
    phases = {
        ("none", "STANDALONE"),
        *(("prescriber", p) for p in ("ADVERTISING", "CHOOSING", "PRESCRIBING")),
        *(("receiver", p) for p in ("INTENDING", "WAITING")),
        *((r, p) for r in ("prescriber", "receiver") for p in ("NEGOTIATING", "ACTUATING")),
    }
    types = ("Advertisement", "Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack")
    for found in (one, closed):
        assert {f"phase {role} {phase}" for role, phase in phases} <= found
        assert {f"message {type_}" for type_ in types} <= found
        assert {"refusal busy", "refusal unknown_session"} <= found
    assert {"refusal unsafe", "refusal undecided"} <= one
    refusing = ("ADV-1", "CMD-1", "END-7", "MEM-1", "NEG-7", "PRE-2", "PRE-5")
    assert {f"refused by {rule}" for rule in refusing} <= one


def test_the_hazard_reaches_its_bound_in_every_fault_class() -> None:
    labels = reached("hazard_bounds")
    assert len(labels) == 32  # 36 fault classes, in four of which there is no hazard at all
    assert not [
        label for label in labels if label.startswith("backward cut,") and "lossy" not in label
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: (d / "extra.cfg").touch(), "extra.cfg is not listed"),
        (lambda d: (d / "unreduced.cfg").unlink(), "unreduced: there is no unreduced.cfg"),
        (lambda d: (d / "rejoin.cfg").touch(), "rejoin: has a base, and a rejoin.cfg"),
        (lambda d: (d / models.LIST).unlink(), "cannot be read"),
        (lambda d: edit(d, "[retarget]", "[rejoin]"), "rejoin"),
        (lambda d: edit(d, "depth = ", "# "), "depth: required in a model that holds"),
        (
            lambda d: edit(d, "depth = ", "length = 3\ndepth = "),
            "length: not allowed in a model that holds",
        ),
        (lambda d: edit(d, 'module = "System"', 'module = "Sistem"'), "module Sistem does not"),
        (lambda d: edit(d, "AcceptedInv", "AcceptingInv"), "AcceptingInv is not the name of a"),
        (
            lambda d: edit(d, "AckMatches <-", 'Reduced = FALSE", "AckMatches <-'),
            "changes: Reduced = FALSE is what unreduced.cfg says",
        ),
        (
            lambda d: (d / "unreduced.cfg").write_text("CONSTANTS\nINIT Init"),
            "unreduced checks nothing",
        ),
    ],
)
def test_a_list_that_does_not_fit(
    folder: Path, change: Callable[[Path], object], message: str
) -> None:
    change(folder)
    with pytest.raises(ModelError) as caught:
        models.load(folder)
    assert message in str(caught.value)


def test_a_property_that_the_spec_lacks(tmp_path: Path) -> None:
    (tmp_path / "System.tla").write_text("TypeInv == TRUE\n")
    with pytest.raises(ModelError, match="no module defines the property OneSessionProp"):
        models.load(MODELS, tmp_path)


def test_a_change_is_not_lost_where_the_checks_take_two_lines(folder: Path) -> None:
    wrapped = "INVARIANTS TypeInv\n "
    edit(folder, "INVARIANTS TypeInv", wrapped, "one_by_two.cfg")
    [retarget] = [m for m in models.load(folder) if m.cfg == "retarget"]
    assert models.replaced_in(retarget.config) == {"NextTarget": "Retarget"}


def test_a_cfg_is_that_of_the_base_with_the_changes() -> None:
    """A change replaces a line or adds one; a must-fail model checks what it breaks alone."""
    base, made = model("outsider_left"), model("thief_keeps_committed")
    assert base.config == (MODELS / "outsider_left.cfg").read_text()
    assert made.base == "outsider_left" and made.changes
    constants_ = constants(base.cfg) | {
        line.split()[0]: line.split(maxsplit=2)[2] for line in made.changes
    }
    assert constants(made.cfg) == constants_
    assert models.checked_in(made.config) == [made.breaks]


@pytest.mark.slow
def test_a_cfg_that_is_kept_is_run_by_the_command_beside_it(tmp_path: Path) -> None:
    one = model("bare_ack")
    command = kept(one, tmp_path)
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert (tmp_path / "bare_ack.cfg").read_text() == one.config
    assert "Action property AckedProp is violated" in done.stdout


FAILS = {"breaks": "AckedProp", "length": 6}
HOLDS = {"distinct_states": 1, "states": 1, "depth": 1}
NO_FAILS, NO_HOLDS = dict.fromkeys(FAILS), dict.fromkeys(HOLDS)


@pytest.mark.parametrize(
    ("cfg", "changes", "problem"),
    [
        ("restarts", {"distinct_states": 7}, r"distinct_states is \d{3,}, expected 7"),
        ("bare_ack", {"length": 99}, r"length is \d, expected 99"),
        (
            "bare_ack",
            {"breaks": "NoHazardInv"},
            "S-6 is violated; expected a violation of S-5",
        ),
        (
            "bare_ack",
            HOLDS | NO_FAILS,
            "S-6 is violated; expected no violation",
        ),
        (
            "restarts",
            FAILS | NO_HOLDS,
            "nothing is violated; expected a violation of S-6",
        ),
    ],
)
def test_something_else_than_expected(cfg: str, changes: dict[str, Any], problem: str) -> None:
    verdict = judged(model(cfg, **changes))
    assert not verdict.ok and re.fullmatch(problem, verdict.problem or "")


def test_no_verdict() -> None:
    verdict = models.check(model("unreduced"), timeout_s=0.2)
    assert (verdict.outcome, verdict.result, verdict.trace) == (
        "error",
        None,
        (),
    ) and not verdict.ok
    assert verdict.error is not None and verdict.error.kind == "timeout"


@pytest.mark.slow
def test_an_interrupt_ends_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    ends: list[str] = []

    def noted(*args: Any, **options: Any) -> tlc.TlcResult:
        try:
            return RUN(*args, **options)
        except tlc.TlcError as error:
            ends.append(str(error))
            raise

    def interrupt(_: ModelVerdict) -> None:
        raise KeyboardInterrupt

    chosen = [model("bare_ack", seconds=999.0), model("one_by_three"), model("two_by_one")]
    monkeypatch.setattr(tlc, "run", noted)
    with pytest.raises(KeyboardInterrupt):
        model_runs.check_all(chosen, on_done=interrupt)
    assert set(ends) == {"TLC was stopped"}
