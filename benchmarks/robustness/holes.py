"""Past vulnerabilities with variations: bombs, links, floods of text, physically impossible shapes."""

import copy
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from lxml import etree

from .files import Seed, alias_bomb
from .inputs import INJECTED, MADE, ROOT, Call, Chance, HostileInput, PlacedFile

_Seeds = Mapping[str, list[Seed]]


def hostile_holes(seeds: _Seeds, scenario_id: str, chance: Chance) -> Iterator[HostileInput]:
    """Yield endless inputs: the holes in turn, their variations by chance."""
    number = 0
    while True:
        for cause, make in _HOLES.items():
            number += 1
            calls, files = make(_Hole(seeds, scenario_id, chance, f"hole{number}"))
            yield HostileInput("files" if files else "args", f"hole: {cause}", calls, files)


class _Hole:
    """The material of a variation; ``folder`` is the input's own folder below the root."""

    def __init__(self, seeds: _Seeds, scenario_id: str, chance: Chance, folder: str) -> None:
        self.seeds, self.scenario_id, self.chance, self.folder = seeds, scenario_id, chance, folder

    def file(self, name: str, content: bytes) -> PlacedFile:
        """Return a file in the folder."""
        return PlacedFile(f"{self.folder}/{name}", content)

    def imports(self, name: str, /, **arguments: Any) -> Call:
        """Return the call that imports it."""
        return Call("import_files", {"path": f"{ROOT}/{self.folder}/{name}".rstrip("/"), **arguments})

    def scenario(self) -> "etree._Element":
        """Return a small real scenario as XML."""
        return etree.fromstring(self.chance.choice(self.seeds[".xml"][:3]).content)

    def used(self) -> tuple[Call, ...]:
        """Return the calls that use a scenario if it is accepted after all."""
        known = {"scenario_id": MADE}
        uses = (
            Call("render", {"ids": [MADE]}),
            Call("run_planner", {"scenarios": [MADE], "configs": ["idm"], "wait_s": 20}),
            Call("modify_scenario", {**known, "edits": [{"op": "set_goal", "goal_time": "1..3s"}]}),
            Call("modify_scenario", {**known, "edits": [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]}),
        )
        return (Call("describe_scenario", known), self.chance.choice(uses))

    def mutated_scenario(self, root: "etree._Element") -> tuple[tuple[Call, ...], tuple[PlacedFile, ...]]:
        """Return the import and use of a scenario."""
        return (self.imports("a.xml"), *self.used()), (self.file("a.xml", etree.tostring(root)),)


_Made = tuple[tuple[Call, ...], tuple[PlacedFile, ...]]


def _yaml_bomb(hole: _Hole) -> _Made:
    content = alias_bomb(hole.chance.choice((6, 7, 8, 12)), hole.chance.choice((5, 10)), hole.chance)
    return (hole.imports("a.yaml"),), (hole.file("a.yaml", content),)


def _planted(hole: _Hole) -> _Made:
    """Return a link or FIFO at a path where the server will write a file."""
    form = hole.chance.choice(("json", "recipe", "xml"))
    ending = {"json": ".json", "recipe": ".recipe.json", "xml": ".xml"}[form]
    suffix = hole.chance.choice((".partial", ".partial", "", ".tmp"))
    path = f"{hole.folder}/{hole.scenario_id}{ending}{suffix}"
    targets = ("{outside}/written.json", "{outside}/secret.xml", "/dev/full", "/dev/zero", "{root}/small.xml")
    planted = (
        PlacedFile(path, is_fifo=True)
        if hole.chance.random() < 0.4
        else PlacedFile(path, link_to=hole.chance.choice(targets))
    )
    arguments = {"ids": [hole.scenario_id], "folder": f"{ROOT}/{hole.folder}", "formats": [form]}
    return (Call("export_artifacts", {**arguments, "overwrite": hole.chance.random() < 0.7}),), (planted,)


