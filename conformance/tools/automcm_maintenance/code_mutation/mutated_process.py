"""A child process in which one module of the reference is replaced.

``python -m automcm_maintenance.code_mutation.mutated_process MODULE FILE`` answers like ``automcm
adapter``, with the source of FILE instead of MODULE; with ``-`` as FILE nothing is replaced.
Another task can follow (lockstep.py):

    compare GRAPH VARIANT    prints, as JSON, the first state with other outcomes, or null
    serve GRAPH VARIANT      answers the questions of ``compare``

The states of the special graph `forms` are messages; its inputs are their edge cases
(accepted_forms.py).
"""

from __future__ import annotations

import gc
import json
import resource
import signal
import sys
from pathlib import Path

from automcm_maintenance.code_mutation.faults import Hook

GRAMMAR = ("messages", "parameters")
"""The modules that are not in the reference's package; the forms of messages use only these."""
NO_IMPORT = 86
"""Exit code of a child whose module cannot be imported."""
BYTES = 2 << 30
CPU_S, LARGE_CPU_S = 600, 3_600
"""Limits of processor time in seconds: in general, and for the largest graph, which took 430."""
ANSWER_CPU_S = 0.5
"""That for one answer to the suite; the reference takes some milliseconds."""


def full_name(module: str) -> str:
    """The name with its package."""
    package = "automcm_spec.vocabulary" if module in GRAMMAR else "automcm.core"
    return f"{package}.{module}"


def replace(module: str, file: str) -> None:
    """Replace a module by a file.  No module of the reference may have been imported before."""
    if file == "-":
        return
    if any(name.startswith("automcm.") for name in sys.modules):
        raise RuntimeError("the reference must not be imported before its module is replaced")
    Hook.put({full_name(module): Path(file).read_text(encoding="utf-8")})


def limited(cpu_s: int) -> None:
    """Set limits on time and memory, because a mutant may loop or allocate without end."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))


def main() -> None:
    """Replace the module given by the arguments, then run the task."""
    module, file, *task = sys.argv[1:]
    limited(LARGE_CPU_S if "two-peers" in task else CPU_S)
    replace(module, file)
    try:
        import automcm.adapters.adapter_lines  # noqa: F401
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(NO_IMPORT)
    if task:
        _behave(*task)
    else:
        _serve()


def _serve() -> None:
    from automcm.adapters.adapter_lines import serve

    out = sys.stdout.buffer
    for answer in serve(sys.stdin.buffer):
        out.write(answer)
        out.flush()
        signal.setitimer(signal.ITIMER_PROF, ANSWER_CPU_S)  # then SIGPROF ends this process


def _behave(task: str, graph: str, variant: str) -> None:
    from automcm_maintenance.code_mutation import accepted_forms, lockstep, station_behaviour
    from automcm_spec.graph.oracle import load
    from automcm_spec.graph.oracle_generation import GRAPHS
    from automcm_spec.vocabulary.json_forms import canonical, to_json
    from automcm_spec.vocabulary.rules import kind

    gc.disable()  # the graph is large and permanent
    walked: lockstep.Walked = accepted_forms.Forms()
    if graph != "forms":
        oracle, chosen = load(GRAPHS[graph].path), station_behaviour.VARIANTS[int(variant)]
        walked = station_behaviour.AnyState(oracle, chosen)
    if task == "serve":
        lockstep.serve(walked, sys.stdin, sys.stdout.buffer)
        return
    with lockstep.unchanged(graph, variant) as right:
        found = lockstep.first_difference(walked, right)
    if found is None:
        print("null")
        return
    value, rightly, wrongly = found.outcomes[0]
    state = to_json(walked.states[found.state])
    shown = {
        "graph": graph,
        "state": [state, repr(found.changed)] if found.changed else state,
        "input": value if isinstance(value, str) else canonical(value),
        "right": rightly,
        "wrong": wrongly,
    }
    kinds = {kind(value) for value, *_ in found.outcomes if not isinstance(value, str)}
    print(json.dumps({"number": found.state, "kinds": sorted(kinds), "difference": shown}))


if __name__ == "__main__":
    main()
