"""Draw ``docs/house.svg``, the map of the packages, from the code: ``make house``.

A box is a package with the first sentence of its docstring; a row is a layer of ``pyproject.toml``. An arrow leads to
an imported package. A package may import everything below it; transitive reduction removes implied arrows.
"""

import ast
import textwrap
import tomllib
from pathlib import Path

import grimp
import networkx as nx
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

CHECKOUT = Path(__file__).resolve().parent.parent
WIDTH, BOX_WIDTH, BOX_HEIGHT, ROW_HEIGHT = 15.0, 3.3, 0.86, 1.32
COLOURS = {"schemas": "#f0e442", "engine": "#cfe8f5", "other": "#f5d9c3"}
"""Light tints of Okabe and Ito's yellow, sky blue and vermilion, which suit any colour vision."""


def rows() -> list[list[str]]:
    """Return the packages by layer, the highest first; the engine's as ``engine.<name>``."""
    settings = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    outer, inner = settings["tool"]["importlinter"]["contracts"][:2]
    layers: list[list[str]] = []
    for layer in outer["layers"]:
        names = [name.strip().removeprefix("plannerforge.") for name in layer.split("|")]
        if names == ["engine"]:
            layers += [[f"engine.{name.strip()}" for name in part.split("|")] for part in inner["layers"]]
        else:
            layers.append(names)
    return layers


def imports(packages: list[str]) -> nx.DiGraph:
    """Return the imported packages of each package, without implied ones."""
    graph = grimp.build_graph("plannerforge")
    found = nx.DiGraph()
    found.add_nodes_from(packages)
    for importer in graph.modules:
        for imported in graph.find_modules_directly_imported_by(importer):
            ends = [_package_of(module, packages) for module in (importer, imported)]
            if all(ends) and ends[0] != ends[1]:
                found.add_edge(*ends)
    return nx.transitive_reduction(found)


def _package_of(module: str, packages: list[str]) -> str:
    name = module.removeprefix("plannerforge.")
    return next((package for package in packages if f"{name}.".startswith(f"{package}.")), "")


def purpose(package: str) -> str:
    """Return the first sentence of a package's docstring."""
    path = CHECKOUT / package.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split()).split(". ")[0].rstrip(".")


def draw(target: Path) -> None:
    """Draw the boxes row by row, and the arrows between rows."""
    rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "house", "font.family": "sans-serif"})
    layers = rows()
    height = ROW_HEIGHT * len(layers) + 0.4
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, WIDTH), ylim=(0, height))
    axes.axis("off")
    centers = {}
    for row, layer in enumerate(layers):
        y = height - 0.75 - row * ROW_HEIGHT
        for column, package in enumerate(layer):
            centers[package] = (WIDTH * (column + 0.5) / len(layer), y)
    for importer, imported in imports(list(centers)).edges:
        (x1, y1), (x2, y2) = centers[importer], centers[imported]
        arrow = FancyArrowPatch(
            (x1 + 0.12 * (x2 - x1), y1 - BOX_HEIGHT / 2),
            (x2 - 0.12 * (x2 - x1), y2 + BOX_HEIGHT / 2),
            arrowstyle="-|>",
            mutation_scale=11,
            linewidth=1.1 if y1 - y2 < 2.5 * ROW_HEIGHT else 0.5,
            color="#333333" if y1 - y2 < 2.5 * ROW_HEIGHT else "#aaaaaa",
        )
        axes.add_patch(arrow)
    for package, (x, y) in centers.items():
        colour = COLOURS.get(package.split(".")[0], COLOURS["other"])
        corner = (x - BOX_WIDTH / 2, y - BOX_HEIGHT / 2)
        box = FancyBboxPatch(
            corner,
            BOX_WIDTH,
            BOX_HEIGHT,
            boxstyle="round,pad=0.02,rounding_size=0.08",
            facecolor=colour,
            edgecolor="#333333",
            zorder=3,
        )
        axes.add_patch(box)
        axes.text(x, y + 0.27, package, ha="center", va="center", fontsize=11, fontweight="bold", zorder=4)
        axes.text(x, y - 0.13, textwrap.fill(purpose(package), 46), ha="center", va="center", fontsize=7.8, zorder=4)
    figure.savefig(target, metadata={"Date": None})


if __name__ == "__main__":
    draw(CHECKOUT / "docs" / "house.svg")
