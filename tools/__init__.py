"""The tools of MCP: validate the arguments, run one workflow, shape the answer. No domain logic."""
