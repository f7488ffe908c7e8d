"""What a server tells whoever runs it: the journal of calls, the log, traces and metrics where they are asked for."""
