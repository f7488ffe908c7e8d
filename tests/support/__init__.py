"""Shared helpers of tests: handmade scenarios and runs, sessions with a server, operations that misbehave.

Importable as ``support`` because pytest's ``pythonpath`` holds the folder ``tests``.
"""
