"""MCP prompts: whole tasks to pick and fill in, and each task of the paper under its five conditions."""
