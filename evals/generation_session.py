"""What one process of ``make bench-generation`` keeps from request to request."""

from dataclasses import dataclass, field
from pathlib import Path

from plannerforge.evals.generation_maps import BenchMaps
from plannerforge.evals.map_evidence import MapEvidence, read_evidence


@dataclass
class Session:
    """The maps, those that the generator has read here, and what the map files say beside it."""

    maps: BenchMaps
    _read: set[str] = field(default_factory=set)
    _evidence: dict[str, MapEvidence] = field(default_factory=dict)

    def reads(self, map_path: Path | str) -> bool:
        """Note that the generator reads a map; whether it is for the first time."""
        first = str(map_path) not in self._read
        self._read.add(str(map_path))
        return first

    def evidence(self, map_path: str) -> MapEvidence:
        """What a map file says; read once."""
        if map_path not in self._evidence:
            self._evidence[map_path] = read_evidence(Path(map_path))
        return self._evidence[map_path]
