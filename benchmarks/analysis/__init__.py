"""``make bench-analysis``: whether what an analysis says of runs is so."""
