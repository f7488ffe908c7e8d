"""All engine operations that tools run in workers: entry point, request, response, time limit.

The table gives type checkers the types between the server's process and its workers: ``call.run(OPERATION, request)``
accepts only the operation's request and returns its response. Entry points are strings because the server's process
must not import them. A test resolves each one and compares its signature.

Time limits are generous (our choice), because they only have to end operations that hang. If a client waits for the
answer, the limit is 50 s.
"""

from ..engine.execution import Operation
from ..schemas.analysis.comparison import CompareRequest, CompareResultsResult
from ..schemas.analysis.optimization import (
    DesignRequest,
    Effects,
    EffectsRequest,
    Gain,
    GainRequest,
    Proposals,
    ProposeRequest,
)
from ..schemas.artifacts import (
    FileWritten,
    ForeignExport,
    ForeignExportRequest,
    RunTableRequest,
    SolutionRequest,
    StepTableRequest,
    SuccessRates,
    SuccessRequest,
)
from ..schemas.boundaries import DescribeLogicalRequest, DrawRoadRequest, PointsRequest, PointsResponse, RoadDrawn
from ..schemas.catalog import BuildIndexRequest, BuildIndexResponse, RankRequest, RankResponse
from ..schemas.exploration import LogicalScenario
from ..schemas.failures import (
    EvaluatedPoints,
    ProposalsRequest,
    ProposedPoints,
    SearchSpace,
    ShrinkRequest,
    Shrunk,
    SpacePointsRequest,
    SpaceRequest,
)
from ..schemas.generation import (
    ConvertedMap,
    ConvertMapRequest,
    CoverageReport,
    CoverageRequest,
    CutExtractRequest,
    CutOfExtract,
    FetchedMaps,
    FetchMapRequest,
    GeneratedScenario,
    GenerationRequest,
    IndexedExtract,
    IndexExtractRequest,
    MapFacts,
    ReadMapRequest,
    SiteCount,
)
from ..schemas.maps import LocatedPlace, LocateRequest
from ..schemas.modification import ModificationOutcome, ModificationRequest
from ..schemas.odd import OddCoverage, OddRequest
from ..schemas.planning import Replayed, ReplayRequest, RunRequest, RunResponse
from ..schemas.rendering import Rendered, RenderRequest, ReportRequest, ReportWritten, ViewRequest, ViewWritten
from ..schemas.results import AnalyseRequest, AnalyzeResultsResult
from ..schemas.reviews import LooksResponse, ReviewResponse
from ..schemas.runs import ReviewRequest
from ..schemas.scenarios import DescribeRequest, Description, ReadFactsRequest, ScenarioFacts

# Scenarios
READ_FACTS = Operation("plannerforge.engine.scenarios:read_facts", ReadFactsRequest, ScenarioFacts, timeout_s=60.0)
DESCRIBE_SCENARIO = Operation("plannerforge.engine.scenarios:describe", DescribeRequest, Description)
APPLY_EDITS = Operation(
    "plannerforge.engine.edits:apply_edits", ModificationRequest, ModificationOutcome, timeout_s=120.0
)
JUDGE_ODD = Operation("plannerforge.engine.catalog:judge_odd", OddRequest, OddCoverage, timeout_s=50.0)

# Maps and generation
CONVERT_MAP = Operation("plannerforge.engine.maps:write_as_xml", ConvertMapRequest, ConvertedMap, timeout_s=120.0)
CONVERT_ROADS = Operation("plannerforge.engine.maps:convert_roads", ConvertMapRequest, ConvertedMap, timeout_s=180.0)
INDEX_EXTRACT = Operation(
    "plannerforge.engine.maps:index_extract", IndexExtractRequest, IndexedExtract, timeout_s=43_200.0
)
CUT_EXTRACT = Operation("plannerforge.engine.maps:cut_extract", CutExtractRequest, CutOfExtract, timeout_s=50.0)
READ_MAP = Operation("plannerforge.engine.maps:read_map", ReadMapRequest, MapFacts, timeout_s=120.0)
LOCATE_PLACE = Operation("plannerforge.engine.maps:locate_place", LocateRequest, LocatedPlace, timeout_s=180.0)
FETCH_MAPS = Operation("plannerforge.engine.maps:fetch_maps", FetchMapRequest, FetchedMaps, timeout_s=400.0)
COUNT_SITES = Operation("plannerforge.engine.generation:count_sites", GenerationRequest, SiteCount, timeout_s=180.0)
GENERATE_SCENARIO = Operation(
    "plannerforge.engine.generation:generate_scenario",
    GenerationRequest,
    GeneratedScenario,
    timeout_s=180.0,
    reads=("map_path",),
    writes="folder",
)
PLAN_COVERAGE = Operation(
    "plannerforge.engine.generation:plan_coverage", CoverageRequest, CoverageReport, timeout_s=120.0
)

