"""Build ``dist/plannerforge-mcp-VERSION.mcpb``, which a host installs with a click, from the wheel in ``dist``.

The manifest is ``packaging/bundle/manifest.json`` with the server's tools. The format's official tool
(``@anthropic-ai/mcpb``, with npx) validates and packs it; ``--stage`` only writes the folder.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
SOURCE, DIST, STAGE = CHECKOUT / "packaging" / "bundle", CHECKOUT / "dist", CHECKOUT / "build" / "bundle"
MCPB = "@anthropic-ai/mcpb@2.1.2"


def stage(wheel: Path, folder: Path) -> str:
    """Write the bundle's files into a new folder, and return its version, which is the wheel's."""
    version = wheel.name.split("-")[1]
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copy(wheel, folder)
    for name in ("server.py", "icon.png"):
        shutil.copy(SOURCE / name, folder)
    project = (SOURCE / "environment.toml").read_text(encoding="utf-8")
    (folder / "pyproject.toml").write_text(project.replace("VERSION", version), encoding="utf-8")
    manifest = json.loads((SOURCE / "manifest.json").read_text(encoding="utf-8"))
    manifest |= {"version": version, "tools": list(offered())}
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return version


def offered() -> list[dict[str, str]]:
    """Return the server's tools, each with the first sentence of its description."""
    described = (
        json.loads(path.read_text(encoding="utf-8"))
        for path in sorted((CHECKOUT / "server" / "descriptions").glob("*.json"))
    )
    return [{"name": tool["name"], "description": tool["description"].split(". ")[0].rstrip(".")} for tool in described]


def main() -> int:
    """Build the bundle, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stage", action="store_true", help="write the folder and pack nothing")
    given = parser.parse_args()
    wheels = sorted(DIST.glob("plannerforge_mcp-*.whl"), key=lambda wheel: wheel.stat().st_mtime)
    if not wheels:
        sys.stderr.write("There is no wheel in dist: run `make dist` first.\n")
        return 1
    version = stage(wheels[-1], STAGE)
    if given.stage:
        sys.stdout.write(f"{STAGE}\n")
        return 0
    if shutil.which("npx") is None:
        sys.stderr.write("Node is not installed, whose npx runs the tool that packs a bundle.\n")
        return 1
    bundle = DIST / f"plannerforge-mcp-{version}.mcpb"
    for words in (["validate", str(STAGE / "manifest.json")], ["pack", str(STAGE), str(bundle)]):
        subprocess.run(["npx", "--yes", MCPB, *words], check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
