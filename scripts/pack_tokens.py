"""Write ``server/o200k_base.json.gz``, the table of OpenAI's encoding o200k_base for ``server/tokens.py``.

    python scripts/pack_tokens.py

The table comes from tiktoken (MIT), which downloads it from OpenAI's server or reads it from ``TIKTOKEN_CACHE_DIR``,
and checks its SHA-256. tiktoken's package doesn't contain it, and an offline server needs it. The same table gives the
same bytes.
"""

import base64
import gzip
import json
from pathlib import Path

import tiktoken

TABLE = Path(__file__).resolve().parent.parent / "server" / "o200k_base.json.gz"
ABOUT = "OpenAI's encoding o200k_base, as tiktoken (MIT License, Copyright (c) 2022 OpenAI, Shantanu Jain) publishes it"


def pack(encoding: tiktoken.Encoding, path: Path) -> None:
    """Write the splitting pattern, and the tokens in base64 by rank from 0."""
    tokens = sorted(encoding._mergeable_ranks, key=encoding._mergeable_ranks.__getitem__)
    table = {
        "about": ABOUT,
        "pattern": encoding._pat_str,
        "tokens": [base64.b64encode(token).decode("ascii") for token in tokens],
    }
    path.write_bytes(gzip.compress(json.dumps(table, separators=(",", ":")).encode("ascii"), compresslevel=9, mtime=0))


if __name__ == "__main__":
    pack(tiktoken.get_encoding("o200k_base"), TABLE)
