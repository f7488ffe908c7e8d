"""MCP resources: read the files of artifacts."""
