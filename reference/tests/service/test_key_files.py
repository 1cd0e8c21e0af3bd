"""Keys in files: who can read them, and what an error shows."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest
from security_stage import AUTHORITY, OTHER_AUTHORITY, credentials, key

from automcm.encoding.codec import JSON
from automcm.security import certificates, cose
from automcm.service import key_files
from automcm.service.key_files import KeyFileError
from automcm_spec.vocabulary.parameters import Parameters

ONE = credentials(1)
AUTHORITIES = [AUTHORITY.public_key(), OTHER_AUTHORITY.public_key()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    key_files.save(folder, ONE.key, ONE.certificate, AUTHORITIES)
    return folder


def test_what_is_saved_is_loaded_and_readable_by_its_owner_only(folder: Path) -> None:
    found, authorities = key_files.load(folder), key_files.load_authorities(folder)
    assert found.certificate == ONE.certificate
    assert found.key.private_numbers() == ONE.key.private_numbers()
    named = {certificates.authority_digest(each) for each in authorities}
    assert named == {certificates.authority_digest(each) for each in AUTHORITIES}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "key.pem").stat().st_mode) == 0o600


def test_a_key_that_others_can_read_is_refused(folder: Path) -> None:
    for mode in (0o640, 0o604, 0o610):
        (folder / "key.pem").chmod(mode)
        with pytest.raises(KeyFileError, match="chmod 600"):
            key_files.load(folder)


@pytest.mark.parametrize("place", [".", "authorities"])
def test_a_folder_in_which_others_can_write_is_refused(folder: Path, place: str) -> None:
    for mode in (0o770, 0o702):
        (folder / place).chmod(mode)
        with pytest.raises(KeyFileError, match=f"chmod go-w {folder / place}$"):
            key_files.load(folder)
            key_files.load_authorities(folder)


def test_no_key_is_overwritten(folder: Path) -> None:
    before = (folder / "key.pem").read_bytes()
    for again in (
        lambda: key_files.save(folder, ONE.key, ONE.certificate, AUTHORITIES),
        lambda: key_files.save_key(folder / "key.pem", key(5)),
    ):
        with pytest.raises(KeyFileError, match="File exists"):
            again()
    assert (folder / "key.pem").read_bytes() == before


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("key.pem", b"rubbish", "private key of P-256"),
        ("key.pem", cose.public_pem(ONE.key.public_key()), "private key of P-256"),
        ("key.pem", cose.private_pem(key(5)), "not that of the certificate"),
        ("certificate.cwt", b"rubbish", "certificate.cwt: "),
        ("authorities/x.pem", cose.private_pem(key(5)), "public key of P-256"),
        ("authorities/x.pem", b"", "public key of P-256"),
    ],
)
def test_an_error_names_the_file_and_shows_nothing_of_it(
    folder: Path, name: str, content: bytes, said: str
) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(KeyFileError, match=said) as caught:
        key_files.load(folder)
        key_files.load_authorities(folder)
    assert str(caught.value).startswith(str(folder)) and "\n" not in str(caught.value)
    lines = cose.private_pem(ONE.key).decode().splitlines()[1:-1]
    lines += content.decode().splitlines()[1:-1]
    assert not any(line in str(caught.value) for line in lines)


def test_a_station_without_authority_is_refused(folder: Path) -> None:
    for path in (folder / "authorities").iterdir():
        path.unlink()
    with pytest.raises(KeyFileError, match="authorities: expected the public key"):
        key_files.load_verifier(folder, JSON, Parameters())
