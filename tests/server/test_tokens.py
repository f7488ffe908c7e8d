import base64
import gzip
import hashlib
import json

import pytest
import tiktoken
from tiktoken_ext import openai_public

from plannerforge.server import tokens
from plannerforge.server.tokens import count_tokens


def test_the_packed_table_has_the_digest_that_tiktoken_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    table = json.loads(gzip.decompress(tokens._TABLE.read_bytes()))
    lines = "".join(f"{token} {rank}\n" for rank, token in enumerate(table["tokens"]))
    digests = []

    def loaded(_url: str, expected_hash: str) -> dict[bytes, int]:
        digests.append(expected_hash)
        return {base64.b64decode(token): rank for rank, token in enumerate(table["tokens"])}

    monkeypatch.setattr(openai_public, "load_tiktoken_bpe", loaded)
    known = tiktoken.Encoding(**openai_public.o200k_base())
    assert [hashlib.sha256(lines.encode()).hexdigest()] == digests
    assert table["pattern"] == known._pat_str
    text = "Ein Lkw bremst vor der Kreuzung; 横断歩道で止まる. speed_mps=13.89 <|endoftext|>"
    assert count_tokens(text) == len(known.encode(text, disallowed_special=()))


@pytest.mark.parametrize("character", [" ", "a", "\n", "서", "\ud83d"])
def test_a_text_of_one_character_alone_is_counted(character: str) -> None:
    assert 0 < count_tokens(character * 100_000) <= 300_000