def _planted_folder(hole: _Hole) -> _Made:
    """Return a link at a path of a future or readable folder, or a FIFO or device at a path of a readable file."""
    name = hole.chance.choice(("a.xml", "a.yaml", "a.osm", "a.net.xml", "a.osm.pbf", "a.osm.gz"))
    target = hole.chance.choice(
        ("/dev/zero", "/dev/urandom", "/proc/kmsg", "/proc/self/mem", "{outside}/secret.xml", "a.xml")
    )
    planted = PlacedFile(f"{hole.folder}/{name}", is_fifo=True)
    if hole.chance.random() < 0.6:
        planted = PlacedFile(f"{hole.folder}/{name}", link_to=target)
    path = f"{ROOT}/{hole.folder}" + hole.chance.choice(("", f"/{name}"))
    out = PlacedFile(f"{hole.folder}/link", link_to="{outside}")
    export = Call("export_artifacts", {"ids": [hole.scenario_id], "folder": f"{ROOT}/{hole.folder}/link/deep"})
    return (Call("import_files", {"path": path}) if hole.chance.random() < 0.7 else export,), (planted, out)


def _bad_file_among_good(hole: _Hole) -> _Made:
    bad = hole.chance.choice(
        (
            ("b.yaml", b"cost_weights:\n  jerk: " + b"9" * 5000),
            ("b.yaml", b"cost_weights:\n  jerk: 2020-99-99"),
            ("b.yaml", b"cost_weights:\n  jerk: !!timestamp x"),
            ("b.yaml", b"cost_weights:\n  ? {a: 1}\n  : 1"),
            ("b.xml", b"<commonRoad/>"),
            ("b.osm", b"<osm><node id='" + b"9" * 5000 + b"' lat='1' lon='1'/></osm>"),
        )
    )
    good = hole.seeds[".xml"][0].content.replace(b"ZAM_Zip-1_1", f"ZAM_Zip-{hole.chance.randint(2, 10**6)}_1".encode())
    return (hole.imports(""),), (
        hole.file(*bad),
        hole.file("c.yaml", hole.seeds[".yaml"][0].content),
        hole.file("d.xml", good),
    )


def _long_name(hole: _Hole) -> _Made:
    chance = hole.chance
    length = chance.choice((300, 3000, 30_000, 100_000))
    word = chance.choice(("straße ", "a", "ab", "Musterstadt ", "1", "é", "Hauptstr. / "))
    text = (word * length)[:length]
    places = (
        Call("generate_scenarios", {"place": text}),
        Call("generate_scenarios", {"place": f"Musterstadt / {text}"}),
        Call("generate_scenarios", {"country": text}),
        Call("find_scenarios", {"city": text}),
        Call("find_scenarios", {"country": text}),
        Call("find_scenarios", {chance.choice(("tags", "features", "road_net", "obstacles")): [text]}),
        Call("find_scenarios", {"within": text}),
        Call("find_scenarios", {"text": text}),
        Call("configure_planner", {"preset": text}),
        Call("configure_planner", {"weights": [f"{text}=1"]}),
        Call("configure_planner", {"settings": [f"{text}=1"]}),
        Call("configure_planner", {"base": text}),
        Call("describe_scenario", {"scenario_id": text}),
        Call("describe_scenario", {"scenario_id": hole.scenario_id, "focus": text}),
        Call("run_planner", {"configs": [text], "wait_s": 0}),
        Call("run_planner", {"scenarios": [text], "wait_s": 0}),
        Call("analyze_results", {"results": [text]}),
        Call("analyze_results", {"where": [f"{text}=1"]}),
        Call("compare_results", {"metrics": [text]}),
        Call("get_job", {"job_id": text}),
        Call("list_artifacts", {"kind": text}),
        Call("list_artifacts", {text: 1}),
        Call(text, {}),
        Call("list_artifacts", {"parent": text}),
        Call("list_planners", {"planner": text}),
        Call("import_files", {"path": text}),
        Call("import_files", {"path": f"{ROOT}/small.xml", "country": text}),
        Call("modify_scenario", {"scenario_id": hole.scenario_id, "edits": [{"op": text}]}),
        Call("modify_scenario", {"scenario_id": hole.scenario_id, "edits": [{"op": "set_goal", text: 1}]}),
    )
    return (chance.choice(places),), ()


