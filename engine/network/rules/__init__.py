"""Rules that check a road network. One rule, one file; ``registry.py`` lists them."""
