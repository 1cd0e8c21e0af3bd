"""A folder of keys that is read again while its station runs; and the folder of an authority."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Any
from unittest.mock import Mock

import pytest
from security_stage import DAY, SecuredSimulation, credentials, seal
from service_stage import Noted

from automcm.encoding.codec import JSON
from automcm.links.link import Link
from automcm.security import certificates, cose
from automcm.service import key_files
from automcm.service.authority_folder import AuthorityFolder
from automcm.service.key_files import KeyFileError
from automcm.service.station_keys import POLL_MS, SOON_S, StationKeys
from automcm.service.station_process import StationProcess
from automcm_spec.vocabulary.messages import Fin, encode
from automcm_spec.vocabulary.parameters import ParameterError, Parameters


@pytest.fixture
def authority(tmp_path: Path) -> AuthorityFolder:
    return AuthorityFolder.create(tmp_path / "authority")


def keys(folder: Path, station_id: int = 1, **parameters: int) -> StationKeys:
    return StationKeys(folder, station_id, JSON, Parameters(**parameters))


class Watched(SecuredSimulation):
    """A station 1 whose folder is read again."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.keys = keys(folder)
        self.complaints: list[str] = []
        self.reports: list[dict[str, Any]] = []
        service = self.add(1, Noted())
        self.keys.attach(
            service, self.complaints.append, lambda **event: self.reports.append(event)
        )

    def link(self, station_id: int) -> Link:
        link = self.keys.link(self.radio.link(station_id), self.clock)
        self.links[station_id] = self.keys._link
        return link

    def polled(self) -> list[str]:
        """What it complains about in the next poll."""
        before = len(self.complaints)
        self.clock.run(self.clock.now() + POLL_MS)
        return self.complaints[before:]


@pytest.fixture
def folder(tmp_path: Path, authority: AuthorityFolder) -> Path:
    authority.issue(tmp_path / "1", ids=[1, 11], not_before=0, not_after=DAY)
    return tmp_path / "1"


def test_a_renewed_certificate_is_taken_and_nothing_else_of_it_changes(
    folder: Path, authority: AuthorityFolder
) -> None:
    watched = Watched(folder)
    assert watched.polled() == [] and watched.reports == []
    signer = watched.links[1].signer
    old = signer.credentials.certificate
    new = authority.renew(folder, not_before=0, not_after=2 * DAY)
    assert watched.polled() == [] and signer.credentials.certificate == new != old
    watched.polled()
    about = {"certificate": new.digest.hex(), "not_after": 2 * DAY}
    assert watched.reports == [{"event": "certificate"} | about]
    assert (new.ids, new.roles, new.point) == (old.ids, old.roles, old.point)


def test_end_8_a_certificate_for_another_id_is_refused_once_and_out_of_a_session_too(
    tmp_path: Path, folder: Path, authority: AuthorityFolder
) -> None:
    watched = Watched(folder)
    authority.issue(tmp_path / "5", ids=[5], not_before=0, not_after=DAY)
    for name in ("key.pem", "certificate.cwt"):
        (folder / name).write_bytes((tmp_path / "5" / name).read_bytes())
    (said,) = watched.polled()
    assert "for station_id 5, not 1; another id needs a new process (END-8)" in said
    assert watched.polled() == [] and not watched.reports
    assert watched.links[1].signer.credentials.certificate.ids == (1, 11)
    with pytest.raises(KeyFileError, match="END-8"):
        keys(folder)


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda folder: (folder / "certificate.cwt").unlink(), "No such file"),
        (lambda folder: (folder / "certificate.cwt").write_bytes(b"x"), "certificate.cwt: "),
        (lambda folder: next(folder.glob("authorities/*.revoked")).write_bytes(b"x"), "newer list"),
    ],
)
def test_a_file_that_cannot_be_used_changes_nothing_and_is_reported_once(
    harm: Any, said: str, folder: Path, authority: AuthorityFolder
) -> None:
    authority.revoke([bytes(8)], 5)
    (folder / "authorities" / authority.revoked_list.name).write_bytes(
        authority.revoked_list.read_bytes()
    )
    watched = Watched(folder)
    harm(folder)
    (complaint,) = watched.polled()
    assert said in complaint and complaint.endswith("nothing has changed")
    assert watched.polled() == [] and not watched.reports