def _long_street(hole: _Hole) -> _Made:
    """Return a map with a long street name, requested by another long name."""
    length = hole.chance.choice((3000, 50_000, 200_000))
    street = "ab" * (length // 2)
    content = re.sub(rb'(k="highway" v=")', b'k="name" v="' + street.encode() + rb'"/><tag \1', _osm(hole), count=3)
    asked = Call("generate_scenarios", {"place": "ba" * hole.chance.choice((50, 15_000))})
    return (hole.imports("a.osm"), asked), (hole.file("a.osm", content),)


def _osm(hole: _Hole) -> bytes:
    return hole.chance.choice(hole.seeds[".osm"][:2]).content


_LINE_ENDS = ("\n", "\r\n", "\u2028", "\x85", "\t\n\n")


def _forged(hole: _Hole) -> str:
    end = hole.chance.choice(_LINE_ENDS)
    return f"Elm{end}{INJECTED}{end}checks passed"


def _forging_street(hole: _Hole) -> _Made:
    """Return streets with a name that ends its line."""
    name = "".join(f"&#{ord(c)};" if ord(c) < 32 or ord(c) > 126 else c for c in _forged(hole))
    content = re.sub(rb'(k="highway" v=")', b'k="name" v="' + name.encode() + rb'"/><tag \1', _osm(hole), count=9)
    calls = (hole.imports("a.osm"), Call("generate_scenarios", {"place": "Elm"}), *_listing_maps())
    return calls, (hole.file("a.osm", content),)


def _forging_map(hole: _Hole) -> _Made:
    """Return a map with a name that ends its line."""
    content = _osm(hole).replace(b"<osm ", b'<osm note="%d" ' % hole.chance.randrange(10**6), 1)
    calls = (hole.imports("a.osm", name=_forged(hole)), Call("generate_scenarios", {"place": "x"}), *_listing_maps())
    return calls, (hole.file("a.osm", content),)


def _listing_maps() -> tuple[Call, Call]:
    return Call("list_artifacts", {"kind": "map"}), Call("describe_catalog", {"facet": "maps"})


def _forging_weights(hole: _Hole) -> _Made:
    """Return a weight file with names that end their lines, or with such a file name."""
    if hole.chance.random() < 0.5:
        content = f'cost_weights:\n  "jerk\\n{INJECTED}": 1\nplanner: "x\\n{INJECTED}"\n'.encode()
        return (hole.imports("a.yaml"), hole.imports("")), (hole.file("a.yaml", content), hole.file("b.yaml", content))
    content = b"cost_weights:\n  lateral_jerk: 0.%d\n" % hole.chance.randrange(10**6)
    listed = (
        Call("list_artifacts", {"kind": "config"}),
        Call("list_planners", {}),
        Call("run_planner", {"configs": ["x"]}),
    )
    return (hole.imports("a.yaml", name=_forged(hole)), *listed), (hole.file("a.yaml", content),)


def _forging_file_name(hole: _Hole) -> _Made:
    """Return files with a name that ends its line, alone and in a folder."""
    name = f"a{hole.chance.choice(_LINE_ENDS)}{INJECTED}.xml"
    content = hole.chance.choice((b"", hole.seeds[".xml"][0].content))
    return (hole.imports(""), hole.imports(name)), (hole.file(name, content), hole.file("b.xml", b"<a/>"))


def _forging_author(hole: _Hole) -> _Made:
    """Return a scenario with an author, source, tag or id that ends its line."""
    root = hole.scenario()
    for key in ("author", "affiliation", "source", "tags", "benchmarkID"):
        if hole.chance.random() < 0.5:
            root.set(key, (root.get(key) or "ZAM_A-1_1_T-1") + f"\n{INJECTED}")
    calls = (
        hole.imports("a.xml"),
        Call("describe_scenario", {"scenario_id": MADE, "detail": "recipe"}),
        Call("list_artifacts", {}),
        Call("find_scenarios", {"tags": ["x"]}),
        Call("describe_catalog", {"facet": "tags"}),
    )
    return calls, (hole.file("a.xml", etree.tostring(root)),)


def _many_problems(hole: _Hole) -> _Made:
    root = hole.scenario()
    problem = root.find("planningProblem")
    if problem is not None:
        for number in range(hole.chance.choice((10, 100, 1000, 3000))):
            twin = copy.deepcopy(problem)
            twin.set("id", str(800_000 + number))
            root.append(twin)
    return hole.mutated_scenario(root)


def _long_list(hole: _Hole) -> _Made:
    chance = hole.chance
    count = chance.choice((1000, 5000, 20_000))
    item: Any = chance.choice(
        (1, "x", None, {}, {"op": "x"}, {"op": "set_goal", "y": 1}, "latest", "y" * 40, hole.scenario_id)
    )
    places: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("modify_scenario", "edits", {"scenario_id": hole.scenario_id}),
        ("find_scenarios", "tags", {}),
        ("find_scenarios", "obstacles", {}),
        ("find_scenarios", "road_net", {}),
        ("configure_planner", "weights", {}),
        ("configure_planner", "settings", {}),
        ("run_planner", "scenarios", {"wait_s": 0, "configs": ["x"]}),
        ("run_planner", "configs", {"wait_s": 0}),
        ("analyze_results", "results", {}),
        ("analyze_results", "where", {}),
        ("compare_results", "results", {}),
        ("compare_results", "metrics", {}),
        ("render", "ids", {}),
        ("export_artifacts", "ids", {"folder": f"{ROOT}/{hole.folder}"}),
        ("generate_scenarios", "vehicles", {"place": "x"}),
        ("generate_scenarios", "bbox", {}),
        ("generate_scenarios", "road_classes", {"place": "x"}),
    )
    tool, name, beside = chance.choice(places)
    return (Call(tool, {**beside, name: [item] * count}),), ()


