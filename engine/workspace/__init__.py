"""The workspace: immutable artifacts with their recipes, jobs, and the files behind them, in one folder."""
