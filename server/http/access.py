"""Access control over HTTP: this server's own bearer tokens, and those of an OAuth authorization server.

Each of the server's own tokens has a name, which the journal records, and may be read-only. Memory contains only its
SHA-256. A plain digest is enough: a token has at least 24 random characters, so no dictionary contains it.
"""

import hashlib
import hmac
import logging
import re
import secrets
import stat
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import anyio
import httpx
import jwt
from mcp.server.auth.provider import AccessToken, TokenVerifier
from pydantic import SecretStr

from ...schemas.errors import InvalidRequest, OutsideRoots
from ...schemas.text import quoted
from ..clients import READ_SCOPE, WRITE_SCOPE

logger = logging.getLogger(__name__)
FEWEST_CHARACTERS = 24
"""Minimum length of a token; chosen: 24 random characters of 64 are 144 bits."""
_DIGEST = re.compile(r"sha256:([0-9a-f]{64})")
_NAME = re.compile(r"[A-Za-z0-9][\w.\-]{0,63}")
_READ_ONLY = "read-only"
_FORM = "NAME TOKEN, or NAME TOKEN read-only"
_ALGORITHMS = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA")
"""Algorithms that sign with a key pair; with a shared secret, everyone who can check a token could make one."""
_LEEWAY_S = 30.0
_FETCH_TIMEOUT_S = 10.0
_KEYS_KEPT_S = 300.0
_LEAST_BETWEEN_FETCHES_S = 10.0
"""Tolerance for clocks, timeout of a request to the authorization server, lifetime of its keys, and minimum interval
before an unknown key refetches them; chosen.
"""
_MOST_BYTES = 1_000_000
_MOST_ISSUED = 20_000
"""Maximum bytes of a document of the authorization server, and characters of a token; chosen: real ones are a tenth of
this.
"""


@dataclass(frozen=True)
class OwnToken:
    """One of this server's own tokens: its name, the SHA-256 of its text, and whether it is read-only."""

    name: str
    digest: str
    reads_only: bool

    @property
    def scopes(self) -> list[str]:
        """The scopes that it allows."""
        return [READ_SCOPE] if self.reads_only else [READ_SCOPE, WRITE_SCOPE]


def new_token(name: str, *, reads_only: bool) -> tuple[str, str]:
    """Return a random token, and the line that allows it.

    Raises:
        InvalidRequest: the name is invalid.
    """
    text = secrets.token_urlsafe(32)
    line = f"{name} sha256:{_digest(text)}{' ' + _READ_ONLY if reads_only else ''}"
    read_tokens([line], "the name")
    return text, line


def tokens_of(listed: Sequence[SecretStr], file: Path | None) -> tuple[OwnToken, ...]:
    """Return the tokens of settings and of a file, each name once.

    Raises:
        InvalidRequest: an entry is invalid, or two have the same name.
        OutsideRoots: the file cannot be read, or others may read the plain tokens in it.
    """
    tokens = read_tokens([entry.get_secret_value() for entry in listed], "http_tokens")
    if file is not None:
        tokens += _tokens_in(file.expanduser())
    names = [token.name for token in tokens]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InvalidRequest(f"two tokens have the name {twice[0]}", next_step="give each its own name")
    return tuple(tokens)


def read_tokens(lines: Iterable[str], where: str) -> list[OwnToken]:
    """Return tokens, one per line; empty lines and those that begin with ``#`` are ignored.

    Raises:
        InvalidRequest: a line is invalid; the error does not repeat it, because it may contain a secret.
    """
    tokens = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        valid = [_FORM, f"a token has at least {FEWEST_CHARACTERS} characters, or is its digest: sha256:…"]
        is_form = len(words) == 2 or (len(words) == 3 and words[2] == _READ_ONLY)
        if not is_form or not _NAME.fullmatch(words[0]):
            raise InvalidRequest(f"entry {number} of {where} is not a token", valid=valid, next_step=_MAKE_ONE)
        digest = _DIGEST.fullmatch(words[1])
        if digest is None and len(words[1]) < FEWEST_CHARACTERS:
            raise InvalidRequest(f"entry {number} of {where} is too easy to guess", valid=valid, next_step=_MAKE_ONE)
        tokens.append(OwnToken(words[0], digest[1] if digest else _digest(words[1]), len(words) == 3))
    return tokens


