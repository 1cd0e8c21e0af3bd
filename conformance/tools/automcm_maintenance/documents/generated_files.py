"""Writes the committed generated files, and finds stale ones."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from automcm_cli.spec import model_output
from automcm_conformance.adapter import adapter_schema
from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.suite import two_peer_pairs
from automcm_maintenance.compilation import compiler, data_independence
from automcm_maintenance.corpus import corpus
from automcm_maintenance.documents import attacker_table, state_diagrams
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.exact_vectors import vector_texts
from automcm_maintenance.induction import recorded_proof
from automcm_maintenance.spec_mutation import mutant_results
from automcm_maintenance.verify import kept_stages
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.log_format import log_schema
from automcm_spec.model_checking import kept_results, models
from automcm_spec.support import files, scratch
from automcm_spec.vocabulary import json_schema

COUNTEREXAMPLES = ROOT / "traces" / "counterexamples"
CORPUS_ROOT = ROOT / "traces" / "corpus"
SCHEMA = ROOT / "spec" / "automcm_spec" / "log_format" / "trace-1.schema.json"
ADAPTER_SCHEMA = ROOT / "conformance" / "adapter-1.schema.json"
SECURITY = ROOT / "docs" / "security.md"
VERIFICATION = ROOT / "docs" / "verification.md"
MESSAGES_SCHEMA = ROOT / "spec" / "automcm_spec" / "vocabulary" / "messages.schema.json"
MESSAGES_PAGE = ROOT / "docs" / "messages.md"
DIAGRAMS = ROOT / "docs" / "state-diagrams.md"
EVALUATION = ROOT / "docs" / "evaluation.md"
PICTURE = ROOT / "docs" / "four-vehicles.svg"
KEPT = ROOT / "runs" / "kept"
"""The folder of data for later runs: results of models and of stages."""
OF_GRAPH = ("spec/automcm_spec", "spec/tools", "spec/tla", "spec/oracle", "pyproject.toml")
"""What the graph of one station depends on."""
_OF_SLOW = (
    *(*OF_GRAPH, "spec/models", "spec/simulation", "traces/automcm_traces", "traces/tools"),
    *("traces/counterexamples", "reference/automcm", "conformance/automcm_conformance"),
)
T = TypeVar("T")


@dataclass(frozen=True)
class Generated:
    """Files that are made together.

    ``path`` is what a finding names if they cannot be made.  Other files in ``folders`` are stale.
    ``slow``: takes minutes.
    """

    path: Path
    make: Callable[[], Mapping[Path, str | bytes]]
    folders: Sequence[Path] = ()
    slow: bool = False

    def stale(self) -> dict[Path, bytes | None]:
        """The files that differ, with what they must contain; None: they must not be there."""
        made = self.make().items()
        wanted = {path: data.encode() if isinstance(data, str) else data for path, data in made}
        there = (p for folder in self.folders for p in folder.rglob("*") if p.is_file())
        other = {path: None for path in there if path not in wanted}
        return other | {p: d for p, d in wanted.items() if not p.exists() or _read(p) != d}

    def drift(self) -> list[str]:
        """A line for each stale file.

        An exception becomes a line, because the checked code may be under change and the other
        files must still be compared.
        """
        try:
            return [_stale(path) for path in sorted(self.stale())]
        except oracle.OracleError as error:
            reason = error_text(error)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
        return [f"{_name(self.path)}: cannot be generated now: {reason}"]

    def write(self) -> list[Path]:
        """Renew the stale files; returns them."""
        stale = self.stale()
        for path, data in stale.items():
            if data is None:
                path.unlink()
            elif path.suffix == ".xz":
                oracle.write(path, data)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                files.write(path, data)
        return list(stale)


def _read(path: Path) -> bytes:
    return oracle.content(path) if path.suffix == ".xz" else path.read_bytes()


def _stale(path: Path) -> str:
    name = _name(path)
    return f"{name}: not what would be generated now; run .venv/bin/automcm generate {name}"


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)


def error_text(error: oracle.OracleError) -> str:
    """The error's text, with paths relative to the repository."""
    return str(error).replace(f"{ROOT}/", "")


def counterexamples(verdicts: Iterable[models.ModelVerdict]) -> Generated:
    """The counterexamples of these verdicts."""
    return Generated(
        COUNTEREXAMPLES,
        lambda: {
            COUNTEREXAMPLES / f"{v.model.cfg}.itf.json": model_output.counterexample(v)
            for v in verdicts
            if v.model.expect == "violates" and v.ok
        },
    )


def proof(found: recorded_proof.Proof) -> Generated:
    """The committed result of the proof."""
    path = recorded_proof.PATH
    return Generated(path, lambda: {path: recorded_proof.text(found)})


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
    from automcm_maintenance.corpus import corpus_runs

    runs = {}
    for name, write in corpus_runs.RUNS.items():
        with scratch.folder("logs") as folder:
            write(folder)
            for path in sorted(folder.iterdir()):
                runs[f"{name}/{path.name}"] = path.read_bytes()
    files = corpus.rest(CORPUS_ROOT, runs)
    return {CORPUS_ROOT / name: data for name, data in files.items()}


def _corpus_of_tlc(notify: Callable[[str], None]) -> dict[Path, bytes]:
    """The logs of the closed and of the must-fail models; takes minutes."""
    files = corpus.behaviours(notify) | corpus.counterexamples(COUNTEREXAMPLES, notify)
    return {CORPUS_ROOT / name: data for name, data in files.items()}


