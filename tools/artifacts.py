"""The tool that lists what was made."""

from ..engine.workspace import Artifact
from ..resources.templates import SCHEME
from ..schemas.artifacts import ListArtifactsArguments, ListArtifactsResult, ListedArtifact
from .call import ToolCall


async def list_artifacts(arguments: ListArtifactsArguments, call: ToolCall) -> ListArtifactsResult:
    """Artifacts or jobs, newest first."""
    if arguments.kind == "job":
        return _jobs(arguments, call)
    artifacts = call.workspace.newest(
        kind=arguments.kind,
        parent=arguments.parent,
        text=arguments.text,
        limit=arguments.limit + 1,
        offset=arguments.offset,
    )
    listed = tuple(_listed(artifact) for artifact in artifacts[: arguments.limit])
    return ListArtifactsResult(artifacts=listed, more=len(artifacts) > arguments.limit)


def _listed(artifact: Artifact) -> ListedArtifact:
    return ListedArtifact(
        artifact_id=artifact.artifact_id,
        kind=artifact.kind,
        name=artifact.name,
        made_by=artifact.recipe.tool,
        parents=artifact.recipe.parents,
        made_at=artifact.made_at,
        uri=f"{SCHEME}{artifact.kind}/{artifact.artifact_id}/record",
    )


def _jobs(arguments: ListArtifactsArguments, call: ToolCall) -> ListArtifactsResult:
    jobs = call.jobs.store.newest(arguments.limit + 1, arguments.offset)
    listed = tuple(
        ListedArtifact(
            artifact_id=job.job_id,
            kind="job",
            name=f"{job.state}, {job.share:.0%}",
            made_by=job.recipe.tool,
            parents=job.recipe.parents,
            made_at="",
            uri="",
        )
        for job in jobs[: arguments.limit]
    )
    return ListArtifactsResult(artifacts=listed, more=len(jobs) > arguments.limit)
