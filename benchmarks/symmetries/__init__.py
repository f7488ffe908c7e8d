"""Laws of symmetry: what a scenario says does not depend on where it lies, how it is numbered, or how it is written.

``relations`` changes a file in a way that must not change the answers, ``answers`` asks the product, ``cases`` compares
what it says before and after, translated back. The laws, with what they cannot hold, stand in ``docs/symmetries.md``.
"""
