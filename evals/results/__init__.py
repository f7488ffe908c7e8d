"""What an evaluation leaves: rows, tables in the paper's form, a report, and two evaluations beside each other."""
