"""Tokens of an OAuth authorization server: only its own, in time, signed, made for this server, and with the scope."""

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import jwt
import pytest
from cryptography.hazmat.primitives.asymmetric import rsa
from jwt.algorithms import RSAAlgorithm
from pydantic import SecretStr
from support.http_serving import PATIENCE_S, called, served

from plannerforge.schemas.errors import InvalidRequest
from plannerforge.server.assembly import create_server
from plannerforge.server.http.serving import HttpServer
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools", "warm_workers")]
RESOURCE = "https://forge.example.org/mcp"
BOTH = "plannerforge:read plannerforge:write"


class Issuer:
    """An authorization server that signs whatever a test asks for."""

    def __init__(self) -> None:
        self.key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
        self.asked: list[str] = []
        issuer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                issuer.asked.append(self.path)
                known = {
                    "/.well-known/oauth-authorization-server/realm": {
                        "issuer": issuer.address,
                        "jwks_uri": f"{issuer.address}/keys",
                    },
                    "/realm/keys": {"keys": [issuer.public_key()]},
                }
                body = json.dumps(known.get(self.path, {})).encode()
                self.send_response(200 if self.path in known else 404)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - as its base class has it
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self.server.server_address[1]}/realm"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def public_key(self) -> dict[str, Any]:
        return {**json.loads(RSAAlgorithm.to_jwk(self.key.public_key())), "kid": "one", "use": "sig", "alg": "RS256"}

    def token(self, key: Any = None, algorithm: str = "RS256", kid: str = "one", **changes: Any) -> str:
        claims = {
            "iss": self.address,
            "aud": RESOURCE,
            "sub": "ada",
            "client_id": "host",
            "exp": int(time.time()) + 600,
            "scope": BOTH,
            **changes,
        }
        kept = {name: value for name, value in claims.items() if value is not None}
        return jwt.encode(kept, self.key if key is None else key, algorithm, headers={"kid": kid})


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    started = Issuer()
    yield started
    started.server.shutdown()
    started.server.server_close()


@pytest.fixture
def oauth(settings: Settings, issuer: Issuer) -> Settings:
    return settings.model_copy(update={"oauth_issuer": issuer.address, "http_url": RESOURCE})


async def statuses(oauth: Settings, folder: Path, tokens: list[str], tool: str = "echo") -> list[int]:
    body, headers = called(tool, text="x")
    async with served(oauth, folder) as server, httpx.AsyncClient(timeout=PATIENCE_S) as client:
        answers = [
            await client.post(server.url, json=body, headers={**headers, "Authorization": f"Bearer {token}"})
            for token in tokens
        ]
    return [answer.status_code for answer in answers]


async def test_a_token_for_this_server_is_accepted(oauth: Settings, issuer: Issuer, tmp_path: Path) -> None:
    issuer.asked.clear()
    several = issuer.token(aud=["https://other.example", RESOURCE])
    listed = issuer.token(scope=None, scp=BOTH.split())
    assert await statuses(oauth, tmp_path, [issuer.token(), several, listed]) == [200, 200, 200]
    assert len(issuer.asked) == 2, "metadata and keys, once"


async def test_every_other_token_is_refused(oauth: Settings, issuer: Issuer, tmp_path: Path) -> None:
    other = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    shared = issuer.public_key()["n"]
    refused = [
        issuer.token(aud="https://other.example/mcp"),
        issuer.token(aud=f"{RESOURCE}/other"),
        issuer.token(aud=[]),
        issuer.token(aud=None),
        issuer.token(iss="https://other.example"),
        issuer.token(exp=int(time.time()) - 600),
        issuer.token(exp=None),
        issuer.token(nbf=int(time.time()) + 600),
        issuer.token(key=other),
        issuer.token(kid="two"),
        issuer.token(key=shared, algorithm="HS256"),
        issuer.token(key="", algorithm="none"),
        issuer.token()[:-8] + "AAAAAAAA",
        "no.token.at-all",
        "x" * 30_000,
    ]
    assert await statuses(oauth, tmp_path, refused) == [401] * len(refused)


async def test_the_scope_decides_the_offered_tools(oauth: Settings, issuer: Issuer, tmp_path: Path) -> None:
    assert await statuses(oauth, tmp_path, [issuer.token(scope="openid"), issuer.token(scope="plannerforge:read")]) == [
        403,
        200,
    ]
    async with served(oauth, tmp_path) as server:
        async with server.client("auto", issuer.token(scope="plannerforge:read")) as client:
            reading = {tool.name for tool in (await client.list_tools()).tools}
        async with server.client("legacy", issuer.token()) as client:
            everything = {tool.name for tool in (await client.list_tools()).tools}
    assert everything - reading == {"cancel_job", "export_artifacts", "make_long", "ask_late"}


async def test_a_refused_client_learns_the_valid_token_issuer(oauth: Settings, issuer: Issuer, tmp_path: Path) -> None:
    body, headers = called("echo", text="x")
    async with served(oauth, tmp_path) as server, httpx.AsyncClient() as client:
        refused = await client.post(server.url, json=body, headers=headers)
        metadata = await client.get(f"{server.address}/.well-known/oauth-protected-resource/mcp")
    assert refused.status_code == 401
    place = "https://forge.example.org/.well-known/oauth-protected-resource/mcp"
    assert f'resource_metadata="{place}"' in refused.headers["www-authenticate"]
    assert metadata.json()["resource"] == RESOURCE
    assert metadata.json()["authorization_servers"] == [issuer.address]  # to the letter: RFC 8414 compares so


async def test_own_tokens_work_next_to_issued_ones(oauth: Settings, issuer: Issuer, tmp_path: Path) -> None:
    own = oauth.model_copy(update={"http_tokens": (SecretStr(f"ci {'c' * 32}"),)})
    assert await statuses(own, tmp_path, ["c" * 32, issuer.token(), "d" * 32]) == [200, 200, 401]


async def test_issuer_without_an_address_of_this_server_is_refused(oauth: Settings) -> None:
    with pytest.raises(InvalidRequest, match="http_url"):
        HttpServer(create_server(oauth), oauth.model_copy(update={"http_url": ""}))
