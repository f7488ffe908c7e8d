"""``make train-rbfn``: trains the network of MP-RBFN and writes its weights; the same seed gives the same bytes.

Samples are solutions of an optimal control problem (``rbfn_samples.py``, which needs casadi, the extra ``train``). The
seed chooses the samples on which the units sit. All units have one width, and the outputs are a least-squares fit with
a ridge to the samples minus the straight line between their ends. The fit has no iterations, so it depends only on the
samples and on numpy's linear algebra.

``--cache`` keeps the samples in a folder, because solving them takes most of the time.
"""

import argparse
import hashlib
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from plannerforge.engine.geometry import Points, Values
from plannerforge.engine.planners.rbfn.network import PRIMITIVE_NODES, PrimitiveNetwork, driven_poses, straight_lines

from ..harness import print_figures
from .rbfn_samples import PrimitiveSamples, solved_samples

SEED, SAMPLES, UNITS = 20, 40_000, 512
"""Units of the shipped network (chosen). More units learn more and take longer to run."""
HELD_OUT_SEED, HELD_OUT = 21, 4_000
"""Number of samples that judge the network."""
_WIDTH, _RIDGE = 3.0, 1e-7
"""Chosen on samples of another seed, among 2.5 to 9 and 1e-5 to 1e-7."""
_KNOWN_SHARE = 0.2
"""Percent of the samples beyond each bound of an input that count as unknown."""
_SHIPPED = Path(__file__).resolve().parents[2] / "engine" / "planners" / "rbfn" / "network.npz"


def trained(samples: PrimitiveSamples, seed: int, units: int = UNITS) -> PrimitiveNetwork:
    """Return the network that fits the samples."""
    inputs = samples.inputs
    mean, spread = inputs.mean(axis=0).astype(np.float32), inputs.std(axis=0).astype(np.float32)
    chosen = np.sort(np.random.default_rng(seed).choice(len(inputs), min(units, len(inputs)), replace=False))
    lowest, highest = np.percentile(inputs, (_KNOWN_SHARE, 100.0 - _KNOWN_SHARE), axis=0)
    lowest[[0, 2, 5]] = 0.0  # speeds may be 0, and a bearing straight ahead
    empty = PrimitiveNetwork(
        mean=mean,
        spread=spread,
        lowest=lowest.astype(np.float32),
        highest=highest.astype(np.float32),
        centres=((inputs[chosen] - mean) / spread).astype(np.float32),
        width=np.array(_WIDTH, dtype=np.float32),
        outputs=np.zeros((0, 0), dtype=np.float32),
    )
    features = empty.features(inputs).astype(np.float64)
    normal = features.T @ features
    normal[np.diag_indices(len(normal))] += _RIDGE
    outputs = np.linalg.solve(normal, features.T @ _above_the_line(samples))
    return PrimitiveNetwork(
        **{item.name: getattr(empty, item.name) for item in fields(empty) if item.name != "outputs"},
        outputs=outputs.astype(np.float32),
    )


def _above_the_line(samples: PrimitiveSamples) -> Points:
    """Return the curvatures and speeds of samples minus the straight line between their ends, (n, 58)."""
    parts = []
    for column, first, last in ((4, 1, 4), (3, 0, 5)):
        line = straight_lines(samples.inputs[:, first], samples.inputs[:, last])
        parts.append((samples.states[:, :, column] - line)[:, 1 : PRIMITIVE_NODES - 1])
    return np.concatenate(parts, axis=1)


def misses(network: PrimitiveNetwork, inputs: Points) -> tuple[Values, Values]:
    """Return the network's errors at the ends as a share of the chord, and of their headings in rad; each (n,)."""
    x, y, heading = driven_poses(*network.profiles(inputs))
    away = np.hypot(x[:, -1] - np.cos(inputs[:, 2]), y[:, -1] - np.sin(inputs[:, 2]))
    return away, np.abs(heading[:, -1] - inputs[:, 3])


def error_table(network: PrimitiveNetwork, held_out: PrimitiveSamples) -> Mapping[str, float]:
    """Return errors on held-out samples before they are closed, in shares of the chord and in rad."""
    inside = network.knows(held_out.inputs)
    away, turned = misses(network, held_out.inputs[inside])
    table = {"known": float(inside.mean())}
    for name, values in (("end_error", away), ("end_heading_rad", turned)):
        for rank in (50, 95, 99):
            table[f"{name}_{rank}"] = float(np.percentile(values, rank))
    return {key: round(value, 6) for key, value in table.items()}


def write(network: PrimitiveNetwork, path: Path) -> str:
    """Write the weights; the first 16 digits of their SHA-256."""
    with path.open("wb") as stream:
        np.savez_compressed(stream, **{item.name: getattr(network, item.name) for item in fields(network)})
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _samples(cache: Path | None, seed: int, count: int) -> PrimitiveSamples:
    """Return samples from the cache, or solve and store them."""
    path = cache / f"primitives_{seed}_{count}.npz" if cache else None
    if path is not None and path.is_file():
        return PrimitiveSamples.load(path)
    samples = solved_samples(seed, count)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        samples.save(path)
    return samples


def _main() -> None:
    """Read the command line, train, write, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--samples", type=int, default=SAMPLES, help="number of problems to solve")
    parser.add_argument("--cache", type=Path, help="folder for the samples")
    parser.add_argument("--out", type=Path, default=_SHIPPED, help="target of the weights (default: the package)")
    given = parser.parse_args()
    before = hashlib.sha256(given.out.read_bytes()).hexdigest()[:16] if given.out.is_file() else ""
    samples = _samples(given.cache, given.seed, given.samples)
    network = trained(samples, given.seed)
    digest = write(network, given.out)
    held_out = _samples(given.cache, HELD_OUT_SEED, HELD_OUT)
    print_figures(
        "Network of MP-RBFN",
        {
            "samples": len(samples.inputs),
            "failures": samples.failures + held_out.failures,
            "sha256": digest,
            "same_as_before": int(digest == before),
            **error_table(network, held_out),
        },
    )


if __name__ == "__main__":
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":  # sums of several threads differ in their last digits
        again = [sys.executable, *sys.orig_argv[1:]]
        sys.exit(subprocess.run(again, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}, check=False).returncode)
    _main()
