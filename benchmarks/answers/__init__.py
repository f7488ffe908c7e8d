"""Checks that the tools understand requests and answer them truthfully."""