_FROM_TLC = tuple(CORPUS_ROOT / name for name in ("behaviours", "counterexamples"))
_AT_ONCE = tuple(CORPUS_ROOT / name for name in ("bad", "four-vehicles", "pair", "secured"))


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
            MESSAGES_PAGE, {"automcm_evaluation.bandwidth.message_sizes": sizes.table()}
        ),
        SECURITY: lambda: between(SECURITY, {"attackers": attacker_table.table(models.load())}),
        VERIFICATION: lambda: between(
            VERIFICATION,
            {
                "ids and numbers": data_independence.table(),
                "mutants": mutant_results.load().summary,
            },
        ),
        PICTURE: picture,
        EVALUATION: lambda: report.evaluation(EVALUATION.with_suffix("")),
        DIAGRAMS: lambda: state_diagrams.text(oracle.parse(one_peer, "one-peer"), phases.WAYS),
    }


def between(page: Path, parts: Mapping[str, str]) -> str:
    """A page with each part between the two marks with its name and the rest unchanged.

    Raises ValueError without the marks.
    """
    text = page.read_text(encoding="utf-8")
    for name, part in parts.items():
        begin, end = f"<!-- begin: {name} -->", f"<!-- end: {name} -->"
        before, begun, rest = text.partition(begin)
        _, ended, after = rest.partition(end)
        if not (begun and ended):
            raise ValueError(f"the page must contain the marks {begin} and {end}")
        text = f"{before}{begin}\n{part}\n{end}{after}"
    return text


def _all(one_peer: bytes, notify: Callable[[str], None]) -> Iterator[Generated]:
    """All but the counterexamples and the proof, each after those that it is made from.

    ``one_peer`` is the graph of the present specification.
    """

    def graph(of: oracle_generation.Graph) -> Mapping[Path, bytes]:
        notify(f"oracle: {of.name}")
        fresh = of is oracle_generation.ONE_PEER
        return {of.path: one_peer if fresh else oracle_generation.generate(of)}

    def text(path: Path, make: Callable[[], str]) -> Mapping[Path, str]:
        return {path: make()}

    for of in oracle_generation.GRAPHS.values():
        slow = of is not oracle_generation.ONE_PEER
        yield Generated(of.path, partial(graph, of), slow=slow)
    for path, make in _texts(one_peer).items():
        yield Generated(path, partial(text, path, make))
    yield Generated(VECTORS, vector_texts.texts)
    pairs = two_peer_pairs.PATH
    yield Generated(pairs, partial(text, pairs, _two_peer_pairs), slow=True)
    yield Generated(CORPUS_ROOT, lambda: _corpus_of_tlc(notify), _FROM_TLC, slow=True)
    yield Generated(CORPUS_ROOT, _corpus, _AT_ONCE)


def drift(profile: str, one_peer: bytes, notify: Callable[[str], None]) -> list[str]:
    """One line for each generated file that is stale or cannot be generated.

    The quick profile leaves out what is slow: who uses the other graphs checks their version.
    """
    quick = profile == "quick"
    found = []
    for each in _all(one_peer, notify):
        if not (quick and each.slow):
            found += each.drift()
    if quick and two_peer_pairs.spec_hash() != oracle_generation.spec_hash():
        found.append(_stale(two_peer_pairs.PATH))
    return found


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


def _two_peer_pairs() -> str:
    """The two-peer pairs, from the graphs on disk; takes a minute."""
    two, one = (
        oracle.load(graph.path)
        for graph in (oracle_generation.TWO_PEERS, oracle_generation.ONE_PEER)
    )
    return two_peer_pairs.text(two, one)


def write(notify: Callable[[str], None], only: Sequence[Path] = ()) -> list[Path]:
    """Renew all generated files, or those at or below these paths; returns those that changed or
    were deleted.

    What is slow is not made again if nothing that it depends on has changed. Raises ValueError for
    a path at which nothing is generated.
    """
    used = set[Path]()

    def wanted(*places: Path) -> bool:
        near = {o for o in only for p in places if o == p or o in p.parents or p in o.parents}
        used.update(near)
        return bool(near) or not only

    broken = [m for m in models.load() if m.expect == "violates"]
    broken = [m for m in broken if wanted(COUNTEREXAMPLES / f"{m.cfg}.itf.json")]
    changed = counterexamples(_verdicts(broken, notify)).write()
    graph = oracle_generation.ONE_PEER
    fresh = partial(oracle_generation.generate, graph)
    anew = wanted(graph.path)
    one_peer = _kept(f"oracle {graph.name}", fresh) if anew else oracle.content(graph.path)
    for each in _all(one_peer, notify):
        if wanted(*(each.folders or [each.path])):
            notify(_name(each.path))
            make = partial(_kept, each.path.name, each.make) if each.slow else each.make
            changed += replace(each, make=make).write()
    if wanted(recorded_proof.PATH) and recorded_proof.committed() is None:
        notify(_name(recorded_proof.PATH))
        found = recorded_proof.prove()
        if found.open:
            raise ValueError(f"the proof fails: {found.open[0]}")
        changed += proof(found).write()
    if unused := [path for path in only if path not in used]:
        raise ValueError(f"nothing is generated at {', '.join(map(_name, unused))}")
    return changed


def _kept(name: str, make: Callable[[], T]) -> T:
    """A result, from an earlier run if nothing that it depends on has changed."""
    path, key = KEPT / f"generated {name}.stage", kept_stages.key(ROOT, *_OF_SLOW)
    return kept_stages.kept(path, key, make, lambda result: True)[0]


def _verdicts(
    chosen: Sequence[models.Model], notify: Callable[[str], None]
) -> list[models.ModelVerdict]:
    found: list[models.ModelVerdict] = []

    def done(verdict: models.ModelVerdict) -> None:
        found.append(verdict)
        notify(f"models {len(found)}/{len(chosen)}: {verdict.model.cfg}")

    kept_results.check_all(chosen, KEPT, on_done=done)
    return found
