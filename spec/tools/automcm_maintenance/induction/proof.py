"""Proves Inductive.tla with z3: the initial states have Inv, every step keeps it, and it implies
S-1 to S-8.

All is taken from the syntax trees of the modules. Nothing is bounded: the stations, prescribers,
receivers and restarters are any sets of ids from 1, the radio is any set of messages, an outbox any
set of entries, and the numbers of sessions and rounds are any integers. A step may do more than in
TLA+: a test of the size of a set may have either value (MEM-1), and a step may change nothing.
What TypeInv says of sizes is left out.

Use it without Python's garbage collector, which another thread may start at any time: z3 crashes if
what belongs to it is freed while it works. Garbage is collected after each kind of step.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from collections.abc import Set as AnySet
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import NamedTuple

import z3  # type: ignore[import-untyped]

from automcm_maintenance.compilation.sany import Node, ParsedModules
from automcm_maintenance.induction.symbolic import (
    Env,
    Evaluator,
    Fn,
    Member,
    Set,
    Value,
    all_of,
    lift,
    negated,
    sort_of,
    variables,
)

FIRST, NEXT, INVARIANT = "CInit", "NextInOrder", "Inv"
OF_STATES = {
    "S-3": "AcceptedInv",
    "S-4": "AgreementInv",
    "S-5": "NoHazardInv",
    "S-8": "ExclusiveInv",
}
OF_STEPS = {
    "S-1": "OneSessionProp",
    "S-2": "CommitmentProp",
    "S-6": "AckedProp",
    "S-7": "NoCrossEffectProp",
}
MESSAGES = ("Advertisement", "Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack")
ENTRIES = ("Intention", "Prescription", "Acceptance", "Fin", "Cancel")
"""The types of records in the radio and in an outbox. FormInv and OwnEntriesInv say so."""
EFFORT = 20_000_000
"""The limit of z3's own measure of its work on an obligation: the same on every machine."""


_VERDICTS = {"unsat": "proved", "sat": "refuted", "unknown": "unknown"}


class ProofResult(NamedTuple):
    """What z3 says of an obligation."""

    goal: str
    """A conjunct of the invariant, or the id of a property."""
    step: str
    """The kind of step: "" if the goal follows from the invariant in one state."""
    verdict: str
    """proved, refuted or unknown."""
    seconds: float
    uses: frozenset[str]
    """Conjuncts of the invariant that this proof used. Another one may need fewer."""


class ProofStep(NamedTuple):
    """The steps of one kind."""

    name: str
    guard: Value
    after: Mapping[str, Value]


@dataclass(frozen=True)
class _Hypotheses:
    """A solver with the conjuncts of the invariant, each under a name."""

    solver: z3.Solver

    def prove(self, goal: Value, guard: Value = True) -> tuple[str, float, frozenset[str]]:
        started = time.monotonic()
        claim = z3.And(lift(guard), lift(negated(goal)))
        self.solver.push()
        self.solver.add(claim)
        verdict = _VERDICTS[str(self.solver.check())]
        core = self.solver.unsat_core() if verdict == "proved" else []
        self.solver.pop()
        return verdict, time.monotonic() - started, frozenset(str(name) for name in core)


