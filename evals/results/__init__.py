"""The results of an evaluation: rows, tables in the paper's form, a report, and the comparison of two evaluations."""