def test_a_list_is_taken_when_it_is_new_and_not_when_it_is_the_same_or_old(
    tmp_path: Path, folder: Path, authority: AuthorityFolder
) -> None:
    watched = Watched(folder)
    other = authority.issue(tmp_path / "2", ids=[2], not_before=0, not_after=DAY)
    verifier = watched.links[1].verifier
    assert verifier.problem(other, 0) is None
    copy = folder / "authorities" / authority.revoked_list.name
    lists = []
    for digest in (bytes(8), other.digest):
        authority.revoke([digest], 0)
        lists.append(authority.revoked_list.read_bytes())
    copy.write_bytes(lists[1])
    assert watched.polled() == [] and verifier.problem(other, 0) == "revoked"
    copy.write_bytes(lists[1])
    assert watched.polled() == []
    copy.write_bytes(lists[0])
    assert "expected a newer list" in watched.polled()[0]
    assert verifier.problem(other, 0) == "revoked"
    assert watched.reports == [{"event": "revocations", "file": copy.name}]


@pytest.mark.slow
def test_a_certificate_that_ends_is_reported_before_and_after(
    folder: Path, authority: AuthorityFolder
) -> None:
    authority.renew(folder, not_before=0, not_after=SOON_S + 3)
    watched = Watched(folder)
    watched.clock.run(2999)
    assert watched.complaints == []
    watched.clock.run((SOON_S + 3) * 1000 - 1)
    assert [re.sub(".*: ", "", each) for each in watched.complaints] == [
        "it expires within 60 minutes"
    ]
    watched.clock.run((SOON_S + 9) * 1000)
    assert "it has expired; renew it" in watched.complaints[1] and len(watched.complaints) == 2
    with pytest.raises(KeyFileError, match="it has expired"):
        keys(folder).link(watched.radio.link(9), watched.clock)


def test_a_certificate_that_is_not_valid_is_not_taken(
    folder: Path, authority: AuthorityFolder
) -> None:
    watched = Watched(folder)
    old = watched.links[1].signer.credentials.certificate
    authority.renew(folder, not_before=9, not_after=DAY)
    assert "it is not valid yet" in watched.polled()[0]
    assert watched.links[1].signer.credentials.certificate == old and not watched.reports
    watched.clock.run(9000)
    watched.polled()
    assert watched.links[1].signer.credentials.certificate.not_before == 9


def test_a_station_whose_certificate_is_revoked_does_not_start(
    folder: Path, authority: AuthorityFolder
) -> None:
    watched = Watched(folder)
    authority.revoke([watched.links[1].signer.credentials.certificate.digest], 0)
    copy = folder / "authorities" / authority.revoked_list.name
    copy.write_bytes(authority.revoked_list.read_bytes())
    assert "it is revoked" in watched.polled()[0]
    with pytest.raises(KeyFileError, match="it is revoked"):
        keys(folder).link(watched.radio.link(9), watched.clock)


def test_parameters_that_leave_no_time_are_refused(folder: Path) -> None:
    with pytest.raises(ParameterError, match="increase t_timeout"):
        keys(folder, t_timeout=150, t_resend=20)


def test_a_list_of_a_stranger_is_refused_at_the_start(tmp_path: Path, folder: Path) -> None:
    stranger = AuthorityFolder.create(tmp_path / "stranger")
    stranger.revoke([bytes(8)], 0)
    (folder / "authorities" / "x.revoked").write_bytes(stranger.revoked_list.read_bytes())
    with pytest.raises(KeyFileError, match=r"x\.revoked: expected a list"):
        keys(folder)


