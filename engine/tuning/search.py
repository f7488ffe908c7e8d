"""Searches over weights and settings: the search space, and new candidates from Optuna.

A search runs in rounds of a fixed size. All candidates of a round are drawn before the first result is reported, and
results are reported in order, so the outcome does not depend on the speed of the workers. Every draw replays all
earlier results from the start, so an interrupted search continues from the runs in the workspace.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING

from ...schemas.analysis.optimization import Gain, GainRequest, Proposals, ProposeRequest
from ...schemas.errors import Faults, InvalidRequest, UnexpectedFailure, UnknownName, closest, with_values
from ...schemas.planning import PlannerConfiguration
from ...schemas.text import quoted
from ..execution import ProgressReporter
from .settings import known_settings, setting_values
from .tunings import LARGEST_WEIGHT, tuning_of

if TYPE_CHECKING:
    import optuna

_OFF = 0.1
"""The part of a weight's range that means 0 (chosen: off is as likely as a tenth of the range)."""
_SMALLEST, _LARGEST = 0.01, 100.0
"""Range of weights in a search, in addition to 0 (chosen: an order of magnitude beyond the presets on both sides)."""
_USUAL = with_values(vary=None)
"""The remedy of a refusal if a name to vary cannot be corrected: the usual dimensions."""
_VARIED = re.compile(r"(?P<name>[A-Za-z_]\w*)(?:\s*=\s*(?P<low>\d+(?:\.\d+)?)\s*\.\.\s*(?P<high>\d+(?:\.\d+)?))?")


def legacy_seed(seed: int) -> int:
    """Return a seed for 32-bit generators (NumPy's legacy one, which Optuna and SALib use)."""
    return seed % 2**32


@dataclass(frozen=True)
class Dimension:
    """A weight or setting that a search varies, and the mapping of [0, 1] to its values.

    ``can_be_off``: the lowest tenth means 0; ``is_log``: evenly spaced in the logarithm; ``is_whole``: only whole
    numbers.
    """

    name: str
    low: float
    high: float
    is_setting: bool = False
    is_log: bool = False
    can_be_off: bool = False
    is_whole: bool = False

    def value(self, place: float) -> float:
        """Return the value at a position in [0, 1], with three significant digits."""
        if self.can_be_off:
            if place < _OFF:
                return 0.0
            place = (place - _OFF) / (1 - _OFF)
        span = self.high - self.low
        value = self.low * (self.high / self.low) ** place if self.is_log else self.low + span * place
        if self.is_whole:
            return float(min(self.high, max(self.low, round(value))))
        return min(self.high, max(self.low, float(f"{value:.3g}")))

    def place(self, value: float) -> float:
        """Return the position of a value, or the nearest end if the value is outside."""
        if self.can_be_off and value < self.low:
            return _OFF / 2
        inside = min(self.high, max(self.low, value))
        if self.is_log:
            place = math.log(inside / self.low) / math.log(self.high / self.low)
        else:
            place = (inside - self.low) / (self.high - self.low)
        return _OFF + (1 - _OFF) * place if self.can_be_off else place


def dimensions(planner: str, vary: Sequence[str]) -> tuple[Dimension, ...]:
    """Return the dimensions of a search: all active weights, or those given, such as ``jerk`` or ``horizon_s=2..5``.

    Raises:
        UnknownName: The planner has no such weight or setting.
        InvalidRequest: A text is malformed, its range is empty or outside the limits, or a name occurs twice.
    """
    tuning = tuning_of(planner)
    if not vary:
        return tuple(_weight(planner, name, None) for name in tuning.weights)
    faults, made = Faults(), dict[str, Dimension]()
    for text in vary:
        with faults.collecting():
            dimension = _dimension(planner, text)
            if dimension.name in made:
                raise InvalidRequest(f"{dimension.name} is given twice", next_step="give it once")
            made[dimension.name] = dimension
    faults.raise_all()
    return tuple(made.values())


def _dimension(planner: str, text: str) -> Dimension:
    found = _VARIED.fullmatch(text.strip())
    if found is None:
        raise InvalidRequest(
            f"{quoted(text)} is not a weight or setting to vary", valid=["jerk", "prediction=0.1..50", "horizon_s=2..5"]
        ).also(_USUAL)
    name, tuning, settings = found["name"], tuning_of(planner), known_settings()
    given = None if found["low"] is None else (float(found["low"]), float(found["high"]))
    if given is not None and given[0] >= given[1]:
        valid = [f"{name}={given[1]:g}..{given[0]:g}"]
        is_known = name in tuning.weights or name in tuning.external or name in settings
        raise InvalidRequest(
            f"{quoted(text)} is not a range", valid=valid, given=text if is_known and given[0] > given[1] else ""
        ).also(_USUAL)
    if name in tuning.weights or name in tuning.external:
        return _weight(planner, name, given)
    if name not in settings:
        known = [*tuning.weights, *settings]
        raise UnknownName(f"{planner} has no weight or setting {quoted(name)}", valid=closest(name, known)).also(_USUAL)
    setting = settings[name]
    low, high = given or (setting.lowest, setting.highest)
    _refuse_outside(name, (low, high), (setting.lowest, setting.highest))
    return Dimension(name, low, high, is_setting=True, is_whole=setting.whole)


