"""Planner runs: success and cost of the loop, and one bench each for traffic, terms, weights and routes."""
