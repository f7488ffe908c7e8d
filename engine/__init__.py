"""The domain library: maps, networks, traffic, scenarios, planners, results. It knows nothing of MCP."""
