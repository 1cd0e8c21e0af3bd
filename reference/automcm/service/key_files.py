"""Keys and certificates in files, which only their owner can read.

A station's folder has ``key.pem`` (PKCS #8), ``certificate.cwt``, and in ``authorities`` of each
authority its public key, ``DIGEST.pem``, and ``DIGEST.revoked``, if it has revoked certificates.
Errors name the file and never show what is in it.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from automcm.encoding.codec import Codec
from automcm.links.link import LinkError
from automcm.security import certificates
from automcm.security.certificates import Certificate, Credentials
from automcm.security.cose import PrivateKey, PublicKey, private_pem, public_pem, read_pem
from automcm.security.verifier import Verifier
from automcm_spec.support import files
from automcm_spec.vocabulary.parameters import Parameters

KEY, CERTIFICATE, AUTHORITIES = "key.pem", "certificate.cwt", "authorities"
LARGEST = 1_000_000
"""Bytes of the largest file, a list of more than 100,000 revoked certificates."""


class KeyFileError(LinkError):
    """A file with a key or certificate cannot be used; the text names the file."""


def save_key(path: Path, key: PrivateKey) -> None:
    """Write a private key to a new file (mode 600).  Raises KeyFileError, also if it exists."""
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(fd, "wb") as file:
            file.write(private_pem(key))
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None


def load_key(path: Path) -> PrivateKey:
    """A private key.  Raises KeyFileError, also if others than its owner can read the file."""
    key = read_pem(content(path, private=True))
    if not isinstance(key, PrivateKey):
        raise KeyFileError(f"{path}: expected a private key of P-256 in PEM without a password")
    return key


def save(
    folder: Path,
    key: PrivateKey,
    certificate: Certificate,
    authorities: Iterable[PublicKey],
    lists: Iterable[Path] = (),
) -> None:
    """Write the files of a station to a new folder, with copies of lists of revoked certificates.

    Raises KeyFileError.
    """
    with new_folder(folder, authorities) as new:
        write(new / CERTIFICATE, certificates.encoded(certificate))
        for path in lists:
            write(new / AUTHORITIES / path.name, content(path))
        save_key(new / KEY, key)


@contextmanager
def new_folder(folder: Path, authorities: Iterable[PublicKey]) -> Iterator[Path]:
    """A folder (mode 700) with the public keys of authorities, which is ``folder`` at the end.

    So ``folder`` is complete or does not exist, whatever interrupts the command.  Raises
    KeyFileError, also if it exists.
    """
    try:
        if folder.exists():
            raise FileExistsError(errno.EEXIST, "File exists")
        new = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.new")
        new.mkdir(mode=0o700)
        try:
            (new / AUTHORITIES).mkdir(mode=0o700)
            for authority in authorities:
                write(authority_path(new, authority), public_pem(authority))
            yield new
            new.rename(folder)
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            raise
    except OSError as error:
        raise KeyFileError(f"{folder}: {error.strerror}") from None


def authority_path(folder: Path, authority: PublicKey) -> Path:
    """Where a folder has the public key of an authority."""
    return folder / AUTHORITIES / f"{certificates.authority_digest(authority).hex()}.pem"


def load(folder: Path) -> Credentials:
    """The credentials of a station.  Raises KeyFileError."""
    key, path = load_key(folder / KEY), folder / CERTIFICATE
    try:
        return Credentials(load_certificate(path), key)
    except ValueError as error:
        raise KeyFileError(f"{path}: {error}") from None


def load_certificate(path: Path) -> Certificate:
    """A certificate, before its verification.  Raises KeyFileError."""
    try:
        return certificates.read(content(path))
    except ValueError as error:
        raise KeyFileError(f"{path}: {error}") from None


def load_authorities(folder: Path) -> list[PublicKey]:
    """The authorities that the owner of a folder trusts.  Raises KeyFileError."""
    paths = sorted((folder / AUTHORITIES).glob("*.pem"))
    if not paths:
        raise KeyFileError(f"{folder / AUTHORITIES}: expected the public key of an authority")
    return [load_authority(each) for each in paths]


def revoked_lists(folder: Path) -> list[Path]:
    """The lists of revoked certificates in a folder."""
    return sorted((folder / AUTHORITIES).glob("*.revoked"))


def load_verifier(folder: Path, codec: Codec, parameters: Parameters) -> Verifier:
    """A verifier with the authorities of a folder and their lists.

    Raises KeyFileError, and ParameterError as ``freshness_ms``.
    """
    verifier = Verifier(load_authorities(folder), codec, parameters)
    for path in revoked_lists(folder):
        if not verifier.revoke(content(path)):
            raise KeyFileError(f"{path}: expected a list that an authority beside it has signed")
    return verifier


def load_authority(path: Path) -> PublicKey:
    """The public key of an authority.  Raises KeyFileError."""
    key = read_pem(content(path))
    if not isinstance(key, PublicKey):
        raise KeyFileError(f"{path}: expected a public key of P-256 in PEM")
    return key


def content(path: Path, *, private: bool = False) -> bytes:
    """The bytes of a file, at most LARGEST.

    Raises KeyFileError, also if other users can write in its folder or read a private file.
    """
    try:
        if path.parent.stat().st_mode & 0o022:
            raise OSError(0, f"other users can write in its folder; chmod go-w {path.parent}")
        if private:
            return files.read_private(path, LARGEST)
        with path.open("rb") as file:
            return file.read(LARGEST)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None


def write(path: Path, data: bytes) -> None:
    """Write a file that is not secret, atomically.  Raises KeyFileError."""
    try:
        files.write(path, data)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None
