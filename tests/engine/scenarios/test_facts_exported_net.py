"""A SUMO network beside a scenario is read before it is stored, and refused by name where it is none."""

from pathlib import Path

import pytest
from support.builders import town_road

from plannerforge.engine.catalog import exported_net
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.scenarios import ReadFactsRequest

NET = '<net version="1.20"><edge id="a"><lane id="a_0" index="0" speed="13.9" shape="0,0 9,0"/></edge></net>'
REFUSED = {
    "no network": ("<osm/>", "not a SUMO net"),
    "a document type": ("<!DOCTYPE net [<!ENTITY a 'b'>]><net/>", "document type"),
    "a speed that is no number": (NET.replace("13.9", "fast"), "fast"),
    "broken": ("<net><edge", "well-formed"),
    "larger than files may be": (NET.replace("</net>", "<!--" + "a" * 5000 + "--></net>"), "4,000"),
}


def request(folder: Path, net: str) -> ReadFactsRequest:
    path = town_road().cut(3).write(folder / "a.xml")
    (folder / "a.net.xml").write_text(net, encoding="utf-8")
    return ReadFactsRequest(path=path, net=exported_net(path))


def test_a_network_file_next_to_a_scenario_is_used(tmp_path: Path) -> None:
    assert read_facts(request(tmp_path, NET), silent).scenario_id == "ZAM_Builder-1_1_T-1"


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_is_not_a_network_is_refused_by_name(tmp_path: Path, name: str) -> None:
    net, reason = REFUSED[name]
    asked = request(tmp_path, net)
    limit = 4000 if "larger" in name else asked.file_bytes
    with pytest.raises(UnsafeInput, match=rf"next to the scenario.*a\.net\.xml.*{reason}") as caught:
        read_facts(asked.model_copy(update={"file_bytes": limit}), silent)
    assert "remove it" in caught.value.next_step
