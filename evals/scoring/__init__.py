"""Scorers: an attempt at a request, judged by what stands in the workspace, in the columns of the paper's tables."""
