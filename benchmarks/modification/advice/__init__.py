"""Checks that the first suggestion of a refusal succeeds if a client follows it literally, over all tools."""
