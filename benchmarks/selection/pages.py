"""Calls find_scenarios as a client does, page by page, and compares the result with the ids of the corpus."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from mcp import Client

from plannerforge.evals.ground_truth.selection import Request, arguments_of
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult

from ..harness import ask, call_ms

PAGE = 50
_VALID = ("ok", "empty")
"""Requests with slots as ground truth."""


@dataclass(frozen=True)
class Answered:
    """The result of a request over all pages: ids in their order, the facts behind each, and the stage without
    matches.
    """

    request: Request
    facts: dict[str, tuple[str, ...]]
    emptied_at: str | None

    @property
    def is_exact(self) -> bool:
        """True if the matches are the corpus's ids."""
        return set(self.facts) == self.request.matching

    @property
    def is_rightly_empty(self) -> bool:
        """True if nothing matches, and the named stage is the corpus's."""
        return not self.facts and self.emptied_at == self.request.truth["emptied_by"]["stage"]

    @property
    def asked(self) -> str:
        """The request in the words of the tool's arguments."""
        return str(arguments_of(self.request.truth).model_dump(exclude_defaults=True))

    def difference(self) -> str:
        """Return the ids that only one side has; those of the search come with the facts that decide who is right."""
        added = [f"{key} ({'; '.join(facts)})" for key, facts in self.facts.items() if key not in self.request.matching]
        missed = sorted(self.request.matching - set(self.facts))
        only_found, only_expected = ", ".join(added) or "-", ", ".join(missed) or "-"
        return f"{self.request.request_id}: only found: {only_found}; only expected: {only_expected}"


async def answer_all(client: Client, requests: Iterable[Request]) -> list[Answered]:
    """Return every request that has ground truth by its slots, all pages."""
    return [await _answered(client, request) for request in requests if request.expect in _VALID]


async def search_ms(client: Client, requests: Iterable[Request]) -> list[float]:
    """Return milliseconds of every request by its slots: the whole tool with the stored search, at the client."""
    return [
        await call_ms(client, "find_scenarios", **_words(arguments_of(request.truth), limit=5))
        for request in requests
        if request.expect in _VALID
    ]


async def _answered(client: Client, request: Request) -> Answered:
    asked, facts = arguments_of(request.truth), dict[str, tuple[str, ...]]()
    while True:
        answer = await ask(client, "find_scenarios", **_words(asked, limit=PAGE, offset=len(facts)))
        page = FindScenariosResult.model_validate(answer)
        facts |= {match.scenario_id: match.satisfied for match in page.matches}
        if len(page.matches) < PAGE:
            return Answered(request, facts, page.emptied_by.stage if page.emptied_by else None)


def _words(arguments: FindScenariosArguments, **instead: int) -> dict[str, Any]:
    return arguments.model_copy(update=instead).model_dump(mode="json", exclude_none=True)
