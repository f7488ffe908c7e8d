"""Names the packages, those below the top-level folders each as ``plannerforge.<folder>``, and writes the package page.

All else is in ``pyproject.toml``. Setuptools finds packages by the names of their folders, and these folders bear
common names that must not be installed as such.
"""

import re
import tomllib
from pathlib import Path

from setuptools import find_packages, setup

CHECKOUT = Path(__file__).parent
SETTINGS = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
FOLDERS = [folder for folder in SETTINGS["package-dir"].values() if folder != "plannerforge"]


def package_page(readme: str) -> str:
    """The README for a package page, where relative links lead nowhere: they name the file, pictures are left out."""
    without_pictures = re.sub(r"^!\[[^\]]*\]\((?!https?:)[^)]*\)\n\n", "", readme, flags=re.MULTILINE)
    return re.sub(r"\[([^\]]*)\]\((?!https?:)([^)#]*)(?:#[^)]*)?\)", r"\1 (`\2`)", without_pictures)


setup(
    long_description=package_page((CHECKOUT / "README.md").read_text(encoding="utf-8")),
    long_description_content_type="text/markdown",
    packages=[
        "plannerforge",
        *(f"plannerforge.{name}" for name in find_packages(include=[*FOLDERS, *(f"{folder}.*" for folder in FOLDERS)])),
    ],
)