_MAKE_ONE = "`plannerforge token NAME` creates one"


def _tokens_in(file: Path) -> list[OwnToken]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
        others = file.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    except (OSError, UnicodeDecodeError) as error:
        raise OutsideRoots(
            f"the file of tokens {quoted(str(file))} cannot be read: {error}", next_step="use a readable one"
        ) from error
    tokens = read_tokens(lines, f"the file {file.name}")
    if others and any(not _DIGEST.search(line) for line in lines if line.split() and not line.startswith("#")):
        raise OutsideRoots(
            f"others on this machine may read the plain tokens in {quoted(str(file))}",
            next_step=f"chmod 600 it, or store digests there: {_MAKE_ONE}",
        )
    return tokens


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class OwnTokens(TokenVerifier):
    """Accepts this server's own tokens.

    Args:
        resource: the address of this server, if it is also the resource of an OAuth authorization server.
    """

    def __init__(self, tokens: Sequence[OwnToken], resource: str | None = None) -> None:
        self._tokens, self._resource = tuple(tokens), resource

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return the permissions of a token, or None if it is unknown. All are compared, even after a match."""
        digest = _digest(token)
        fitting = [own for own in self._tokens if hmac.compare_digest(own.digest, digest)]
        if not fitting:
            return None
        own = fitting[0]
        return AccessToken(token="", client_id=own.name, scopes=own.scopes, resource=self._resource)


class IssuedTokens(TokenVerifier):
    """Accepts signed tokens (JWT, RFC 9068) that an OAuth authorization server issued for this server.

    The SDK checks that a token is for this server and not for another server of the same person: it compares the
    token's audience with this server's address (``validate_token_resource``).

    Args:
        issuer: address of the authorization server, as in its tokens.
        resource: address of this server, as in the audience of tokens.
        keys_url: address of its public keys; if empty, its metadata give it (RFC 8414, or OpenID).
    """

    def __init__(self, issuer: str, resource: str, keys_url: str = "") -> None:
        self._issuer, self._resource = issuer, resource
        self._keys = _IssuerKeys(issuer, keys_url)

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return the permissions of a token, or None if it is not valid here; the log states the reason."""
        if len(token) > _MOST_ISSUED:
            return None
        try:
            claims = await anyio.to_thread.run_sync(self._claims, token)
        except (jwt.PyJWTError, httpx.HTTPError, ValueError) as error:
            logger.warning("a token of %s was refused: %s", self._issuer, error)
            return None
        audiences = claims["aud"] if isinstance(claims["aud"], list) else [claims["aud"]]
        return AccessToken(
            token="",
            client_id=str(claims.get("client_id") or claims.get("azp") or claims.get("sub") or self._issuer),
            scopes=_scopes(claims),
            expires_at=int(claims["exp"]),
            resource=self._resource if self._resource in audiences else str(next(iter(audiences), "")),
            subject=None if claims.get("sub") is None else str(claims["sub"]),
            claims={"iss": claims["iss"]},
        )

    def _claims(self, token: str) -> dict[str, Any]:
        """Return the claims of a token after checking its signature, issuer and time.

        Raises:
            jwt.PyJWTError: a check failed.
            httpx.HTTPError: the issuer's keys cannot be fetched.
            ValueError: its metadata are invalid.
        """
        header = jwt.get_unverified_header(token)
        claims: dict[str, Any] = jwt.decode(
            token,
            self._keys.key(str(header.get("kid", ""))),
            algorithms=list(_ALGORITHMS),
            issuer=self._issuer,
            leeway=_LEEWAY_S,
            options={"require": ["exp", "iss", "aud"], "verify_aud": False},
        )
        return claims


