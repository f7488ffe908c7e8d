"""Rules that check a road network: a function under ``@rule`` each, in the module of its subject; ``check`` runs all."""
