"""Evaluation of agents: a corpus of requests, an agent that carries them out with the server's tools, and its score."""
