"""The command line: the commands and the flags that they share."""
