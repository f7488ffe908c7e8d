"""The command line: what each command does, and the flags that they share."""
