"""A service on a secured link: which senders come first, and the record of what is rejected."""

from __future__ import annotations

import math

from automcm.links.secured import SecuredLink
from automcm.security.budget import Budget, Rank
from automcm.security.certificates import Credentials
from automcm.security.verifier import Rejected, Rejection
from automcm.service.service import McService

NEAR_M = 100
"""A station within this distance has priority over others."""
LOGGED_PER_SECOND = 100
"""How many discarded datagrams are logged in a second; all are counted."""


def attach(service: McService, link: SecuredLink) -> None:
    """Let the service rank senders for the verifier of its link, and record what that rejects."""

    def ranking(ids: tuple[int, ...]) -> Rank:
        st = service.state
        if any(each == st.peer or each in st.recorded for each in ids):
            return 0
        own = service.application.kinematics(service.now())
        last = [service.neighbours[each] for each in ids if each in service.neighbours]
        if own is None:
            return 2
        near = (math.hypot(h.x_mm - own.x_mm, h.y_mm - own.y_mm) <= NEAR_M * 1000 for h in last)
        return 1 if any(near) else 2

    logged = Budget(LOGGED_PER_SECOND)  # a flood must not fill the log

    def rejected(what: Rejected) -> None:
        if what.reason is Rejection.OVER_BUDGET or not logged.spend(0, service.now()):
            service.statistics.rejected[what.reason] += 1
        else:
            service.rejected(what.reason, what.datagram.data, what.datagram.tx)

    link.verifier.ranking, link.rejected = ranking, rejected


def change_credentials(service: McService, link: SecuredLink, credentials: Credentials) -> None:
    """Sign with other credentials.  Raises PseudonymError if a session would lose its id.

    A service keeps its id: credentials with another id are for a new service, which begins with
    ``restart``, because it does not remember sessions (END-8).
    """
    st = service.state
    in_use = service.station_id if st.bound or st.outbox else None
    link.signer.change(credentials, in_use=in_use)
