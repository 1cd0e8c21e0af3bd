"""Keys and certificates in files, which only their owner can read.

A folder has ``key.pem`` (PKCS #8), ``certificate.cwt``, and in ``authorities`` a PEM file with the
public key of each.  Errors name the file and never show what is in it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from automcm.security import certificates
from automcm.security.certificates import Certificate, Credentials
from automcm.security.cose import PrivateKey, PublicKey, private_pem, public_pem, read_pem
from automcm_spec.support import files

KEY, CERTIFICATE, AUTHORITIES = "key.pem", "certificate.cwt", "authorities"


class KeyFileError(Exception):
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
    data = _content(path)
    if path.stat().st_mode & 0o077:
        raise KeyFileError(f"{path}: other users can read it; chmod 600 {path}")
    key = read_pem(data)
    if not isinstance(key, PrivateKey):
        raise KeyFileError(f"{path}: expected a private key of P-256 in PEM without a password")
    return key


def save(
    folder: Path, key: PrivateKey, certificate: Certificate, authorities: Iterable[PublicKey]
) -> None:
    """Write the files of a station to a new folder (mode 700).  Raises KeyFileError."""
    try:
        folder.mkdir(mode=0o700)
        (folder / AUTHORITIES).mkdir()
        for authority in authorities:
            name = f"{certificates.authority_digest(authority).hex()}.pem"
            files.write(folder / AUTHORITIES / name, public_pem(authority))
        files.write(folder / CERTIFICATE, certificates.encoded(certificate))
    except OSError as error:
        raise KeyFileError(f"{folder}: {error.strerror}") from None
    save_key(folder / KEY, key)


def load(folder: Path) -> tuple[Credentials, list[PublicKey]]:
    """The credentials of a station and the authorities that it trusts.  Raises KeyFileError."""
    key, path = load_key(folder / KEY), folder / CERTIFICATE
    try:
        credentials = Credentials(certificates.read(_content(path)), key)
    except ValueError as error:
        raise KeyFileError(f"{path}: {error}") from None
    paths = sorted((folder / AUTHORITIES).glob("*.pem"))
    if not paths:
        raise KeyFileError(f"{folder / AUTHORITIES}: expected the public key of an authority")
    return credentials, [load_authority(each) for each in paths]


def load_authority(path: Path) -> PublicKey:
    """The public key of an authority.  Raises KeyFileError."""
    key = read_pem(_content(path))
    if not isinstance(key, PublicKey):
        raise KeyFileError(f"{path}: expected a public key of P-256 in PEM")
    return key


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(10_000)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None