def _net_next_to_scenario(hole: _Hole) -> _Made:
    """Return an invalid, huge or linked network file next to a scenario."""
    scenario = hole.scenario()
    scenario.set("benchmarkID", f"ZAM_Net-{hole.chance.randint(1, 10**6)}_1_T-1")
    forms = (b"", b"no xml", b"<net>" * 10_000, b"<net>" + b"<edge/>" * 200_000 + b"</net>", b"\x00" * 2_000_000)
    net = hole.file("a.net.xml", hole.chance.choice(forms))
    if hole.chance.random() < 0.3:
        net = PlacedFile(f"{hole.folder}/a.net.xml", link_to=hole.chance.choice(("{outside}/secret.xml", "/dev/zero")))
    elif hole.chance.random() < 0.2:
        net = PlacedFile(f"{hole.folder}/a.net.xml", is_fifo=True)
    edit = Call(
        "modify_scenario", {"scenario_id": MADE, "edits": [{"op": "set_speed", "vehicles": ["lead"], "speed": "5m/s"}]}
    )
    return (hole.imports("a.xml"), edit), (hole.file("a.xml", etree.tostring(scenario)), net)


def _impossible_numbers(hole: _Hole) -> _Made:
    """Return goals, ids, vertices and steps beyond physics."""
    root, chance = hole.scenario(), hole.chance
    way = chance.randrange(6)
    number = chance.choice(("NaN", "1e300", "-4.5", "1e9", "inf", "1e26", "0", "-0"))
    if way == 0:
        goals = root.findall(".//goalState") + root.findall(".//goalRegion/state")
        for goal in goals:
            position = goal.find("position")
            if position is None:
                position = etree.SubElement(goal, "position")
            for child in list(position):
                position.remove(child)
            shape = etree.SubElement(position, chance.choice(("rectangle", "circle", "polygon")))
            for name in ("length", "width", "radius", "orientation"):
                etree.SubElement(shape, name).text = chance.choice((number, "4.5"))
            center = etree.SubElement(shape, "center")
            etree.SubElement(center, "x").text, etree.SubElement(center, "y").text = chance.choice((number, "1")), "1"
    elif way == 1:
        big = chance.choice(("1" + "0" * 26, "9" * 5000, "9223372036854775808", "-5", "4294967296"))
        content = etree.tostring(root)
        known = re.findall(rb'<lanelet id="(\d+)"', content)
        old = chance.choice(known) if known else b"1"
        content = re.sub(rb'(id|ref)="' + old + rb'"', rb'\g<1>="' + big.encode() + b'"', content)
        return (hole.imports("a.xml"), *hole.used()), (hole.file("a.xml", content),)
    elif way == 2:
        for point in chance.choice(root.findall("lanelet")).findall(".//point")[: chance.choice((1, 3, 100))]:
            for name in ("x", "y"):
                found = point.find(name)
                if found is not None:
                    found.text = chance.choice(("1e7", "-1e7", "9.9e7", "1e5"))
    elif way == 3:
        root.set("timeStepSize", chance.choice(("1e-30", "1e-9", "0", "-0.1", "NaN", "1e300", "9.99", "0.00001")))
    elif way == 4:
        for state in root.findall(".//initialState")[: chance.choice((1, 10))]:
            for name in ("velocity", "orientation", "acceleration", "yawRate", "slipAngle"):
                exact = state.find(f"{name}/exact")
                if exact is not None and chance.random() < 0.5:
                    exact.text = number
    else:
        for shape in root.findall(".//rectangle"):
            for name in ("length", "width"):
                found = shape.find(name)
                if found is not None:
                    found.text = number
    return hole.mutated_scenario(root)


