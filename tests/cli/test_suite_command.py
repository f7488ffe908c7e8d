"""``plannerforge test``: exit codes, what is printed and written, baselines, and the example of the docs."""

import shlex
import shutil
from pathlib import Path

import pytest
import yaml
from lxml import etree
from typer.testing import CliRunner, Result

from plannerforge.cli.program import application
from plannerforge.cli.suite import junit_xml, markdown, read_suite
from plannerforge.schemas.analysis.suite import SuiteReport
from plannerforge.server.settings import Settings

CHECKOUT = Path(__file__).resolve().parent.parent.parent
EXAMPLE = CHECKOUT / "docs" / "examples" / "gate"
SCENARIOS = ["preset:2"]
pytestmark = pytest.mark.usefixtures("warm_workers")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory, starter_workspace: Path) -> Path:
    """One workspace for all suites of this file: what was run is not run again."""
    return shutil.copytree(starter_workspace, tmp_path_factory.mktemp("gate") / "workspace")


_TOLD = ({"type", "message"}, set[str](), ())
_JUNIT: dict[str, tuple[set[str], set[str], tuple[str, ...]]] = {
    "testsuites": ({"name", "time", "tests", "failures", "errors"}, set(), ("testsuite",)),
    "testsuite": (
        {"name", "tests", "failures", "errors", "skipped", "time", "timestamp", "hostname", "id", "package"},
        {"name", "tests", "failures", "errors"},
        ("properties", "testcase", "system-out", "system-err"),
    ),
    "testcase": ({"name", "classname", "time"}, {"name"}, ("skipped", "error", "failure", "system-out", "system-err")),
    "skipped": _TOLD,
    "error": _TOLD,
    "failure": _TOLD,
    "system-out": (set(), set(), ()),
    "system-err": (set(), set(), ()),
}
"""What the XSD of Jenkins' xUnit plugin (junit-10) and its predecessor both allow: attributes, those that must be,
children in their order."""


def breaches(element: etree._Element) -> list[str]:
    """Where a JUnit file breaks the schema, or counts what is not there."""
    allowed, needed, children = _JUNIT[str(element.tag)]
    given, tags = set(element.attrib), [str(child.tag) for child in element]
    found = [f"{element.tag}: {name}" for name in sorted(given - allowed | needed - given)]
    found += [f"{element.tag} holds {tag}" for tag in tags if tag not in children]
    if not found and tags != sorted(tags, key=children.index):
        found.append(f"order in {element.tag}")
    if element.tag == "testsuite":
        for count, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            if element.get(count, "0") != str(sum(1 for _ in element.iter(tag))):
                found.append(f"testsuite counts {count}")
    return found + [one for child in element if child.tag in _JUNIT for one in breaches(child)]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("<testsuites><testsuite name='a' tests='0' failures='0'/></testsuites>", "testsuite: errors"),
        ("<testsuite name='a' tests='2' failures='0' errors='0'><testcase name='b'/></testsuite>", "counts tests"),
        ("<testcase name='a' result='b'/>", "testcase: result"),
        ("<testcase name='a'><system-out/><failure/></testcase>", "order in testcase"),
    ],
)
def test_the_check_of_junit_files_sees_faults(text: str, found: str) -> None:
    assert found in "; ".join(breaches(etree.fromstring(text)))


def run_suite(workspace: Path, path: Path, *flags: str) -> Result:
    environment = {"COLUMNS": "250", "PLANNERFORGE_MAPS_ONLINE": "offline"}
    return CliRunner(env=environment).invoke(application, ["test", str(path), "--workspace", str(workspace), *flags])


def written(folder: Path, **keys: object) -> Path:
    path = folder / "suite.yaml"
    suite = {"name": "small", "scenarios": SCENARIOS, "configurations": ["idm:Default"], "limits": ["invalid == 0"]}
    path.write_text(yaml.safe_dump(suite | keys), encoding="utf-8")
    return path


