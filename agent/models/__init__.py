"""Chat models: one protocol, and clients of model servers (Ollama, OpenAI-compatible servers)."""
