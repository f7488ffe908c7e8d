"""MCP prompts: complete tasks with blanks to fill in, and each task of the paper with its five conditions."""
