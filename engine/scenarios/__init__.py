"""Facts and descriptions of a scenario, and its export to the formats of other tools.

``Manoeuvre``: what a road user does on the ego's path, and when.
``manoeuvres_met``: returns what road users would do on the path of an ego with its own planning problem.
``read_facts``: the operation that returns the facts of one CommonRoad file, for the catalogue.
``describe``: the operation that returns the ego, vehicles and lanelets near the focus of a scenario.
``write_opendrive``: the operation that writes the lanelets of a scenario as OpenDRIVE, and returns losses and
deviations.
``write_openscenario``: the operation that writes the recording of a scenario as OpenSCENARIO XML, and returns losses.
``OPENLABEL_ENDING``: the ending of files with the tags of a scenario.
``read_openlabel``: returns the tags of an OpenLABEL file as CommonRoad's tags.
``with_tags``: returns the content of a CommonRoad file with additional tags.
``write_openlabel``: writes the tags of a scenario as OpenLABEL.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .description import describe
    from .exchange.opendrive import write_opendrive
    from .exchange.openlabel import OPENLABEL_ENDING, read_openlabel, with_tags, write_openlabel
    from .exchange.openscenario import write_openscenario
    from .facts import manoeuvres_met, read_facts
    from .manoeuvres import Manoeuvre

__getattr__, __dir__ = lazy_face(__name__, __file__)
