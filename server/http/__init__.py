"""MCP over HTTP: who may come in, how much at once, and the server itself."""
