"""Configurations of planners: what can be set in each, presets, changes, and the files that hold them.

``DEFAULT_CONFIGURATION``: The name of the configuration in force while none is named.
``changed_configuration``: A base with a preset's weights (where one is named) and changes, and remarks on them.
``from_file``: The configuration of a weight file, which keeps the file's comments, order and layout.
``differences``: The weights and settings in which two configurations of a planner differ, in their order.
``named_configuration``: The configuration that ``PLANNER:PRESET`` or ``PLANNER`` means; None for other texts.
``preset_configuration``: The configuration of a preset as it stands, with the default settings.
``Objective``: A measure that a search raises, with its weight in a sum.
``parse_objective``: The objective that a text such as ``comfort*0.2`` means.
``Constraint``: A bound on the mean of a measure.
``parse_constraint``: The constraint that a text such as ``success>=base`` means.
``Dimension``: A weight or setting that a search varies.
``dimensions``: What a search varies, from the words of a call.
``values_at``: The values at a point of the space of a search.
``point_of``: The point of a configuration in the space of a search.
``propose``: an operation: the next points of a search.
``judge_gain``: an operation: a mean difference over scenarios with its interval.
``fewest_configurations``: How many configurations the smallest design of a sensitivity analysis drives.
``sensitivity_design``: an operation: the points at which a sensitivity analysis looks.
``sensitivity_effects``: an operation: which weights matter, from the objective at these points.
``known_settings``: All settings by name, in their order.
``setting_values``: Every setting with the value in force, in their order.
``PlannerTuning``: What can be set in one planner: weights, presets, and settings that do nothing in it.
``tuning_of``: The tuning of a planner by its name.
``read_weight_file``: What a cost-weight file holds; ``UnsafeInput`` where it is not of that form.
``read_yaml``: A YAML file as mappings, lists and texts; ``UnsafeInput`` where it is hostile.
``to_yaml``: A configuration as the text of a cost-weight file.
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
