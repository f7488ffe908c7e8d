"""The arguments of a call: reads unambiguous forms, checks them, and refuses invalid arguments in one clear line."""
