"""Files that try to harm are refused with their reason."""

from pathlib import Path

import pytest
from builders import town_road

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.scenarios import ReadFactsRequest

GOOD = town_road().xml()
BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
HEAD = "<?xml version='1.0' encoding='UTF-8'?>"

HOSTILE = {
    "entity bomb": (GOOD.replace(HEAD, HEAD + BOMB), "document type"),
    "external entity": (GOOD.replace(HEAD, HEAD + OUTSIDE), "document type"),
    "deep nesting": (HEAD + "<commonRoad>" + "<a>" * 5000 + "</a>" * 5000 + "</commonRoad>", "deeper"),
    "truncated": (GOOD[: len(GOOD) // 2], "well-formed"),
    "empty": ("", "well-formed"),
    "another root": (HEAD + "<osm/>", "no CommonRoad file"),
    "unknown encoding": (GOOD.replace("UTF-8", "UTF-42"), "well-formed"),
    "a path as id": (GOOD.replace("ZAM_Builder-1_1_T-1", "../../../tmp/evil"), "naming"),
    "coordinates that are no numbers": (GOOD.replace("<x>10.0000", "<x>NaN"), "finite|readable"),
    "infinite coordinates": (GOOD.replace("<x>10.0000", "<x>1e999"), "finite|readable"),
    "no lanelets": (
        HEAD + '<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" benchmarkID="A"/>',
        "readable|naming",
    ),
}


@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_a_hostile_file_is_refused(tmp_path: Path, name: str) -> None:
    content, reason = HOSTILE[name]
    assert content != GOOD
    path = tmp_path / "hostile.xml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(UnsafeInput, match=reason):
        read_facts(ReadFactsRequest(path=path), silent)


def test_a_file_of_zeros_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "zeros.xml"
    with path.open("wb") as stream:
        stream.truncate(500_000_000)
    with pytest.raises(UnsafeInput, match="bytes"):
        read_facts(ReadFactsRequest(path=path), silent)


def test_a_million_lanelets_are_refused_while_they_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "million.xml"
    with path.open("w", encoding="utf-8") as stream:
        stream.write(HEAD + "<commonRoad>")
        for block in range(1000):
            stream.write("".join(f'<lanelet id="{block * 1000 + index}"/>' for index in range(1000)))
        stream.write("</commonRoad>")
    with pytest.raises(UnsafeInput, match="lanelets"):
        read_facts(ReadFactsRequest(path=path), silent)
