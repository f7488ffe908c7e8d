"""Whether the first suggestion of a refusal, followed literally, succeeds: refusals that are drawn over all tools."""
