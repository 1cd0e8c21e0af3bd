"""``automcm keys``: an authority, and the keys and certificates of stations (docs/secured.md)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from automcm_cli.shared.common import Json, code_3, example, say, unknown, usage, write_json

if TYPE_CHECKING:
    from automcm.security.certificates import Certificate
    from automcm.security.verifier import Verifier

app = typer.Typer()

BEFORE_S = 60
"""A certificate is valid from this time before its issue, for stations whose clocks are behind."""
Authority = Annotated[Path, typer.Argument(help="Folder of the authority.")]
Station = Annotated[Path, typer.Argument(help="Folder of the station.")]


@contextmanager
def _code_3(command: str) -> Iterator[None]:
    """Exit with code 3 for a file that cannot be used, and without the extra ``secure``."""
    from automcm.links.link import LinkError
    from automcm_spec.support.extras import MissingExtra

    with code_3(f"keys {command}", LinkError, MissingExtra):
        yield


@app.command(epilog=example("keys authority authority"))
def authority(folder: Authority, json_: Json = None) -> None:
    """Make an authority in a new folder.

    Its key.pem signs certificates; nobody else may read it.  Its public key, in authorities, is for
    every station; keys issue copies it.
    """
    with _code_3("authority"):
        from automcm.service.authority_folder import AuthorityFolder

        made = AuthorityFolder.create(folder)
    if write_json(json_, {"authority": made.public.stem, "public": str(made.public)}):
        say(f"authority {made.public.stem}; its public key: {made.public}")


@app.command(epilog=example("keys issue authority keys-7 --id 7"))
def issue(
    authority: Authority,
    folder: Station,
    ids: Annotated[
        list[int] | None,
        typer.Option("--id", min=1, max=2**32 - 1, help="A station_id.  Repeatable."),
    ] = None,
    days: Annotated[float, typer.Option(help="Validity.", min=0, max=36_500)] = 7,
    role: Annotated[
        list[str] | None,
        typer.Option(help="prescriber, receiver or cam.  Repeatable.  Default: all three."),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(help="A scenario that it may advertise.  Repeatable.  Default: all."),
    ] = None,
    station_type: Annotated[
        int,
        typer.Option(
            help="5 car, 10 special vehicle, 15 road-side unit (TS 102 894-2).", min=0, max=255
        ),
    ] = 5,
    renew: Annotated[
        bool, typer.Option("--renew", help="New certificate for the key and claims in the folder.")
    ] = False,
    json_: Json = None,
) -> None:
    """Make a key and a certificate for a station.

    They are in a new folder, for automcm station --keys.  With --renew, replace the certificate in
    a folder.  A running station takes the new one within a second, also during a session.
    """
    if bool(ids) == renew or (renew and (role or scenario)):
        raise typer.BadParameter("give --id, or --renew without --id, --role and --scenario")
    with _code_3("issue"):
        from automcm.security.certificates import ROLES
        from automcm.service.authority_folder import AuthorityFolder

        for each in role or ():
            if each not in ROLES:
                raise typer.BadParameter(unknown(each, ROLES, "role"))
        signer = AuthorityFolder(authority)
        now = int(time.time())
        with usage(ValueError):
            valid = {"not_before": now - BEFORE_S, "not_after": now + int(days * 86_400)}
            if renew:
                made = signer.renew(folder, **valid)
            else:
                made = signer.issue(
                    folder,
                    ids={*(ids or ())},
                    roles=[each for each in ROLES if not role or each in role],
                    scenarios={*scenario} if scenario else None,
                    station_type=station_type,
                    **valid,
                )
    if write_json(json_, {"folder": str(folder)} | claims(made)):
        say(f"{folder}: {_text(claims(made))}")


@app.command(epilog=example("keys show keys-7"))
def show(
    folder: Annotated[Path, typer.Argument(help="Folder of a station or an authority.")],
    json_: Json = None,
) -> None:
    """Show the certificates in a folder.

    A private key is never shown.  The exit code is 1 if the certificate of a station is not valid
    now.
    """
    with _code_3("show"):
        from automcm.encoding.codec import JSON
        from automcm.service import key_files
        from automcm.service.authority_folder import ISSUED, AuthorityFolder
        from automcm_spec.vocabulary.parameters import Parameters

        verifier = key_files.load_verifier(folder, JSON, Parameters())
        is_station = (folder / key_files.CERTIFICATE).exists()
        own = key_files.load(folder).certificate if is_station else None
        of = [own] if own else AuthorityFolder(folder).issued()
        shown = [_with_status(each, verifier) for each in of]
        authorities = sorted(path.stem for path in (folder / key_files.AUTHORITIES).glob("*.pem"))
    what = ISSUED if own is None else "certificate"
    if write_json(json_, {"folder": str(folder), what: shown, "authorities": authorities}):
        for each in shown:
            say(f"{what}: {_text(each)}")
        for name in authorities:
            say(f"authority: {name}")
    raise typer.Exit(own is not None and shown[0]["status"] != VALID)


@app.command(epilog=example("keys revoke authority --id 7"))
def revoke(
    authority: Authority,
    ids: Annotated[
        list[int] | None,
        typer.Option("--id", help="Revoke all certificates of this station_id.  Repeatable."),
    ] = None,
    certificate: Annotated[
        list[str] | None, typer.Option(help="Revoke the one with this digest.  Repeatable.")
    ] = None,
    json_: Json = None,
) -> None:
    """Revoke certificates.

    It adds them to the authority's list, DIGEST.revoked in authorities.  Copy the list to the
    folder authorities of every station; running ones read it within a second.
    """
    if not ids and not certificate:
        raise typer.BadParameter("give --id or --certificate")
    with _code_3("revoke"):
        from automcm.service.authority_folder import AuthorityFolder
        from automcm.service.key_files import KeyFileError

        signer = AuthorityFolder(authority)
        issued = {each.digest.hex(): each for each in signer.issued()}
        of_ids = {name for name, each in issued.items() if {*each.ids} & {*(ids or ())}}
        known = {station_id for name in of_ids for station_id in issued[name].ids}
        for each in [*({*(ids or ())} - known), *({*(certificate or ())} - {*issued})]:
            raise KeyFileError(f"{authority}: it has issued no certificate {each}")
        names = of_ids.union(certificate or ())
        whole = signer.revoke([bytes.fromhex(name) for name in names], int(time.time()))
    found = {"list": str(signer.revoked_list), "revoked": sorted(each.hex() for each in whole)}
    if write_json(json_, found):
        say(f"revoked: {', '.join(sorted(names))}")
        say(f"copy {signer.revoked_list} to authorities/ of every station")


VALID = "valid"


def claims(certificate: Certificate) -> dict[str, Any]:
    """A certificate for JSON, as in the test vectors."""
    return {
        "digest": certificate.digest.hex(),
        "ids": list(certificate.ids),
        "not_before": certificate.not_before,
        "not_after": certificate.not_after,
        "roles": sorted(certificate.roles),
        "scenarios": None if certificate.scenarios is None else sorted(certificate.scenarios),
        "station_type": certificate.station_type,
        "authority": certificate.authority.hex(),
    }


def _with_status(certificate: Certificate, verifier: Verifier) -> dict[str, Any]:
    """A certificate for JSON, with its status now."""
    status = verifier.problem(certificate, int(time.time() * 1000)) or VALID
    return claims(certificate) | {"status": status}


def _text(of: dict[str, Any]) -> str:
    times = (datetime.fromtimestamp(of[name], UTC) for name in ("not_before", "not_after"))
    parts = [
        f"{of['digest']}, id {' '.join(map(str, of['ids']))}",
        "valid " + " to ".join(f"{each:%Y-%m-%d %H:%M:%SZ}" for each in times),
        f"roles {' '.join(of['roles'])}",
        *([] if of["scenarios"] is None else [f"scenarios {' '.join(of['scenarios'])}"]),
        f"type {of['station_type']}",
        *([of["status"]] if "status" in of else []),
    ]
    return "; ".join(parts)
