"""PlannerForge MCP: scenario-based testing of motion planners behind one MCP server.

The folders beside this file are links to the top-level packages, so that type checkers and import
linters see the same tree that a wheel installs. Importing this package loads nothing else.
"""

__version__ = "0.1.0"
