"""What a stage of a stored search left: a search keeps the counts of its stages, the scenarios are looked up again."""

from plannerforge.engine.catalog.entries import entries_of
from plannerforge.engine.catalog.search import Search
from plannerforge.engine.catalog.tables import MOST_ENTRIES
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.catalog import SearchRecord
from plannerforge.schemas.errors import UnknownName
from plannerforge.tools.call import ToolCall


def stage_hits(search: Artifact, stage: str, call: ToolCall) -> tuple[tuple[str, ...], list[str]]:
    """Ids of what the stage left, alphabetically, and a remark where versions have changed since the search.

    What was added to the catalogue after the search is not among them.

    Raises:
        UnknownName: the search has no conditions for this stage, or an earlier stage left nothing.
    """
    record, connection = search.read(SearchRecord), call.workspace.database.connection()
    counts = {one.stage: one.left for one in record.stages}
    if stage not in counts:
        valid = [f"{search.artifact_id}:{name}" for name in counts]
        raise UnknownName(f"{search.artifact_id} has no stage '{stage}'", valid=valid)
    again = Search(connection, record.arguments, searched_within(record.arguments.within, call))
    numbers = next((left.numbers for left in again.funnel.stages if left.stage == stage), frozenset[int]())
    known = frozenset(number for number in numbers if number < search.sequence * MOST_ENTRIES)
    changed = len(known) != counts[stage]
    note = f"{search.artifact_id}:{stage} left {counts[stage]}; {len(known)} of them are in the catalogue as they were"
    return tuple(entry.scenario_id for entry in entries_of(connection, known)), [note] if changed else []


def searched_within(search_id: str | None, call: ToolCall) -> tuple[str, ...] | None:
    """The hits of the search that another one refines; None where the whole catalogue is searched."""
    if search_id is None:
        return None
    return call.workspace.get(search_id, "search").read(SearchRecord).scenario_ids
