"""Unmodified clients of other makers, each in its own environment, on a server started for them.

Keys: ``hosts_passed`` (clients that find, modify, run, compare and draw over every transport tried, by the server's
journal and workspace), ``hosts_tried``, and ``host_NAME``, a sentence for each: its version and, for each transport,
the protocol's revision or the missing step. A client that cannot be installed is listed with the reason and does not
pass.

Environments are created once, in the folder that ``--hosts-folder`` or ``PLANNERFORGE_HOSTS`` gives, otherwise in the
user's cache. ``--host`` selects clients, and ``--page`` writes the table into a page such as ``docs/hosts.md``.
"""

from .running import measure

__all__ = ["measure"]
