"""The work itself, for every door: generate, import, find, edit, run, analyse, compare, optimise, draw, export.

A workflow takes a typed request and a :class:`~plannerforge.workflows.context.WorkflowContext`, uses the engine and the
workers, stores what it makes, and returns a typed result. It knows nothing of MCP; tools, commands and Python code call
the same functions.
"""
