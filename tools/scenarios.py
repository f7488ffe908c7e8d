"""The scenario tools: describe the catalogue, generate, find, describe, edit."""

from ..schemas.catalog import (
    DescribeCatalogArguments,
    DescribeCatalogResult,
    FindScenariosArguments,
    FindScenariosResult,
)
from ..schemas.generation import GenerateScenariosArguments, GenerateScenariosResult
from ..schemas.modification import ModifyScenarioArguments, ModifyScenarioResult
from ..schemas.scenarios import DescribeScenarioArguments, DescribeScenarioResult
from ..workflows import catalog, critical_scenarios, modification, scenarios
from ..workflows.generation import generate
from .call import ToolCall


async def describe_catalog(arguments: DescribeCatalogArguments, call: ToolCall) -> DescribeCatalogResult:
    """Return the content of the catalogue, and the words to search it with."""
    return await catalog.describe_catalog(arguments, call)


async def find_scenarios(arguments: FindScenariosArguments, call: ToolCall) -> FindScenariosResult:
    """Return the scenarios that meet the conditions, best first."""
    return await catalog.find_scenarios(arguments, call)


async def generate_scenarios(arguments: GenerateScenariosArguments, call: ToolCall) -> GenerateScenariosResult:
    """Generate scenarios from maps; a view shows the first."""
    # The usual request, which is most of them, enters none of the search's modules.
    is_usual = arguments.criticality == "usual"
    make = generate.generate_scenarios if is_usual else critical_scenarios.generate_scenarios
    result = await make(arguments, call)
    if result.plan is None:
        call.shows(*(one.scenario_id for one in result.scenarios[:1]))
    return result


async def check_generation(arguments: GenerateScenariosArguments, call: ToolCall) -> None:
    """Refuse a call of ``generate_scenarios`` that could make no scenario, without making one."""
    await generate.check_generation(arguments, call)


async def describe_scenario(arguments: DescribeScenarioArguments, call: ToolCall) -> DescribeScenarioResult:
    """Describe a scenario in words and ids."""
    result = await scenarios.describe_scenario(arguments, call)
    call.shows(result.scenario_id)
    return result


async def modify_scenario(arguments: ModifyScenarioArguments, call: ToolCall) -> ModifyScenarioResult:
    """Store a scenario with edits; a view shows it next to its original."""
    result = await modification.modify_scenario(arguments, call)
    if result.scenario_id is not None:
        call.shows(result.base_id, result.scenario_id)
    return result
