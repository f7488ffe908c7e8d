"""``python -m benchmarks.modification.advice``: refusals that are drawn, and their first suggestion followed.

Wrong calls of all tools are drawn by kind from a seeded generator, on scenarios of a folder and on made ones, and sent
to a server by standard input and output. Of each refusal the first suggestion is read from its text, and sent.

Keys: ``refusals``: calls that were refused; ``advice_succeeds``: share of them whose first suggestion is a call and is
answered; ``advice_mends``: share whose first suggestion is the same tool's call, mended, and is answered (the others
look something up); ``advice_repeated``: suggestions that failed and were given again; ``advice_names_ego``: suggestions
that name the ego as a vehicle; ``not_refused``: drawn calls that were answered.
"""

import argparse
import sys
from pathlib import Path

import anyio

from ...harness import existing, print_figures, shared_scenarios
from .measure import measure_advice

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument("--half", choices=["odd", "even", "both"], default="odd")
    parser.add_argument("--seed", type=int, default=37)
    parser.add_argument("--refusals", type=int, default=240, help="how many are drawn")
    parser.add_argument("--tools", nargs="*", default=None, help="only refusals of these tools")
    parser.add_argument("--kinds", nargs="*", default=None, help="only kinds that have one of these in their names")
    given = parser.parse_args()
    folder = existing(given.folder)
    figures = anyio.run(measure_advice, folder, given.half, given.seed, given.refusals, given.tools, given.kinds)
    print_figures("Advice", figures)
    sys.exit(0)
