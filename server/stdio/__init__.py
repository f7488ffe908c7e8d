"""MCP over standard input and output: the streams, and messages on them that cannot be read."""
