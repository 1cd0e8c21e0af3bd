"""Who may connect to the bridge (docs/bridge.md, Security)."""

from __future__ import annotations

import hmac
from pathlib import Path
from typing import Any

import pytest
from bridge_stage import TOKEN, Recorder, World, holds
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from automcm.bridge import access
from automcm.bridge.websocket_bridge import WebSocketBridge
from automcm.links.link import LinkError
from automcm_simulation.road.remote_application import RemoteApplication

OTHER_TOKEN = TOKEN[:-1] + "0"


def guarded() -> World:
    return World(Recorder(), WebSocketBridge(port=0, token=TOKEN))


@pytest.mark.parametrize(
    "headers",
    [
        [],
        [("Authorization", f"Bearer {OTHER_TOKEN}")],
        [("Authorization", f"Bearer {TOKEN}x")],
        [("Authorization", "Bearer ")],
        [("Authorization", TOKEN)],
        [("Authorization", f"Basic {TOKEN}")],
        [("Authorization", "Bearer \u00e9\u00e9")],
        [("X-Token", TOKEN)],
    ],
)
async def test_a_client_without_the_token_is_refused(headers: list[tuple[str, str]]) -> None:
    async with guarded() as world:
        with pytest.raises(InvalidStatus) as refused:
            await connect(world.uri, additional_headers=headers)
        response = refused.value.response
        assert response.status_code == 401 and response.headers["WWW-Authenticate"] == "Bearer"
        assert response.body == (
            b"the header Authorization: Bearer TOKEN is missing or has another token\n"
        )
        assert not world.bridge._clients


@pytest.mark.parametrize("scheme", ["Bearer", "bearer"])
async def test_a_client_with_the_token_is_let_in(scheme: str) -> None:
    headers = [("Authorization", f"{scheme} {TOKEN}")]
    async with guarded() as world, connect(world.uri, additional_headers=headers):
        await holds(lambda: len(world.bridge._clients) == 1)


async def test_a_token_is_compared_in_constant_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the function of the standard library that does so, each that is given."""
    compared: list[bytes] = []

    def compare(given: Any, token: Any) -> bool:
        assert token == TOKEN.encode()
        compared.append(given)
        return real(given, token)

    real = hmac.compare_digest
    monkeypatch.setattr(hmac, "compare_digest", compare)
    assert access.authorized([f"Bearer {TOKEN}", "Bearer wrong"], TOKEN)
    assert not access.authorized(["Bearer wrong"], TOKEN)
    assert compared == [TOKEN.encode(), b"wrong", b"wrong"]


@pytest.mark.parametrize(
    ("token", "problem"), [(None, "it requires a token"), (OTHER_TOKEN, "it has another token")]
)
async def test_a_remote_application_says_why_at_once(token: str | None, problem: str) -> None:
    async with guarded() as world:
        remote = RemoteApplication(Recorder(), world.uri, token=token, attempts=1000)
        with pytest.raises(LinkError, match=f"cannot reach the bridge at {world.uri}: {problem}"):
            await remote.run()


def test_a_token_is_read_from_a_file_or_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(access.VARIABLE, raising=False)
    assert access.read_token(None) is None
    monkeypatch.setenv(access.VARIABLE, OTHER_TOKEN)
    assert access.read_token(None) == OTHER_TOKEN
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\n")
    for mode in (0o640, 0o604, 0o622):
        file.chmod(mode)
        with pytest.raises(LinkError, match=f"^{file}: other users can read it; chmod 600 {file}"):
            access.read_token(file)
    file.chmod(0o600)
    assert access.read_token(file) == TOKEN


@pytest.mark.parametrize("bad", ["", "short", "x" * 257, "two words are no token", "é" * 20])
def test_what_is_no_token(bad: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "token"
    file.touch(0o600)
    file.write_text(bad, encoding="utf-8")
    with pytest.raises(LinkError, match=f"^{file}: a token must be") as error:
        access.read_token(file)
    said = str(error.value).removeprefix(str(file))
    assert not bad or bad not in said, "it is a secret"
    monkeypatch.setenv(access.VARIABLE, bad)
    with pytest.raises(LinkError, match=f"^{access.VARIABLE}: a token must be"):
        access.read_token(None)
    with pytest.raises(LinkError, match=r"^token: a token must be"):
        WebSocketBridge(token=bad)
