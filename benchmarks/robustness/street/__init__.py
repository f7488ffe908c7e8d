"""A server on the street: strangers at its door, archives and answers of others, planner programs and kills."""
