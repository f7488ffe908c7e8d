"""The tools of MCP: validated arguments in, one workflow, a shaped answer out. No domain logic."""
