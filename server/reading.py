"""The protocol side of resources: lists in pages, reading, completion and subscription.

Content that a tool already answers (the catalogue, maps, planners) is read through that tool, so that a resource never
contradicts it.
"""

import json
import re
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from mcp import MCPError
from mcp.server.context import ServerRequestContext
from mcp.server.lowlevel import Server
from mcp.types import (
    INTERNAL_ERROR,
    INVALID_PARAMS,
    CompleteRequestParams,
    CompleteResult,
    Completion,
    EmptyResult,
    ListResourcesResult,
    ListResourceTemplatesResult,
    PaginatedRequestParams,
    PromptReference,
    Resource,
    ResourceTemplate,
    SubscribeRequestParams,
    UnsubscribeRequestParams,
)

from ..engine.execution import CallThreads
from ..engine.workspace import Workspace
from ..prompts.catalog import completions
from ..resources.apps import VIEW_TEMPLATE, completed_views, viewed_ids
from ..resources.templates import (
    SCHEME,
    TEMPLATES,
    listed_resources,
    read_resource,
    resource_completions,
    unknown_resource,
)
from ..schemas.errors import InvalidRequest, PlannerForgeError
from ..schemas.text import quoted
from ..tools.call import ToolCall
from ..tools.registry import TOOLS, ToolSpec
from ..workflows.context import Services, WorkflowContext
from .clients import client_of
from .news import WorkspaceNews
from .tool_calls import answer, answer_text
from .tool_schema import described_tool

PAGE = 50
"""Entries per page of any list; chosen so that hosts that read only the first page see what matters."""
_MOST_COMPLETIONS = 100
"""The protocol's limit of values of one completion."""
_JSON = "application/json"
_BY_TOOLS: dict[str, tuple[str, dict[str, Any], str, str]] = {
    "catalog": ("describe_catalog", {}, "Catalogue", "what scenarios there are, with counts"),
    "maps": (
        "describe_catalog",
        {"facet": "maps"},
        "Maps",
        "the available maps, with the sites that can be cut from them",
    ),
    "planners": ("list_planners", {}, "Planners", "planners with their weights, settings and presets"),
}
_Found = TypeVar("_Found")
_SCHEMA = f"{SCHEME}schema/"
_SCHEMA_TEMPLATE = ResourceTemplate(
    uri_template=f"{_SCHEMA}{{tool}}",
    name="schema",
    title="Schema",
    description="Arguments and answer of a tool as JSON Schema",
    mime_type=_JSON,
)


