"""What several tests share: scenarios and runs made by hand, sessions with a server, operations that misbehave.

Importable as ``support`` because pytest's ``pythonpath`` holds the folder ``tests``.
"""
