"""MCP resources: where the files of artifacts can be read."""
