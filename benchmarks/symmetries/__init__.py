"""Laws of symmetry: a scenario's meaning does not depend on its position, its numbering, or its notation.

``relations`` changes a file in a way that must not change the answers, ``answers`` queries the product, and ``cases``
compares the answers before and after, translated back. ``docs/symmetries.md`` states the laws and their exceptions.
"""
