"""Rules that check a road network. Each rule is a function decorated with ``@rule``, in the module of its subject."""
