"""Which client of the bridge is the driver, and when it gets the role back (docs/bridge.md)."""

from __future__ import annotations


class DriverRole:
    """The driver, and the holder: the first driver, which takes the role back after a failure.

    A client is a name (str), or for one without a name its connection.  The role passes on only if
    the driver has left or been silent for ``lost_after_ms``, with one exception: the holder takes
    it back while the station is in no session, once it has published for ``return_ms`` without a
    gap of ``lost_after_ms``.  Each time this happens, ``return_ms`` doubles, so that a holder that
    fails again and again cannot make the role flap.
    """

    def __init__(self, lost_after_ms: int, return_ms: int) -> None:
        self.driver: object | None = None
        self._holder: object | None = None
        self._lost_after_ms, self._return_ms = lost_after_ms, return_ms
        self._driven_ms: int | None = None
        """The last publication of any driver."""
        self._heard_ms = 0
        """The last publication of the holder."""
        self._steady_ms: int | None = None
        """Since when the holder has published without a gap."""

    def silent(self, now: int) -> bool:
        """Whether no driver has published for ``lost_after_ms``."""
        return self._driven_ms is None or now - self._driven_ms >= self._lost_after_ms

    def publish(self, client: object, now: int, bound: bool) -> bool:
        """A client publishes; whether it is the driver.  ``bound``: the station is in a session."""
        if self._holder is None and (self.driver in (None, client) or self.silent(now)):
            self._holder = client
        if client == self._holder:
            self._hear_holder(now)
        if self.driver is None or self.silent(now):
            self.driver = client
        elif client != self.driver:
            if bound or not self._is_steady(client, now):
                return False
            self.driver = client
            self._return_ms *= 2
        self._driven_ms = now
        return True

    def release(self) -> None:
        """Nobody drives from now on."""
        self.driver = None

    def leave(self, client: object) -> None:
        """The last connection of a client has ended.  Only a holder with a name may come back."""
        if client == self.driver:
            self.driver = None
        if client == self._holder:
            self._steady_ms = None
            if not isinstance(client, str):
                self._holder = None

    def _hear_holder(self, now: int) -> None:
        if self._steady_ms is None or now - self._heard_ms >= self._lost_after_ms:
            self._steady_ms = now
        self._heard_ms = now

    def _is_steady(self, client: object, now: int) -> bool:
        since = self._steady_ms
        return client == self._holder and since is not None and now - since >= self._return_ms
