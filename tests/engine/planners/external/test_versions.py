"""What the version of a planner of others is called."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from support.own_planners import STRAIGHT, install

from plannerforge.engine.planners import built_in_version, source_that_drives
from plannerforge.engine.planners.external.versions import described_by_git
from plannerforge.engine.planners.registry import version_that_drives

Install = Callable[..., Path]
needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a planner of a name where this process finds packages."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    return lambda name, source=STRAIGHT, **options: install(folder, name, source, **options)


def git(folder: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=test", "-c", "user.email=test@localhost", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", "-C", str(folder), *identity, *arguments], check=True, capture_output=True, text=True)
    return done.stdout


def checkout(folder: Path, text: str = "print(1)\n") -> Path:
    folder.mkdir()
    source = folder / "planner.py"
    source.write_text(text)
    git(folder, "init", "--quiet")
    git(folder, "add", "planner.py")
    git(folder, "commit", "--quiet", "--message", "first")
    git(folder, "tag", "v1")
    return source


def test_a_declared_version_comes_with_the_digest_of_the_source(installed: Install) -> None:
    declared = STRAIGHT.replace('summary="drives straight on"', 'summary="drives straight on", version="v2.1"')
    installed("versioned", declared)
    found = version_that_drives("versioned")
    assert found.words == f"v2.1 ({found.source[:7]})"
    assert found.source == source_that_drives("versioned")


def test_an_edit_without_a_new_declaration_is_another_version(installed: Install) -> None:
    installed("unversioned")
    before = version_that_drives("unversioned")
    installed("unversioned", f"{STRAIGHT}# edited\n")
    after = version_that_drives("unversioned")
    assert before.words.startswith("1.0 ("), "the version of the package"
    assert before.words != after.words


def test_a_built_in_planner_has_the_version_of_its_core_and_ours() -> None:
    old, new = (built_in_version("frenetix", {"frenetix": one, "plannerforge-mcp": "1.0"}) for one in ("0.4", "0.5"))
    assert old.words == "frenetix 0.4, plannerforge-mcp 1.0"
    assert old.source != new.source
    assert "frenetix" not in built_in_version("idm", {"frenetix": "0.4", "plannerforge-mcp": "1.0"}).words


@needs_git
def test_git_calls_a_commit_by_its_tag_and_an_edit_dirty(tmp_path: Path) -> None:
    source = checkout(tmp_path / "checkout")
    assert described_by_git([source]) == "v1"
    source.write_text("print(2)\n")
    assert described_by_git([source]) == "v1-dirty"
    git(source.parent, "commit", "--quiet", "--all", "--message", "second")
    assert described_by_git([source]).startswith("v1-1-g")


@needs_git
def test_a_repository_that_only_surrounds_the_source_is_not_its_version(tmp_path: Path) -> None:
    around = checkout(tmp_path / "project").parent
    inside = around / "environment" / "planner.py"
    inside.parent.mkdir()
    inside.write_text("print(1)\n")
    assert described_by_git([inside]) == ""
    assert described_by_git([tmp_path / "absent.py"]) == ""


@needs_git
def test_commands_configured_in_a_repository_are_not_run(tmp_path: Path) -> None:
    source = checkout(tmp_path / "checkout")
    ran = tmp_path / "ran"
    script = tmp_path / "hook.sh"
    script.write_text(f"#!/bin/sh\ntouch {ran}\ncat\n")
    script.chmod(0o755)
    for name in ("core.fsmonitor", "filter.own.clean", "filter.own.smudge", "core.pager", "diff.external"):
        git(source.parent, "config", name, str(script))
    (source.parent / ".gitattributes").write_text("*.py filter=own\n")
    hooks = source.parent / ".git" / "hooks"
    for name in ("post-index-change", "reference-transaction", "post-checkout"):
        shutil.copy(script, hooks / name)
    source.write_text("print(3)\n")
    assert described_by_git([source]) == "v1-dirty"
    assert not ran.exists()


@needs_git
def test_git_that_hangs_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = checkout(tmp_path / "checkout")
    slow = tmp_path / "bin" / "git"
    slow.parent.mkdir()
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o755)
    monkeypatch.setenv("PATH", f"{slow.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr("plannerforge.engine.planners.external.versions.GIT_LIMIT_S", 0.2)
    assert described_by_git([source]) == ""
