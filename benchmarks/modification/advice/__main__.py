"""``python -m benchmarks.modification.advice``: draws refusals and follows their first suggestion.

A seeded generator draws wrong calls of all tools by kind, on scenarios of a folder and on generated ones, and sends
them to a server over standard input and output. The bench reads the first suggestion from the text of each refusal and
sends it.

Keys:

- ``refusals``: refused calls; ``not_refused``: drawn calls that were answered.
- ``advice_succeeds``: share of refusals that first suggest a successful call.
- ``advice_mends``: share that first suggest a corrected, successful call of the same tool (others look something up).
- ``advice_repeated``: suggestions that failed and were given again.
- ``advice_names_ego``: suggestions that name the ego as a vehicle.
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
    parser.add_argument("--refusals", type=int, default=240, help="number of drawn calls")
    parser.add_argument("--tools", nargs="*", default=None, help="only refusals of these tools")
    parser.add_argument("--kinds", nargs="*", default=None, help="only kinds with one of these in their names")
    given = parser.parse_args()
    folder = existing(given.folder)
    figures = anyio.run(measure_advice, folder, given.half, given.seed, given.refusals, given.tools, given.kinds)
    print_figures("Advice", figures)
    sys.exit(0)
