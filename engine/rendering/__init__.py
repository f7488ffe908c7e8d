"""Pictures, animations, charts and the report of scenarios and runs."""
