"""Rules that check a road network: each is a function under ``@rule``, in the module of its subject."""
