"""Configurations of planners: what can be set in each, presets, changes, and the files that hold them.

``DEFAULT_CONFIGURATION``: The name of the configuration in force while none is named.
``changed_configuration``: A base with a preset's weights (where one is named) and changes, and remarks on them.
``from_file``: The configuration of a weight file, which keeps the file's comments, order and layout.
``differences``: The weights and settings in which two configurations of a planner differ, in their order.
``named_configuration``: The configuration that ``PLANNER:PRESET`` or ``PLANNER`` means; None for other texts.
``preset_configuration``: The configuration of a preset as it stands, with the default settings.
``Setting``: One setting: its unit, range and meaning.
``known_settings``: All settings by name, in their order.
``setting_values``: Every setting with the value in force, in their order.
``PlannerTuning``: What can be set in one planner: weights, presets, and settings that do nothing in it.
``tuning_of``: The tuning of a planner by its name.
``WeightFile``: The planner of a weight file, and its weights and settings as assignments.
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
    from .settings import Setting, known_settings, setting_values
    from .tunings import PlannerTuning, tuning_of
    from .weight_file import WeightFile, read_weight_file, read_yaml, to_yaml

__getattr__, __dir__ = lazy_face(__name__, __file__)