class ResourceReading:
    """Answers the protocol's requests about resources, in the threads of calls.

    Args:
        tools: the server's tools, for their schemas.
        threads: where files and the database are read.
        news: notifies subscribers of changes.
    """

    def __init__(self, tools: tuple[ToolSpec, ...], threads: CallThreads, news: WorkspaceNews) -> None:
        self._tools = {spec.name: spec for spec in tools}
        self._threads, self._news = threads, news

    def serve_on(self, protocol: Server[Services]) -> None:
        """Take over requests that the SDK handles differently, or not at all."""
        protocol.add_request_handler("resources/list", PaginatedRequestParams, self._list)
        protocol.add_request_handler("resources/templates/list", PaginatedRequestParams, self._list_templates)
        protocol.add_request_handler("resources/subscribe", SubscribeRequestParams, self._subscribe)
        protocol.add_request_handler("resources/unsubscribe", UnsubscribeRequestParams, self._unsubscribe)
        protocol.add_request_handler("completion/complete", CompleteRequestParams, self._complete)

    def templates(self) -> list[ResourceTemplate]:
        """Return the URI templates of everything that tools link to."""
        return [*TEMPLATES, _SCHEMA_TEMPLATE, VIEW_TEMPLATE]

    async def read(self, uri: str, services: Services) -> tuple[str | bytes, str]:
        """Return the content and media type of a URI.

        Raises:
            MCPError: it does not exist (-32602); the error lists the templates.
        """

        async def look() -> tuple[str | bytes, str]:
            if (name := uri.removeprefix(SCHEME)) in _BY_TOOLS and uri.startswith(SCHEME):
                return await _answer_of_tool(name, services), _JSON
            if uri.startswith(_SCHEMA):
                return self._schema(uri), _JSON
            if viewed := viewed_ids(uri):
                return await _view_data(viewed, services), _JSON
            return read_resource(uri, services.workspace)

        return await self._done(look)

    async def _list(
        self, context: ServerRequestContext[Services], request: PaginatedRequestParams
    ) -> ListResourcesResult:
        workspace = context.lifespan_context.workspace

        async def look() -> ListResourcesResult:
            by_tools = [
                Resource(uri=SCHEME + name, name=name, title=title, description=description, mime_type=_JSON)
                for name, (_, _, title, description) in _BY_TOOLS.items()
            ]
            entries = [*by_tools, *listed_resources(workspace), *map(self._schema_link, self._tools)]
            page, following = page_of(entries, request.cursor, PAGE)
            return ListResourcesResult(resources=page, next_cursor=following)

        return await self._done(look)

    async def _list_templates(
        self, context: ServerRequestContext[Services], request: PaginatedRequestParams
    ) -> ListResourceTemplatesResult:
        del context

        async def look() -> ListResourceTemplatesResult:
            page, following = page_of(self.templates(), request.cursor, PAGE)
            return ListResourceTemplatesResult(resource_templates=page, next_cursor=following)

        return await self._done(look)

    async def _subscribe(self, context: ServerRequestContext[Services], request: SubscribeRequestParams) -> EmptyResult:
        """Notify this session of changes to a resource, in the protocol revisions that have sessions."""
        await self.read(request.uri, context.lifespan_context)
        self._news.follow(client_of(context).key, request.uri, context.session)
        return EmptyResult()

    async def _unsubscribe(
        self, context: ServerRequestContext[Services], request: UnsubscribeRequestParams
    ) -> EmptyResult:
        self._news.forget(client_of(context).key, request.uri)
        return EmptyResult()

    async def _complete(
        self, context: ServerRequestContext[Services], request: CompleteRequestParams
    ) -> CompleteResult:
        """Return the values of a prompt's or a resource template's argument that begin with the typed text."""
        reference, argument = request.ref, request.argument
        given = (request.context.arguments if request.context is not None else None) or {}
        workspace = context.lifespan_context.workspace

        async def look() -> list[str]:
            if isinstance(reference, PromptReference):
                return completions(reference.name, argument.name, argument.value, workspace)
            return self._completed(reference.uri, argument.name, argument.value, given, workspace)

        found = await self._done(look)
        more = len(found) > _MOST_COMPLETIONS
        return CompleteResult(completion=Completion(values=found[:_MOST_COMPLETIONS], total=len(found), has_more=more))

    def _completed(
        self, template: str, argument: str, typed: str, given: dict[str, str], workspace: Workspace
    ) -> list[str]:
        if (template, argument) == (_SCHEMA_TEMPLATE.uri_template, "tool"):
            return [name for name in self._tools if name.startswith(typed.casefold())]
        if (template, argument) == (VIEW_TEMPLATE.uri_template, "ids"):
            return completed_views(typed, workspace)
        return resource_completions(template, argument, typed, given, workspace)

    @staticmethod
    def _schema_link(tool: str) -> Resource:
        return Resource(
            uri=_SCHEMA + tool,
            name=f"schema of {tool}",
            title=f"Schema of {tool}",
            description=_SCHEMA_TEMPLATE.description,
            mime_type=_JSON,
        )

    def _schema(self, uri: str) -> str:
        spec = self._tools.get(uri.removeprefix(_SCHEMA))
        if spec is None:
            raise unknown_resource(uri)
        tool = described_tool(spec)
        shown = {
            "name": tool.name,
            "description": tool.description,
            "arguments": tool.input_schema,
            "answer": tool.output_schema,
        }
        return json.dumps(shown, indent=1, ensure_ascii=False)

    async def _done(self, look: Callable[[], Awaitable[_Found]]) -> _Found:
        """Run a query of the workspace in its own thread.

        Raises:
            MCPError: the query was refused; the error has the text of the refusal (-32602).
        """
        try:
            return await self._threads.run(look)
        except PlannerForgeError as error:
            raise MCPError(INVALID_PARAMS, error.text) from error


def page_of(entries: list[_Found], cursor: str | None, size: int) -> tuple[list[_Found], str | None]:
    """Return one page of a list, and the cursor of the next page; None after the last page.

    Raises:
        InvalidRequest: the cursor is not from this list.
    """
    match = re.fullmatch(r"from-(\d{1,9})", cursor) if cursor else None
    if cursor and (match is None or int(match[1]) >= max(len(entries), 1)):
        raise InvalidRequest(f"{quoted(cursor)} is not a cursor of this list", next_step="start without a cursor")
    start = int(match[1]) if match else 0
    more = start + size < len(entries)
    return entries[start : start + size], f"from-{start + size}" if more else None


async def _answer_of_tool(name: str, services: Services) -> str:
    """Return the structured answer of a tool, as JSON."""
    tool, arguments, _, _ = _BY_TOOLS[name]
    spec = next(spec for spec in TOOLS if spec.name == tool)
    result = await answer(spec, arguments, ToolCall(services))
    if result.is_error:
        raise MCPError(INTERNAL_ERROR, answer_text(result))
    return json.dumps(result.structured_content, indent=1, ensure_ascii=False)


async def _view_data(ids: list[str], services: Services) -> str:
    """Return the data of a view; a board requests its runs one by one. The import is inside the function so that the
    first answers are fast.
    """
    from ..workflows.rendering import make_view

    return (await make_view(ids, WorkflowContext(services), whole=False)).data
