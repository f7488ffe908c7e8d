"""Files that try to harm are refused with their reason, and cost little until then."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.builders import town_road

from plannerforge.engine.commonroad.reader import read_recorded, read_scenario, scan_xml
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.scenarios import ReadFactsRequest

GOOD = town_road().cut(20).xml()
HEAD = "<?xml version='1.0' encoding='UTF-8'?>"
BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
PARAMETER = '<!DOCTYPE x [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>'
ELSEWHERE = '<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">'

HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "entity bomb": (GOOD.replace(HEAD, HEAD + BOMB), "document type"),
    "external entity": (GOOD.replace(HEAD, HEAD + OUTSIDE), "document type"),
    "parameter entity": (GOOD.replace(HEAD, HEAD + PARAMETER), "document type"),
    "document type on a server": (GOOD.replace(HEAD, HEAD + ELSEWHERE), "document type"),
    "deep nesting": (HEAD + "<commonRoad>" + "<a>" * 5000 + "</a>" * 5000 + "</commonRoad>", "deeper"),
    "truncated": (GOOD[: len(GOOD) // 2], "well-formed"),
    "empty": ("", "well-formed"),
    "another root": (HEAD + "<osm/>", "not CommonRoad"),
    "unknown encoding": (GOOD.replace("UTF-8", "UTF-42"), "well-formed"),
    "not in its encoding": (GOOD.replace("nobody", "M\xf6lln").encode("latin-1"), "well-formed"),
    "UTF-16 declared as UTF-8": (GOOD.encode("utf-16"), "well-formed"),
    "a null byte": (GOOD.replace("nobody", "no\0body"), "well-formed"),
    "a packed file": (b"\x1f\x8b\x08\x00" + b"\x00" * 1000, "well-formed"),
    "a path as id": (GOOD.replace("ZAM_Builder-1_1_T-1", "../../../tmp/evil"), "naming"),
    "coordinates that are no numbers": (GOOD.replace("<x>10.0000", "<x>NaN"), "line 7: x of lanelet 1 is nan m"),
    "a speed that is no number": (
        GOOD.replace("<velocity><exact>10.0000", "<velocity><exact>NaN", 1),
        "velocity of dynamicObstacle 31 is nan",
    ),
    "a later speed that is no number": (
        re.sub("(3</exact></time><velocity><exact>)10.0000", r"\1NaN", GOOD),
        "velocity of dynamicObstacle 31 is nan",
    ),
    "an endless acceleration": (GOOD.replace("<acceleration><exact>0.0", "<acceleration><exact>INF"), "acceleration"),
    "infinite coordinates": (GOOD.replace("<x>10.0000", "<x>1e999"), "is inf m"),
    "coordinates beyond the earth": (GOOD.replace("<x>10.0000", "<x>1e300"), "is 1e.300 m"),
    "two lanelets with one id": (GOOD.replace('<lanelet id="2"', '<lanelet id="1"'), "two elements with the id 1"),
    "two vehicles with one id": (re.sub('(Obstacle id=")32"', '\\g<1>31"', GOOD), "two elements with the id 31"),
    "no lanelets": (HEAD + '<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" benchmarkID="A"/>', "no lanelets"),
    "no lanelets left": (re.sub("<lanelet .*?</lanelet>", "", GOOD, flags=re.DOTALL), "no lanelets"),
    "time that stands still": (GOOD.replace('StepSize="0.1"', 'StepSize="0"'), "timeStepSize"),
    "time that is no number": (GOOD.replace('StepSize="0.1"', 'StepSize="nan"'), "timeStepSize"),
    "a recording of years": (GOOD.replace("<exact>19</exact>", "<exact>2000000000</exact>"), "2,000,000,000"),
    "a goal in years": (GOOD.replace(">150</interval", ">1000000000000</interval"), "1,000,000,000,000"),
    "a vehicle as large as a town": (GOOD.replace("<length>4.5", "<length>1e12"), "length of dynamicObstacle 31"),
    "a vehicle turned inside out": (GOOD.replace("<length>4.5", "<length>-4.5"), "length of dynamicObstacle 31"),
}


def zeros(path: Path) -> None:
    """500 MB that take no place on the disk."""
    with path.open("wb") as stream:
        stream.truncate(500_000_000)


def million_lanelets(path: Path) -> None:
    with path.open("w", encoding="utf-8") as stream:
        stream.write(HEAD + "<commonRoad>")
        for block in range(1000):
            stream.write("".join(f'<lanelet id="{block * 1000 + index}"/>' for index in range(1000)))
        stream.write("</commonRoad>")


def endless_tag(path: Path) -> None:
    with path.open("w", encoding="utf-8") as stream:
        stream.write(HEAD + '<commonRoad author="')
        for _ in range(60):
            stream.write("a" * 1_000_000)
        stream.write('"/>')


def endless_number(path: Path) -> None:
    head, _, tail = GOOD.partition("<x>10.0000")
    with path.open("w", encoding="utf-8") as stream:
        stream.write(head + "<x>")
        for _ in range(60):
            stream.write("1" * 1_000_000)
        stream.write(tail)


LARGE: dict[str, tuple[Callable[[Path], None], str]] = {
    "zeros": (zeros, "bytes"),
    "a million lanelets": (million_lanelets, "lanelets"),
    "a tag of 60 MB": (endless_tag, "tag"),
    "a number of 60 MB": (endless_number, "at most 2,000|characters"),
}

READS_A_FOLDER = """
import re, sys
from pathlib import Path
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.scenarios import ReadFactsRequest
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read_facts(ReadFactsRequest(path=path), silent)
    except UnsafeInput:
        continue
    sys.exit(f"{path.name} was taken")
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""


