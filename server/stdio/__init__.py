"""MCP over standard input and output: the streams, and unreadable messages on them."""
