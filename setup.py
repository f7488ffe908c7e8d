"""Names the packages: those below the top-level folders, each as ``plannerforge.<folder>``.

All else is in ``pyproject.toml``. Setuptools finds packages by the names of their folders, and these folders bear
common names that must not be installed as such.
"""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

SETTINGS = tomllib.loads((Path(__file__).parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
FOLDERS = [folder for folder in SETTINGS["package-dir"].values() if folder != "plannerforge"]

setup(
    packages=[
        "plannerforge",
        *(f"plannerforge.{name}" for name in find_packages(include=[*FOLDERS, *(f"{folder}.*" for folder in FOLDERS)])),
    ]
)