@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_a_hostile_file_is_refused(tmp_path: Path, name: str) -> None:
    content, reason = HOSTILE[name]
    assert content != GOOD
    path = tmp_path / "hostile.xml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UnsafeInput, match=reason):
        read_facts(ReadFactsRequest(path=path), silent)


@pytest.mark.parametrize("read", [read_recorded, read_scenario])
def test_a_file_without_a_road_is_refused_with_the_remedy(tmp_path: Path, read: Callable[[Path], object]) -> None:
    path = tmp_path / "empty.xml"
    path.write_text(re.sub("<lanelet .*?</lanelet>", "", GOOD, flags=re.DOTALL), encoding="utf-8")
    with pytest.raises(UnsafeInput, match=r"empty\.xml has no lanelets") as caught:
        read(path)
    assert "lanelet network" in caught.value.next_step


@pytest.mark.parametrize("name", sorted(LARGE))
def test_a_large_hostile_file_is_refused(tmp_path: Path, name: str) -> None:
    write, reason = LARGE[name]
    write(tmp_path / "hostile.xml")
    with pytest.raises(UnsafeInput, match=reason):
        read_facts(ReadFactsRequest(path=tmp_path / "hostile.xml"), silent)


@pytest.mark.skipif(sys.platform != "linux", reason="the peak of the memory is read from /proc")
def test_refusing_needs_less_than_a_gigabyte(tmp_path: Path) -> None:
    for index, (content, _) in enumerate(HOSTILE.values()):
        (tmp_path / f"{index}.xml").write_bytes(content if isinstance(content, bytes) else content.encode())
    for index, (write, _) in enumerate(LARGE.values()):
        write(tmp_path / f"large{index}.xml")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", READS_A_FOLDER, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 1_000_000


def test_the_valid_file_behind_the_hostile_ones_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "good.xml"
    path.write_text(GOOD, encoding="utf-8")
    assert read_facts(ReadFactsRequest(path=path), silent).scenario_id == "ZAM_Builder-1_1_T-1"
    with pytest.raises(UnsafeInput, match="the limit is 5,000"):
        read_facts(ReadFactsRequest(path=path, file_bytes=5000), silent)


def test_a_long_comment_within_the_limit_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "good.xml"
    path.write_text(GOOD.replace("</commonRoad>", f"<!--{'a' * 900_000}--></commonRoad>"), encoding="utf-8")
    assert scan_xml(path).name == "commonRoad"
