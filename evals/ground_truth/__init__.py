"""Requests with their ground truth: the content of a corpus, as calls and as expected results."""