def _weight(planner: str, name: str, given: tuple[float, float] | None) -> Dimension:
    limits = tuning_of(planner).limits.get(name, (0.0, LARGEST_WEIGHT))
    if given is not None:
        _refuse_outside(name, given, limits)
        low, high = given
        if low > 0:
            return Dimension(name, low, high, is_log=True)
        return Dimension(name, high * _SMALLEST / _LARGEST, high, is_log=True, can_be_off=True)
    if limits[0] > 0:
        return Dimension(name, *limits, is_log=True)
    return Dimension(name, _SMALLEST, min(_LARGEST, limits[1]), is_log=True, can_be_off=True)


def _refuse_outside(name: str, given: tuple[float, float], limits: tuple[float, float]) -> None:
    if not limits[0] <= given[0] < given[1] <= limits[1]:
        raise InvalidRequest(
            f"{name} cannot be varied from {given[0]:g} to {given[1]:g}",
            valid=[f"{name}={limits[0]:g}..{limits[1]:g}"],
            remedies=[with_values(vary=[f"{name}={limits[0]:g}..{limits[1]:g}"])],
        )


def values_at(space: Sequence[Dimension], point: Sequence[float]) -> dict[str, float]:
    """Return the values of a point by name."""
    return {one.name: one.value(place) for one, place in zip(space, point, strict=True)}


def point_of(space: Sequence[Dimension], configuration: PlannerConfiguration) -> tuple[float, ...]:
    """Return the point of a configuration; values outside the space move to its edge."""
    values: Mapping[str, float] = (
        configuration.weights | configuration.external_weights | setting_values(configuration.settings)
    )
    return tuple(one.place(values[one.name]) for one in space)


def propose(request: ProposeRequest, report: ProgressReporter) -> Proposals:
    """Return the next points of a search (an operation).

    Raises:
        UnexpectedFailure: Replaying the search gave points other than the reported points, because the libraries have
            changed.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(directions=["maximize"] * request.objectives, sampler=_sampler(request))
    space = {name: optuna.distributions.FloatDistribution(0.0, 1.0) for name in request.names}
    for result in request.enqueued:
        params = dict(zip(request.names, result.point, strict=True))
        study.add_trial(optuna.trial.create_trial(params=params, distributions=dict(space), values=list(result.values)))
    for number, results in enumerate(request.rounds):
        trials = [study.ask(dict(space)) for _ in results]
        for trial, result in zip(trials, results, strict=True):
            if any(
                abs(trial.params[name] - place) > 1e-9 for name, place in zip(request.names, result.point, strict=True)
            ):
                raise UnexpectedFailure("propose", f"round {number} of the search gave other points before")
            study.tell(trial, list(result.values))
        report(0.9 * (number + 1) / len(request.rounds), "replaying the search")
    drawn = [study.ask(dict(space)) for _ in range(request.count)]
    return Proposals(points=tuple(tuple(float(one.params[name]) for name in request.names) for one in drawn))


def _sampler(request: ProposeRequest) -> "optuna.samplers.BaseSampler":
    import warnings

    import optuna

    with (
        warnings.catch_warnings()
    ):  # warnings about experimental and ageing options; the version of the library is fixed
        warnings.simplefilter("ignore")
        if request.method == "random":
            return optuna.samplers.RandomSampler(seed=legacy_seed(request.seed))
        if request.method == "cmaes":
            start = dict(zip(request.names, request.start, strict=True))
            return optuna.samplers.CmaEsSampler(x0=start, sigma0=0.2, seed=legacy_seed(request.seed))
        return optuna.samplers.TPESampler(
            seed=legacy_seed(request.seed),
            multivariate=True,
            constant_liar=True,
            n_startup_trials=max(8, len(request.names)),
        )


def judge_gain(request: GainRequest, report: ProgressReporter) -> Gain:
    """Return the mean difference over scenarios, with its 95% interval from Student's t (an operation)."""
    from scipy.special import stdtrit

    groups: dict[str, list[float]] = {}
    for root, difference in request.differences:
        groups.setdefault(root, []).append(difference)
    means = [fmean(group) for group in groups.values()]
    middle, half = fmean(means), math.inf
    if len(means) > 1:
        variance = sum((mean - middle) ** 2 for mean in means) / (len(means) - 1)
        half = float(stdtrit(len(means) - 1, 0.975)) * math.sqrt(variance / len(means))
    report(1.0, "judged")
    return Gain(difference=middle, low=middle - min(half, 10.0), high=middle + min(half, 10.0), scenarios=len(means))
