"""The engine on the finite graph: for what is counted of the graph, and to compare with.

What it shares with ``Engine`` is how effects are held against what must follow.
"""

from __future__ import annotations

from typing import Any

from automcm_spec.station import State, Timer
from automcm_traces import graph_inputs
from automcm_traces.asking import ask
from automcm_traces.engine import Engine
from automcm_traces.graph_view import Found, View, Y, expected, real_after, real_timer
from automcm_traces.inputs import Asked
from automcm_traces.log import Event
from automcm_traces.step import Step
from automcm_traces.track import CannotTell

Json = Any


class GraphEngine(Engine):
    """As Engine.  Raises CannotTell too where the graph knows no such situation."""

    def _asked(self, event: Event) -> Asked:
        return graph_inputs.asked(self.track, event)

    def _answered(self, at: int, t_ms: int, event: Event | None, question: Asked) -> Step:
        """Ask the graph, for each other recorded station too if the input is about all."""
        view: View = question.view
        value, given = question.value, question.given
        answer, after = ask(view, value)
        effect = answer.effect
        messages = [expected(view, m, given) for m in effect.messages]
        arm = [_real(view, timer, messages) for timer in effect.arm]
        for p in self._all_recorded(view, value):
            more = View(self.track, view.real_id(Y), p, view.event_session)
            also = ask(more, value)[0].effect
            about_p = [e for m in also.messages if (e := expected(more, m, given)).dst == p]
            messages += about_p
            of_p = [t for t in also.arm if len(t) > 1 and t[1][1] == more.ids[p]]
            arm += [_real(more, timer, about_p) for timer in of_p]
        restarts = value[0] == "restart"
        told = effect.told
        return Step(
            at,
            t_ms,
            event,
            value,
            question.what,
            effect.rule,
            self.track.state._replace(phase=after[0], role=after[1]),
            answer.changes,
            tuple(told),
            messages,
            arm,
            [] if restarts else [_real(view, timer, messages) for timer in effect.stop],
            [] if told[0] == "nothing" else [told[0]],
            given,
            dict(question.content),
            t_ms,
            found=Found(view, value, answer, after),
        )

    def _all_recorded(self, view: View, value: Json) -> list[int]:
        """Recorded stations out of view that a choice, an abort or its absence is about."""
        t = self.track
        about_all = value[0] == "command" or value == ("expire", ("decide",))
        if not about_all or t.phase not in ("ADVERTISING", "CHOOSING"):
            return []
        return [p for p in t.recorded if p not in view.ids]

    def _after(self, step: Step) -> State:
        found, t = step.found, self.track
        assert found is not None
        if step.input[0] == "restart":
            nobody: frozenset[Any] = frozenset()
            t.outbox = []
            t.state = t.state._replace(outbox=nobody, joined=nobody, recorded=nobody)
        elif found.answer.next == found.answer.state and not step.sent:
            return t.state
        return real_after(found, step.given, step.sent)


def _real(view: View, timer: Json, messages: list[Any]) -> Timer:
    real = real_timer(view, timer, messages)
    if real is None:
        raise CannotTell(f"a timer of a message that is not known: {timer}")
    return real
