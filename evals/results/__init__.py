"""The results of an evaluation: rows, tables in the paper's format, a report, and a comparison of two evaluations."""
