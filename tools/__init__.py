"""The tools: validated arguments in, one call of the engine, a shaped answer out. No domain logic."""
