"""A child process in which one module of the reference is replaced.

``python -m automcm_maintenance.code_mutation.mutated_process MODULE FILE`` answers like ``automcm
adapter``, with the source of FILE instead of MODULE; with ``-`` as FILE nothing is replaced.
With ``GRAPH VARIANT KEPT`` after these, it prints the first difference from the unchanged
reference on this graph as JSON, or null (lockstep.py).
"""

from __future__ import annotations

import json
import resource
import signal
import sys
from dataclasses import asdict
from pathlib import Path

from automcm_maintenance.code_mutation import lockstep
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


def limited(cpu_s: int) -> None:
    """Set limits on time and memory, because a mutant may loop or allocate without end."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))


def main() -> None:
    """Replace the module given by the arguments, then serve or compare."""
    module, file, *walk = sys.argv[1:]
    limited(LARGE_CPU_S if "two-peers" in walk else CPU_S)
    right = lockstep.unchanged(walk[0], int(walk[1]), walk[2]) if walk else None
    if file != "-":
        Hook.put({full_name(module): Path(file).read_text(encoding="utf-8")})
    try:
        import automcm.adapters.adapter_lines  # noqa: F401
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(NO_IMPORT)
    if right is None:
        _serve()
        return
    wrong = lockstep.walked(walk[0], int(walk[1]))
    found = lockstep.first_difference(walk[0], wrong, right)
    print(json.dumps(found and asdict(found)))


def _serve() -> None:
    from automcm.adapters.adapter_lines import serve

    out = sys.stdout.buffer
    for answer in serve(sys.stdin.buffer):
        out.write(answer)
        out.flush()
        signal.setitimer(signal.ITIMER_PROF, ANSWER_CPU_S)  # then SIGPROF ends this process


if __name__ == "__main__":
    main()
