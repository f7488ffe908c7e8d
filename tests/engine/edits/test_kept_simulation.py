"""What SUMO held and drove can be kept beside the scenario that came of it."""

from lxml import etree
from support.edits import Apply

from plannerforge.engine.cosimulation.replay import ROUTES_FILE, TYPES_FILE

AGGRESSIVE = {"op": "set_behaviour", "vehicles": ["31"], "preset": "aggressive"}


def test_the_types_and_routes_that_sumo_drove_with_are_kept_on_request(apply: Apply) -> None:
    done = apply(AGGRESSIVE, keep_simulation=True)
    routes = etree.parse(done.xml.parent / ROUTES_FILE).getroot()
    driven = next(vehicle for vehicle in routes.iter("vehicle") if vehicle.get("id") == "31")
    types = etree.parse(done.xml.parent / TYPES_FILE).getroot()
    kept = next(one for one in types.iter("vType") if one.get("id") == driven.get("type"))
    assert (kept.get("tau"), kept.get("decel")) == ("0.8", "5")
    assert driven.find("route").get("edges")


def test_a_simulation_is_kept_only_on_request_and_if_a_vehicle_was_driven(apply: Apply) -> None:
    assert sorted(path.name for path in apply(AGGRESSIVE).xml.parent.iterdir()) == ["scenario.net.xml", "scenario.xml"]
    removed = apply({"op": "remove_vehicle", "vehicles": ["31"]}, keep_simulation=True)
    assert not (removed.xml.parent / TYPES_FILE).exists()


def test_caching_the_simulation_does_not_change_the_scenario(apply: Apply) -> None:
    written = apply(AGGRESSIVE).xml.read_bytes()
    assert apply(AGGRESSIVE, keep_simulation=True).xml.read_bytes() == written