class Prover:
    """The obligations of the specification.

    ``without`` is left out of the invariant; the rest is then proved, if it can be.
    """

    def __init__(self, spec: ParsedModules, without: AnySet[str] = frozenset()) -> None:
        self.spec = spec
        self.conjuncts = [
            node.name for node in spec.operators[INVARIANT].body.args if node.name not in without
        ]
        limits = ("MaxRounds", "MaxParticipants", "OutboxLimit", "MemoryLimit", "MaxSessions")
        ids = ("Stations", "Prescribers", "Receivers", "Restarters")
        self._constants: dict[str, Value] = {
            **{name: z3.Int(name) for name in limits},
            **{name: _any_set(name, 0) for name in ids},
            "Forgetting": z3.Bool("Forgetting"),
            "Reduced": False,
        }
        known = Evaluator(spec, self._constants)
        message = known.operator("Message", "Ack", 0, 0, (0, 0), 0)
        self._entry = known.operator("Entry", message)
        self._initial = known.operator("Initial")
        self._state: dict[str, Value] = {
            "st": Fn(self.station),
            "net": _any_set("net", message, (), MESSAGES),
            "excused": _any_set("excused", ((0, 0), 0)),
            "received": _any_set("received", message, (), MESSAGES),
            "been": _any_set("been", ((0, 0), 0)),
            "last": {},
        }

    def results(self, step: str = "") -> Iterator[ProofResult]:
        """Prove all obligations; with ``step``, those of the steps whose name contains the text."""
        if not step:
            first = _Hypotheses(self._solver())
            for goal, claim in self._claims(self._invariant(self._first())):
                yield ProofResult(goal, "Init", *first.prove(claim))
        base = self._base()
        if not step:
            now = self._invariant(self._state)
            for goal, name in OF_STATES.items():
                yield ProofResult(goal, "", *base.prove(now.operator(name)))
        for kind in self.transitions():
            if step in kind.name:
                yield from self._step(base, kind)
                gc.collect()

    def satisfiable(self) -> tuple[str, dict[str, str]]:
        """Attempts to prove FALSE: from the invariant, and from a step of each kind.

        A verdict "proved" means that the obligations with these hypotheses say nothing.
        """
        base = self._base()
        base.solver.set("rlimit", EFFORT // 10)
        verdicts = {k.name: base.prove(False, k.guard)[0] for k in self.transitions()}
        return base.prove(False)[0], verdicts

    def _base(self) -> _Hypotheses:
        base = _Hypotheses(self._solver())
        for name, holds in self._claims(self._invariant(self._state)):
            base.solver.assert_and_track(lift(holds), name)
        return base

    def _step(self, base: _Hypotheses, kind: ProofStep) -> Iterator[ProofResult]:
        for goal, claim in self._claims(self._invariant(kind.after)):
            yield ProofResult(goal, kind.name, *base.prove(claim, kind.guard))
        both = Evaluator(self.spec, self._constants, self._state, kind.after)
        for goal, name in OF_STEPS.items():
            action = self.spec.operators[name].body.args[0].args[0]  # of [][action]_vars
            yield ProofResult(goal, kind.name, *base.prove(both.value(action, {}), kind.guard))

    def _claims(self, where: Evaluator) -> Iterator[tuple[str, Value]]:
        for name in self.conjuncts:
            yield name, where.operator(name)

    def _invariant(self, state: Mapping[str, Value]) -> Evaluator:
        return Evaluator(self.spec, self._constants, state, {}, lambda _: True)

    def _solver(self) -> z3.Solver:
        solver = z3.Solver()
        solver.set("rlimit", EFFORT)
        solver.set("random_seed", 0)
        n = z3.Int("n")
        stations = self._constants["Stations"]
        solver.add(self._constants["MaxRounds"] >= 1)
        solver.add(z3.ForAll([n], z3.Implies(stations.contains(n), n >= 1)))
        return solver

    def _first(self) -> dict[str, Value]:
        known = Evaluator(self.spec, self._constants)
        init = self._conjuncts(self.spec.operators[FIRST].body)
        return {part.args[0].name: known.value(part.args[1], {}) for part in init}

    def _conjuncts(self, node: Node) -> Iterator[Node]:
        """The parts of a conjunction, also of those that it calls."""
        if node.op == "call":
            yield from self._conjuncts(self.spec.operators[node.name].body)
        elif node.op in ("\\land", "$ConjList"):
            for arg in node.args:
                yield from self._conjuncts(arg)
        else:
            yield node

    def station(self, s: Value) -> Value:
        """Any station, in the form of ``Initial``."""
        s = lift(s)
        of_sets = {"recorded": 0, "withdrawn": 0, "joined": (0, 0)}
        made: dict[str, Value] = {}
        for name, value in self._initial.items():
            if name == "outbox":
                made[name] = _any_set(name, self._entry, (s,), ENTRIES)
            elif isinstance(value, Set):
                made[name] = _any_set(name, of_sets[name], (s,))
            elif isinstance(value, tuple):
                made[name] = tuple(_any(f"{name}_{n}", 0, s) for n, _ in enumerate(value, 1))
            else:
                made[name] = _any(name, value, s)
        return made

    def transitions(self) -> Iterator[ProofStep]:
        """The steps of ``NextInOrder``, by input."""
        before = Evaluator(self.spec, self._constants, self._state)
        yield from self._action(before, self.spec.operators[NEXT].body, {}, [], "")

    def _action(
        self, e: Evaluator, node: Node, env: Env, guards: Sequence[Value], name: str
    ) -> Iterator[ProofStep]:
        if node.op in ("\\lor", "$DisjList"):
            for arg in node.args:
                yield from self._action(e, arg, env, guards, name)
        elif node.op == "call":
            operator = self.spec.operators[node.name]
            given = [e.value(arg, env) for arg in node.args]
            inner = dict(zip(operator.params, given, strict=True))
            yield from self._action(e, operator.body, inner, guards, name)
        elif node.op == "$BoundedExists":
            ((bound, where),) = node.bounds
            for part in e.value(where, env).parts:
                member = part()
                if member.guard is not False:
                    chosen = {**env, bound: member.element}
                    label = _label(member.element) if bound == "i" else name
                    more = [*guards, member.guard]
                    yield from self._action(e, node.args[0], chosen, more, label)
        elif node.op in ("\\land", "$ConjList"):
            actions = [arg for arg in node.args if self._is_action(arg)]
            updates = [arg for arg in actions if _is_assignment(arg) or _says_that_it_changes(arg)]
            more = [*guards, *(e.value(arg, env) for arg in node.args if arg not in actions)]
            calls = [arg for arg in actions if arg not in updates]
            for parts in product(*(list(self._action(e, arg, env, [], name)) for arg in calls)):
                after = {var: value for part in parts for var, value in part.after.items()}
                both = replace(e, after=after)
                for arg in filter(_is_assignment, updates):
                    after = {**after, arg.args[0].args[0].name: both.value(arg.args[1], env)}
                guard = all_of([*more, *(part.guard for part in parts)])
                yield ProofStep(name, guard, after)
        elif _is_assignment(node):
            after = {node.args[0].args[0].name: e.value(node.args[1], env)}
            yield ProofStep(name, all_of(guards), after)
        else:
            raise ValueError(f"{node.at}: not a form of action that can be proved")

    def _is_action(self, node: Node) -> bool:
        """Whether it speaks of the next state."""
        inside = [node.args, [body for _, body in node.bounds]]
        if node.op == "call":
            inside.append([self.spec.operators[node.name].body])
        return node.op == "'" or any(map(self._is_action, chain(*inside)))


def _is_assignment(node: Node) -> bool:
    return node.op == "=" and node.args[0].op == "'"


def _says_that_it_changes(node: Node) -> bool:
    """view' # view, which is left out."""
    return node.op == "/=" and node.args[0].op == "'"


def _label(i: Value) -> str:
    """An input in words."""
    match i["kind"]:
        case "receive":
            return f"receive {i['message']['type']}"
        case "command":
            return f"command {i['name']}"
        case "expire":
            first, *rest = i["timer"]
            if rest and isinstance(rest[0], dict):
                return f"expire {first}({rest[0]['type']})"
            return f"expire {first}"
    return str(i["kind"])


def _any(name: str, sample: Value, of: z3.ExprRef) -> z3.ExprRef:
    return z3.Function(name, of.sort(), sort_of(sample))(of)


def _any_set(
    name: str, sample: Value, of: Sequence[z3.ExprRef] = (), types: Sequence[str] = ("",)
) -> Set:
    """Any set of values in the form of the sample; if types are given, of records of these types.

    The set is a function of the arguments ``of``.
    """

    def part(kind: str) -> Callable[[], Member]:
        def make() -> Member:
            rest = {k: v for k, v in sample.items() if k != "type"} if kind else sample
            element, free = variables(rest, name)
            sorts = [x.sort() for x in (*of, *free)]
            holds = z3.Function(f"{name}_{kind}", *sorts, z3.BoolSort())(*of, *free)
            if kind:
                element = {key: kind if key == "type" else element[key] for key in sample}
            return Member(tuple(free), holds, element, holds)

        return make

    return Set(tuple(map(part, types)))
