"""The application: settings, assembly, transports, and the journal of calls."""
