"""The machine of the stateful tests: what applications do too, as rules of hypothesis."""

from __future__ import annotations

from typing import Any

import hypothesis
from hypothesis import strategies as st
from hypothesis import target
from hypothesis.stateful import precondition
from stateful_oracle import LEASES
from stateful_surroundings import LOST, SOME, STATION, Surroundings, nth, step
from stateful_world import trajectory

from automcm_spec.vocabulary import application

UPTO = ("CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING", "DECIDING")
"""DECIDING: about the next proposal, or ACTUATING if there is none."""
NAMES = ("close", "prescribe", "proceed", "accept", "refuse", "complete", "abort")


class Coordination(Surroundings):
    """The same, and applications that take part in sessions."""

    # -- the applications

    @step(s=STATION)
    def request(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.command(nth(up, s), application.Request(scenario="lane_change", details={}))

    def choosing(self) -> list[int]:
        world = self.world
        deciding = [s for s in world.at("prescriber", "NEGOTIATING") if world.state(s).deciding]
        return world.at("prescriber", "CHOOSING") + deciding

    def verifying(self) -> list[int]:
        return self.world.at("receiver", "NEGOTIATING")

    def _say(
        self, s: int, command: type[application.Proceed | application.Complete | application.Abort]
    ) -> None:
        """Of the session that it is in."""
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, command(session=session))

    def _prescribe(self, s: int, to: int, lease: int) -> None:
        x = self.world.state(s)
        assert x.session is not None
        targets = sorted(x.recorded) or [x.target]
        command = application.Prescribe(
            session=x.session,
            proposal=x.proposal + 1,
            target=nth(targets, to),
            prescribed=trajectory(x.session[1] * 10 + x.proposal),
            hold_ms=50,
            lease_ms=lease,
        )
        self.world.command(s, command)

    @precondition(choosing)
    @step(s=STATION, to=STATION, lease=st.sampled_from(LEASES))
    def prescribe(self, s: int, to: int, lease: int) -> None:
        self._prescribe(nth(self.choosing(), s), to, lease)

    @precondition(choosing)
    @step(s=STATION)
    def proceed(self, s: int) -> None:
        self._say(nth(self.choosing(), s), application.Proceed)

    def _verdict(self, s: int, refused: bool) -> None:
        m = self.world.asked[s]
        which: Any = {"session": m.session, "proposal": m.proposal}
        command = (
            application.Refuse(**which)
            if refused
            else application.Accept(**which, selected=m.prescribed)
        )
        self.world.command(s, command)

    @precondition(verifying)
    @step(s=STATION, refused=st.booleans())
    def verdict(self, s: int, refused: bool) -> None:
        self._verdict(nth(self.verifying(), s), refused)

    @precondition(Surroundings.acting)
    @step(s=STATION)
    def complete(self, s: int) -> None:
        self._say(nth(self.acting(), s), application.Complete)

    @precondition(Surroundings.bound)
    @step(s=STATION)
    def abort(self, s: int) -> None:
        self._say(nth(self.bound(), s), application.Abort)

    @step(s=STATION, name=st.sampled_from(NAMES), what=st.integers(0, 3))
    def untimely(self, s: int, name: str, what: int) -> None:
        """A command, whatever the phase."""
        up = self.world.up()
        if up:
            self._mistake(nth(up, s), name, what)

    def asked(self) -> list[tuple[str, int]]:
        """Whose command would fit its phase."""
        found = [("close", s) for s in self.world.at("prescriber", "ADVERTISING")]
        found += [("prescribe", s) for s in self.choosing()]
        found += [("proceed", s) for s in self.world.at("prescriber", "CHOOSING")]
        found += [(name, s) for s in self.verifying() for name in ("accept", "refuse")]
        return found + [("complete", s) for s in self.acting()]

    @precondition(asked)
    @step(n=SOME, what=st.integers(0, 3))
    def mistaken(self, n: int, what: int) -> None:
        """A command that fits the phase, but perhaps not the session, proposal or target."""
        name, s = nth(self.asked(), n)
        self._mistake(s, name, what)

    def _mistake(self, s: int, name: str, what: int) -> None:
        x = self.world.state(s)
        session = x.session or (s, 1)
        if what == 1:
            session = session[0], session[1] + 1
        wrong = what == 2
        prescribed = trajectory(1)
        which: Any = {"session": session, "proposal": max(1, x.proposal + wrong)}
        command: application.Command
        match name:
            case "prescribe":
                targets = [q for q in self.world.ids if q not in (x.target, *x.recorded)]
                targets = sorted(targets, key=lambda q: q != s)  # itself first
                others = [q for q in self.world.ids if q != s]
                command = application.Prescribe(
                    session=session,
                    proposal=x.proposal + 1 + wrong,
                    target=targets[0] if what == 3 and targets else (x.target or others[0]),
                    prescribed=prescribed,
                    hold_ms=0,
                    lease_ms=LEASES[0],
                )
            case "close":
                command = application.Close(session=session)
            case "proceed":
                command = application.Proceed(session=session)
            case "accept":
                m = self.world.asked.get(s)
                command = application.Accept(**which, selected=m.prescribed if m else prescribed)
            case "refuse":
                command = application.Refuse(**which)
            case "complete":
                command = application.Complete(session=session)
            case _:
                command = application.Abort(session=session)
        self.world.command(s, command)

    def _arrive(self, lost: str, slow: bool) -> None:
        """What arrives, arrives, but for messages of one type; if there is nothing, time passes.
        It also does if messages are slow."""
        world = self.world
        world.lost = lost
        deadline = world.next_deadline()
        moved = not slow and world.exchange() > 0
        if deadline is not None and not (moved or self.choosing() or self.verifying()):
            world.pass_time(deadline, late=slow)
        world.lost = ""

    def _answer(self, lease: int, refusals: int) -> None:
        """Who is asked agrees, after some refusals."""
        for s in self.choosing():
            self._prescribe(s, 0, lease)
        for s in self.verifying():
            self._verdict(s, refused=self.world.asked[s].proposal <= refusals)

    @step(rounds=st.integers(1, 8), refusals=st.integers(0, 2), lost=LOST, slow=st.booleans())
    def go_on(self, rounds: int, refusals: int, lost: str, slow: bool) -> None:
        """A while in which all goes well, but that messages of one type are lost."""
        for _ in range(rounds):
            self._arrive(lost, slow)
            self._answer(LEASES[0], refusals)

    def at_rest(self) -> list[int]:
        states = ((s, self.world.state(s)) for s in self.world.up())
        return [s for s, x in states if not x.bound and not x.backoff]

    @precondition(at_rest)
    @step(
        s=STATION,
        upto=st.sampled_from(UPTO),
        lease=st.sampled_from(LEASES),
        refusals=st.integers(0, 2),
        lost=LOST,
        slow=st.booleans(),
    )
    def session(self, s: int, upto: str, lease: int, refusals: int, lost: str, slow: bool) -> None:
        """A station opens a session, and it goes on up to a phase of its."""
        self._session(nth(self.at_rest(), s), upto, lease, refusals, lost, slow)

    def _session(
        self, s: int, upto: str, lease: int, refusals: int = 0, lost: str = "", slow: bool = False
    ) -> None:
        self.world.command(s, application.Request(scenario="lane_change", details={}))
        for _ in range(16):
            for go_on in (lambda: self._arrive(lost, slow), lambda: self._answer(lease, refusals)):
                go_on()
                x = self.world.state(s)
                if x.phase in (upto, "STANDALONE"):
                    return
                if upto == "DECIDING" and (x.deciding or x.phase == "ACTUATING"):
                    return

    @precondition(at_rest)
    @step(s=STATION, times=st.integers(1, 3))
    def change_of_mind(self, s: int, times: int) -> None:
        """A station opens a session and soon aborts it; nobody hears of that."""
        s = nth(self.at_rest(), s)
        for _ in range(times):
            self.world.command(s, application.Request(scenario="lane_change", details={}))
            self.world.exchange()
            if self.world.state(s).session is not None:
                self._say(s, application.Abort)

    def promised(self) -> list[int]:
        return self.world.at("receiver", "INTENDING", "WAITING", "NEGOTIATING", "ACTUATING")

    @precondition(promised)
    @step(s=STATION, heard=st.booleans())
    def defect(self, s: int, heard: bool) -> None:
        """A receiver breaks off.  That arrives before anything else; or nobody hears of it, and
        it opens a session of its own."""
        s = nth(self.promised(), s)
        self._say(s, application.Abort)
        if heard:
            self.world.exchange(backwards=True)
        else:
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
            self.world.command(s, application.Request(scenario="lane_change", details={}))

    def committed(self) -> list[int]:
        return self.world.at("receiver", "ACTUATING")

    @step(s=STATION, restart=st.booleans(), rival=st.booleans())
    def let_go(self, s: int, restart: bool, rival: bool) -> None:
        """A committed receiver (of a new session if there is none) aborts, or restarts, and nobody
        hears of it; another station may want it then."""
        stations = self.at_rest()
        if stations and not self.committed():
            self._session(nth(stations, s), "ACTUATING", LEASES[0])
        if not self.committed():
            return
        s = nth(self.committed(), s)
        if restart:
            self.world.restart(s)
        else:
            self._say(s, application.Abort)
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
        rivals = [t for t in self.at_rest() if t != s]
        if rival and rivals:
            self._session(rivals[0], "ACTUATING", LEASES[0])

    session_again = session
    go_on_again = go_on
    mistaken_again = mistaken

    def teardown(self) -> None:
        if hypothesis.currently_in_test_context():
            world = self.world
            target(len(world.rules), label="rules by role and phase")
            target(len(world.accepted), label="acceptances")
            target(max((k for _, k in world.prescribed), default=0), label="proposals")
            target(world.longest_hazard, label="hazard, ms")
