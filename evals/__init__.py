"""Evaluation of agents: a corpus of requests, an agent that fulfils them with the server's tools, and its score."""
