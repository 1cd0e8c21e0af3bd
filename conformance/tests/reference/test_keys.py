"""``automcm keys``, and stations as processes that sign their messages."""

from __future__ import annotations

import base64
import json
import re
import shutil
import signal
import stat
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm, automcm_process
from station_stage import Road, Running, road

from automcm.security import cose
from automcm.service import key_files
from automcm_simulation.road.demo_processes import Demo, DemoVehicle

SIGNED = ("--set", "t_timeout=700")
"""Short sessions, but messages are fresh for 800 ms, also on a busy machine."""


def made(*words: object) -> dict[str, Any]:
    done = automcm("keys", *words, "--json", "-")
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def issued(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An authority, and stations 1 and 2."""
    folder = tmp_path_factory.mktemp("keys")
    made("authority", folder / "authority")
    for n in (1, 2):
        made("issue", folder / "authority", folder / str(n), "--id", n)
    return folder


@pytest.fixture
def folder(issued: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(issued, tmp_path, dirs_exist_ok=True))


def revoke(folder: Path, *of: object) -> None:
    found = made("revoke", folder / "authority", *of)
    for n in (1, 2):
        shutil.copy(found["list"], folder / str(n) / "authorities")


def test_an_authority_issues_shows_and_revokes(folder: Path) -> None:
    authority = folder / "authority"
    options = ["--id", 3, "--id", 4, "--role", "cam", "--scenario", "merge", "--station-type", 15]
    issued = made("issue", authority, folder / "3", *options, "--days", 0.5)
    assert issued.pop("folder") == str(folder / "3")
    assert (issued["ids"], issued["roles"], issued["scenarios"]) == ([3, 4], ["cam"], ["merge"])
    assert issued["station_type"] == 15
    assert issued["not_after"] - issued["not_before"] == 43_200 + 60
    assert abs(issued["not_before"] + 60 - time.time()) < 60
    shown = made("show", folder / "3")
    assert shown["certificate"] == [issued | {"status": "valid"}]
    assert shown["authorities"] == [issued["authority"]]
    of_all = {each["digest"]: each["status"] for each in made("show", authority)["issued"]}
    assert set(of_all.values()) == {"valid"} and len(of_all) == 3

    revoked = made("revoke", authority, "--id", 4)
    assert revoked["revoked"] == [issued["digest"]]
    text = automcm("keys", "show", authority).output
    assert text.count("; revoked") == 1 and text.count("; valid") >= 2
    assert automcm("keys", "show", folder / "3").exit_code == 0, "it has no list yet"
    shutil.copy(revoked["list"], folder / "3" / "authorities")
    done = automcm("keys", "show", folder / "3")
    assert done.exit_code == 1 and "; revoked" in done.output
    digest = made("show", folder / "1")["certificate"][0]["digest"]
    both = made("revoke", authority, "--certificate", digest)["revoked"]
    assert both == sorted([digest, issued["digest"]])


def test_only_its_owner_can_read_a_key(folder: Path) -> None:
    for name in ("authority", "1"):
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o700
        assert stat.S_IMODE((folder / name / "key.pem").stat().st_mode) == 0o600
        (folder / name / "key.pem").chmod(0o640)
    for words in (["issue", folder / "authority", folder / "9", "--id", 9], ["show", folder / "1"]):
        done = automcm("keys", *words)
        assert done.exit_code == 3 and "other users can read it; chmod 600" in done.output
    done = automcm("station", "--id", "1", "--keys", folder / "1")
    assert done.exit_code == 3 and f"chmod 600 {folder / '1' / 'key.pem'}" in done.output


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("keys authority authority", 3, "authority: File exists"),
        ("keys issue authority 1 --id 1", 3, "1: File exists"),
        ("keys issue none 3 --id 1", 3, "none/key.pem: No such file"),
        ("keys issue 1 3", 2, "give --id, or --renew"),
        ("keys issue authority 1 --renew --id 1", 2, "give --id, or --renew"),
        ("keys issue authority 1 --renew --role cam", 2, "give --id, or --renew"),
        ("keys issue 2 1 --renew", 3, "1/certificate.cwt: 2 has not issued it"),
        ("keys issue authority 3 --id 3 --role car", 2, "there is no role 'car'"),
        ("keys issue authority 3 --id 3 --days nan", 2, "--days"),
        ("keys issue authority 3 --id 0", 2, "--id"),
        (
            "keys issue authority 3 " + " ".join(f"--id {n}" for n in range(1, 18)),
            2,
            "out of bounds",
        ),
        ("keys revoke authority", 2, "give --id or --certificate"),
        ("keys revoke authority --id 9", 3, "it has issued no certificate 9"),
        ("keys revoke authority --certificate xyz", 3, "it has issued no certificate xyz"),
        ("keys show none", 3, "none/authorities: expected the public key"),
        ("station --id 3 --keys 1", 3, "it is for station_id 1, not 3"),
        ("station --id 1 --keys none", 3, "none/key.pem: No such file"),
        ("station --id 1 --keys 1 --set t_timeout=150 --set t_resend=20", 2, "increase t_timeout"),
    ],
)
def test_errors_name_the_file_or_the_option(
    words: str, code: int, said: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    done = automcm(*words.split())
    assert done.exit_code == code and said in " ".join(done.output.split()), done.output
    assert sorted(path.name for path in folder.iterdir()) == ["1", "2", "authority"]


# -- private keys


def shows(output: bytes, key: cose.PrivateKey) -> str | None:
    """In which form a private key is in this output; None if it is in none."""
    number = key.private_numbers().private_value
    raw, pem = number.to_bytes(32), cose.private_pem(key)
    packed = re.sub(rb"\s|\\n", b"", output)
    forms = {
        "raw": raw in output,
        "hex": raw.hex().encode() in packed.lower().replace(b":", b""),
        "decimal": str(number).encode() in packed,
        "escaped": repr(raw)[2:-1].encode() in output,
        "PEM": any(line in output for line in pem.splitlines()[1:-1]),
        "base64": False,
    }
    for run in re.findall(rb"[A-Za-z0-9+/_-]{40,}", packed):
        for at in range(4):
            text = run[at:].translate(bytes.maketrans(b"-_", b"+/"))
            text = text[: -1 if len(text) % 4 == 1 else None]
            forms["base64"] |= raw in base64.b64decode(text + b"=" * (-len(text) % 4))
    return next((name for name, found in forms.items() if found), None)


@pytest.mark.parametrize("form", ["raw", "hex", "decimal", "escaped", "PEM", "base64"])
def test_a_private_key_would_be_found(form: str) -> None:
    key = cose.new_key()
    number = key.private_numbers().private_value
    raw = number.to_bytes(32)
    texts = {
        "raw": b"\1" + raw,
        "hex": b"key=" + raw.hex(":").upper().encode(),
        "decimal": str({"d": number}).encode(),
        "escaped": repr({"d": raw}).encode(),
        "PEM": cose.private_pem(key),
        "base64": json.dumps(base64.b64encode(b"??" + raw).decode()).encode(),
    }
    assert shows(b"key: " + texts[form] + b"\n", key) is not None
    assert shows(texts[form], cose.new_key()) is None


def in_files(folder: Path) -> Iterable[Path]:
    return (path for path in folder.rglob("*") if path.is_file() and path.name != "key.pem")


def test_no_output_no_log_and_no_other_file_has_a_private_key(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    outputs = [
        automcm(*words.split()).output.encode()
        for each in (
            "keys issue authority 3 --id 3",
            "keys issue authority 3 --renew --json renewed.json",
            "keys show authority --json shown.json",
            "keys show 3 --json -",
            "keys revoke authority --id 3",
            "keys show authority",
            "keys issue authority 1 --id 1",
            "keys authority 1",
        )
        for words in (each, f"{each} --json -")
    ]
    shutil.copytree("1", "mixed")
    shutil.copy("2/key.pem", "mixed")
    shutil.copytree("1", "cut")
    pem = Path("1/key.pem").read_bytes()
    Path("cut/key.pem").write_bytes(pem[:-40])
    shutil.copytree("1", "swapped")
    shutil.copy("1/key.pem", "swapped/certificate.cwt")
    shutil.copytree("1", "given")
    shutil.copy("1/key.pem", "given/authorities/x.pem")
    shutil.copy("1/key.pem", "given/authorities/x.revoked")
    for name in ("mixed", "cut", "swapped", "given"):
        for words in (f"keys show {name}", f"station --id 1 --keys {name}"):
            done = automcm(*words.split())
            assert done.exit_code == 3, done.output
            outputs.append(done.output.encode())
    with road(folder) as on:
        one = station(on, folder, 1)
        one.until(event="start")
        Path("1/certificate.cwt").write_bytes(pem)
        outputs.append(one.complains("nothing has changed").encode())
        one.signal(signal.SIGTERM)
        outputs += [one.errors().encode(), one.lines.read().encode()]
        assert one.wait() == 0
    for name in ("certificate.cwt", "authorities/x.pem", "authorities/x.revoked"):
        for where in ("swapped", "given", "1"):
            (folder / where / name).unlink(missing_ok=True)  # copies of a key made by this test
    outputs += [path.read_bytes() for path in in_files(folder)]
    keys = [key_files.load_key(folder / name / "key.pem") for name in ("authority", "1", "2", "3")]
    assert [shows(output, key) for output in outputs for key in keys if shows(output, key)] == []
    assert all(shows(pem, key) for key in keys[1:2]) and len(outputs) > 40


# -- processes


def station(on: Road, folder: Path, number: int, *more: str) -> Running:
    return on.station(number, "--keys", str(folder / str(number)), *SIGNED, *more)


def session(on: Road, folder: Path, maneuver_ms: int) -> tuple[Running, Running]:
    """The prescriber 1 and the receiver 2, while they drive the maneuver."""
    two = station(on, folder, 2)
    asks = ("--request-after", "300", "--target", "2", "--no-concerned")
    one = station(on, folder, 1, *asks, "--maneuver", str(maneuver_ms))
    one.until(event="phase", phase="ACTUATING")
    return one, two


def ended(running: Running) -> tuple[dict[str, Any], str]:
    """The statistics and the complaints of a station that is stopped."""
    running.signal(signal.SIGTERM)
    end = running.until(event="end")
    return end["statistics"], running.errors()


@pytest.mark.slow
def test_certificates_are_renewed_while_a_session_runs(folder: Path) -> None:
    """And one with another id is refused (END-8)."""
    with road(folder) as on:
        one, two = session(on, folder, 5000)
        for n, running in ((1, one), (2, two)):
            new = made("issue", folder / "authority", folder / str(n), "--renew", "--days", n)
            event = running.until(event="certificate")
            assert event["certificate"] == new["digest"] and event["not_after"] == new["not_after"]
            assert event["phase"] == "ACTUATING"
        made("issue", folder / "authority", folder / "9", "--id", 9)
        for name in ("key.pem", "certificate.cwt"):
            shutil.copy(folder / "9" / name, folder / "1" / name)
        one.until(event="phase", phase="STANDALONE", rule="ACT-3")
        two.until(event="told", name="finished")
        (of_one, said), (of_two, nothing) = ended(one), ended(two)
    assert of_one["rejected"] == of_two["rejected"] == {} and nothing == ""
    assert said.count("\n") == 1 and "another id needs a new process (END-8)" in said


@pytest.mark.slow
def test_act_2_a_station_that_is_revoked_in_mid_session_is_no_longer_heard(folder: Path) -> None:
    with road(folder) as on:
        one, two = session(on, folder, 20_000)
        revoke(folder, "--id", 2)
        one.until(event="revocations")
        one.until(event="told", name="fallback", reason="cam_loss")
        (of_one, nothing), (_, said) = ended(one), ended(two)
    assert set(of_one["rejected"]) == {"revoked"} and nothing == ""
    assert "it is revoked; other stations discard what this one sends" in said


@pytest.mark.slow
def test_a_station_with_keys_and_one_without_are_told_once_why_nobody_answers(folder: Path) -> None:
    with road(folder) as on:
        signs, plain = station(on, folder, 1), on.station(2)
        three = on.station(3)
        said = [each.complains("station: ") for each in (signs, plain, three)]
        assert [ended(each)[1] for each in (signs, plain, three)] == ["", "", ""], "once"
    other = "station: receives signed messages, which it cannot read; give it keys with --keys\n"
    assert said == [
        "station: discards messages that are not signed; give their sender keys with --keys\n",
        *(other, other),
    ]


def test_a_station_with_an_expired_certificate_does_not_start(folder: Path) -> None:
    made("issue", folder / "authority", folder / "3", "--id", 3, "--days", 0)
    assert automcm("keys", "show", folder / "3").exit_code == 1
    done = automcm_process("station", "--id", 3, "--keys", folder / "3", "--listen", 0)
    assert done.returncode == 3 and "it has expired; renew it" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_demonstration_with_signed_messages(tmp_path: Path) -> None:
    """The other demonstrations are in test_demo."""
    words = ["--secured", "--out", tmp_path, "--listen", 0, "--json", "-"]
    done = automcm_process("demo", *words)
    assert done.returncode == 0, done.stdout
    unsigned = Demo(tmp_path, secured=True, vehicles=[DemoVehicle("A", 1)])
    assert ("all vehicles sign their messages", False) in unsigned._described()
