"""Clients that others made, unmodified, each in an environment of its own, on the server as it is started for them.

Keys: ``hosts_passed`` (clients that find, modify, run, compare and draw by every transport that they are tried with,
as the server's journal and workspace show), ``hosts_tried``, and ``host_NAME``, a sentence for each: its version
and, by transport, the protocol's revision or what is missing. What cannot be installed is named with the reason and
does not pass.

Environments are made once, in the folder that ``--hosts-folder`` or ``PLANNERFORGE_HOSTS`` names, otherwise in the
user's cache; ``--host`` takes some clients alone, ``--page`` writes the table into a page such as ``docs/hosts.md``.
"""

from .running import measure

__all__ = ["measure"]
