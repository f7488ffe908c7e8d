"""Scorers: judge an attempt at a request by the content of the workspace, in the columns of the paper's tables."""
