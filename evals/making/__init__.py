"""Corpora from what a workspace holds: requests in several styles, with ground truth by code."""
