"""Reading a CommonRoad file for its facts: the road and the problems by commonroad-io, the recording as arrays."""

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree

from commonroad.common.reader.file_reader_xml import XMLFileReader

from plannerforge.engine.scenarios.plain_states import take_plain_states
from plannerforge.engine.scenarios.reader import LoadedScenario, XmlLimits, refuse_without_lanelets, unsaid_remarks
from plannerforge.engine.scenarios.tracks import Track, recorded_tracks
from plannerforge.engine.scenarios.xml_document import parse_document
from plannerforge.schemas.errors import UnsafeInput


@dataclass(frozen=True)
class RecordedScenario:
    """A scenario with its recording; the obstacles of ``loaded`` keep the first and the last of their states only."""

    loaded: LoadedScenario
    tracks: dict[int, Track]


def read_recorded(path: Path, limits: XmlLimits | None = None) -> RecordedScenario:
    """Read a CommonRoad file (2018b or 2020a) as ``read_scenario`` does, in half of its time.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, or has no lanelets.
    """
    root = parse_document(path, limits)
    if root.tag != "commonRoad":
        raise UnsafeInput(f"{path.name} is no CommonRoad file: its root element is <{root.tag}>, not <commonRoad>")
    refuse_without_lanelets(path.name, len(root.findall("lanelet")))
    _refuse_duplicate_ids(path.name, root)
    states = take_plain_states(root)
    try:
        with unsaid_remarks():
            scenario, problems = _ParsedReader(path, root).open()
    except Exception as error:
        raise UnsafeInput(f"{path.name} is not readable as CommonRoad: {type(error).__name__}: {error}") from error
    loaded = LoadedScenario(scenario, problems, path, root.get("benchmarkID", ""))
    return RecordedScenario(loaded, recorded_tracks(scenario, states))


def _refuse_duplicate_ids(name: str, root: Element) -> None:
    """commonroad-io keeps one of two lanelets with one id; a planning problem may share its id with something else."""
    seen: set[tuple[bool, str]] = set()
    for element in root:
        key = element.tag == "planningProblem", element.get("id", "")
        if key[1] and key in seen:
            raise UnsafeInput(f"{name} has two elements with the id {key[1][:40]}, the second a {element.tag}")
        seen.add(key)


class _ParsedReader(XMLFileReader):  # type: ignore[misc]  # commonroad-io has no types
    """commonroad-io's reader on a document that is parsed already."""

    def __init__(self, path: Path, root: Element) -> None:
        super().__init__(path)
        self._root = root

    def _parse_file(self) -> None:
        self._tree = ElementTree(self._root)
