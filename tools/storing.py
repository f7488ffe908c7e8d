"""Storing a scenario: its facts are read, then files, recipe and facts go into the workspace and the catalogue."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from plannerforge.engine.catalog.refresh import refresh
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.scenarios import Origin, ReadFactsRequest, ScenarioFacts, ScenarioRecord
from plannerforge.tools.call import ToolCall

READ_TIMEOUT_S = 60.0


async def store_scenario(
    call: ToolCall,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    beside: Mapping[str, Path] | None = None,
) -> Artifact:
    """Store a CommonRoad file, with the SUMO network that it came from where there is one.

    Args:
        beside: further files of the artifact by name, such as the report of how it was made.

    Raises:
        UnsafeInput: the file is broken or hostile.
        NotPossible: another scenario has this id already.
    """
    facts = await call.run(
        "plannerforge.engine.scenarios.facts:read_facts",
        ReadFactsRequest(path=xml),
        ScenarioFacts,
        timeout_s=READ_TIMEOUT_S,
    )
    return put_scenario(call, facts, xml=xml, net=net, recipe=recipe, origin=origin, beside=beside)


def put_scenario(
    call: ToolCall,
    facts: ScenarioFacts,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    beside: Mapping[str, Path] | None = None,
) -> Artifact:
    """Store a scenario whose facts are known.

    Raises:
        NotPossible: another scenario has this id already, or this recipe made another file before.
    """
    content = content_digest(xml)
    found = call.workspace.find("scenario", facts.scenario_id)
    if found is not None and found.read(ScenarioRecord).content != content:
        raise _id_taken(found, recipe)
    files = {"scenario.xml": xml} | ({"scenario.net.xml": net} if net is not None else {}) | dict(beside or {})
    record = ScenarioRecord(facts=facts, origin=origin, content=content)
    artifact = call.workspace.put("scenario", facts.scenario_id, recipe=recipe, record=record, files=files)
    refresh(call.workspace.database)
    return artifact


def _id_taken(found: Artifact, recipe: Recipe) -> NotPossible:
    """A recipe holds the versions of programs: two builds of one version, or two machines, may make different files."""
    if found.recipe.digest != recipe.digest:
        return NotPossible(
            f"another scenario with other content has the id {found.artifact_id} already",
            next_step="give the file another benchmarkID",
        )
    return NotPossible(
        f"{found.artifact_id} was stored by the same call with other content: by another build of this version, or on "
        "another machine",
        valid=[found.artifact_id],
        next_step=f"use the stored one, or make a new one with another seed than {recipe.seed}",
    )


def content_digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
