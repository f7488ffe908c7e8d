"""How work grows with its input: processor time on inputs that are doubled, and the exponent of its growth."""
