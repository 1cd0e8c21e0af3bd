"""Writes the committed generated files, and finds stale ones."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from automcm_cli.spec import model_output
from automcm_conformance.adapter import adapter_schema
from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.suite import two_peer_pairs
from automcm_maintenance.compilation import compiler
from automcm_maintenance.corpus import corpus
from automcm_maintenance.documents import (
    attacker_table,
    independence_tables,
    state_diagrams,
)
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.exact_vectors import vector_texts
from automcm_maintenance.spec_mutation import mutant_results
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.log_format import log_schema
from automcm_spec.model_checking import model_runs, models
from automcm_spec.support import files, scratch
from automcm_spec.vocabulary import json_schema

COUNTEREXAMPLES = ROOT / "traces" / "counterexamples"
CORPUS_ROOT = ROOT / "traces" / "corpus"
CORPUS = CORPUS_ROOT / "four-vehicles"
SCHEMA = ROOT / "spec" / "automcm_spec" / "log_format" / "trace-1.schema.json"
ADAPTER_SCHEMA = ROOT / "conformance" / "adapter-1.schema.json"
SECURITY = ROOT / "docs" / "security.md"
VERIFICATION = ROOT / "docs" / "verification.md"
MESSAGES_SCHEMA = ROOT / "spec" / "automcm_spec" / "vocabulary" / "messages.schema.json"
MESSAGES_PAGE = ROOT / "docs" / "messages.md"
DIAGRAMS = ROOT / "docs" / "state-diagrams.md"
EVALUATION = ROOT / "docs" / "evaluation.md"
PICTURE = ROOT / "docs" / "four-vehicles.svg"
FOUR_VEHICLES = (1001, 2002, 3003, 4004)


def _counterexamples(verdicts: Iterable[models.ModelVerdict]) -> dict[Path, str]:
    return {
        COUNTEREXAMPLES / f"{verdict.model.cfg}.itf.json": model_output.counterexample(verdict)
        for verdict in verdicts
        if verdict.model.expect == "violates" and verdict.ok
    }


def counterexample_drift(verdicts: Sequence[models.ModelVerdict]) -> list[str]:
    """The committed counterexamples that differ from those just found."""
    return _lines(
        COUNTEREXAMPLES,
        lambda: [_stale(p) for p, text in _counterexamples(verdicts).items() if _differs(p, text)],
    )


def four_vehicles(folder: Path) -> None:
    """The logs of the paper's four vehicles: seeded, with loss, so that every byte is fixed."""
    from automcm.links.simulated_radio import Channel
    from automcm_simulation.road.simulation import Simulation
    from automcm_simulation.road.straight_lane import Straight
    from automcm_spec.vocabulary.parameters import Parameters

    simulation = Simulation(seed=3, channel=Channel(loss=0.2, duplicate=0.05), logs=folder)
    for station in FOUR_VEHICLES:
        simulation.add(station, Straight(target=FOUR_VEHICLES[2]), Parameters(t_cam=400))
    simulation.request(FOUR_VEHICLES[0], at=500)
    simulation.run(until=10_000)


def pair(folder: Path) -> None:
    """The logs of a prescriber and a receiver that refuses once; the bad logs are edits of them."""
    from automcm.links.simulated_radio import Channel
    from automcm_simulation.road.simulation import Simulation
    from automcm_simulation.road.straight_lane import Straight
    from automcm_spec.vocabulary.parameters import Parameters

    simulation = Simulation(seed=5, channel=Channel(loss=0.25, duplicate=0.1), logs=folder)
    for station in FOUR_VEHICLES[:2]:
        driver = Straight(refuse_first=1, maneuver_ms=900)
        simulation.add(station, driver, Parameters(t_timeout=500, t_cam=500, max_rounds=2))
    simulation.request(FOUR_VEHICLES[0], at=300)
    simulation.run(until=4000)


def picture() -> str:
    """The paper's four vehicles in a lane change, with a little loss and few repetitions."""
    from automcm.applications.lane_change import Plan
    from automcm.links.simulated_radio import Channel
    from automcm_simulation.road.drive import NAMES, FourVehicles
    from automcm_spec.log_format.reader import read
    from automcm_spec.vocabulary.parameters import Parameters
    from automcm_traces.export.svg_drawing import drawing
    from automcm_traces.system.log_merge import merge

    setting = FourVehicles(seed=3, until_s=12, plan=Plan(hold_s=0.2))
    with scratch.folder("logs") as folder:
        setting.run(
            channel=Channel(loss=0.15),
            parameters=Parameters(t_timeout=200, t_cam=500),
            logs=folder,
        )
        logs = [read(path) for path in sorted(folder.iterdir())]
    return drawing(merge(logs), NAMES)


