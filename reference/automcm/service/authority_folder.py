"""An authority in a folder: it issues, renews and revokes certificates.

The folder has ``key.pem``, in ``authorities`` what every station needs (the public key and the list
of revoked certificates), and in ``issued`` a copy of each certificate.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Unpack

from automcm.security import certificates, cose
from automcm.security.certificates import Certificate, Claims
from automcm.service import key_files
from automcm.service.key_files import CERTIFICATE, KEY, KeyFileError
from automcm_spec.support import scratch

ISSUED = "issued"


class AuthorityFolder:
    """The authority in this folder.  All methods raise KeyFileError.  Times are in s since 1970."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._key = key_files.load_key(folder / KEY)
        self.public = key_files.authority_path(folder, self._key.public_key())
        self.revoked_list = self.public.with_suffix(".revoked")

    @classmethod
    def create(cls, folder: Path) -> AuthorityFolder:
        """A new authority in a new folder."""
        key = cose.new_key()
        with key_files.new_folder(folder, [key.public_key()]) as new:
            key_files.save_key(new / KEY, key)
        return cls(folder)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """No other process changes the folder between reading, signing and writing."""
        try:
            with scratch.locked_folder(self.folder):
                yield
        except OSError as error:
            raise KeyFileError(f"{self.folder}: {error.strerror}") from None

    def issue(self, folder: Path, **claims: Unpack[Claims]) -> Certificate:
        """A new key and its certificate in a new folder, with what a station needs to run.

        Also raises ValueError for claims that are out of bounds.
        """
        key = cose.new_key()
        new = certificates.issue(self._key, key.public_key(), **claims)
        with self._locked():
            lists = key_files.revoked_lists(self.folder)
            key_files.save(folder, key, self._keep(new), [self._key.public_key()], lists)
        return new

    def renew(self, folder: Path, *, not_before: int, not_after: int) -> Certificate:
        """Replace the certificate in a station's folder by one with the same key and claims.

        The old one must be in ``issued``, so that nobody can ask for other claims, and must not be
        revoked.
        """
        path = folder / CERTIFICATE
        with self._locked():
            old = key_files.load_certificate(path)
            if certificates.encoded(old) not in map(certificates.encoded, self.issued()):
                raise KeyFileError(f"{path}: {self.folder} has not issued it")
            if old.digest in self.revoked()[0]:
                raise KeyFileError(f"{path}: it is revoked; issue another one")
            new = certificates.issue(
                self._key,
                old.key(),
                ids=old.ids,
                not_before=not_before,
                not_after=not_after,
                roles=old.roles,
                scenarios=old.scenarios,
                station_type=old.station_type,
            )
            key_files.write(path, certificates.encoded(self._keep(new)))
        return new

    def issued(self) -> list[Certificate]:
        """The certificates that it has issued, the oldest first."""
        paths = (self.folder / ISSUED).glob("*.cwt")
        return sorted(
            map(key_files.load_certificate, paths), key=lambda each: (each.not_before, each.digest)
        )

    def revoked(self) -> tuple[frozenset[bytes], int]:
        """The digests on its list, and when that was issued."""
        if not self.revoked_list.exists():
            return frozenset(), 0
        try:
            present = certificates.read_revocations(key_files.content(self.revoked_list))
        except cose.Malformed as error:
            raise KeyFileError(f"{self.revoked_list}: {error}") from None
        return present.digests, present.issued

    def revoke(self, digests: Collection[bytes], now: int) -> frozenset[bytes]:
        """Add certificates to its list.  Returns all that are on it."""
        with self._locked():
            present, issued = self.revoked()
            whole = present.union(digests)
            key_files.write(
                self.revoked_list, certificates.revoke(self._key, whole, max(now, issued + 1))
            )
        return whole

    def _keep(self, new: Certificate) -> Certificate:
        try:
            (self.folder / ISSUED).mkdir(mode=0o700, exist_ok=True)
        except OSError as error:
            raise KeyFileError(f"{self.folder / ISSUED}: {error.strerror}") from None
        key_files.write(self.folder / ISSUED / f"{new.digest.hex()}.cwt", certificates.encoded(new))
        return new