def _map(nodes: list[tuple[float, float]], ways: list[list[int]], kind: str = "residential") -> bytes:
    lines = ['<osm version="0.6">']
    lines += [
        f'<node id="{number + 1}" lat="{lat:.7f}" lon="{lon:.7f}" version="1"/>'
        for number, (lat, lon) in enumerate(nodes)
    ]
    for number, way in enumerate(ways):
        refs = "".join(f'<nd ref="{node + 1}"/>' for node in way)
        lines.append(f'<way id="{number + 1}" version="1">{refs}<tag k="highway" v="{kind}"/></way>')
    return "\n".join([*lines, "</osm>"]).encode()


def _strange_map(hole: _Hole) -> _Made:
    """Return a map around the world, of stars or rings, over the antimeridian, or at the poles."""
    chance = hole.chance
    way, size = chance.randrange(5), chance.choice((10, 100, 1000, 3000))
    if way == 0:
        content = _map([(0, -170), (0, -60), (0, 60), (0, 170)], [[0, 1, 2, 3, 0]], "motorway")
    elif way == 1:
        arms = [(48 + 0.002 * math.cos(arm), 11 + 0.003 * math.sin(arm)) for arm in range(size)]
        content = _map([(48.0, 11.0), *arms], [[0, arm + 1] for arm in range(size)])
    elif way == 2:
        count = min(size, 1000)
        nodes, ways = list[tuple[float, float]](), list[list[int]]()
        for ring in range(count):
            begin = len(nodes)
            nodes += [(48 + 0.001 * (ring % 30) + dy, 11 + 0.001 * (ring // 30) + dx) for dy, dx in _RING]
            ways.append([*range(begin, begin + len(_RING)), begin])
        content = _map(nodes, ways).replace(
            b'v="residential"/>', b'v="residential"/><tag k="junction" v="roundabout"/>'
        )
    elif way == 3:
        content = _map([(10, 179.999), (10, -179.999), (10.001, -179.998)], [[0, 1, 2]], "primary")
    else:
        content = _map([(89.9999, 0), (89.9999, 90), (90, 180), (-90, 0), (91, 400)], [[0, 1, 2, 3, 4]], "primary")
    calls: tuple[Call, ...] = (hole.imports("a.osm"),)
    if chance.random() < 0.3:
        calls = (*calls, Call("generate_scenarios", {"place": MADE, "duration_s": 5}))
    return calls, (hole.file("a.osm", content),)


_RING = tuple((0.0002 * math.cos(0.8 * step), 0.0003 * math.sin(0.8 * step)) for step in range(8))


def _beyond_the_types(hole: _Hole) -> _Made:
    """Return numbers that no database, clock or file name can hold."""
    chance = hole.chance
    big = chance.choice((2**63, 2**64, -(2**63) - 1, 10**30))
    edit = {"op": chance.choice(("shift_time", "set_speed", "change_lane")), "vehicles": ["nearest:1"], "time_s": 1e308}
    if edit["op"] == "set_speed":
        edit["speed"] = "5m/s"
    if edit["op"] == "change_lane":
        edit["lane"] = "left"
    calls = (
        Call("list_artifacts", {"offset": big}),
        Call("find_scenarios", {"offset": big}),
        Call("render", {"ids": [hole.scenario_id], "time_s": chance.choice((1e308, 1e300, 1e18))}),
        Call("modify_scenario", {"scenario_id": hole.scenario_id, "edits": [edit]}),
        Call("modify_scenario", {"scenario_id": hole.scenario_id, "edits": [], "seed": big}),
        Call(
            "modify_scenario",
            {"scenario_id": hole.scenario_id, "edits": [{"op": "set_goal", "goal_time": "1..3s"}], "seed": big},
        ),
        Call("run_planner", {"scenarios": [hole.scenario_id], "configs": ["idm"], "seed": big, "wait_s": 5}),
        Call("generate_scenarios", {"place": "Musterstadt", "duration_s": 5, "seed": big}),
        Call(
            "export_artifacts", {"ids": [hole.scenario_id], "folder": f"{ROOT}/{'n' * chance.choice((256, 300, 5000))}"}
        ),
        Call("import_files", {"path": f"{ROOT}/{'é' * 200}.xml"}),
        Call("import_files", {"path": f"{ROOT}/small.xml", "name": "n" * 300}),
        Call("generate_scenarios", {"bbox": [chance.choice((1e308, -1e308, 91.0, float("nan"))), 11, 49, 12]}),
        Call("list_artifacts", {"limit": 10**5000 if chance.random() < 0.02 else 10**400}),
    )
    if chance.random() < 0.1:
        content = re.sub(rb'speed="[\d.]+"', b'speed="inf"', hole.seeds[".net.xml"][0].content)
        return (hole.imports("a.net.xml"),), (hole.file("a.net.xml", content),)
    return (chance.choice(calls),), ()


def _workspace_itself(hole: _Hole) -> _Made:
    chance = hole.chance
    path = chance.choice(
        (f"{ROOT}/../workspace", f"{ROOT}/../workspace/scenarios", "", ".", f"{ROOT}/../workspace/workspace.sqlite")
    )
    export = {"ids": [hole.scenario_id], "folder": path, "formats": ["recipe"]}
    return (chance.choice((Call("import_files", {"path": path}), Call("export_artifacts", export))),), ()


_HOLES: dict[str, Callable[[_Hole], _Made]] = {
    "yaml aliases": _yaml_bomb,
    "planted link or FIFO": _planted,
    "planted folder or device": _planted_folder,
    "bad file among good": _bad_file_among_good,
    "long name": _long_name,
    "long name again": _long_name,
    "long street": _long_street,
    "forging street": _forging_street,
    "forging map name": _forging_map,
    "forging weights": _forging_weights,
    "forging file name": _forging_file_name,
    "forging author": _forging_author,
    "many planning problems": _many_problems,
    "long list": _long_list,
    "network beside": _net_next_to_scenario,
    "impossible numbers": _impossible_numbers,
    "impossible numbers again": _impossible_numbers,
    "strange map": _strange_map,
    "beyond the types": _beyond_the_types,
    "workspace itself": _workspace_itself,
}
