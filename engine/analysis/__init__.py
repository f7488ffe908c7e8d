"""Statistics of runs: outcomes, criticality, findings, paired comparison."""
