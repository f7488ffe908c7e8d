"""The lowest layer: Pydantic models of all inputs and outputs, the errors, and the grammar of arguments."""
