"""What follows from each fault, and why."""

from __future__ import annotations

import signal
from typing import NamedTuple


class Why(NamedTuple):
    """The effect of a fault, for the page, and its permitted results."""

    text: str
    acting: tuple[str, ...]
    """How the session may end for the peer if the fault begins in ACTUATING."""
    codes: tuple[int, ...] = (0,)
    diverges: bool = False
    ends: bool = False
    """The process ends by itself, at once or with its session."""
    everywhere: bool = False
    """The session ends so in whatever phase the fault begins."""


GOES_ON = "Lost records are counted; the session continues."
STOPS = "The station leaves with a Cancel (END-1) and exits."
LOG = (0, 3)
OURS = (1, 70)
FIN, CAMS, ABORT = ("Fin",), ("end of CAMs",), ("Cancel(abort)",)


def unharmed(text: str, codes: tuple[int, ...] = (0,)) -> Why:
    """Nobody notices anything."""
    return Why(text, FIN, codes, everywhere=True)


def only_new(text: str) -> Why:
    """A session goes on; a new one is not begun."""
    return Why(text, FIN, LOG, diverges=True)


def stops(text: str = STOPS, codes: tuple[int, ...] = (0,)) -> Why:
    """The process stops in order."""
    return Why(text, ABORT, codes, ends=True)


WHY: dict[str, Why] = {
    "nothing": unharmed("No fault."),
    "send refused": Why("Messages and CAMs are lost; the peer leaves by its timers.", CAMS),
    "send refused now and then": unharmed("Lost messages are resent."),
    "receive fails": Why(
        "The station receives nothing. Its timers end the session with a Cancel.",
        ("Cancel(cam_loss)",),
    ),
    "select fails": Why("The event loop and the CAMs stop at once.", CAMS, (3,)),
    "names cannot be looked up": unharmed("None: addresses are numeric."),
    "log: no space": unharmed(GOES_ON + " Exit code 3 reports lost log records.", LOG),
    "log: input/output error": unharmed("As without space.", LOG),
    "log: space for half a line": unharmed("As without space. The half line is removed.", LOG),
    "log: write blocks": unharmed("As without space: only the writer thread waits.", LOG),
    "standard output: no space": unharmed(GOES_ON),
    "standard output: closed": unharmed(GOES_ON),
    "standard output: blocks": unharmed(GOES_ON),
    "every write blocks": unharmed("Log and reports are lost; the session continues.", LOG),
    "number file: no space": only_new(
        "Only a new session needs the file. Its messages are not sent (END-8), the log diverges, "
        "and the process exits."
    ),
    "number file: rename fails": only_new("As without space."),
    "no file can be opened": only_new("As for the number file."),
    "no descriptor is free": only_new("As for the number file; nothing else needs a descriptor."),
    "memory limit": Why(
        "Python's reserve usually lasts for a session. Otherwise as without memory.",
        FIN + ABORT,
        (0, *OURS),
        ends=True,
    ),
    "no memory now and then": stops(codes=OURS),
    "time jumps ahead": Why(
        "All timers are due. The station leaves, by ACT-2 if it acts.",
        ("Cancel(cam_loss)",),
        diverges=True,
    ),
    "time goes back": Why(
        "No timer is due and no CAM is sent until time has caught up.", CAMS, diverges=True
    ),
    "time stands still": Why("No timer is ever due; no CAMs are sent.", CAMS, diverges=True),
    "the host sleeps": Why(
        "As if time jumped ahead, because the peer was awake.",
        ("Cancel(cam_loss)",),
        diverges=True,
    ),
    "the position raises": stops(codes=OURS),
    "the application raises": stops(
        STOPS + " If the application is not called again, the session continues.", (0, *OURS)
    ),
    "SIGTERM": stops(),
    "SIGTERM twice": stops(
        "The second signal ends the process at once; the Cancel is sent once.", (0, -signal.SIGTERM)
    ),
    "SIGINT": stops(),
    "SIGHUP": stops(),
    "SIGPIPE": unharmed("The signal is ignored."),
    "SIGUSR1": Why("The system kills the process; the CAMs stop.", CAMS, (-signal.SIGUSR1,)),
    "SIGKILL": Why("The CAMs stop.", CAMS, (-signal.SIGKILL,)),
    "SIGSTOP": Why(
        "The process is stopped until its peer has left; the CAMs stop. Then due timers end the "
        "session, and the log has late_ms.",
        CAMS,
        diverges=True,
    ),
}
