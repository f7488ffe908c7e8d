"""MCP prompts: whole tasks to fill in, and each task of the paper with its five conditions."""
