"""Text that tries to escape its quotes."""

HOSTILE = "</script><script>window.broken=1</script><!--{{ scripts }}{{ policy }}\u2028&lt;'\"\u202e]]>"
"""A name that would get out of its place in a page, were it put there as it is."""
