"""The keys of a running station: a folder that is read again while it runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from automcm.encoding.codec import Codec
from automcm.links.clock import Clock
from automcm.links.link import Link
from automcm.links.secured import SecuredLink
from automcm.security.certificates import Credentials
from automcm.security.signer import Signer
from automcm.security.verifier import Rejection
from automcm.service import key_files
from automcm.service.key_files import CERTIFICATE, KeyFileError
from automcm.service.secured_service import attach, change_credentials
from automcm.service.service import McService
from automcm_spec.vocabulary.parameters import Parameters

POLL_MS = 1000
"""How often the certificate and the lists of revoked ones are read again."""
SOON_S = 3600
"""A certificate that expires within this time is reported."""

_PROBLEMS = {
    Rejection.UNKNOWN_AUTHORITY: "its authority is not in authorities/",
    Rejection.CERTIFICATE_EXPIRED: "it has expired; renew it with automcm keys issue --renew",
    Rejection.CERTIFICATE_NOT_YET: "it is not valid yet; compare the clocks of the two hosts",
    Rejection.REVOKED: "it is revoked; other stations discard what this one sends",
    Rejection.BAD_SIGNATURE: "the signature of its authority is wrong",
}


class StationKeys:
    """The keys of one station (docs/secured.md).

    Raises KeyFileError for a folder that cannot be used, and ParameterError for parameters that
    leave signed messages too little time.
    """

    def __init__(self, folder: Path, station_id: int, codec: Codec, parameters: Parameters) -> None:
        self._path, self._station_id, self._codec = folder / CERTIFICATE, station_id, codec
        self._credentials = self._load()
        self._verifier = key_files.load_verifier(folder, codec, parameters)
        paths = (self._path, *key_files.revoked_lists(folder))
        self._present = {path: key_files.content(path) for path in paths}
        """What was last read successfully."""
        self._reported: dict[Path, str] = {}
        """The last problem of each file."""

    def link(self, link: Link, clock: Clock) -> Link:
        """A secured link, not on the air yet.  Raises KeyFileError for an invalid certificate."""
        self._clock = clock
        self._check(self._credentials)
        signer = Signer(self._credentials, self._codec.name)
        self._link = SecuredLink(link, signer, self._verifier, clock)
        self._link.on_air = False
        return self._link

    def attach(
        self, service: McService, complain: Callable[[str], None], report: Callable[..., None]
    ) -> None:
        """Attach the service on the link, and read the folder again from now on.

        A file that cannot be used changes nothing; ``complain`` takes one line about it.
        """
        self._service, self._complain, self._report = service, complain, report
        attach(service, self._link)
        self._link.on_air = True
        self._wait()

    def about(self) -> dict[str, Any]:
        """The present certificate, for a report."""
        own = self._credentials.certificate
        return {"certificate": own.digest.hex(), "not_after": own.not_after}

    def _wait(self) -> None:
        self._clock.at(self._clock.now() + POLL_MS, self._poll)

    def _poll(self) -> None:
        lists = key_files.revoked_lists(self._path.parent)
        for path, task in (*((each, self._revoke) for each in lists), (self._path, self._renew)):
            try:
                problem = task(path)
            except KeyFileError as error:
                problem = f"{error}; nothing has changed"
            if problem and self._reported.get(path) != problem:
                self._complain(problem)
            self._reported[path] = problem
        self._wait()

    def _renew(self, path: Path) -> str:
        """Take a new certificate.  Returns what is wrong with the present one."""
        if (data := key_files.content(path)) != self._present[path]:
            new = self._load()
            self._check(new)
            change_credentials(self._service, self._link, new)
            self._credentials, self._present[path] = new, data
            self._report(event="certificate", **self.about())
        own, now = self._credentials.certificate, self._clock.now()
        if problem := self._verifier.problem(own, now):
            return f"{path}: {_PROBLEMS[problem]}"
        soon = own.not_after * 1000 - now <= SOON_S * 1000
        return f"{path}: it expires within {SOON_S // 60} minutes" if soon else ""

    def _revoke(self, path: Path) -> str:
        """Take a new list of revoked certificates."""
        if (data := key_files.content(path)) != self._present.get(path):
            if not self._verifier.revoke(data):
                raise KeyFileError(f"{path}: expected a newer list that an authority has signed")
            self._present[path] = data
            self._report(event="revocations", file=path.name)
        return ""

    def _load(self) -> Credentials:
        """The credentials in the folder.  A station keeps its id for its whole life (END-8)."""
        found = key_files.load(self._path.parent)
        if self._station_id not in found.certificate.ids:
            ids = ", ".join(map(str, found.certificate.ids))
            raise KeyFileError(
                f"{self._path}: it is for station_id {ids}, not {self._station_id}; another id "
                "needs a new process (END-8)"
            )
        return found

    def _check(self, credentials: Credentials) -> None:
        if problem := self._verifier.problem(credentials.certificate, self._clock.now()):
            raise KeyFileError(f"{self._path}: {_PROBLEMS[problem]}")
