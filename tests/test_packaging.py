"""Bundle, registry entry, image and release workflow: they name what there is, in its present version, and no more."""

import importlib.util
import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator
from PIL import Image
from support.tree import CHECKOUT
from typer.main import get_command

from benchmarks.serve.__main__ import PARTS
from benchmarks.serve.install import LEFT_OUT
from plannerforge import __version__
from plannerforge.cli.hosts import start_command
from plannerforge.cli.main import application, main
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

PACKAGING = CHECKOUT / "packaging"
WORKFLOWS = CHECKOUT / ".github" / "workflows"
RELEASE, CHANGE = "release.yml", "ci.yml"
DEVELOPERS = ".venv/.installed-dev"
TARGETS = set(re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def project() -> dict[str, Any]:
    return tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))


def flags_of(command: str) -> set[str]:
    """The flags of a command of ``plannerforge``."""
    options = get_command(application).commands[command].params  # type: ignore[attr-defined]
    return {flag for option in options for flag in (*option.opts, *option.secondary_opts)}


def instructions() -> list[tuple[str, str]]:
    """The Dockerfile's instructions with what they say, lines joined."""
    text = (PACKAGING / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(line.split(maxsplit=1)[0], " ".join(line.split()[1:])) for line in lines]


def final_stage() -> list[tuple[str, str]]:
    every = instructions()
    starts = [number for number, (word, _) in enumerate(every) if word == "FROM"]
    return every[starts[-1] :]


def compose() -> dict[str, Any]:
    made: dict[str, Any] = yaml.safe_load((PACKAGING / "compose.yaml").read_text(encoding="utf-8"))
    return made


def test_versions_that_files_name_are_that_of_the_package() -> None:
    registry = json.loads((PACKAGING / "server.json").read_text(encoding="utf-8"))
    manifest = json.loads((PACKAGING / "bundle" / "manifest.json").read_text(encoding="utf-8"))
    labels = " ".join(said for word, said in final_stage() if word == "LABEL")
    assert registry["version"] == registry["packages"][0]["version"] == manifest["version"] == __version__
    assert f'image.version="{__version__}"' in labels
    assert compose()["services"]["plannerforge"]["image"] == f"plannerforge:{__version__}"


# ---- the image


def test_the_final_stage_runs_as_an_unprivileged_user_and_installs_no_packages() -> None:
    stage = final_stage()
    assert [said for word, said in stage if word == "USER"] == ["10001:10001"]
    runs = [said for word, said in stage if word == "RUN"]
    assert runs == ["install -d -o 10001 -g 10001 -m 700 /workspace"]
    assert not re.search(r"apt-get|gcc|build-essential", " ".join(said for _, said in instructions()))
    words = [word for word, _ in stage]
    assert words.index("USER") > max(number for number, word in enumerate(words) if word in {"RUN", "COPY"})


def test_the_image_writes_to_its_volume_and_tmp_alone() -> None:
    stage = dict(final_stage())
    variables = dict(re.findall(r"(\w+)=(\S+)", stage["ENV"]))
    assert stage["VOLUME"] == variables["PLANNERFORGE_WORKSPACE"] == "/workspace"
    assert variables["HOME"] == "/tmp"
    assert variables["MPLCONFIGDIR"].startswith("/tmp/")
    assert variables["PYTHONDONTWRITEBYTECODE"] == "1"
    assert {
        name.lower().removeprefix("plannerforge_") for name in variables if name.startswith("PLANNERFORGE_")
    } <= set(Settings.model_fields)


def test_the_image_serves_by_http_with_existing_flags_and_checks_its_health() -> None:
    stage = dict(final_stage())
    assert json.loads(stage["ENTRYPOINT"])[0] in project()["project"]["scripts"]
    command, *arguments = json.loads(stage["CMD"])
    assert {word for word in arguments if word.startswith("--")} <= flags_of(command)
    assert "--token-file" in arguments, "who listens at every address asks for a token"
    port = str(Settings.model_fields["http_port"].default)
    assert stage["EXPOSE"] == port
    assert f"http://127.0.0.1:{port}/health" in stage["HEALTHCHECK"]


