"""``plannerforge maps``: maps go in, packed or plain, and are listed with what they hold."""

import gzip
from pathlib import Path

import pytest
from support.online import town_servers
from typer.testing import CliRunner, Result

from plannerforge.cli.program import application
from plannerforge.engine.maps.drawn_library import LIBRARY

pytestmark = pytest.mark.usefixtures("warm_workers")


@pytest.fixture(autouse=True)
def _workspace_of_the_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PLANNERFORGE_WORKSPACE", str(tmp_path / "workspace"))
    monkeypatch.setenv("PLANNERFORGE_STARTER", "false")
    monkeypatch.setenv("COLUMNS", "250")


def maps(*arguments: str) -> Result:
    return CliRunner().invoke(application, ["maps", *arguments])


def test_a_map_is_added_once_packed_or_plain_and_listed(tmp_path: Path) -> None:
    packed = tmp_path / "harbour.osm.gz"
    packed.write_bytes(gzip.compress((LIBRARY / "fahrhausen.osm").read_bytes()))
    added = maps("add", str(packed), "--place", "Harbour", "--country", "Germany")
    assert added.exit_code == 0, added.output
    assert "“Harbour” (DEU): 1.9 km of roads, 4 intersection sites, 4 urban sites" in added.stdout
    plain = tmp_path / "other.osm"
    plain.write_bytes(gzip.decompress(packed.read_bytes()))
    again = maps("add", str(plain), "--place", "Harbour", "--country", "de")
    assert "already stored" in again.stdout
    listed = maps("list")
    assert listed.exit_code == 0
    row = next(line for line in listed.stdout.splitlines() if "Harbour" in line)
    assert "DEU" in row
    assert "54.5966" in row


def test_valid_files_are_imported_and_refused_ones_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.osm"
    broken.write_text("<osm>")
    result = maps("add", str(broken), str(LIBRARY / "neuland.osm"))
    assert result.exit_code == 1
    assert "broken.osm: [unsafe_input]" in result.stderr
    assert "“Neuland” (ZAM)" in result.stdout


def test_an_unknown_country_is_refused_before_anything_is_read() -> None:
    result = maps("add", str(LIBRARY / "neuland.osm"), "--country", "Atlantis")
    assert result.exit_code == 2
    assert "there is no country 'Atlantis'" in result.stderr


def test_ids_are_listed_in_full_on_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = maps("list")
    assert "map_fahrhausen " in listed.stdout
    assert "map_quadratstadt " in listed.stdout


def test_a_map_can_be_fetched_in_addition_to_an_existing_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with town_servers().running() as servers:
        monkeypatch.setenv("PLANNERFORGE_MAPS_ONLINE", "online")
        monkeypatch.setenv("PLANNERFORGE_NOMINATIM_URL", servers.nominatim)
        monkeypatch.setenv("PLANNERFORGE_OVERPASS_URLS", ",".join(servers.mirrors))
        fetched = maps("fetch", "Ringstadt", "--country", "Germany", "--scenario-type", "roundabout")
        assert fetched.exit_code == 0, fetched.output
        assert "Ringstadt (DEU): 2.3 km of roads" in fetched.stdout
        assert "1 roundabout site" in fetched.stdout
        assert f"roads of “Ringstadt, Germany”, downloaded from 127.0.0.1:{servers.port}" in fetched.stdout
        assert "© OpenStreetMap contributors, ODbL" in fetched.stdout
        assert f"Asks 127.0.0.1:{servers.port}" in fetched.stderr
        assert "Ringstadt" in maps("list").stdout
        unknown = maps("fetch", "Gotham City")
        assert unknown.exit_code == 1
        assert "knows no such place" in repr(unknown.exception), "which the command line tells"
    monkeypatch.setenv("PLANNERFORGE_MAPS_ONLINE", "offline")
    refused = maps("fetch", "Ringstadt")
    assert refused.exit_code == 1
    assert "nothing is fetched" in refused.stderr
