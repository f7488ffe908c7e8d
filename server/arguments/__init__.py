"""The arguments of a call: read as what they can only mean, checked, and refused in one clear line."""
