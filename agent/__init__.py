"""Clients of the server that come with it: the demo."""
