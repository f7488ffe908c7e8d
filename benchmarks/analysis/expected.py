"""The expected fields of an analysis or comparison, recomputed from the runs of a batch.

``Expected`` builds content in the form of an answer with the figures that ``recomputed`` derives from records, steps
and scenario files. ``Tally`` compares both. Four things come from the answers about single runs instead: how a
collision came about, where an ego stood or braked, the encounters of a run, and the degree of a rule violation.
``causes``, ``loop.standing`` and ``rules`` judge them.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import fmean, median
from typing import Any

import numpy as np
from scipy.stats import fisher_exact

from plannerforge.schemas.runs import RunRecord
from plannerforge.schemas.vocabulary import ROAD_KINDS

from .public_runs import RawRuns
from .recomputed import METRICS, Costs, Pairs, correlation, goal, holm, late_because, metric, rate
from .trivial import problem_of, truth

LATE = ("timeout", "goal_late")
"""Outcomes of runs that were late or never arrived."""
_FROM_BEHIND = ("rear_end_by_other", "onto_standing_ego")
_OWN = {
    "stood_without_cause": ("stood_at_green", "stood_without_cause"),
    "braked_without_cause": ("braked_without_cause", "braked_too_hard"),
}
_AGAINST_COLLISIONS = ("prediction", "distance_to_obstacles", "responsibility")
_WORKS_AGAINST = {
    **dict.fromkeys(_AGAINST_COLLISIONS, ("collision",)),
    **dict.fromkeys(("lane_center_offset", "distance_to_reference_path"), ("off_road",)),
    **dict.fromkeys(("velocity_offset", "velocity"), LATE),
}
"""The failures that each weight works against (``docs/analysis.md``)."""
_OF_ALL_CONFIGURATIONS = ("harder_group", "hard_scenarios")


def is_close(record: RunRecord) -> bool:
    """Return True if a run came closer than half a metre or 1.5 s to a collision."""
    gap, time = metric(record, "minimum_distance_m"), metric(record, "minimum_time_to_collision_s")
    return (gap is not None and gap < 0.5) or (time is not None and time < 1.5)


@dataclass
class Tally:
    """Figures in fields that agree with the recomputed ones, that differ, and that nothing recomputes."""

    agreeing: int = 0
    wrong: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)

    @property
    def figures(self) -> int:
        """All of them."""
        return self.agreeing + len(self.wrong) + len(self.unread)

    def hold(self, told: Any, expected: Any, place: str = "") -> None:
        """Compare the figures of a field with the expected ones (None if nothing recomputes it)."""
        if isinstance(told, Mapping):
            for key, part in told.items():
                if key not in _NO_STATEMENTS:
                    self.hold(part, expected.get(key) if isinstance(expected, Mapping) else None, f"{place}.{key}")
        elif isinstance(told, list | tuple):
            listed = expected if isinstance(expected, list | tuple) else []
            for number, part in enumerate(told):
                self.hold(part, listed[number] if number < len(listed) else None, f"{place}[{number}]")
        elif isinstance(told, int | float) and not isinstance(told, bool):
            if not isinstance(expected, int | float):
                self.unread.append(f"{place} {told}")
            elif math.isclose(told, expected, rel_tol=1e-6, abs_tol=1e-9):
                self.agreeing += 1
            else:
                self.wrong.append(f"{place} {told}, recomputed {expected}")


_NO_STATEMENTS = frozenset(["next_offset", "obstacle_id", "also_touched", "flips_asked"])
"""Numbers that are ids, or that repeat the request."""


class Expected:
    """The expected content of answers about the runs of a batch.

    ``reviews``: the events of runs by run id; ``broken``: verdicts on traffic rules, by run id and rule; ``weights``:
    by configuration id, with ``default`` for the planner's first preset; ``findings``: their number.
    """

    def __init__(
        self,
        raw: RawRuns,
        weights: Mapping[str, Mapping[str, float]],
        reviews: Mapping[str, Any],
        broken: Mapping[str, Mapping[str, Any]],
        findings: int = 0,
    ) -> None:
        self.raw, self.weights, self.reviews, self.broken, self.findings = raw, weights, reviews, broken, findings
        self.costs = Costs(raw)
        self.records = {record.run_id: record for record in raw.records}

    @cached_property
    def apart(self) -> dict[str, "Expected"]:
        """The same for the runs of each configuration, by its id."""
        found = {}
        for config_id in self.raw.batch.configs:
            batch = self.raw.batch.model_copy(update={"configs": (config_id,)})
            own = tuple(one for one in self.raw.records if one.config_id == config_id)
            raw = replace(self.raw, batch=batch, records=own)
            found[config_id] = Expected(raw, self.weights, self.reviews, self.broken)
        return found

    # ---- runs

    def of(self, *outcomes: str) -> list[RunRecord]:
        """Return the valid runs, of some outcomes."""
        return [one for one in self.raw.valid if not outcomes or one.outcome in outcomes]

    @cached_property
    def contacts(self) -> dict[str, Any]:
        """How the collisions of the runs came about."""
        found = {one.run_id: self.reviews[one.run_id]["contact"] for one in self.of("collision")}
        return {run_id: contact for run_id, contact in found.items() if contact is not None}

    @cached_property
    def judged(self) -> dict[str, Any]:
        """Return the drivers that would have prevented the collisions, if a verdict is known."""
        return {key: one["prevention"] for key, one in self.contacts.items() if one["prevention"] is not None}

    @cached_property
    def unprevented(self) -> set[str]:
        """Collisions that no reference driver prevents and that the ego did not make."""
        keys = ("by_careful_driver", "by_rss", "by_fuzzy_driver")
        return {
            run_id
            for run_id, by in self.judged.items()
            if self.contacts[run_id].get("laid_to") != "ego"
            if by["by_braking_until_s"] is None and not any(by[key] for key in keys)
            if not any(one["prevents"] and one["driver"] != "evading" for one in by.get("drivers", ()))
        }

    @cached_property
    def not_attributable(self) -> set[str]:
        """Collisions that neither the careful nor the fuzzy driver prevents from both starts."""
        found = set()
        for run_id, by in self.judged.items():
            prevented = {(one["driver"], one["start"]) for one in by.get("drivers", ()) if one["prevents"]}
            starts = ("before_contact", "start")
            by_both = any(all((name, start) in prevented for start in starts) for name in ("r157_careful", "fsm"))
            earlier = not by.get("drivers") and (by["by_careful_driver"] or by["by_fuzzy_driver"])
            if not by_both and not earlier:
                found.add(run_id)
        return found

    @cached_property
    def the_others(self) -> set[str]:
        """Return the collisions that others cause: from behind, or ones that no driver in the ego's place prevents."""
        behind = {key for key, contact in self.contacts.items() if contact["kind"] in _FROM_BEHIND}
        return self.unprevented | {key for key in behind if self.contacts[key].get("laid_to") != "ego"}

    @cached_property
    def laid_to(self) -> Counter[str]:
        """The attribution of the collisions: the first rule of ``docs/runs.md`` that applies."""
        found: Counter[str] = Counter()
        for one in self.raw.valid:
            contact = self.contacts.get(one.run_id)
            if contact is None:
                continue
            gap = contact["predicted_gap_m"]
            if contact.get("laid_to") == "ego":
                found["ego"] += contact["fault"] is not None
            elif contact["kind"] in _FROM_BEHIND and one.traffic == "recorded":
                found["recording"] += 1
            elif contact["prevention"] is None:
                continue
            elif one.run_id in self.not_attributable:
                found["neither"] += 1
            elif one.prediction == "ground_truth" or gap == 0:
                found["planning"] += 1
            elif gap is not None:
                found["prediction"] += 1
        return found

    @cached_property
    def trivial(self) -> dict[str, str]:
        """Goals that require no driving, by the judge of ``trivial``."""
        kinds = {
            one.run_id: truth(problem_of(self.raw.files[one.scenario_id], one), self.raw.steps[one.run_id])
            for one in self.of("goal_reached")
            if one.scenario_id in self.raw.files
        }
        return {run_id: kind for run_id, kind in kinds.items() if kind is not None}

    @cached_property
    def late(self) -> dict[str, str]:
        """Why runs came late, by run id."""
        return {one.run_id: late_because(self.raw, one, self.pace(one.run_id)) for one in self.of(*LATE)}

    def pace(self, run_id: str) -> list[dict[str, Any]]:
        """Return the stretches of a run, as the answer on it alone has them."""
        return list(self.reviews.get(run_id, {}).get("pace", ()))

    def goals(self, left_out: Iterable[str] = ()) -> dict[str, float]:
        """Return the rate of runs that reached the goal, without some."""
        skipped = set(left_out)
        return _rate((one.scenario_id, float(goal(one))) for one in self.raw.valid if one.run_id not in skipped)

    # ---- an analysis

    def analysis(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return the expected fields of an answer of ``analyze_results`` on all of these runs."""
        valid, records = self.raw.valid, self.raw.records
        by_any = [(one.scenario_id, float(one.outcome in ("goal_reached", "goal_refused"))) for one in valid]
        correlated = correlation(self.raw)
        return {
            "runs": len(records),
            "valid_count": len(valid),
            "invalid_count": len(records) - len(valid),
            "success": self.goals(),
            "by_any_motion": _rate(by_any),
            "outcomes": [self._outcome(one["outcome"]) for one in told["outcomes"]],
            "groups": [self._group(one) for one in told["groups"]],
            "metrics": [self._metric(one["name"]) for one in told["metrics"]],
            "costs": [self.apart[one["config_id"]].cost(one["term"]) for one in told["costs"]],
            "correlations": [_correlated(correlated.get(one["feature"], [])) for one in told["correlations"]],
            "findings": [self._finding(one) for one in told["findings"]],
            "rows": [self._row(one) for one in told["rows"]],
            "rule_shares": [self._rule(one["rule"], one["config_id"]) for one in told["rule_shares"]],
            "note_figures": self._notes(told),
            **self._causes_and_goals(told),
        }

    def _notes(self, told: Mapping[str, Any]) -> dict[str, float]:
        rows = told["rows"]
        return {
            "first_row": 1,
            "last_row": len(rows),
            "asked_runs": len(self.raw.records),
            "scenarios": len({one.scenario_id for one in self.raw.valid}),
            "least_scenarios": 12,
            "hidden_findings": self.findings - len(told["findings"]),
        }

    def _causes_and_goals(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return the expected content about collisions, goals and vehicles, of all runs or of one configuration."""
        hits, asked = self.of("collision"), self.trivial if told.get("trivial") else {}
        beyond = [{excess.name for excess in one.beyond_vehicle} for one in self.raw.valid if one.beyond_vehicle]
        evidence = (told.get("causes") or {}).get("evidence", ())
        shares = [(self.records[key].scenario_id, float(key in self.unprevented)) for key in self.judged]
        return {
            "causes": {
                "collisions": len(hits),
                "looked_at": len(hits),
                "judged": len(self.judged),
                "kinds": Counter(contact["kind"] for contact in self.contacts.values()),
                "unpreventable_share": _rate(shares),
                "from_behind": sum(self.contacts[key]["kind"] in _FROM_BEHIND for key in self.unprevented),
                "success_without": self.goals(self.unprevented),
                "laid_to": self.laid_to,
                "evidence": [{"time_s": _time_of(self.records.get(one["run_id"]))} for one in evidence],
            },
            "trivial": {
                "kinds": Counter(asked.values()),
                "goals": len(self.of("goal_reached")),
                "looked_at": len(self.of("goal_reached")),
                "success_without": self.goals(asked),
            },
            "beyond_vehicle": {
                "limits": Counter(name for names in beyond for name in names),
                "judged": sum(one.beyond_vehicle is not None for one in self.raw.valid),
            },
        }

    def _outcome(self, outcome: str) -> dict[str, Any]:
        trials = [(one.scenario_id, float(one.outcome == outcome)) for one in self.raw.valid]
        return {"count": len(self.of(outcome)), "rate": _rate(trials)}

    def _group(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return the figures of a group by configuration; the group's name ends in the configuration's id."""
        own = next((one for key, one in self.apart.items() if told["name"].endswith(f"({key})")), None)
        if own is None:
            return {}
        return {
            "success": own.goals(),
            "outcomes": Counter(one.outcome for one in own.raw.valid),
            "invalid": len(own.raw.records) - len(own.raw.valid),
            "valid_count": len(own.raw.valid),
            "metrics": [own._metric(one["name"]) for one in told["metrics"]],
            **own._causes_and_goals(told),
        }

    def _metric(self, name: str) -> dict[str, float]:
        values = [value for one in self.raw.valid if (value := metric(one, name)) is not None]
        if not values:
            return {}
        spread = {"lowest": min(values), "highest": max(values)}
        return {"n": len(values), "mean": fmean(values), "median": median(values), **spread}

    def cost(self, term: str) -> dict[str, float]:
        """Return the mean cost of a term under the one configuration, its share, and the runs behind it."""
        terms = self.costs.means(self.raw.valid)
        counted = sum(one.run_id in self.raw.steps for one in self.raw.valid)
        return {"mean_weighted": terms[term], "share": terms[term] / sum(terms.values()), "runs": counted}

    def _row(self, told: Mapping[str, Any]) -> dict[str, Any]:
        one = self.records[told["run_id"]]
        excesses = {excess.name: excess for excess in one.beyond_vehicle or ()}
        return {
            "duration_s": one.metrics.duration_s if one.metrics else None,
            "minimum_distance_m": metric(one, "minimum_distance_m"),
            "contact": self._contact(one),
            "beyond_vehicle": [excesses[excess["name"]].model_dump() for excess in told["beyond_vehicle"]],
        }

    def _contact(self, record: RunRecord) -> Any:
        """Return how a collision came about, as the answer on that run has it, with its time and speed from the run."""
        told = self.contacts.get(record.run_id)
        if told is None or record.collision is None:
            return told
        return {**told, "time_s": record.collision.time_s, "ego_speed_mps": self.raw.steps[record.run_id].speed_mps[-1]}

    def _rule(self, rule: str, config_id: str) -> dict[str, Any]:
        verdicts = [(one.scenario_id, self.broken[one.run_id][rule]) for one in self.apart[config_id].raw.valid]
        asked = [(name, verdict) for name, verdict in verdicts if verdict["robustness"] is not None]
        worst = [-verdict["robustness"] for _, verdict in asked if verdict["first_s"] is not None]
        violated = _rate((name, float(verdict["first_s"] is not None)) for name, verdict in asked)
        return {"violated": violated, "worst": max(worst, default=None)}

    # ---- findings

    def _finding(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return the figures of a finding, how many runs are behind it, and its moments."""
        name, first = told["name"], self.records[told["run_ids"][0]]
        own = self if name in _OF_ALL_CONFIGURATIONS else self.apart[first.config_id]
        if name in ("stood_without_cause", "braked_without_cause"):
            figures = own._own_doing(name, self)
        elif name in ("goal_out_of_reach", "stood_late", "waited_late", "held_up"):
            figures = own._late(name)
        else:
            figures = getattr(own, f"_{name}")(told["subject"])
        suggestion = told["suggestion"] or {}
        return {
            "figures": figures,
            "run_count": figures.get("_run_count", figures.get("runs")),
            "moments": [{"time_s": self._moment(one)} for one in told["moments"]],
            "suggestion": {"value": self.weights.get(first.config_id, {}).get(suggestion.get("weight", ""))},
        }

    def _moment(self, told: Mapping[str, Any]) -> float | None:
        """Return the requested event of a run: the nearest of the known ones."""
        one, review = self.records[told["run_id"]], self.reviews.get(told["run_id"]) or {}
        known = [0.0, one.metrics.duration_s if one.metrics else 0.0]
        known += [one.collision.time_s] if one.collision else []
        known += [moment["since_s"] for moment in review.get("pace", ())]
        known += [moment["time_s"] for name in ("closest", "most_urgent") if (moment := review.get(name))]
        steps = self.raw.steps.get(one.run_id)
        if steps is not None and len(steps.x_m) > 1:
            speeds, turns = np.array(steps.speed_mps[1:]), np.diff(np.unwrap(steps.heading_rad))
            known.append((int(np.abs(speeds * turns).argmax()) + 1) * one.step_s)
        return min(known, key=lambda time_s: abs(time_s - float(told["time_s"])))

    @property
    def _hits(self) -> dict[str, float]:
        """Return the number of examined collisions: all of them."""
        return dict.fromkeys(("looked_at", "collisions"), float(len(self.of("collision"))))

    def _main_failure(self, _: str) -> dict[str, float]:
        failures = [one for one in self.raw.valid if not goal(one)]
        most = max(Counter(one.outcome for one in failures).values())
        return {"runs": most, "failures": len(failures), "valid_runs": len(self.raw.valid)}

    def _unforeseen(self, _: str) -> dict[str, float]:
        own = [contact for key, contact in self.contacts.items() if key not in self.the_others]
        known = [gap for contact in own if (gap := contact.get("predicted_gap_m")) is not None]
        apart = [gap for gap in known if gap > 0]
        return {"runs": len(apart), "of": len(known), "median_gap_m": median(apart), **self._hits}

    def _weight_off(self, weight: str) -> dict[str, float]:
        ends = _WORKS_AGAINST[weight]
        failed = [one for one in self.of(*ends) if one.run_id not in self.the_others]
        (config_id,) = self.raw.batch.configs
        values = {"weight": self.weights[config_id][weight], "default_weight": self.weights["default"][weight]}
        return {**values, "runs": len(failed), "of": len(self.raw.valid), **self._hits}

    def _weak_obstacle_cost(self, _: str) -> dict[str, float]:
        hits = [one for one in self.of("collision") if one.run_id not in self.the_others]
        shares = [share for one in hits if (share := self._obstacle_share(one)) is not None]
        low = [share for share in shares if share < 0.1]
        return {"runs": len(low), "of": len(shares), "most_share": 0.1, "median_share": median(low), **self._hits}

    def _obstacle_share(self, record: RunRecord) -> float | None:
        if record.collision is None or record.run_id not in self.raw.steps:
            return None
        terms = self.costs.terms(record, record.collision.step - round(1.0 / record.step_s))
        total = sum(terms.values())
        return sum(terms.get(name, 0.0) for name in _AGAINST_COLLISIONS) / total if total > 0 else None

    def _late(self, name: str) -> dict[str, float]:
        count = list(self.late.values()).count(name)
        return {"runs": count, "of": len(self.late), "late_runs": len(self.late), "least_share": 0.4}

    def _held_back(self, term: str) -> dict[str, float]:
        own = [one for one in self.of(*LATE) if not self.late[one.run_id]]
        return {"runs": len(own), "median_share": self.costs.median_shares(own)[term] / 100}

    def _own_doing(self, name: str, whole: "Expected") -> dict[str, float]:
        ends = (*LATE, "goal_missed", "infeasible", "collision")
        having = [one for one in self.of(*ends) if any(m["code"] in _OWN[name] for m in self.pace(one.run_id))]
        moments = [m for one in having for m in self.pace(one.run_id) if m["code"] in _OWN[name]]
        worst = max(moments, key=lambda one: one["largest_mps2"] or one["until_s"] - one["since_s"])
        all_ends = float(len(whole.of(*ends)))
        counts = {"runs": len(having), "of": len(self.of(*ends)), "looked_at": all_ends, "failures": all_ends}
        return {**counts, **{key: value for key, value in worst.items() if isinstance(value, int | float)}}

    def _rejecting_constraint(self, name: str) -> dict[str, float]:
        stuck = [one for one in self.of("infeasible") if one.rejected_candidates]
        most = [max(sorted(one.rejected_candidates), key=lambda key: one.rejected_candidates[key]) for one in stuck]
        shares = [one.rejected_candidates.get(name, 0) / sum(one.rejected_candidates.values()) for one in stuck]
        count = {"runs": most.count(name), "of": len(stuck), "_run_count": len(stuck)}
        return {**count, "median_share": median(shares)}

    def _near_misses(self, _: str) -> dict[str, float]:
        close = [one for one in self.of("goal_reached") if is_close(one)]
        near = sum(_by_ego(self.reviews[one.run_id]) for one in close)
        counts = {"runs": near, "of": len(self.of("goal_reached")), "by_others": len(close) - near}
        return {**counts, "gap_m": 0.5, "time_to_collision_s": 1.5, "looked_at": len(close), "close_runs": len(close)}

    def _uncomfortable_turns(self, _: str) -> dict[str, float]:
        values = [metric(one, "maximum_lateral_acceleration_mps2") or 0.0 for one in self.of("goal_reached")]
        counts = {"runs": sum(value > 3.0 for value in values), "of": len(values)}
        return {**counts, "limit_mps2": 3.0, "largest_mps2": max(values)}

    def _dominating_cost(self, term: str) -> dict[str, float]:
        counted = sum(one.run_id in self.raw.steps for one in self.raw.valid)
        return {"median_share": self.costs.median_shares(self.raw.valid)[term] / 100, "_run_count": counted}

    def _idle_weights(self, _: str) -> dict[str, float]:
        return {"runs": sum(one.run_id in self.raw.steps for one in self.raw.valid)}

    def _hard_scenarios(self, _: str) -> dict[str, float]:
        runs_of: dict[str, list[RunRecord]] = {}
        for one in self.raw.valid:
            runs_of.setdefault(one.scenario_id, []).append(one)
        tried = {key: runs for key, runs in runs_of.items() if len({one.config_id for one in runs}) > 1}
        failed = {key: runs for key, runs in tried.items() if not any(map(goal, runs))}
        fair = {key: runs for key, runs in failed.items() if any(one.run_id not in self.the_others for one in runs)}
        counts = {"scenarios": len(fair), "of": len(tried), "by_others": len(failed) - len(fair)}
        return {**counts, "_run_count": sum(map(len, fair.values()))}

    def _harder_group(self, name: str) -> dict[str, float]:
        goals_of: dict[str, list[bool]] = {}
        for one in self.raw.valid:
            if one.run_id not in self.the_others:
                goals_of.setdefault(one.scenario_id, []).append(goal(one))
        reached = {key for key, values in goals_of.items() if 2 * sum(values) > len(values)}
        groups: dict[str, set[str]] = {}
        for key in {one.scenario_id for one in self.raw.valid}:
            facts = self.raw.facts[key]
            for kind in (*facts.participants.counts, *[kind for kind in ROAD_KINDS if kind in facts.tags][:1]):
                groups.setdefault(kind, set()).add(key)
        p_values, tables = dict[str, float](), dict[str, list[int]]()
        for group, members in groups.items():
            inside, outside = members & goals_of.keys(), goals_of.keys() - members
            if min(len(inside), len(outside)) >= 4:
                a, b, c, d = tables[group] = [len(inside & reached), len(inside), len(outside & reached), len(outside)]
                p_values[group] = float(fisher_exact(np.array([[a, b - a], [c, d - c]]))[1])
        a, b, c, d = tables[name]
        behind = [one for one in self.raw.valid if not goal(one) and one.scenario_id in groups[name] - reached]
        counts = {"reached": a, "of": b, "reached_by_others": c, "of_others": d, "_run_count": len(behind)}
        return {**counts, "p_holm": holm(p_values)[name]}

    # ---- a comparison

    def comparison(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return the expected fields of an answer of ``compare_results`` on the two configurations."""
        pairs = Pairs(self.raw, self.raw.batch.configs)
        adjusted = pairs.adjusted(name for name in METRICS if name != "mean_total_cost")
        before, after = (self.weights[config] for config in self.raw.batch.configs)
        gained, lost = pairs.count(before=False, after=True), pairs.count(before=True, after=False)
        success = pairs.success()
        (one,) = told["comparisons"]
        return {
            "comparisons": [
                {
                    "success": {
                        **success,
                        **{key: success[key] / 100 for key in ("difference", "low", "high")},
                        "p_holm": adjusted.get("success"),
                        "pairs": len(pairs.pairs),
                        "both": pairs.count(before=True, after=True),
                        "only_before": lost,
                        "only_after": gained,
                        "neither": pairs.count(before=False, after=False),
                    },
                    "metrics": [_tested(pairs, test["name"], adjusted) for test in one["metrics"]],
                    "cost": self._uncompared(pairs),
                    "to_success": [self._flip(flip) for flip in one["to_success"]],
                    "to_success_count": gained,
                    "to_failure": [self._flip(flip) for flip in one["to_failure"]],
                    "to_failure_count": lost,
                    "weights": [
                        {"before": before.get(change["weight"]), "after": after.get(change["weight"])}
                        for change in one["weights"]
                    ],
                    "unpaired": pairs.unpaired,
                    "invalid_pairs": pairs.invalid,
                    "run_count": 2 * len(pairs.pairs),
                    "least_differing": 6,
                    "edited_count": 0,
                }
            ]
        }

    def _flip(self, told: Mapping[str, Any]) -> dict[str, Any]:
        failed = next(one for key in ("before_run", "after_run") if not goal(one := self.records[told[key]]))
        return {"contact": self._contact(failed)}

    def _uncompared(self, pairs: Pairs) -> dict[str, float]:
        """Return the median cost of each side over the valid runs of all pairs."""
        sides = zip(*pairs.pairs, strict=True)
        costs = [[cost for one in side if (cost := metric(one, "mean_total_cost")) is not None] for side in sides]
        return {key: median(side) for key, side in zip(("before", "after"), costs, strict=True) if side}


def _tested(pairs: Pairs, name: str, adjusted: Mapping[str, float]) -> dict[str, Any]:
    test = pairs.tested(name)
    if test is None:
        return {"pairs": 0, "scenarios": 0, "higher": 0, "lower": 0}
    medians = {"median_before": test["before"], "median_after": test["after"]}
    return {**test, **medians, "p_holm": adjusted.get(name)}


def _rate(trials: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return a rate as answers hold it."""
    listed = list(trials)
    found: dict[str, float] = dict(zip(("count", "of", "share", "low", "high"), rate(listed), strict=False))
    shares: dict[str, float] = {key: found[key] / 100 for key in ("share", "low", "high") if key in found}
    return {**found, **shares, "scenarios": len({name for name, _ in listed})}


def _correlated(values: Sequence[float]) -> dict[str, float]:
    return dict(zip(("rho", "p", "p_holm", "n", "rho_fixed", "p_fixed"), values, strict=False))


def _time_of(record: RunRecord | None) -> float | None:
    return None if record is None or record.collision is None else record.collision.time_s


def _by_ego(review: Mapping[str, Any]) -> bool:
    """Return True if the ego came near a road user ahead or crossing, faster than 2 m/s."""
    moments = [(review["closest"], "gap_m", 0.5), (review["most_urgent"], "time_to_collision_s", 1.5)]
    return any(
        one is not None
        and one[key] is not None
        and one[key] < below
        and one["side"] == "front"
        and one["direction"] != "oncoming"
        and one["ego_speed_mps"] > 2.0
        for one, key, below in moments
    )