class _IssuerKeys:
    """The public keys of an authorization server, fetched on demand and cached for a while."""

    def __init__(self, issuer: str, keys_url: str) -> None:
        self._issuer, self._keys_url = issuer.rstrip("/"), keys_url
        self._lock = threading.Lock()
        self._keys: dict[str, jwt.PyJWK] = {}
        self._fetched_at = float("-inf")

    def key(self, key_id: str) -> jwt.PyJWK:
        """Return the key with this id; if a token has no key id, return the only key.

        Raises:
            jwt.PyJWTError: there is no such key, or the keys are invalid.
            httpx.HTTPError: they cannot be fetched.
            ValueError: the response is not JSON.
        """
        with self._lock:
            now = time.monotonic()
            age_s = now - self._fetched_at
            is_known = key_id in self._keys or (not key_id and len(self._keys) == 1)
            if age_s > _KEYS_KEPT_S or (not is_known and age_s > _LEAST_BETWEEN_FETCHES_S):
                self._fetched_at = now  # a failed fetch counts too
                self._keys = self._fetched()
            if not key_id and len(self._keys) == 1:
                return next(iter(self._keys.values()))
            if key_id not in self._keys:
                raise jwt.InvalidKeyError(f"{self._issuer} has no key {quoted(key_id)}")
            return self._keys[key_id]

    def _fetched(self) -> dict[str, jwt.PyJWK]:
        with httpx.Client(timeout=_FETCH_TIMEOUT_S, follow_redirects=False) as client:
            address = self._keys_url or self._found_address(client)
            keys = jwt.PyJWKSet.from_dict(_document(client, address)).keys
        return {key.key_id or "": key for key in keys}

    def _found_address(self, client: httpx.Client) -> str:
        """Return the address of the keys from the metadata of the authorization server."""
        parts = urlsplit(self._issuer)
        places = (
            f"{parts.scheme}://{parts.netloc}/.well-known/oauth-authorization-server{parts.path}",
            f"{self._issuer}/.well-known/openid-configuration",
        )
        for place in places:
            try:
                metadata = _document(client, place)
            except (httpx.HTTPStatusError, ValueError):
                continue
            if str(metadata.get("issuer", "")).rstrip("/") == self._issuer and "jwks_uri" in metadata:
                return str(metadata["jwks_uri"])
        raise ValueError(f"{self._issuer} does not state where its keys are; set oauth_keys_url")


def _document(client: httpx.Client, address: str) -> dict[str, Any]:
    """Return the JSON object at an address.

    Raises:
        httpx.HTTPError: it cannot be fetched.
        ValueError: it is invalid, or too large.
    """
    response = client.get(address)
    response.raise_for_status()
    if len(response.content) > _MOST_BYTES:
        raise ValueError(f"{address} answers with more than {_MOST_BYTES:,} bytes")
    document = response.json()
    if not isinstance(document, dict):
        raise ValueError(f"{address} does not answer with a JSON object")  # noqa: TRY004 - the value came from there
    return document


def _scopes(claims: dict[str, Any]) -> list[str]:
    """Return the scopes of a token: words in ``scope`` (RFC 9068), or a list in ``scp``, as some servers write it."""
    given = claims.get("scope", claims.get("scp", ""))
    return given.split() if isinstance(given, str) else [str(word) for word in given]


class EitherTokens(TokenVerifier):
    """Accepts this server's own tokens, and tokens that an OAuth authorization server issued."""

    def __init__(self, own: OwnTokens, issued: IssuedTokens) -> None:
        self._own, self._issued = own, issued

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return the permissions of a token, or None if it is unknown."""
        return await self._own.verify_token(token) or await self._issued.verify_token(token)
