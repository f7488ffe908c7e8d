"""MCP prompts: requests in plain words that a person picks and fills in."""
