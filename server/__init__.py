"""The application: settings, assembly, transports, the journal of calls and the command line."""
