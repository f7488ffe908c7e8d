"""Configurations of planners: the available weights and settings, presets, changes, and their files.

``DEFAULT_CONFIGURATION``: The configuration that applies by default.
``changed_configuration``: Applies a preset's weights (if given) and changes to a base; returns the result and remarks.
``from_file``: Returns the configuration of a weight file, which keeps the file's comments, order and layout.
``differences``: Returns the weights and settings in which two configurations of a planner differ, in order.
``named_configuration``: Resolves ``PLANNER:PRESET`` or ``PLANNER`` to a configuration; None for other texts.
``preset_configuration``: Returns the unchanged configuration of a preset, with the default settings.
``Objective``: A measure that a search maximises, with its weight in a sum.
``parse_objective``: Parses an objective such as ``comfort*0.2``.
``Constraint``: A bound on the mean of a measure.
``parse_constraint``: Parses a constraint such as ``success>=base``.
``Dimension``: A weight or setting that a search varies.
``dimensions``: Returns the dimensions of a search from the texts of a call.
``values_at``: Returns the values at a point of a search space.
``point_of``: Returns the point of a configuration in a search space.
``propose``: An operation that returns the next points of a search.
``judge_gain``: An operation that returns the mean difference over scenarios, with its interval.
``fewest_configurations``: Returns the number of configurations in the smallest design of a sensitivity analysis.
``sensitivity_design``: An operation that returns the points of a sensitivity analysis.
``sensitivity_effects``: An operation that finds the weights that matter, from the objective at these points.
``known_settings``: Returns all settings by name, in order.
``setting_values``: Returns every setting with its effective value, in order.
``PlannerTuning``: The options of one planner: weights, presets, and settings without effect.
``tuning_of``: Returns the tuning of a planner by its name.
``read_weight_file``: Reads a cost-weight file; raises ``UnsafeInput`` if it has another form.
``read_yaml``: Reads a YAML file as mappings, lists and texts; raises ``UnsafeInput`` if it is hostile.
``to_yaml``: Returns a configuration as the text of a cost-weight file.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .configurations import (
        DEFAULT_CONFIGURATION,
        changed_configuration,
        differences,
        from_file,
        named_configuration,
        preset_configuration,
    )
    from .objectives import Constraint, Objective, parse_constraint, parse_objective
    from .search import Dimension, dimensions, judge_gain, point_of, propose, values_at
    from .sensitivity import fewest_configurations, sensitivity_design, sensitivity_effects
    from .settings import known_settings, setting_values
    from .tunings import PlannerTuning, tuning_of
    from .weight_file import read_weight_file, read_yaml, to_yaml

__getattr__, __dir__ = lazy_face(__name__, __file__)