def test_bundle_page_and_release_leave_out_unimported_packages() -> None:
    overrides = [f"{name} ; python_version < '3'" for name in LEFT_OUT]
    bundle = tomllib.loads((PACKAGING / "bundle" / "environment.toml").read_text(encoding="utf-8"))
    assert overrides == bundle["tool"]["uv"]["override-dependencies"]
    assert project()["tool"]["uv"]["override-dependencies"][0] in overrides
    for place in ("docs/install.md", ".github/workflows/release.yml"):
        words = (CHECKOUT / place).read_text(encoding="utf-8")
        assert f"""printf "%s ; python_version < '3'\\n" {" ".join(LEFT_OUT)} > overrides.txt""" in words
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    assert f"""printf "%s ; python_version < '3'\\n" {" ".join(LEFT_OUT)} | uv pip compile""" in makefile


def test_the_image_has_the_pinned_versions() -> None:
    build = " ".join(said for _, said in instructions())
    assert "--no-deps -r packaging/requirements.txt /wheels/*.whl" in build


def test_the_build_gets_exactly_the_required_files() -> None:
    lines = (PACKAGING / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    let_in = {line[1:] for line in lines if line.startswith("!")}
    metadata = project()["project"]
    needed = {*project()["tool"]["setuptools"]["package-dir"].values(), "README.md", *metadata["license-files"]}
    asked_by_name = set(re.findall(r"-r (\S+)", (PACKAGING / "Dockerfile").read_text(encoding="utf-8")))
    assert asked_by_name
    assert needed | asked_by_name | {"pyproject.toml", "setup.py", "__init__.py", "__main__.py"} == let_in
    assert all((CHECKOUT / name).exists() for name in let_in)


def test_compose_runs_it_without_rights_on_a_root_that_cannot_be_written() -> None:
    service = compose()["services"]["plannerforge"]
    assert service["read_only"] is True
    assert service["tmpfs"] == ["/tmp"]
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["volumes"] == ["workspace:/workspace"]
    assert service["ports"] == ["127.0.0.1:8765:8765"]
    assert compose()["secrets"]["tokens"] == {"file": "tokens"}
    assert (PACKAGING / service["build"]["context"] / service["build"]["dockerfile"]).is_file()
    names = {name.lower().removeprefix("plannerforge_") for name in service["environment"]}
    assert names <= set(Settings.model_fields)


STAND_IN = """#!{python}
import os, signal, subprocess, sys, time, urllib.request
from pathlib import Path

words, here = sys.argv[1:], Path({folder!r})
program = [{python!r}, "-P", "-m", "plannerforge"]
served = [*program, "serve", "--http", "--port", "{port}", "--token-file", str(here / "tokens")]
pid = here / "pid"
with (here / "asked").open("a") as asked:
    print(*words, file=asked)
if words[0] == "run":
    sys.exit(subprocess.run([*program, *words[3:]]).returncode)
command = words[3]
if command == "up":
    log = (here / "log").open("a")
    started = subprocess.Popen(served, stdout=log, stderr=log, start_new_session=True)
    pid.write_text(str(started.pid))
    for _ in range(600):
        try:
            urllib.request.urlopen("http://127.0.0.1:{port}/health", timeout=1)
            break
        except OSError:
            time.sleep(0.1)
if command == "down" and pid.exists():
    os.kill(int(pid.read_text()), signal.SIGTERM)
    while Path("/proc", pid.read_text()).exists():
        time.sleep(0.05)
    pid.unlink()
print({{"config": "plannerforge:1", "port": "127.0.0.1:{port}"}}.get(command, ""))
"""
"""What stands in for docker where none runs: a container is a process of this checkout, its volume a folder."""


def tried(tmp_path: Path) -> subprocess.CompletedProcess[str]:
    """What the script that tries the image says, with a server of this checkout in the image's place."""
    for name in ("try_image.sh", "compose.yaml"):
        shutil.copy(PACKAGING / name, tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    program = tmp_path / "bin" / "docker"
    program.parent.mkdir()
    program.write_text(STAND_IN.format(python=sys.executable, folder=str(tmp_path), port=port), encoding="utf-8")
    program.chmod(0o755)
    environment = {
        "PATH": f"{program.parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(CHECKOUT),
        "PLANNERFORGE_WORKSPACE": str(tmp_path / "workspace"),
        "PLANNERFORGE_STARTER": "false",
        "PLANNERFORGE_WARM_UP": "false",
        "PLANNERFORGE_MAPS_ONLINE": "offline",
    }
    return subprocess.run(
        ["bash", str(tmp_path / "try_image.sh")], env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("curl") is None, reason="it asks by curl, and waits for a process in /proc"
)
def test_the_image_is_tried_with_a_token_and_after_a_restart(tmp_path: Path) -> None:
    done = tried(tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^made (cfg_\w+)$[^!]*^\1 is there$", done.stdout, re.MULTILINE)
    asked = [line.split()[3:] for line in (tmp_path / "asked").read_text().splitlines() if line.startswith("compose")]
    ups_and_downs = [words for words in asked if words[0] in {"up", "down"}]
    assert [words[0] for words in ups_and_downs] == ["up", "down", "up", "down"]
    assert [words for words in ups_and_downs if "--volumes" in words] == [["down", "--volumes"]]
    assert not (tmp_path / "tokens").exists()


def test_existing_tokens_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "tokens").write_text("mine")
    assert tried(tmp_path).returncode == 1
    assert (tmp_path / "tokens").read_text() == "mine"


# ---- the bundle


@pytest.fixture(scope="module")
def staged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a bundle, made from a wheel that holds nothing."""
    folder = tmp_path_factory.mktemp("bundle")
    wheel = folder / f"plannerforge_mcp-{__version__}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as made:
        made.writestr("nothing", "")
    spec = importlib.util.spec_from_file_location("bundle", CHECKOUT / "scripts" / "bundle.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.stage(wheel, folder / "staged") == __version__
    return folder / "staged"


def test_a_bundle_contains_the_wheel_of_its_environment(staged: Path) -> None:
    wheel = f"plannerforge_mcp-{__version__}-py3-none-any.whl"
    assert {path.name for path in staged.iterdir()} == {
        "manifest.json",
        "pyproject.toml",
        "server.py",
        "icon.png",
        wheel,
    }
    environment = tomllib.loads((staged / "pyproject.toml").read_text(encoding="utf-8"))
    assert environment["tool"]["uv"]["sources"]["plannerforge-mcp"] == {"path": wheel}
    assert environment["project"]["requires-python"] == project()["project"]["requires-python"]
    assert "VERSION" not in (staged / "pyproject.toml").read_text(encoding="utf-8").split("\n", 1)[1]


def test_the_manifest_names_all_tools_and_only_existing_flags_and_settings(staged: Path) -> None:
    manifest = json.loads((staged / "manifest.json").read_text(encoding="utf-8"))
    assert {tool["name"] for tool in manifest["tools"]} == {spec.name for spec in TOOLS}
    assert all(tool["description"] for tool in manifest["tools"])
    server = manifest["server"]
    assert (staged / server["entry_point"]).is_file()
    arguments = server["mcp_config"]["args"]
    command = arguments[arguments.index(server["entry_point"]) + 1]
    assert {word for word in arguments if word.startswith("--")} - {"--directory"} <= flags_of(command)
    names = {name.lower().removeprefix("plannerforge_") for name in server["mcp_config"]["env"]}
    assert names <= set(Settings.model_fields)
    asked = set(re.findall(r"\$\{user_config\.(\w+)\}", json.dumps(server)))
    assert asked == set(manifest["user_config"])
    for setting in manifest["user_config"].values():
        assert {"type", "title", "description"} <= set(setting)


def test_a_bundle_contains_the_icon_that_it_shows(staged: Path) -> None:
    icon = staged / json.loads((staged / "manifest.json").read_text(encoding="utf-8"))["icon"]
    with Image.open(icon) as picture:
        assert (picture.format, picture.size) == ("PNG", (512, 512))


def test_the_registry_entry_names_no_icon_but_by_an_address() -> None:
    icons = json.loads((PACKAGING / "server.json").read_text(encoding="utf-8")).get("icons", [])
    assert all(icon["src"].startswith("https://") for icon in icons), "its schema takes nothing else"


def test_a_bundle_starts_the_command_line() -> None:
    told = subprocess.run(
        [sys.executable, str(PACKAGING / "bundle" / "server.py"), "--version"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout == f"plannerforge {__version__}\n"


def test_the_changelog_describes_this_version() -> None:
    headings = re.findall(r"^## (.*)$", (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[:2] == ["[Unreleased]", f"[{__version__}]"]


# ---- the registry

TEXT = {"type": "string", "minLength": 1}
ARGUMENT = {
    "type": "object",
    "required": ["type"],
    "properties": {
        "type": {"enum": ["named", "positional"]},
        "format": {"enum": ["string", "number", "boolean", "filepath"]},
        "isRepeated": {"type": "boolean"},
        "isRequired": {"type": "boolean"},
        **dict.fromkeys(("name", "value", "valueHint", "description", "default", "placeholder"), TEXT),
    },
    "oneOf": [
        {"properties": {"type": {"const": "named"}}, "required": ["name"]},
        {
            "properties": {"type": {"const": "positional"}},
            "anyOf": [{"required": ["value"]}, {"required": ["valueHint"]}],
        },
    ],
    "additionalProperties": False,
}
ENTRY = {
    "type": "object",
    "required": ["$schema", "name", "description", "version", "packages"],
    "properties": {
        "$schema": {"const": "https://static.modelcontextprotocol.io/schemas/2025-12-11/server.schema.json"},
        "name": {"type": "string", "pattern": "^[a-zA-Z0-9.-]+/[a-zA-Z0-9._-]+$", "minLength": 3, "maxLength": 200},
        "title": TEXT | {"maxLength": 100},
        "description": TEXT | {"maxLength": 100},
        "version": TEXT | {"maxLength": 255, "pattern": r"^\d+\.\d+\.\d+$"},
        "packages": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["registryType", "identifier", "transport"],
                "properties": {
                    "registryType": {"enum": ["npm", "pypi", "cargo", "oci", "nuget", "mcpb"]},
                    "registryBaseUrl": {"type": "string", "pattern": "^https://"},
                    "transport": {
                        "properties": {"type": {"enum": ["stdio", "streamable-http", "sse"]}},
                        "required": ["type"],
                    },
                    "runtimeArguments": {"type": "array", "items": ARGUMENT},
                    "packageArguments": {"type": "array", "items": ARGUMENT},
                    "environmentVariables": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "required": ["name"],
                            "properties": {
                                "choices": {"type": "array", "items": TEXT},
                                **dict.fromkeys(("name", "description", "default"), TEXT),
                            },
                            "additionalProperties": False,
                        },
                    },
                    **dict.fromkeys(("identifier", "version", "runtimeHint"), TEXT),
                },
                "dependentRequired": {"runtimeArguments": ["runtimeHint"]},
                "additionalProperties": False,
            },
        },
    },
    "additionalProperties": False,
}
"""What the registry's schema of 2025-12-11 asks of the fields that our entry has; it has no others."""


def test_the_entry_of_the_registry_keeps_to_its_rules_and_invents_no_address() -> None:
    entry = json.loads((PACKAGING / "server.json").read_text(encoding="utf-8"))
    assert [error.message for error in Draft202012Validator(ENTRY).iter_errors(entry)] == []
    assert entry["name"].partition("/")[0] == "com.example", "the namespace is the owner's to fill in"
    assert not {"repository", "websiteUrl", "remotes"} & set(entry)
    (package,) = entry["packages"]
    assert (package["identifier"], package["registryType"]) == (project()["project"]["name"], "pypi")
    assert package["transport"] == {"type": "stdio"}
    first, *named = package["packageArguments"]
    assert {argument["name"] for argument in named} <= flags_of(first["value"])
    names = {variable["name"].lower().removeprefix("plannerforge_") for variable in package["environmentVariables"]}
    assert names <= set(Settings.model_fields)


def test_the_registry_entry_starts_an_existing_program_and_command(tmp_path: Path) -> None:
    (package,) = json.loads((PACKAGING / "server.json").read_text(encoding="utf-8"))["packages"]
    assert package["runtimeHint"] == "uvx", "which starts the program that is called like the package"
    module, _, name = project()["project"]["scripts"][package["identifier"]].partition(":")
    assert getattr(importlib.import_module(module), name) is main
    assert package["packageArguments"][0]["value"] in get_command(application).commands  # type: ignore[attr-defined]
    (tmp_path / "CACHEDIR.TAG").touch()
    said = [word for argument in package.get("runtimeArguments", []) for word in (argument["name"], argument["value"])]
    _, *words = start_command([], tmp_path / "archive-v0" / "made")
    assert words[: len(said)] == said, "install writes for uvx what the registry tells hosts"
    assert words[-2:] == [package["identifier"], package["packageArguments"][0]["value"]]


def test_no_public_address_is_invented() -> None:
    assert "urls" not in project()["project"]


# ---- the workflows


def workflow(name: str) -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((WORKFLOWS / name).read_text(encoding="utf-8"))
    return read


def jobs(name: str = RELEASE) -> dict[str, Any]:
    made: dict[str, Any] = workflow(name)["jobs"]
    return made


def commands(name: str = RELEASE) -> list[list[str]]:
    """The words of each line that a step runs."""
    steps = [step for job in jobs(name).values() for step in job["steps"]]
    return [shlex.split(line) for step in steps for line in str(step.get("run", "")).splitlines() if line.strip()]


@pytest.mark.parametrize("name", [RELEASE, CHANGE])
def test_every_command_of_a_workflow_exists(name: str) -> None:
    run = commands(name)
    targets = {target for words in run if words[0] == "make" for target in words[1:]}
    assert targets
    assert targets - {DEVELOPERS} <= TARGETS
    modules = {words[words.index("-m") + 1] for words in run if "-m" in words} - {"pip"}
    assert {module for module in modules if importlib.util.find_spec(f"{module}.__main__") is None} == set()
    parts = [words[words.index("--only") + 1] for words in run if "--only" in words]
    assert parts
    assert [part for part in parts if part not in PARTS.keys] == []
    scripts = [words[0] for words in run if "/" in words[0] and not words[0].startswith(("$", ".venv", "clean", "by-"))]
    assert [script for script in scripts if not os.access(CHECKOUT / script, os.X_OK)] == []


def test_the_environment_that_workflows_ask_make_for_is_the_one_of_developers() -> None:
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    venv, stamp = re.findall(r"^(?:VENV \?|DEV_STAMP :)= (\S+)$", makefile, re.MULTILINE)
    assert stamp.replace("$(VENV)", venv) == DEVELOPERS


def test_the_release_is_tried_in_every_documented_way() -> None:
    known = {*get_command(application).commands, "--version"}  # type: ignore[attr-defined]
    run = commands()
    ours = [words[number + 1] for words in run for number, word in enumerate(words[:-1]) if is_ours(word, words)]
    assert ours
    assert set(ours) <= known
    page = (CHECKOUT / "docs" / "install.md").read_text(encoding="utf-8")
    assert [way for way in ("uv tool install", "uvx", "pipx install", "pip install") if way not in page] == []
    for way in (["uv", "pip"], ["uvx"], ["pipx", "install"], ["by-pip/bin/python", "-m", "pip", "install"]):
        assert any(words[: len(way)] == way for words in run)
    found = [words for words in run if any("--find-links" in word for word in words)]
    assert [words[0] for words in found] == ["uvx", "pipx", "by-pip/bin/python"]
    assert all(project()["project"]["name"] in words for words in found)


def is_ours(word: str, words: list[str]) -> bool:
    """Whether a word of a command is our program, and not our package that something installs."""
    name = word.rpartition("/")[2]
    return (name in project()["project"]["scripts"] and "/" in word) or (
        name == "plannerforge-mcp" and words[0] == "uvx"
    )


def test_a_change_is_checked_against_all_that_can_break() -> None:
    words = commands(CHANGE)
    for command in ([".ci/run"], ["make", "docs"], ["make", "bundle"], ["packaging/try_image.sh"]):
        assert command in words
    measured = [line[line.index("--only") + 1] for line in words if "--only" in line]
    assert measured == ["conformance", "app_bridge"]
    (build,) = [line for line in words if line[:2] == ["docker", "build"]]
    assert (CHECKOUT / build[build.index("-f") + 1]).is_file()
    uses = [step["uses"] for job in jobs(CHANGE).values() for step in job["steps"] if "uses" in step]
    assert [action for action in uses if not re.search(r"@v\d+\.\d+\.\d+$", action)] == []
    assert workflow(CHANGE)["permissions"] == {"contents": "read"}
    assert not any("permissions" in job for job in jobs(CHANGE).values())


def test_a_change_is_checked_by_the_tests_of_product_and_benchmarks() -> None:
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    left_out = re.findall(r"^test: .*\n(?:\t.*\n)*?\t.* -m pytest .*--ignore=(\S+)$", makefile, re.MULTILINE)
    apart = re.findall(r"^test-benchmarks: .*\n(?:\t.*\n)*?\t.* -m pytest .* (\S+)$", makefile, re.MULTILINE)
    assert left_out == apart == ["tests/benchmarks"]
    run = (CHECKOUT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert {"make test", "make test-benchmarks"} <= set(run)


def test_the_tag_is_checked_against_the_version() -> None:
    step = next(step for step in jobs()["build"]["steps"] if step.get("name") == "The tag is the version")
    name = f"v{__version__}"
    for tag, expected in ((name, 0), ("v9.9.9", 1)):
        script = step["run"].replace("python ", f"{shlex.quote(sys.executable)} ")
        environment = {"GITHUB_REF_NAME": tag, "PATH": "/usr/bin:/bin"}
        ended = subprocess.run(["bash", "-c", script], cwd=CHECKOUT, env=environment, capture_output=True, check=False)
        assert ended.returncode == expected


def test_actions_are_pinned_and_rights_are_granted_where_needed() -> None:
    uses = [step["uses"] for job in jobs().values() for step in job["steps"] if "uses" in step]
    assert [action for action in uses if not re.search(r"@v\d+\.\d+\.\d+$", action)] == []
    rights = {name: job.get("permissions", {}) for name, job in jobs().items()}
    assert {name for name, given in rights.items() if "id-token" in given} == {"attest", "publish"}
    assert {name for name, given in rights.items() if given.get("contents") == "write"} == {"attach"}
    assert workflow(RELEASE)["permissions"] == {"contents": "read"}


def test_no_release_is_published_before_it_was_tried_and_attested() -> None:
    def before(job: str) -> list[str]:
        needed = jobs()[job].get("needs")
        return [] if needed is None else [needed, *before(needed)]

    assert before("publish") == ["attest", "try", "build"]
    assert "publish" in before("attach")
    assert any("pypi-publish" in step.get("uses", "") for step in jobs()["publish"]["steps"])
    assert not any("password" in step.get("with", {}) for step in jobs()["publish"]["steps"]), "a trusted publisher"
