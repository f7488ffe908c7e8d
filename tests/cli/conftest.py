"""The probe tools, for commands that list or call tools."""

from support.probes import probe_tools

__all__ = ["probe_tools"]
