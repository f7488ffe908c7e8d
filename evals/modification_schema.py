"""Whether an edited file is as valid by CommonRoad's schema as its source is.

The schema has no form for a road user who enters after time 0: the ``initialState`` of a ``dynamicObstacle`` is at time
0 and says that it is there then, and a ``phantomObstacle``, which may begin later, is nobody real and has no type.
CommonRoad's own reader takes any time. A vehicle that the request itself lets enter later hence makes one error that no
way of writing avoids; that error of that vehicle is told apart from all others.
"""

from lxml import etree

from plannerforge.engine.scenarios.reader import LoadedScenario
from plannerforge.engine.scenarios.validate import schema_errors, schema_errors_of
from plannerforge.evals.modification_written import Written

ENTRY = "initialState/time/exact"


def is_valid(written: Written) -> bool:
    """No schema error that the source does not have, but that of vehicles which enter later because they were asked to.

    The file was read by commonroad-io already.
    """
    tree = etree.parse(written.loaded.path)
    excused = {str(key) for key in enter_later_as_asked(written)}
    for obstacle in tree.getroot():
        entry = obstacle.find(ENTRY) if obstacle.get("id") in excused else None
        if entry is not None:
            entry.text = "0"
    return _anonymous(schema_errors_of(tree), written.loaded) <= _known(written)


def is_strictly_valid(written: Written) -> bool:
    """No schema error that the source does not have."""
    return _anonymous(schema_errors(written.loaded.path), written.loaded) <= _known(written)


def enter_later_as_asked(written: Written) -> frozenset[int]:
    """Ids of the added vehicles that enter after time 0, of which an edit asks so, at the step asked for or later.

    Whether they enter as soon as they can is another check.
    """
    found: set[int] = set()
    for index, truth in enumerate(written.truths):
        asked = round((truth.get("depart_s") or 0.0) / written.scene.step_s)
        if truth["op"] != "add_vehicle" or asked == 0:
            continue
        added = [key for key in written.outcome.edits[index].vehicles if key in written.added()]
        found.update(key for key in added[: truth["count"]] if written.new[key].first_step >= asked)
    return frozenset(found)


def _known(written: Written) -> set[str]:
    return _anonymous(schema_errors(written.scene.loaded.path), written.scene.loaded)


def _anonymous(errors: list[str], loaded: LoadedScenario) -> set[str]:
    """Errors without the file's id: one that breaks the pattern does so in both files, although it is another one."""
    return {error.replace(loaded.declared_id, "") for error in errors}
