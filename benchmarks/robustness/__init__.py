"""Robustness: the effect of hostile inputs over all tools and file kinds on a real server over stdio."""
