"""The arguments of a call: reads unambiguous forms, checks them, and refuses invalid ones in one clear line."""