def test_limits_decide_the_exit_code_and_every_file_agrees(workspace: Path, tmp_path: Path) -> None:
    names = {flag: str(tmp_path / flag) for flag in ("junit", "summary", "report", "save-baseline")}
    flags = [part for flag, path in names.items() for part in (f"--{flag}", path)]
    held = run_suite(workspace, written(tmp_path), *flags)
    assert held.exit_code == 0, held.output
    assert "small: all 2 limits hold; 2 runs" in held.stdout
    report = SuiteReport.model_validate_json(Path(names["report"]).read_bytes())
    assert [case.configuration for case in report.cases] == ["idm:Default"] * 2
    assert "2 limits hold" in Path(names["summary"]).read_text(encoding="utf-8")

    limits = ["success >= 0", "distance_m < 0", f"nothing lost against {Path(names['save-baseline']).name}"]
    broken = run_suite(workspace, written(tmp_path, limits=limits), "--junit", names["junit"])
    assert broken.exit_code == 1
    assert "1 limit broken; 2 runs, 2 of them reused" in broken.stdout
    suites = etree.parse(names["junit"]).getroot()
    assert breaches(suites) == []
    assert [(one.get("tests"), one.get("failures"), one.get("errors")) for one in suites] == [
        ("4", "1", "0"),
        ("2", "0", "0"),
    ]
    (failure,) = suites.iter("failure")
    assert "distance_m < 0: seen within in 0 of 2 runs" in str(failure.get("message"))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"limits": ["succes >= 0.9"]}, "Valid: success"),
        ({"limits": ["success >= 0.9 for fast"]}, "not in the suite"),
        ({"limits": []}, "limits"),
        ({"scenario": ["preset:1"]}, "scenario"),
        ({"scenarios": ["ZAM_Nowhere-1_1_T-1"]}, "ZAM_Nowhere-1_1_T-1"),
        ({"scenarios": [{"files": "none"}]}, "none"),
        ({"scenarios": [{"find": {"county": "DEU"}}]}, "suite.yaml, scenario 1: there is no argument 'county'"),
        ({"scenarios": ["preset:1", {"fles": "a"}]}, "scenario 2: 'fles' is not a scenario"),
        ({"scenarios": ["preset:1", {"generate": "one"}]}, "scenario 2: generate: 'one' is not a mapping"),
        ({"configurations": [{"name": "a", "wieghts": ["x=1"]}]}, "suite.yaml, configuration 1"),
        ({"scenarios": [{"find": {"obstacles": ["bus>=500"]}}]}, "no scenario meets"),
        ({"configurations": [{"file": "gone.yaml"}]}, "no weight file 'gone.yaml'"),
        ({"configurations": ["frenetix:Nobody"]}, "no preset 'Nobody'"),
        ({"configurations": ["idm:Default", "idm:Default"]}, "two configurations"),
        ({"limits": ["not worse than gone.json"]}, "--save-baseline gone.json"),
        ({"limits": ["not worse than suite.yaml"]}, "is not a baseline"),
        ({"limits": ["not worse than ../../../etc/passwd"]}, "outside"),
    ],
)
def test_an_invalid_suite_exits_with_2_and_the_reason(
    workspace: Path, tmp_path: Path, keys: dict[str, object], said: str
) -> None:
    result = run_suite(workspace, written(tmp_path, **keys))
    assert result.exit_code == 2
    assert said in result.stderr
    assert "Traceback" not in result.output


def test_hostile_files_are_not_suites(workspace: Path, tmp_path: Path) -> None:
    path = tmp_path / "suite.yaml"
    for text in ("a: &a [*a]", "- " * 9000, "limits: !!python/object:os.system {}", "[]", "\0"):
        path.write_text(text, encoding="utf-8")
        assert run_suite(workspace, path).exit_code == 2


def test_outcomes_of_runs_are_distinguished_in_junit_and_markdown() -> None:
    def case(outcome: str) -> dict[str, object]:
        ended = f"ended <as> {outcome}\x07|"
        return {
            "configuration": "a",
            "scenario_id": "ZAM_A-1_1_T-1",
            "problem_id": 7,
            "run_id": None,
            "outcome": outcome,
            "ended": ended,
        }

    verdict = {
        "limit": "success >= 1",
        "configuration": "a",
        "holds": False,
        "observed": "0 of 1",
        "run_ids": ["run_1"],
    }
    report = SuiteReport.model_validate(
        {
            "suite": "s",
            "batch_id": "batch_1",
            "cases": [case("goal_reached"), case("collision"), case("invalid"), case("lost")],
            "verdicts": [verdict],
            "reused": 0,
            "runs": {"suite": "s", "configurations": {}},
        }
    )
    limits, runs = made = etree.fromstring(junit_xml(report))
    assert breaches(made) == []
    assert [child.tag for case in limits for child in case] == ["failure"]
    assert [child.tag for case in runs for child in case] == ["system-out", "system-out", "skipped", "error"]
    assert {key: runs.get(key) for key in ("tests", "failures", "errors", "skipped")} == {
        "tests": "4",
        "failures": "0",
        "errors": "1",
        "skipped": "1",
    }
    assert "3 of 4 runs did not reach the goal" in markdown(report)
    assert not report.passed


@pytest.mark.usefixtures("starter_ready")
def test_the_workflow_of_the_docs_runs_the_suite_of_the_docs(
    tmp_path: Path, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    workflow = yaml.safe_load((EXAMPLE / "planner-gate.yml").read_text(encoding="utf-8"))
    steps = workflow["jobs"]["gate"]["steps"]
    (command,) = (step["run"] for step in steps if "plannerforge test" in step.get("run", ""))
    monkeypatch.chdir(tmp_path)
    words = [word.replace("$GITHUB_STEP_SUMMARY", "summary.md") for word in shlex.split(command)]
    suite = CHECKOUT / words[2]
    assert suite == EXAMPLE / "suite.yaml"
    read_suite(suite)
    environment = {"PLANNERFORGE_MAPS_ONLINE": "offline", "PLANNERFORGE_WORKSPACE": str(settings.workspace)}
    result = CliRunner(env=environment).invoke(application, ["test", str(suite), *words[3:]])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "gate.xml").is_file()
    assert "all 9 limits hold" in (tmp_path / "summary.md").read_text(encoding="utf-8")
    kept = next(step["with"]["path"] for step in steps if "upload-artifact" in step.get("uses", ""))
    assert all((tmp_path / name).is_file() for name in kept.split())
