"""Requests with their ground truth: what a corpus asks for, as calls and as what must come out."""
