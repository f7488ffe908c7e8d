"""The work itself, for every interface: generate, import, find, edit, run, analyse, compare, optimise, draw, export.

A workflow takes a typed request and a :class:`~plannerforge.workflows.context.WorkflowContext`, uses the engine and the
workers, stores its artifacts, and returns a typed result. It does not depend on MCP. Tools, commands and Python code
call the same functions.
"""
