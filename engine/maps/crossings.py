"""Where the roads of a map meet."""

from plannerforge.engine.maps.osm_reader import OsmWay


class Crossings:
    """Where roads meet: the roads by node, and the nodes at which at least three arms do."""

    def __init__(self, roads: list[OsmWay]) -> None:
        self.ways_at: dict[int, list[OsmWay]] = {}
        arms: dict[int, int] = {}
        for way in roads:
            for key in dict.fromkeys(way.node_ids):
                self.ways_at.setdefault(key, []).append(way)
            for index, key in enumerate(way.node_ids):
                arms[key] = arms.get(key, 0) + (index > 0) + (index < len(way.node_ids) - 1)
        self.junctions = [key for key, count in arms.items() if count >= 3]

    def of_streets(self) -> list[int]:
        """Junctions of different streets: not one road that parts in two, and not only motorways."""
        return [key for key in self.junctions if self._crosses(key) and not self._only_motorway(key)]

    def _crosses(self, key: int) -> bool:
        names = {way.tags.get("name") or way.tags.get("ref") or str(way.way_id) for way in self.ways_at[key]}
        return len(names) > 1 or len(self.ways_at[key]) > 3

    def _only_motorway(self, key: int) -> bool:
        return all(way.road_class.startswith(("motorway", "trunk")) for way in self.ways_at[key])