def _corpus() -> dict[Path, bytes]:
    """The part of the corpus that is generated in seconds, from logs on disk that need TLC."""
    from automcm_maintenance.corpus.corpus_secured import secured

    runs = {}
    for name, run in (("four-vehicles", four_vehicles), ("pair", pair), ("secured", secured)):
        with scratch.folder("logs") as folder:
            run(folder)
            for path in sorted(folder.iterdir()):
                runs[f"{name}/{path.name}"] = path.read_bytes()
    files = corpus.rest(CORPUS_ROOT, runs)
    return {CORPUS_ROOT / name: data for name, data in files.items()}


def _corpus_of_tlc(notify: Callable[[str], None]) -> dict[Path, bytes]:
    """The logs of the closed and of the must-fail models; takes minutes."""
    files = corpus.behaviours(notify) | corpus.counterexamples(COUNTEREXAMPLES, notify)
    return {CORPUS_ROOT / name: data for name, data in files.items()}


def _superfluous(kinds: Sequence[str], files: dict[Path, bytes]) -> list[Path]:
    """Obsolete files in these folders of the corpus."""
    there = [p for kind in kinds for p in (CORPUS_ROOT / kind).rglob("*") if p.is_file()]
    return sorted(path for path in there if path not in files)


_FROM_TLC = ("behaviours", "counterexamples")
_AT_ONCE = ("bad", "four-vehicles", "pair", "secured")


def _stale_corpus(kinds: Sequence[str], files: dict[Path, bytes]) -> list[str]:
    stale = [p for p, data in files.items() if not p.exists() or p.read_bytes() != data]
    return [_stale(path) for path in sorted([*stale, *_superfluous(kinds, files)])]


def _write_corpus(kinds: Sequence[str], wanted: dict[Path, bytes]) -> list[Path]:
    changed = _superfluous(kinds, wanted)
    for path in changed:
        path.unlink()
    for path, data in wanted.items():
        if not path.exists() or path.read_bytes() != data:
            path.parent.mkdir(parents=True, exist_ok=True)
            files.write(path, data)
            changed.append(path)
    return changed


def _texts(one_peer: bytes) -> dict[Path, Callable[[], str]]:
    """The texts that are generated within a second each; ``one_peer`` is the diagrams' graph."""
    from automcm.core import phases
    from automcm_evaluation.bandwidth import message_sizes as sizes
    from automcm_evaluation.sweeps import report

    return {
        compiler.PATH: compiler.text,
        SCHEMA: lambda: json_schema.text(log_schema.schema()),
        ADAPTER_SCHEMA: lambda: json_schema.text(adapter_schema.schema()),
        MESSAGES_SCHEMA: lambda: json_schema.text(json_schema.messages()),
        MESSAGES_PAGE: lambda: between(
            MESSAGES_PAGE.read_text(), "automcm_evaluation.bandwidth.message_sizes", sizes.table()
        ),
        SECURITY: lambda: between(
            SECURITY.read_text(), "attackers", attacker_table.table(models.load())
        ),
        VERIFICATION: _verification,
        PICTURE: picture,
        EVALUATION: lambda: report.evaluation(EVALUATION.with_suffix("")),
        DIAGRAMS: lambda: state_diagrams.text(oracle.parse(one_peer, "one-peer"), phases.WAYS),
    }


def _verification() -> str:
    text = between(VERIFICATION.read_text(), "interface", independence_tables.interface())
    text = between(text, "ids and numbers", independence_tables.uses())
    return between(text, "mutants", mutant_results.load().summary)


def between(text: str, name: str, part: str) -> str:
    """A page with ``part`` between the two marks with that name and the rest unchanged.

    Raises ValueError without the marks.
    """
    begin, end = f"<!-- begin: {name} -->", f"<!-- end: {name} -->"
    before, begun, rest = text.partition(begin)
    _, ended, after = rest.partition(end)
    if not (begun and ended):
        raise ValueError(f"the page must contain the marks {begin} and {end}")
    return f"{before}{begin}\n{part}\n{end}{after}"


