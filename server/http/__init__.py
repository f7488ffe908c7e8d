"""MCP over HTTP: access control, limits, and the server itself."""