def test_an_authority_renews_only_what_it_has_issued_and_not_revoked(
    tmp_path: Path, folder: Path, authority: AuthorityFolder
) -> None:
    path = folder / "certificate.cwt"
    ours = path.read_bytes()
    old = certificates.read(ours)
    forged = certificates.issue(cose.new_key(), old.key(), ids=[1, 99], not_before=0, not_after=9)
    path.write_bytes(certificates.encoded(forged))
    with pytest.raises(KeyFileError, match="has not issued it"):
        authority.renew(folder, not_before=0, not_after=DAY)
    path.write_bytes(ours)
    authority.revoke([old.digest], 0)
    with pytest.raises(KeyFileError, match="it is revoked"):
        authority.renew(folder, not_before=0, not_after=DAY)
    assert path.read_bytes() == ours


def test_two_revocations_at_once_are_both_on_the_list(
    authority: AuthorityFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    sign, second = certificates.revoke, Thread(target=authority.revoke, args=([b"2" * 8], 0))

    def signing(*of: Any) -> bytes:
        monkeypatch.undo()
        second.start()
        second.join(0.1)  # without a lock it ends here, and its entry is then lost
        return sign(*of)

    monkeypatch.setattr(certificates, "revoke", signing)
    authority.revoke([b"1" * 8], 0)
    second.join()
    assert authority.revoked()[0] == {b"1" * 8, b"2" * 8}


class Killed(BaseException):
    """The process is killed before it changes the next file."""


def _keys_commands(folder: Path) -> None:
    """Every command that changes a folder, unless an earlier run has done so."""
    if not (folder / "authority").exists():
        AuthorityFolder.create(folder / "authority")
    signer = AuthorityFolder(folder / "authority")
    if not (folder / "9").exists():
        signer.issue(folder / "9", ids=[9], not_before=0, not_after=1)
    old = key_files.load(folder / "9").certificate
    signer.renew(folder / "9", not_before=0, not_after=1 + len(signer.issued()))
    signer.revoke([old.digest], 0)


STEPS = 17
"""Changes of a file or a folder by ``_keys_commands``."""


@pytest.mark.parametrize("steps", range(STEPS + 2))
def test_the_next_command_works_with_what_an_interrupted_one_has_left(
    steps: int, tmp_path: Path
) -> None:
    left = iter(range(steps))

    def dying(change: Callable[..., None]) -> Callable[..., None]:
        def then(*of: Any, **more: Any) -> None:
            if next(left, None) is None:
                raise Killed
            change(*of, **more)

        return then

    with pytest.MonkeyPatch.context() as patch, suppress(Killed):
        patch.setattr(shutil, "rmtree", lambda *of, **more: None)  # nor does it clean up
        for owner, name in ((key_files, "write"), (key_files, "save_key")):
            patch.setattr(owner, name, dying(getattr(owner, name)))
        for name in ("mkdir", "rename"):
            patch.setattr(Path, name, dying(getattr(Path, name)))
        _keys_commands(tmp_path)
    _keys_commands(tmp_path)
    assert bool([*left]) == (steps > STEPS)


def test_a_list_grows_and_a_new_station_gets_it(tmp_path: Path, authority: AuthorityFolder) -> None:
    for n in range(3):
        assert len(authority.revoke([bytes(7) + bytes([n])], 7)) == n + 1
    assert authority.revoked()[1] == 9
    authority.issue(tmp_path / "1", ids=[1], not_before=0, not_after=DAY)
    (copy,) = key_files.revoked_lists(tmp_path / "1")
    assert copy.read_bytes() == authority.revoked_list.read_bytes()


@pytest.mark.parametrize("keys", [None, object()])
def test_end_5_what_nobody_signed_is_not_decoded(keys: Any) -> None:
    """It is reported once, by its first bytes."""
    said: list[str] = []
    station = StationProcess(
        station_id=1,
        application=Noted(),
        link=lambda: pytest.fail("no link is needed"),
        codec=Mock(**{"decode.side_effect": AssertionError}),
        parameters=Parameters(),
        report=lambda event: None,
        keys=keys,
        complain=said.append,
    )
    udp, message = Mock(), Fin(src=1, dst=2, session=(1, 1), seq=2)
    for data in (encode(message), seal(credentials(1), message), b"\xff" * 65_000):
        station._unread(udp, data)
    assert ["with --keys" in line for line in said] == [True] * (2 if keys else 1)
    assert udp.unread(b"") is None
