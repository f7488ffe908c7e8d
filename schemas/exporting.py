"""What a worker is asked to write for an export, beside pictures."""

from typing import Literal

from pydantic import Field

from plannerforge.schemas.base import Model
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.runs import LostCell, RunRecord

CostFunctionId = Literal["JB1", "SA1", "WX1", "SM1", "SM2", "SM3", "MW1", "TR1", "TR2"]


class SolutionRequest(Model):
    """A run that is to be written as a CommonRoad solution file."""

    record: RunRecord
    configuration: PlannerConfiguration
    scenario_path: str
    steps_path: str
    target_path: str
    cost_function: CostFunctionId = Field("SM1", description="CommonRoad cost function that the file is entered for")


class RunTableRequest(Model):
    """The cells of a batch that are to be written as a table."""

    records: tuple[RunRecord, ...]
    lost: tuple[LostCell, ...]
    configurations: tuple[PlannerConfiguration, ...]
    form: Literal["csv", "parquet"]
    target_path: str


class FileWritten(Model):
    """The file that a worker wrote."""

    path: str