# Text search, in the one process that holds the embedding model; the first request loads it and builds the index
BUILD_INDEX = Operation(
    "plannerforge.engine.catalog:build_index", BuildIndexRequest, BuildIndexResponse, timeout_s=120.0, lane="retrieval"
)
RANK = Operation("plannerforge.engine.catalog:rank", RankRequest, RankResponse, timeout_s=120.0, lane="retrieval")

# Runs and their pictures
RUN_PLANNER = Operation(
    "plannerforge.engine.planners:run_planner", RunRequest, RunResponse, timeout_s=120.0, reads=("scenario_path",)
)
WRITE_SOLUTION = Operation("plannerforge.engine.planners:write_solution", SolutionRequest, FileWritten)
WRITE_RUN_TABLE = Operation(
    "plannerforge.engine.analysis:write_run_table", RunTableRequest, FileWritten, timeout_s=1800.0
)
WRITE_STEP_TABLE = Operation("plannerforge.engine.analysis:write_step_table", StepTableRequest, FileWritten)
ANALYSE = Operation("plannerforge.engine.analysis:analyse", AnalyseRequest, AnalyzeResultsResult, timeout_s=50.0)
SUCCESS_RATES = Operation("plannerforge.engine.analysis:success_rates", SuccessRequest, SuccessRates, timeout_s=50.0)
REVIEW_RUNS = Operation("plannerforge.engine.analysis:review_runs", ReviewRequest, ReviewResponse, timeout_s=50.0)
LOOK_AT_RUNS = Operation("plannerforge.engine.analysis:look_at_runs", ReviewRequest, LooksResponse, timeout_s=50.0)
COMPARE = Operation("plannerforge.engine.analysis:compare", CompareRequest, CompareResultsResult, timeout_s=50.0)

# Searches for configurations
PROPOSE = Operation("plannerforge.engine.tuning:propose", ProposeRequest, Proposals, timeout_s=600.0)
JUDGE_GAIN = Operation("plannerforge.engine.tuning:judge_gain", GainRequest, Gain)
SENSITIVITY_DESIGN = Operation(
    "plannerforge.engine.tuning:sensitivity_design", DesignRequest, Proposals, timeout_s=120.0
)
SENSITIVITY_EFFECTS = Operation(
    "plannerforge.engine.tuning:sensitivity_effects", EffectsRequest, Effects, timeout_s=120.0
)

# Searches for failures
OPEN_SPACE = Operation("plannerforge.engine.exploration:open_space", SpaceRequest, SearchSpace, timeout_s=300.0)
PROPOSE_POINTS = Operation("plannerforge.engine.exploration:propose_points", ProposalsRequest, ProposedPoints)
EVALUATE_IN_SPACE = Operation(
    "plannerforge.engine.exploration:evaluate_in_space", SpacePointsRequest, EvaluatedPoints, timeout_s=600.0
)
SHRINK_FAILURE = Operation("plannerforge.engine.exploration:shrink_failure", ShrinkRequest, Shrunk, timeout_s=600.0)

# Explorations
READ_LOGICAL_SCENARIO = Operation(
    "plannerforge.engine.exploration:read_logical_scenario", DescribeLogicalRequest, LogicalScenario
)
DRAW_ROAD = Operation("plannerforge.engine.exploration:draw_road", DrawRoadRequest, RoadDrawn)
EVALUATE_POINTS = Operation(
    "plannerforge.engine.exploration:evaluate_points", PointsRequest, PointsResponse, timeout_s=600.0, reads=("xml",)
)

# Pictures and pages
RENDER = Operation("plannerforge.engine.rendering:render", RenderRequest, Rendered, timeout_s=50.0)
WRITE_REPORT = Operation("plannerforge.engine.rendering:write_report", ReportRequest, ReportWritten)

REPLAY_PLANS = Operation("plannerforge.engine.planners.runs:replay_plans", ReplayRequest, Replayed, timeout_s=120.0)
WRITE_VIEW = Operation("plannerforge.engine.rendering:write_view", ViewRequest, ViewWritten, timeout_s=120.0)

# Scenarios for other tools
WRITE_OPENDRIVE = Operation("plannerforge.engine.scenarios:write_opendrive", ForeignExportRequest, ForeignExport)
WRITE_OPENSCENARIO = Operation("plannerforge.engine.scenarios:write_openscenario", ForeignExportRequest, ForeignExport)
