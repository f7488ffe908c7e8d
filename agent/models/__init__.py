"""Chat models: one protocol, and the model servers that are spoken to (Ollama, OpenAI-compatible ones)."""
