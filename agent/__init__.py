"""Clients of the server that are part of this package: the agent, its chat, and the demo."""
