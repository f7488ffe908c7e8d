"""Robustness: hostile inputs over all tools and file kinds against a real server over stdio, and what they do to it."""
