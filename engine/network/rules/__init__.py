"""Rules that check a road network: one function under ``@rule`` each, in the module of its subject."""
