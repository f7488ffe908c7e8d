"""PlannerForge MCP: scenario-based testing of motion planners behind one MCP server.

The checkout itself is the package: its folders import each other by relative paths, which editors, linters and import
graphs follow from file to file. The folder ``plannerforge/`` holds links to them and to this file and gives the package
its name for whoever imports it. Importing this package loads nothing else.
"""

__version__ = "0.1.0"