def drift(
    profile: str,
    one_peer: bytes,
    notify: Callable[[str], None],
) -> list[str]:
    """One line for each generated file that is stale or cannot be generated.

    one_peer is the graph of the present specification.  The quick profile does not check the other
    graphs, because their users check their version.
    """
    whole = profile != "quick"
    checks: list[tuple[Path, Callable[[], list[str]]]] = [
        (path, partial(_text_drift, path, make)) for path, make in _texts(one_peer).items()
    ]
    checks += [
        (VECTORS, _vectors_drift),
        (CORPUS_ROOT, lambda: _stale_corpus(_AT_ONCE, _corpus())),
    ]
    if whole:
        checks.append((CORPUS_ROOT, lambda: _stale_corpus(_FROM_TLC, _corpus_of_tlc(notify))))
    checks += [
        (graph.path, partial(_graph_drift, graph, one_peer, notify))
        for graph in oracle_generation.GRAPHS.values()
        if whole or graph is oracle_generation.ONE_PEER
    ]
    checks.append((two_peer_pairs.PATH, partial(_two_peer_drift, whole)))
    return [line for path, check in checks for line in _lines(path, check)]


def _lines(path: Path, check: Callable[[], list[str]]) -> list[str]:
    """The findings of a check.

    An exception becomes a finding, because the checked code may be under change and the other files
    must still be compared.
    """
    try:
        return check()
    except oracle.OracleError as error:
        reason = error_text(error)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
    return [f"{_name(path)}: cannot be generated now: {reason}"]


def error_text(error: oracle.OracleError) -> str:
    """The error's text, with paths relative to the repository."""
    return str(error).replace(f"{ROOT}/", "")


def _text_drift(path: Path, make: Callable[[], str]) -> list[str]:
    return [_stale(path)] if _differs(path, make()) else []


def _vectors_drift() -> list[str]:
    return [_stale(path) for path, text in vector_texts.texts().items() if _differs(path, text)]


def _graph_drift(
    graph: oracle_generation.Graph, one_peer: bytes, notify: Callable[[str], None]
) -> list[str]:
    notify(f"oracle: {graph.name}")
    fresh = one_peer if graph is oracle_generation.ONE_PEER else oracle_generation.generate(graph)
    same = graph.path.exists() and oracle.content(graph.path) == fresh
    return [] if same else [_stale(graph.path)]


def graph_changed(one_peer: bytes) -> bool:
    """Whether the one-peer graph differs from the committed one apart from the specification hash.

    False if the committed one cannot be read.
    """
    try:
        committed = oracle.content(oracle_generation.ONE_PEER.path)
    except oracle.OracleError:
        return False
    before, after = (json.loads(data) | {"spec_hash": None} for data in (committed, one_peer))
    return bool(before != after)


def _two_peer_drift(whole: bool) -> list[str]:
    if not whole:
        stale = two_peer_pairs.spec_hash() != oracle_generation.spec_hash()
    else:
        stale = _differs(two_peer_pairs.PATH, _two_peer_pairs())
    return [_stale(two_peer_pairs.PATH)] if stale else []


def _two_peer_pairs() -> str:
    """The two-peer pairs, from the graphs on disk; takes a minute."""
    two, one = (
        oracle.load(graph.path)
        for graph in (oracle_generation.TWO_PEERS, oracle_generation.ONE_PEER)
    )
    return two_peer_pairs.text(two, one)


def write(notify: Callable[[str], None], two_peers: bool = True) -> list[Path]:
    """Renew all generated files and return those that changed."""
    changed = []
    verdicts = model_runs.check_all([m for m in models.load() if m.expect == "violates"], jobs=2)
    for graph in oracle_generation.GRAPHS.values():
        if graph is oracle_generation.TWO_PEERS and not two_peers:
            continue
        notify(f"oracle: {graph.name}")
        data = oracle_generation.generate(graph)
        if not graph.path.exists() or oracle.content(graph.path) != data:
            oracle.write(graph.path, data)
            changed.append(graph.path)
    one_peer = oracle.content(oracle_generation.ONE_PEER.path)
    texts = _counterexamples(verdicts)
    texts |= {path: make() for path, make in _texts(one_peer).items()} | vector_texts.texts()
    if two_peers:
        notify("two-peer pairs")
        texts[two_peer_pairs.PATH] = _two_peer_pairs()
    for path, text in texts.items():
        if _differs(path, text):
            path.parent.mkdir(parents=True, exist_ok=True)
            files.write(path, text)
            changed.append(path)
    return changed + write_corpus(notify)


def write_corpus(notify: Callable[[str], None]) -> list[Path]:
    """Renew the corpus and return the files that changed or were deleted."""
    changed = _write_corpus(_FROM_TLC, _corpus_of_tlc(notify))
    return changed + _write_corpus(_AT_ONCE, _corpus())


def _differs(path: Path, text: str) -> bool:
    return not path.exists() or path.read_text() != text


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)


def _stale(path: Path) -> str:
    return f"{_name(path)}: not what would be generated now; run make generate"
