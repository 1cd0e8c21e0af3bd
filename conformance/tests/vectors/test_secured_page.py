"""docs/secured.md: its code runs, and its reasons and figures are those of the code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from automcm.encoding.codec import JSON, NAMES, codec
from automcm.links.clock import VirtualClock
from automcm.links.secured import SecuredLink
from automcm.links.simulated_radio import Radio
from automcm.security import budget, certificates, cose, envelope, verifier
from automcm.security.certificates import Credentials
from automcm.security.signer import Signer
from automcm.security.verifier import Rejection, Verifier
from automcm.service import key_files, secured_service
from automcm.service.secured_service import attach
from automcm.service.service import McService
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.messages import MAX_BYTES
from automcm_spec.vocabulary.parameters import Parameters

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "secured.md").read_text()


def test_the_code_of_the_page_runs(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    authority, key, clock = cose.new_key(), cose.new_key(), VirtualClock()
    own = certificates.issue(authority, key.public_key(), ids=[1], not_before=0, not_after=60)
    key_files.save(tmp_path / "1", key, own, [authority.public_key()])
    radio, heard = Radio(clock), list[bytes]()
    radio.link(2).open(lambda data, tx: heard.append(data))
    names: dict[str, Any] = {
        "folder": tmp_path / "1",
        "codec": JSON,
        "parameters": Parameters(),
        "clock": clock,
        "udp_link": radio.link(1),
        "station_id": 1,
        "application": Straight(),
        "key_files": key_files,
        "SecuredLink": SecuredLink,
        "Signer": Signer,
        "McService": McService,
        "attach": attach,
    }
    exec(compile(code, "<secured.md>", "exec"), names)
    names["service"].start()
    clock.run(1000)
    other = Verifier([authority.public_key()], JSON, Parameters())
    assert {type(each) for data in heard for each in other.receive(data, 1000)} == {
        verifier.Verified
    }


def test_the_reasons_are_those_of_the_code_in_the_order_of_the_checks() -> None:
    _, _, table = PAGE.partition("## What is discarded")
    first = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    assert re.findall(r"`(\w+)`", " ".join(first)) == list(Rejection)


def _added(*, whole: bool) -> list[int]:
    """The bytes that an envelope adds to each message of docs/messages.md, in each codec."""
    now_s = 1_800_000_000
    authority, key, ids = cose.new_key(), cose.new_key(), [sizes.plain()[0].src]
    times = {"not_before": now_s - 3600, "not_after": now_s + 7 * 86_400}
    own = Credentials(certificates.issue(authority, key.public_key(), ids=ids, **times), key)
    messages = [*sizes.plain(), *sizes.carrying(sizes.trajectory(52))]
    encoded = [(name, codec(name).encode(each)) for each in messages for name in NAMES]
    sealed = [(data, envelope.seal(own, n, data, 1000 * now_s, whole=whole)) for n, data in encoded]
    return [len(made) - len(data) for data, made in sealed]


def test_the_figures_are_those_of_the_code() -> None:
    said = " ".join(PAGE.split())
    for form, preposition in (("digest", "with a digest"), ("certificate", "with a certificate")):
        added = _added(whole=form == "certificate")
        assert f"{min(added)} to {max(added)}" + (" bytes" if form == "digest" else "") in said
        assert preposition in said
    for figure in (
        f"at most {certificates.CERTIFICATE_BYTES} bytes",
        f"more than {MAX_BYTES:,} bytes",
        f"by default {verifier.freshness_ms(Parameters())} ms",
        f"clocks {verifier.CLOCK_MS} ms apart",
        f"more than {verifier.CLOCK_MS} ms in the future",
        f"{verifier.WAITING} messages wait, {verifier.WAITING_OF_ONE} of one signer",
        f"{budget.PER_SECOND} verifications a second",
        f"within {secured_service.NEAR_M} m",
    ):
        assert figure in said, figure
