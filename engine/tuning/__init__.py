"""Configurations of planners: weights, presets, settings.

``DEFAULT_CONFIGURATION``: TODO.
``PlannerTuning``: Weights by name in their order.
``changed_configuration``: A base with all weights replaced by a preset's (where one is named), then changed.
``differences``: The weights and settings in which two configurations of a planner differ, in their order.
``named_configuration``: The configuration that ``PLANNER:PRESET`` or ``PLANNER`` (its Default) means.
``preset_configuration``: The configuration of a preset as it stands, with the default settings.
``to_yaml``: The cost-weight file in the form of the Frenetix reference, every weight in its order.
``tuning_of``: What can be set in a planner.
``frenetix_tuning``: The tuning of Frenetix.
``idm_tuning``: The tuning of the Intelligent Driver Model.
``known_settings``: All settings by name, in their order.
``setting_values``: Every setting with the value in force, in their order.
``read_weight_file``: What a file holds.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .configurations import DEFAULT_CONFIGURATION as DEFAULT_CONFIGURATION
    from .configurations import PlannerTuning as PlannerTuning
    from .configurations import changed_configuration as changed_configuration
    from .configurations import differences as differences
    from .configurations import named_configuration as named_configuration
    from .configurations import preset_configuration as preset_configuration
    from .configurations import to_yaml as to_yaml
    from .configurations import tuning_of as tuning_of
    from .planners import frenetix_tuning as frenetix_tuning
    from .planners import idm_tuning as idm_tuning
    from .settings import known_settings as known_settings
    from .settings import setting_values as setting_values
    from .weight_file import read_weight_file as read_weight_file

__getattr__, __dir__ = lazy_face(__name__, __file__)
