"""Pydantic models of every input and output, the errors and the small grammar: the lowest layer."""
